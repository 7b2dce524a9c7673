"""Evidence of a model error: what is predicted on held-out data, against noise of any spectrum."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Play, Ripple, Stretch
from tsmblocks.diagnosis import determined
from tsmblocks.diagnosis.determined import is_determined
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.evidence import evidence
from tsmblocks.diagnosis.model import ModelSettings, calibrate
from tsmblocks.diagnosis.noise_filtering import filters_noise
from tsmblocks.diagnosis.surrogates import rolled, slow_noise, stretches_of

DEG = np.pi / 180
SIGMA = 0.1 * DEG
STEP = 0.02


def motion(seed, seconds=24.0):
    """A sum of sines of some 40 deg, which never repeats."""
    draw = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, STEP)
    f, phase = draw.uniform(0.1, 0.8, 4), draw.uniform(0, 2 * np.pi, 4)
    return t, 15 * DEG * np.sin(2 * np.pi * np.outer(f, t) + phase[:, None]).sum(axis=0)


def noise(kind, n, draw):
    """Noise of unit rms."""
    if kind == "white":
        return draw.standard_normal(n)
    if kind == "heavy":
        return draw.standard_t(3, n) / np.sqrt(3)
    tau = {"slow": 0.3, "very slow": 2.0}[kind]
    a = np.exp(-STEP / tau)
    slow = lfilter([np.sqrt(1 - a * a)], [1, -a], draw.standard_normal(n + 2000))[2000:]
    return np.sqrt(0.5) * (slow + draw.standard_normal(n))


def recordings(kind, seed, worn=lambda x: 0.0 * x, count=4):
    """A gain of 0.9 with what is hidden and noise."""
    draw, result = np.random.default_rng(seed), {}
    for k in range(count):
        t, x = motion(100 * seed + k)
        t = t + 30.0 * k  # one clock
        y = 0.9 * x + worn(x) + SIGMA * noise(kind, len(t), draw)
        result[f"run {k}"] = tsm.Record(f"run {k}", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return result


def fitted(records, model="tendon_sheath_linear"):
    """A model, fitted."""
    settings = ModelSettings(None, {"x_out": SIGMA}, ("x_out",))
    return calibrate(tsm.load(model) if isinstance(model, str) else model, records, settings)


def gap(x):
    """What a play of half width 0.4 deg takes away."""
    middle, y = x[0], []
    for u in x:
        middle = min(max(middle, u - 0.4 * DEG), u + 0.4 * DEG)
        y.append(middle)
    return np.array(y) - x


def curve(x):
    """A characteristic that no block has."""
    return 0.15 * DEG * np.sin(x / (5 * DEG)) * np.tanh(x / (10 * DEG))


@pytest.mark.parametrize("kind", ["white", "heavy", "slow", "very slow"])
@pytest.mark.parametrize("seed", range(4))
def test_noise_of_any_spectrum_is_no_model_error(kind, seed):
    found = evidence(fitted(recordings(kind, seed)), 0)
    assert not found.material
    assert found.share < 0.02


@pytest.mark.parametrize("kind", ["white", "slow"])
def test_a_function_of_the_motion_is_a_model_error_of_its_true_share(kind):
    records = recordings(kind, 7, curve)
    hidden = np.concatenate([curve(r["x_in"]) for r in records.values()])
    true = np.var(hidden) / (np.var(hidden) + SIGMA**2)
    found = evidence(fitted(records), 0)
    assert found.material
    assert found.p <= 0.005
    assert 0.6 * true < found.share < 1.1 * true
    assert found.rest == pytest.approx(1.0, rel=0.25)


@given(st.integers(40, 400), st.integers(0, 10_000))
def test_surrogates_keep_the_squares(n, seed):
    draw = np.random.default_rng(seed)
    r = draw.standard_normal(n).cumsum()
    np.testing.assert_allclose((rolled(r, 3, draw) ** 2).sum(axis=0), np.sum(r**2), rtol=1e-9)
    for one, noise in zip((r, 5 * r), slow_noise([r, 5 * r], 0.01, 3, draw), strict=True):
        np.testing.assert_allclose(noise.var(axis=0), one.var(), rtol=1e-9)


def slopes(parts):
    """Sums of squares (draws,) that straight lines explain in parts of several experiments (n, draws)."""
    return sum((np.linspace(-1, 1, len(x)) @ (x - x.mean(axis=0))) ** 2 for x in parts)


def first_order(draw, n, time):
    a = np.exp(-0.05 / time)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], draw.standard_normal(n), zi=[a * draw.standard_normal()])[0]


@pytest.mark.parametrize("time", [0.001, 0.3, 1.5, 3.0])
def test_noise_so_slow_that_a_recording_does_not_return_is_no_drift(time):
    """Surrogates have slopes as large as the noise has, whatever its correlation time; in 10 s here."""
    draw, above = np.random.default_rng(2), 0
    for _ in range(20):
        parts = [first_order(draw, 200, time) for _ in range(4)]
        parts = [r - r.mean() for r in parts]
        above += slopes(parts) > np.quantile(slopes(slow_noise(parts, 0.05, 99, draw)), 0.95)
    assert above <= 3


def test_a_drift_stands_out_from_fast_noise():
    draw, above = np.random.default_rng(2), 0
    for _ in range(10):
        parts = [draw.standard_normal(400) + 1.2 * np.linspace(-1, 1, 400) for _ in range(3)]
        above += slopes(parts) > np.quantile(slopes(slow_noise(parts, 0.05, 99, draw)), 0.95)
    assert above >= 8


@given(st.lists(st.integers(100, 3000), min_size=1, max_size=12))
def test_stretches_cover_each_experiment_once(lengths):
    for n, parts in zip(lengths, stretches_of(lengths), strict=True):
        assert [k for part in parts for k in range(part.start, part.stop)] == list(range(n))
        assert len(parts) % 5 == 0


@pytest.mark.parametrize("kind", ["white", "slow"])
def test_an_effect_is_determined_where_its_interval_excludes_none(kind):
    """An offset behind the model's own offset is not identifiable, and a ripple that is not there is not determined."""
    rippled = tsm.load("tendon_sheath_linear").insert("ripple", Ripple(cycles=12.0, sine=0.001), before="x_out")
    some = SimpleNamespace(free=("ripple.sine", "ripple.cosine"))
    nulls = {"ripple.sine": 0.0, "ripple.cosine": 0.0}
    noise = recordings(kind, 2)
    assert not is_determined(fitted(noise, rippled), some, nulls, fitted(noise))
    real = recordings(kind, 2, lambda x: 0.1 * DEG * np.sin(12.0 * x))
    base = fitted(real)
    assert is_determined(fitted(real, rippled), some, nulls, base)
    twice = tsm.load("tendon_sheath_linear").insert("again", Bias(bias=0.1), before="x_out")
    offset = SimpleNamespace(free=("again.bias",))
    assert not is_determined(fitted(real, twice), offset, {"again.bias": 0.0}, base)
    assert is_determined(fitted(real, twice), offset, {}, base)  # nothing to compare with


