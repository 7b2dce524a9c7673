"""Parameters that compensate for a large missing effect are reported as doubtful; others are not."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum
from tsmblocks.diagnosis.credibility import parameters_in_doubt


class Fitted:
    """A model that has fitted parameters."""

    def __init__(self, **values):
        self.values = values

    def parameters(self):
        return {k.replace("_", "."): v for k, v in self.values.items()}


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [
        (0.2, 100.0, ("J.gain (0.2 for 1)",)),
        (-1.0, 100.0, ("J.gain (-1 for 1)",)),
        (4.0, 100.0, ("J.gain (4 for 1)",)),
        (2.5, 100.0, ()),
        (4.0, 4.1, ("J.gain (4 for 1)",)),
        (0.2, 3.9, ()),
    ],
    ids=["small", "other sign", "large", "near", "beside twice the noise", "beside a small error"],
)
def test_far_from_the_diagram_beside_a_large_error(value, error, said):
    assert parameters_in_doubt(Fitted(J_gain=value, zero_gain=3.0), {"J.gain": 1.0, "zero.gain": 0.0}, error) == said


def test_an_inertia_that_is_fitted_without_a_large_friction():
    """The mass looked several times too large, and the verdict gave it as that of the mechanism."""
    t = np.arange(0, 10, 0.01)
    force = 3 * np.sin(2 * np.pi * 0.4 * t)
    v, y, speed = 0.0, [], []
    for f in np.repeat(force, 100):  # a stuck mass of 1 kg with dry friction of 2.5 N, in steps of 0.1 ms
        free, most = v + 1e-4 * f, 2.5e-4
        v = 0.0 if abs(free) <= most else free - np.sign(free) * most
        speed.append(v)
    y = np.cumsum(speed)[::100] * 1e-4
    drive = tsm.Diagram(
        blocks={
            "net": Sum(signs="+-"),
            "mass": Gain(gain=1.0),
            "drag": Gain(gain=0.1),
            "v": Integrator(),
            "x": Integrator(),
        },
        wires=["net -> mass -> v -> x", "v -> drag -> net.minus"],
        inputs={"f": "net.plus"},
        outputs={"x": "x"},
    )
    measured = y + 1e-5 * np.random.default_rng(0).standard_normal(len(t))
    record = tsm.Record("run", t, {"f": force, "x": measured}, {"f": "", "x": ""})
    options = dict(free=["mass.gain", "drag.gain"], effects=["offset"])
    found = tsm.diagnose(drive, {"run": record}, **options)
    assert found.verdict != "none"
    (segment,) = found.segments
    assert any(text.startswith("mass.gain (") for text in segment.in_doubt)
    assert "far from the diagram" in found.sentence
    assert "parameters_in_doubt" in found.to_json()
