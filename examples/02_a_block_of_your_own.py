"""A user-defined block: a hardening spring as one class, checked as the blocks of the package are."""

import numpy as np

import tsmblocks as tsm
from tsmblocks.testing import broken_promises


@tsm.block
class HardeningSpring(tsm.Block):
    r"""A spring that grows stiffer with deflection.

    .. math:: F = k x + k_3 x^3
    """

    source = "Duffing, Erzwungene Schwingungen (1918)"
    symbol = "kx+k3x3"

    k: float = tsm.parameter(default=1.0, about="stiffness at rest", unit="N*m/rad", above=0.0)
    k3: float = tsm.parameter(default=0.5, about="hardening", unit="N*m/rad^3", at_least=0.0)

    x = tsm.Input("deflection", unit="rad")
    y = tsm.Output("torque", unit="N*m")

    def outputs(self, t, x, u):
        return dict(y=self.k * u.x + self.k3 * u.x**3)


alone = tsm.Diagram(
    title="spring", blocks={"spring": HardeningSpring()}, inputs={"x": "spring.x"}, outputs={"torque": "spring"}
)
t = np.linspace(0.0, 1.0, 1001)
run = tsm.simulate(alone, inputs={"x": (t, np.sin(2 * np.pi * t))}, step=1e-3)
print(f"largest torque {run['torque'].max():.3f} N m")
print(broken_promises(HardeningSpring()) or "all checks passed")