@pytest.mark.parametrize(("spread", "known"), [(4.0, False), (1.0, True)])
def test_an_effect_of_which_only_a_combination_is_known_is_not_determined(spread, known, monkeypatch):
    """Its sum is known to 0.3 and the sizes themselves to ``spread``: 3 ± 8 is no size to report."""
    covariance = spread**2 * np.array([[1, -1], [-1, 1]]) + 0.05
    estimate = SimpleNamespace(covariance=covariance, freedom=np.array([500.0, 500.0]))
    monkeypatch.setattr(determined, "uncertainty_of_effects", lambda *_: estimate)
    names = ("loop.width", "loop.gain")
    items = tuple(SimpleNamespace(parameter=name) for name in names)
    problem = SimpleNamespace(unknowns=SimpleNamespace(items=items))
    model = SimpleNamespace(theta=np.array([3.0, 3.0]), r=np.zeros(500), problem=problem)
    assert is_determined(model, SimpleNamespace(free=names), dict.fromkeys(names, 0.0), None) == known


@pytest.mark.parametrize(("share", "remains"), [(0.03, False), (0.2, True)])
def test_a_small_effect_that_was_not_accepted_makes_nothing_unknown(share, remains):
    """Slow noise lets a candidate gain a few per cent of the residual, significantly by its t-statistic alone."""
    rejected = SimpleNamespace(loss=(1 - share) * 11.0)
    part = SimpleNamespace(
        count=0,
        losses=[11.0],
        rounds=[SimpleNamespace(verdict=SimpleNamespace(named=rejected))],
        left=SimpleNamespace(material=False, predicted=0.0),
        search=SimpleNamespace(noise=SimpleNamespace(low=1.0)),
        _is_within_given_noise=False,
        is_noise_of_inputs=False,
    )
    part.rejected_share = DiagnosedPart.rejected_share.fget(part)
    assert part.rejected_share == pytest.approx(share)
    assert DiagnosedPart.leaves_predictable.fget(part) == remains


