"""Gains in a row may change their signs together: a diagnosis begins with those of the diagram."""

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Lag
from tsmblocks.diagnosis.model import ModelSettings, calibrate, optimized
from tsmblocks.diagnosis.signs import with_signs

T = np.arange(0.0, 8.0, 0.01)


def chain(first=2.0, second=3.0):
    return tsm.Diagram(
        title="chain",
        blocks={"first": Gain(gain=first), "lag": Lag(time_constant=0.2), "second": Gain(gain=second)},
        wires=["first -> lag -> second"],
        inputs={"u": tsm.Inlet(["first"], unit="mm")},
        outputs={"y": "second"},
    )


def model(polarity=1.0):
    """A fit to recordings of a chain, whose sensor may have the other polarity."""
    u = np.sin(2 * T) + 0.3 * np.sin(7 * T)
    y = polarity * tsm.simulate(chain(), inputs={"u": (T, u)}, step=0.01)["y"]
    y = y + 0.01 * np.random.default_rng(0).standard_normal(len(T))
    record = tsm.Record("run", T, {"u": u, "y": y}, {"u": "mm", "y": "mm"})
    return calibrate(chain(), {"run": record}, ModelSettings(None, {"y": 0.01}, ("y",), False))


def mirrored(one):
    """The same fit with both gains of the other sign."""
    start = one.theta.copy()
    for k, item in enumerate(one.problem.unknowns.items):
        if item.parameter.endswith(".gain"):
            start[k] *= -1
    return optimized(one.problem, one.setup, start)


def gains(one):
    return [one.values[f"{name}.gain"] for name in ("first", "second")]


def test_two_gains_that_changed_their_signs_together_get_those_of_the_diagram():
    found = mirrored(model())
    assert max(gains(found)) < 0
    again = with_signs(found, chain().parameters)
    assert min(gains(again)) > 0
    assert again.mean_square < 1.01 * found.mean_square


def test_a_gain_whose_sign_the_outputs_show_keeps_it():
    found = model(polarity=-1.0)
    assert np.prod(gains(found)) < 0
    assert np.prod(gains(with_signs(found, chain().parameters))) < 0


def test_a_model_with_the_signs_of_the_diagram_stays():
    found = model()
    assert with_signs(found, chain().parameters) is found
