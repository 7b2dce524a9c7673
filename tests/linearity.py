"""Whether a block is linear, found from its equations."""

import casadi as ca

from tsmblocks.compiler.dependencies import call, symbolic


def is_linear(block):
    """Whether the block has inputs and all its equations are linear (or affine) in states and inputs."""
    twin, t, x, u = symbolic(block)
    if not block.inports:
        return False
    parts = [v for e in ("outputs", "derivatives", "updates") for v in call(twin, e, t, x, u).values()]
    moving = ca.vertcat(*x, *u)
    slopes = ca.jacobian(ca.vertcat(*parts), moving)
    return not any(ca.which_depends(ca.vec(slopes), moving, 1, False)) and not ca.depends_on(slopes, t)