def test_a_harmonic_of_the_motion_is_no_disturbance_and_another_frequency_is():
    t = np.arange(0.0, 60.0, STEP)
    x = 20 * DEG * np.sin(2 * np.pi * 0.4 * t)
    draw = np.random.default_rng(0)
    for f, own in ((1.2, False), (1.37, True)):
        y = 0.9 * x + 3 * SIGMA * np.sin(2 * np.pi * f * t + 0.4) + SIGMA * draw.standard_normal(len(t))
        record = tsm.Record("sine", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
        found = tsm.diagnose(tsm.load("tendon_sheath_linear"), record, effects=["periodic_disturbance", "jump"])
        assert [e.name for e in found.effects] == ["periodic_disturbance"] * own
        assert found.verdict == ("named" if own else "unknown")


def test_a_gap_in_front_of_the_model_as_small_as_the_noise_of_its_input_may_only_filter_it():
    half_width = 0.2 * DEG
    worn = tsm.load("tendon_sheath_linear").insert("gap", Play(half_width=half_width), after="x_in")
    model = fitted(recordings("white", 7, gap), worn)
    width = model.values["gap.half_width"]
    loop = SimpleNamespace(family="loop", contains=())
    some = SimpleNamespace(effect=loop, block="gap", point=SimpleNamespace(place="input", signal="x_in"))
    assert filters_noise(model, some, {"x_in": width})
    some.effect = SimpleNamespace(family="friction", contains=("hysteresis",))  # it narrows with the speed
    assert filters_noise(model, some, {"x_in": width})
    some.effect = SimpleNamespace(family="friction", contains=())
    assert not filters_noise(model, some, {"x_in": width})
    some.effect = loop
    assert not filters_noise(model, some, {"x_in": 0.3 * width})
    assert not filters_noise(model, some, {"x_in": 0.0})
    assert not filters_noise(model, some, {})
    behind = SimpleNamespace(effect=loop, block="gap", point=SimpleNamespace(place="output", signal="x_out"))
    assert not filters_noise(model, behind, {"x_in": width})


def without_clock(records, change):
    """Recordings that all begin at zero, each with a change of its output of its own: ``change(k, t, y)``."""
    result = {}
    for k, (name, one) in enumerate(records.items()):
        t = one.t - one.t[0]
        result[name] = tsm.Record(name, t, {"x_in": one["x_in"], "x_out": change(k, t, one["x_out"])}, one.units)
    return result


def test_a_disturbance_has_a_phase_of_its_own_where_recordings_share_no_clock():
    phase = (0.3, 2.0, 3.9, 5.5)
    records = without_clock(recordings("white", 5), lambda k, t, y: y + SIGMA * np.sin(2 * np.pi * 1.37 * t + phase[k]))
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["periodic_disturbance", "jump"])
    (one,) = found.effects
    assert one.name == "periodic_disturbance"
    assert next(iter(one.parameters)) == "frequency"
    assert one.parameters["frequency"].value == pytest.approx(1.37, abs=0.01)
    for k, name in enumerate(records):
        size = np.hypot(one.parameters[f"cosine@{name}"].value, one.parameters[f"sine@{name}"].value)
        angle = np.arctan2(one.parameters[f"cosine@{name}"].value, one.parameters[f"sine@{name}"].value)
        assert size == pytest.approx(SIGMA, rel=0.2)
        assert np.cos(angle - phase[k]) > 0.95


