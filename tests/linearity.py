"""Whether a block is linear, found from its equations."""

import casadi as ca

from tsmblocks.compiler.dependencies import symbolic


def is_linear(block):
    """Whether the block has inputs and all its equations are linear (or affine) in states and inputs."""
    made = symbolic(block)
    if not block.inports:
        return False
    moving = ca.vertcat(*made.x, *made.u)
    slopes = ca.jacobian(ca.vertcat(*made.results.values()), moving)
    return not any(ca.which_depends(ca.vec(slopes), moving, 1, False)) and not ca.depends_on(slopes, made.t)
