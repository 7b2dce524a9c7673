"""Effects at other places, with other centres, and changes that come back: named as what they are."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import tsmblocks as tsm
from tsmblocks.blocks import Bias, FirstOrderLag, Lag, Play, SoftDeadZone, Stretch

STEP = 0.01
T = np.arange(0.0, 15.0, STEP)


def model(**first):
    """A block by its name, and an offset behind it."""
    (name,) = first
    return tsm.Diagram(
        title="axis",
        blocks={**first, "zero": Bias()},
        wires=[f"{name} -> zero"],
        inputs={"u": tsm.Inlet([name], unit="mm")},
        outputs={"y": "zero"},
    )


PLANT, PLAY = model(plant=Lag(time_constant=0.15)), model(play=Play(half_width=0.15))


def motion(seed, reach=4.0):
    """A smooth random motion."""
    rng = np.random.default_rng(seed)
    x = np.convolve(rng.standard_normal(len(T) + 120).cumsum(), np.hanning(80), "same")[60:-60]
    return reach * (x - x.mean()) / np.abs(x - x.mean()).max()


def recordings(models, noise=0.02):
    """One recording of each model, a diagram or a function of the motion."""
    made = []
    for k, model in enumerate(models):
        u, rng = motion(k), np.random.default_rng(50 + k)
        y = model(u) if callable(model) else tsm.simulate(model, inputs={"u": (T, u)}, step=STEP)["y"]
        made.append(
            tsm.Record(f"run {k}", T, {"u": u, "y": y + noise * rng.standard_normal(len(T))}, {"u": "mm", "y": "mm"})
        )
    return made


def test_a_narrow_dead_zone_far_from_the_middle():
    true = PLANT.insert("zone", SoftDeadZone(half_width=0.06, centre=-1.7, softness=0.02), after="zero.y")
    tried = ["dead_zone", "odd_nonlinearity", "even_nonlinearity", "position_ripple"]
    (named,) = tsm.diagnose(PLANT, recordings([true, true]), effects=tried).effects
    assert named.name == "dead_zone"
    width, middle = named.sizes["width"], named.sizes["middle"]
    assert width.low < 0.12 < width.high
    assert middle.low < -1.7 < middle.high


def test_hysteresis_in_front_of_the_model_is_placed_there():
    true = PLANT.insert("friction", Stretch(half_width=0.15, distance=0.3), before="plant.u")
    tried = ["hysteresis", "backlash", "nonlocal_memory", "first_order_lag"]
    (named,) = tsm.diagnose(PLANT, recordings([true, true]), effects=tried).effects
    assert (named.name, named.wire) == ("hysteresis", "u -> plant.u")
    width = named.sizes["loop width"]
    assert width.low < 0.3 < width.high


def test_a_rate_limit_in_front_of_the_model_is_placed_there():
    """The drive follows the command no faster than 2.5 mm/s: stepped with the samples, which no block does."""

    def limited(u):
        drive = [u[0]]
        for wanted in u[1:]:
            drive.append(drive[-1] + min(max(wanted - drive[-1], -2.5 * STEP), 2.5 * STEP))
        run = tsm.simulate(PLANT, inputs={"u": (T, np.array(drive))}, step=STEP)
        return run["y"]

    tried = ["rate_limit", "saturation", "rate_dependence", "first_order_lag"]
    (named,) = tsm.diagnose(PLANT, recordings([limited, limited]), effects=tried).effects
    assert (named.name, named.wire) == ("rate_limit", "u -> plant.u")
    assert named.sizes["fastest rise"].low < 2.5 < named.sizes["fastest rise"].high


@pytest.mark.parametrize(("unit", "wires"), [("mm", {"u -> plant.u", "zero.y -> y"}), ("A", {"zero.y -> y"})])
def test_a_ripple_is_looked_for_along_motions(unit, wires):
    """A motor turns: its position may ripple. The current that drives it does not move along anything."""
    u = motion(0)
    y = tsm.simulate(PLANT, inputs={"u": (T, u)}, step=STEP)["y"] + 0.05 * np.sin(9.0 * u)
    record = tsm.Record("run", T, {"u": u, "y": y}, {"u": unit, "y": "mm"})
    plant = model(plant=FirstOrderLag(time_constant=0.15)).rewire(inputs={"u": tsm.Inlet(["plant"], unit=unit)})
    (part,) = tsm.diagnose(plant, record, effects=["position_ripple"]).segments
    assert {one.wire for one in part.ranking if one.round == 1} == wires


def test_a_change_in_every_recording_that_explains_the_whole_error_is_named():
    def changed(u):
        made, value = [], u[0]
        for k, x in enumerate(u):
            half = 0.15 if k < 0.6 * len(u) else 0.21
            value = min(max(value, x - half), x + half)
            made.append(value)
        return np.array(made)

    (named,) = tsm.diagnose(PLAY, recordings([changed] * 4), effects=["parameter_change", "jump", "drift"]).effects
    assert named.name == "parameter_change"
    widths = [size for name, size in named.sizes.items() if name.startswith("change of the loop's width")]
    assert any(size.low < 0.12 < size.high for size in widths)


@pytest.mark.parametrize("own", [0.015, 0.1])
def test_time_constants_that_may_be_exchanged_are_said_to_be(own):
    """Which of two lags in series is the motor's depends on where the fit of the base began."""
    num, den, _ = cont2discrete(([3.0], np.polymul([0.1, 1], [0.015, 1])), 0.005)
    rng, t, made = np.random.default_rng(1), np.arange(0, 10, 0.005), []
    for k in range(2):
        u = 8 * np.repeat(rng.uniform(-1, 1, 50), 40)
        y = lfilter(num[0], den, u) + 0.05 * rng.standard_normal(len(t))
        made.append(tsm.Record(f"run {k}", t, {"u": u, "y": y}, {"u": "V", "y": "rad/s"}))
    motor = tsm.Diagram(
        title="motor",
        blocks={"motor": FirstOrderLag(gain=2.5, time_constant=own)},
        inputs={"u": tsm.Inlet(["motor"], unit="V")},
        outputs={"y": "motor"},
    )
    found = tsm.diagnose(motor, made, effects=["first_order_lag", "dead_time"])
    assert [e.name for e in found.effects] == ["first_order_lag"]
    (note,) = [n for n in found.notes if "exchanged" in n]
    assert "motor.time_constant" in note
    assert "first_order_lag.time_constant" in note


def test_one_time_constant_cannot_be_exchanged():
    true = PLANT.insert("friction", Stretch(half_width=0.15, distance=0.3), before="plant.u")
    found = tsm.diagnose(PLANT, recordings([true]), effects=["hysteresis"])
    assert not [n for n in found.notes if "exchanged" in n]