def test_a_change_in_one_recording_alone_is_named_with_its_size_there():
    records = without_clock(recordings("white", 6), lambda k, t, y: y * np.where((k == 1) & (t > 9.3), 1.02, 1.0))
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["parameter_change", "jump", "drift"])
    (one,) = found.effects
    assert one.name == "parameter_change"
    assert one.parameters["time@run 1"].value == pytest.approx(9.3, abs=0.5)
    sizes = {name: one.parameters[f"change@{name}"] for name in records}
    assert sizes["run 1"].low < 0.02 < sizes["run 1"].high
    assert all(abs(q.value) < 0.005 for name, q in sizes.items() if name != "run 1")


def test_a_disturbance_at_a_harmonic_that_no_function_of_the_motion_predicts_is_one():
    """The motion has lines at 0.4 Hz; breathing at 1.2 Hz drifts in phase against it."""
    t = np.arange(0.0, 60.0, STEP)
    x = 20 * DEG * np.sin(2 * np.pi * 0.4 * t)
    draw, records = np.random.default_rng(0), {}
    for k in range(4):
        y = 0.9 * x + SIGMA * (3 * np.sin(2 * np.pi * 1.2 * t + 1.6 * k) + draw.standard_normal(len(t)))
        records[f"r{k}"] = tsm.Record(f"r{k}", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["periodic_disturbance", "jump"])
    assert [e.name for e in found.effects] == ["periodic_disturbance"]


def test_slow_noise_is_none_and_says_what_would_tell():
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), recordings("slow", 3), effects=["backlash", "jump", "drift"])
    assert found.verdict == "none"
    text = str(found)
    assert "are indistinguishable" in " ".join(text.split())
    assert "Record twice with the same inputs" in " ".join(text.split())


def test_what_is_predicted_and_in_no_catalogue_is_unknown_with_its_shape():
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), recordings("slow", 3, curve), effects=["jump", "dead_time"])
    segment = found.worst
    assert found.verdict == "unknown"
    assert not found.complete
    assert not segment.irregular
    assert 0.2 < segment.predictable[0] < 0.8
    assert "is predicted from the recorded signals on held-out data" in found.sentence
    assert "tsmblocks compare" in str(found)
    assert found.to_dict()["complete"] is False


def test_what_nothing_predicts_is_irregular_where_the_noise_is_known():
    records = recordings("slow", 3)
    model = tsm.load("tendon_sheath_linear")
    found = tsm.diagnose(model, records, noise_floor=0.5 * SIGMA, effects=["jump", "dead_time"])
    assert found.verdict == "unknown"
    assert found.worst.irregular
    assert "irregular" in found.sentence


def test_what_is_named_beside_an_error_of_another_kind_is_incomplete():
    def worn(x):
        return gap(x) + 2 * curve(x)

    model = tsm.load("tendon_sheath_linear")
    found = tsm.diagnose(model, recordings("slow", 4, worn), effects=["backlash", "jump"])
    if found.verdict == "named":
        assert not found.complete
        assert found.sentence.startswith("The named effects do not explain the whole residual. ")
    else:
        assert found.verdict == "unknown"


@pytest.mark.parametrize("kind", ["white", "slow"])
def test_a_jump_of_one_and_a_half_times_its_detection_limit_is_named(kind):
    """The limit counts the model error that is left: it is far above that of the noise alone."""
    records, model, effects = recordings(kind, 5, curve), tsm.load("tendon_sheath_linear"), ["jump", "backlash"]
    first = tsm.diagnose(model, records, effects=effects)
    assert first.verdict != "named"
    limit = {m.name: m.value for m in first.worst.limits}["jump"]
    jumped = {k: r.with_signal("x_out", r["x_out"] + 1.5 * limit * (r.t > 71.0)) for k, r in records.items()}
    found = tsm.diagnose(model, jumped, effects=effects)
    assert [e.name for e in found.effects] == ["jump"]


def test_a_load_that_steps_in_one_recording_of_a_motor_is_named_at_its_drive():
    """Each recording begins at zero; in the second one a load of 4 mV acts from 6 s on."""
    model, records = tsm.load("motor_linear"), {}
    draw, t = np.random.default_rng(3), np.arange(0.0, 12.0, 0.02)
    for k in range(3):
        low, high = draw.uniform(0.2, 0.5), draw.uniform(0.8, 1.4)
        drive = 3.0 * np.sin(2 * np.pi * low * t) + 2.0 * np.sin(2 * np.pi * high * t)
        load = np.where((t > 6.0) & (k == 1), 0.004, 0.0)
        y = tsm.simulate(model, inputs={"u": (t, drive - load)}, stop=t[-1], step=0.02, hold="cubic")["x"]
        y += 0.5 * DEG * draw.standard_normal(len(t))
        records[f"r{k}"] = tsm.Record(f"r{k}", t, {"u": drive, "x": y}, {"u": "V", "x": "rad"})
    found = tsm.diagnose(model, records, effects=["jump", "coulomb_friction", "load_offset"])
    (one,) = found.effects
    assert (one.name, one.words) == ("jump", "a step of the load")
    assert one.parameters["time@r1"].value == pytest.approx(6.0, abs=0.5)
    assert one.parameters["size@r1"].low < -0.004 < one.parameters["size@r1"].high


@pytest.mark.parametrize("teeth", [17, 24])
def test_cogging_of_many_teeth_is_named(teeth):
    """Between two trial values far apart the search ended elsewhere, and a drift was named; by SciPy at 1e-9."""
    from scipy.integrate import solve_ivp

    model, records, draw, t = tsm.load("motor_linear"), {}, np.random.default_rng(8), np.arange(0.0, 15.0, 0.02)
    gain, lag = (model.parameters[f"motor.{name}"] for name in ("K", "tau"))
    for k in range(3):
        f, phase = draw.uniform(0.15, 0.9, 3), draw.uniform(0, 6, 3)

        def drive(now, f=f, phase=phase):
            return (
                1.2 / gain * (2 * np.pi * f * np.sin(2 * np.pi * f * np.asarray(now)[..., None] + phase)).sum(axis=-1)
            )

        def slope(now, state, drive=drive):
            force = drive(now) - 0.02 * np.sin(teeth * state[0] + 1.0)
            return [state[1], (gain * force - state[1]) / lag]

        x = solve_ivp(slope, (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=0.01).y[0]
        noisy = x + 0.003 * draw.standard_normal(len(t))
        records[f"r{k}"] = tsm.Record(f"r{k}", t, {"u": drive(t), "x": noisy}, {"u": "V", "x": "rad"})
    found = tsm.diagnose(model, records, effects=["position_ripple", "drift", "jump", "coulomb_friction"])
    (one,) = found.effects
    assert one.name == "position_ripple"
    assert one.parameters["force.cycles"].value == pytest.approx(teeth, rel=0.01)


def test_a_drift_has_a_rate_of_its_own_where_recordings_share_no_clock():
    rates = (0.02, -0.03, 0.0, 0.05)  # deg/s
    records = without_clock(recordings("white", 8), lambda k, t, y: y + rates[k] * DEG * t)
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["drift", "jump", "parameter_change"])
    (one,) = found.effects
    assert one.name == "drift"
    for name, rate in zip(records, rates, strict=True):
        curve = one.parameters[f"curve@{name}"].value
        middle = records[name].t.mean() - records[name].t[0]
        assert one.parameters[f"rate@{name}"].value + 2 * curve * middle == pytest.approx(rate * DEG, abs=0.004 * DEG)


def test_a_loop_that_changes_in_one_recording_alone_has_sizes_of_its_own():
    """Each recording begins at zero; in the second one the sheath loses 2 deg more from 20 s on."""
    loop = tsm.Diagram(blocks={"loop": Stretch(half_width=2 * DEG, distance=2 * DEG)}, inputs={"u": "loop"})

    def changed(k, t, y):
        lost = tsm.simulate(loop, inputs={"u": (t, y)}, stop=t[-1], step=t[1] - t[0], hold="cubic")["loop.y"]
        return np.where((k == 1) & (t > 20.0), lost, y)

    records = without_clock(recordings("white", 8), changed)
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["parameter_change", "jump", "hysteresis"])
    (one,) = found.effects
    assert one.name == "parameter_change"
    sizes = [abs(size.value) for name, size in one.parameters.items() if name.rpartition(".")[2].startswith("change@")]
    assert [size > 1.0 * DEG for size in sizes] == [False, True, False, False]
