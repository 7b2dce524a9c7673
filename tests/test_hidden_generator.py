"""The generator of data in which an effect is hidden: independent of the package, repeatable, and of the size asked."""

import ast
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from tests.hidden import GROUPS, MOTOR_EFFECTS, OUTSIDE, SENSOR_FAULTS, SHEATH_EFFECTS, UNEXCITED, Spec, case, cases
from tests.hidden.choose import MOTOR_SCALES, SCALES
from tests.hidden.contact import dahl, gap, iwan, soft_rate
from tests.hidden.kinds import FAMILY
from tests.hidden.motor import KD, KP, TF, run_motor
from tests.hidden.sheath import hysteresis

SLOW_NEEDS = ["tests/hidden/*.py"]  # the generator does without the package
FOLDER = Path(__file__).parent / "hidden"
ROOT = FOLDER.parent.parent
COARSE = 2e-3
"""A step at which a simulation is good enough where only its presence matters, and cheaper [s]."""


def mostly_slow(names, *quick):
    """Parameters of a test of which only some are not slow."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


def stacked(records, name):
    """One signal of all records, one after another."""
    return np.concatenate([record[name] for record in records.values()])


def effect_of(made, name="x_out"):
    """What the effect adds to a clean signal."""
    return stacked(made.clean, name) - stacked(made.without, name)


def rms(y):
    return np.sqrt(np.mean(np.square(y)))


def excess_of(made):
    """Excess at x_out, by a regression of our own."""
    change, x, y = effect_of(made), stacked(made.without, "x_in"), stacked(made.without, "x_out")
    known = np.column_stack([np.ones_like(x), x, y])
    left = change - known @ np.linalg.lstsq(known, change, rcond=None)[0]
    return np.mean(left**2) / made.floor**2


# ---- independence


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda p: p.name)
def test_modules_import_only_numpy_scipy_and_each_other(path):
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module.partition(".")[0])
    assert found <= {"__future__", "collections", "dataclasses", "zlib", "numpy", "scipy"}
    assert "import_module" not in path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_it_works_where_the_package_cannot_be_imported():
    code = (
        "import sys; sys.modules['tsmblocks'] = None; from tests.hidden import case; "
        "case('null', protocol='sine', step=2e-3); case('motor_open', effect='none', step=2e-3); "
        "case('chain', effect='none', step=2e-3); "
        "print([m for m in sys.modules if m.startswith('tsmblocks.') or m == 'casadi'])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ---- repeatability


@pytest.mark.parametrize(
    ("group", "effect"),
    [
        pytest.param("poor", "", marks=pytest.mark.slow),
        ("outside", "chaos"),
        pytest.param("motor_closed", "dead_zone", marks=pytest.mark.slow),
    ],
)
def test_same_seed_same_bytes(group, effect):
    one, same, other = (
        case(group, effect=effect, seed=seed, protocol="sine", amplitude=0.01, step=COARSE) for seed in (4, 4, 5)
    )
    assert one.effect == same.effect
    assert one.numbers == same.numbers
    assert one.numbers != other.numbers
    for name, record in one.experiments.items():
        for signal, values in record.items():
            assert values.tobytes() == same.experiments[name][signal].tobytes()


def test_company_changes_nothing():
    alone = case("single", effect="creep", seed=2, size=0.5, protocol="sine")
    crowd = cases([Spec("single", "creep", size, seed, "sine") for seed in (1, 2) for size in (0.5, 2.0)])
    assert crowd[2].numbers == pytest.approx(alone.numbers, rel=1e-9)
    assert np.allclose(stacked(crowd[2].clean, "x_out"), stacked(alone.clean, "x_out"), atol=1e-9)
    assert np.mean(stacked(crowd[2].experiments, "x_out") != stacked(alone.experiments, "x_out")) < 1e-3


def test_size_leaves_plant_and_noise_as_they_are():
    small, large = cases([Spec("single", "drift", size, 7, "sine") for size in (0.2, 5.0)])
    assert np.array_equal(stacked(small.without, "x_out"), stacked(large.without, "x_out"))
    assert np.array_equal(stacked(small.experiments, "x_in"), stacked(large.experiments, "x_in"))


def test_answers_come_in_the_order_of_the_questions():
    asked = [("null", "", 1.0, 1, "sine"), dict(group="single", effect="drift", protocol="sine"), Spec("null", seed=2)]
    assert [(m.group, m.seed) for m in cases(asked)] == [("null", 1), ("single", 0), ("null", 2)]


# ---- records


def test_a_rich_session_is_eight_records_on_one_clock():
    made = case("null", seed=1)
    records = list(made.experiments.values())
    assert len(records) == 8
    assert all(2500 <= len(r["t"]) <= 2600 for r in records)
    assert all(np.allclose(np.diff(r["t"]), 0.01) for r in records)
    assert all(15.0 < b["t"][0] - a["t"][-1] < 60.1 for a, b in pairwise(records))
    first, last = (made.clean[name]["x_in"] for name in ("sine", "sine_again"))
    assert np.array_equal(first, last)
    assert not np.array_equal(made.experiments["sine"]["x_in"], made.experiments["sine_again"]["x_in"])


@pytest.mark.parametrize(("name", "period"), [("sine", 5.0), ("odd_multisine", 10.0), ("offset_multisine", 13.0)])
def test_periodic_records_repeat_themselves(name, period):
    """After the motor has started (1 s), and the loop has forgotten where it did (a period's worth)."""
    record, n = case("null", seed=3).clean[name], round(period / 0.01)
    x, y = record["x_in"], record["x_out"]
    assert np.allclose(x[100:-n], x[100 + n :], atol=1e-6)
    assert np.allclose(y[n - 200 : -n], y[2 * n - 200 :], atol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_nulls_have_the_floor_they_state(seed):
    made = case("null", seed=seed)
    clean, v = (
        stacked(made.clean, "x_out"),
        np.concatenate([np.gradient(r["x_out"], 0.01) for r in made.clean.values()]),
    )
    seen = stacked(made.experiments, "x_out")
    expected = made.floor**2 + 0.4e-3**2 * np.mean(v**2)
    assert np.mean((seen - clean) ** 2) == pytest.approx(expected, rel=0.06)
    assert made.truth == ()
    assert np.array_equal(clean, stacked(made.without, "x_out"))
    assert np.allclose(seen / 0.05, np.round(seen / 0.05))


def test_noise_is_coloured():
    made = case("null", seed=5)
    noise = made.experiments["chirp"]["x_in"] - made.clean["chirp"]["x_in"]
    slow = [np.corrcoef(noise[:-k], noise[k:])[0, 1] for k in (2, 30)]
    assert slow[0] > 0.1
    assert abs(slow[1]) < 0.1


def test_motor_records_have_the_floor_they_state():
    made = case("motor_closed", effect="none", seed=1)
    assert made.truth == ()
    assert made.segment == ""
    assert made.base == "motor_closed"
    for name, floor in made.floor.items():
        noise = stacked(made.experiments, name) - stacked(made.clean, name)
        assert np.std(noise) == pytest.approx(floor, rel=0.05)
    assert np.array_equal(stacked(made.experiments, "r"), stacked(made.clean, "r"))


# ---- effects


def test_every_effect_of_the_catalogue_can_be_hidden():
    assert {*SHEATH_EFFECTS, *MOTOR_EFFECTS, "hysteresis"} == set(FAMILY) - {"unknown"}


@pytest.mark.parametrize("name", mostly_slow([*SHEATH_EFFECTS, *OUTSIDE], "backlash", "creep", "chaos"))
def test_each_effect_at_the_sheath_changes_the_output(name):
    group = "outside" if name in OUTSIDE else "single"
    bigger = 1.5 if SCALES[name][2] > 2.0 else 3.0
    made = case(group, effect=name, seed=1, amplitude=bigger * SCALES[name][0], protocol="paper", step=COARSE)
    assert made.truth == (("unknown",) if group == "outside" else (name,))
    assert made.families == (FAMILY[made.truth[0]],)
    assert made.segment == "sheath"
    assert made.base == "tendon_sheath_symmetric"
    assert np.array_equal(stacked(made.clean, "x_in"), stacked(made.without, "x_in"))
    assert made.numbers["excess"] == pytest.approx(excess_of(made), rel=1e-6)
    assert excess_of(made) > 0.05
    assert made.numbers["excess_refit"] <= made.numbers["excess"] * (1 + 1e-9)


@pytest.mark.parametrize("name", mostly_slow(MOTOR_EFFECTS, "backlash"))
@pytest.mark.parametrize("group", ["motor_open", "motor_closed"])
def test_each_effect_in_the_motor_changes_an_output(group, name):
    bigger = 1.3 if MOTOR_SCALES[name][2] > 2.0 else 1.0
    made = case(group, effect=name, seed=1, amplitude=bigger * MOTOR_SCALES[name][0], step=COARSE)
    assert made.truth == (name,)
    assert made.segment == "motor"
    assert ("coulomb" in made.base) == (name == "stribeck_friction")
    assert max(rms(effect_of(made, k)) / floor for k, floor in made.floor.items()) > 0.2
    assert made.numbers["excess"] > 0.01


@pytest.mark.parametrize(
    "name", mostly_slow(["backlash", "saturation", "parameter_change", "dead_time", "rate_limit"], "dead_time")
)
def test_the_excess_is_as_asked(name):
    asked = [Spec("single", name, size, seed) for size in (0.1, 3.0) for seed in (0, 1)]
    for spec, made in zip(asked, cases(asked), strict=True):
        assert excess_of(made) == pytest.approx(spec.size, rel=0.15)


@pytest.mark.slow
def test_the_excess_after_a_refit_can_be_asked_for():
    made = case("single", effect="nonlocal_memory", size=1.0, measure="refit")
    assert made.numbers["excess_refit"] == pytest.approx(1.0, rel=0.15)
    assert made.numbers["excess"] > 1.2


@pytest.mark.parametrize(
    ("group", "effect", "size"),
    [
        pytest.param("motor_open", "coulomb_friction", 1.0, marks=pytest.mark.slow),
        pytest.param("motor_closed", "dead_time", 0.3, marks=pytest.mark.slow),
        ("chain", "sheath:creep", 1.0),
    ],
)
def test_the_excess_is_as_asked_in_the_motor_and_in_the_chain(group, effect, size):
    made = case(group, effect=effect, size=size, seed=1, step=COARSE)
    assert made.numbers["excess"] == pytest.approx(size, rel=0.15)


def test_a_size_out_of_reach_ends_at_the_largest_amplitude():
    made = case("poor", effect="resonance", protocol="sine", size=1e9)
    assert made.numbers["resonance.amplitude"] == SCALES["resonance"][1]
    assert 1.0 < made.numbers["excess"] < 1e9


# ---- groups


@pytest.mark.parametrize("seeds", mostly_slow([(0,), (1, 2)], (0,)))
def test_two_effects_are_of_two_families_and_each_of_its_size(seeds):
    for made in cases([Spec("two", size=1.0, seed=seed, protocol="paper") for seed in seeds], step=COARSE):
        assert len(set(made.families)) == 2
        for name in made.truth:
            assert made.numbers[f"{name}.amplitude"] > 0.0
        assert 0.2 < excess_of(made) < 4.5


@pytest.mark.parametrize("name", mostly_slow(UNEXCITED, "dead_zone"))
def test_what_is_not_excited_does_not_show(name):
    made = case("unexcited", effect=name, seed=2)
    assert made.truth == ()
    assert made.segment == ""
    assert excess_of(made) < 0.05
    assert made.numbers[f"{name}.amplitude"] > 0.0


def test_the_sharper_loop_is_of_another_shape():
    made = case("shape", seed=1, protocol="sine")
    assert made.truth == ()
    assert 1.2 <= made.numbers["n"] <= 1.6


def test_a_loop_is_hidden_in_a_straight_line():
    made = case("base_line", seed=1, protocol="paper")
    assert made.truth == ("hysteresis",)
    assert made.base == "tendon_sheath_linear"
    x, y = stacked(made.without, "x_in"), stacked(made.without, "x_out")
    assert np.allclose(y, np.polyval(np.polyfit(x, y, 1), x))
    assert excess_of(made) == pytest.approx(1.0, rel=0.15)


def test_a_gap_in_front_of_the_sheath_is_another_one_than_behind_it():
    front = case("front", seed=1, protocol="paper", amplitude=1.5, step=COARSE)
    assert front.truth == ("backlash",)
    assert not np.any(effect_of(front, "x_in"))
    behind = case("single", effect="backlash", seed=1, protocol="paper", amplitude=1.5, step=COARSE)
    assert rms(effect_of(front)) > 0.1
    lost = [
        float(np.ptp(stacked(made.without, "x_out")) - np.ptp(stacked(made.clean, "x_out"))) for made in (front, behind)
    ]
    gain = front.numbers["c"]
    assert lost == pytest.approx([2 * 1.5 * gain, 2 * 1.5], rel=0.15)


@pytest.mark.parametrize("name", mostly_slow(SENSOR_FAULTS, "parameter_change"))
def test_a_fault_of_the_encoder_shows_on_both_sides_of_it(name):
    made = case("sensor", effect=name, seed=1, amplitude=0.05 if name == "parameter_change" else 0.5, step=COARSE)
    assert made.truth == (name,)
    assert made.segment == "sensor"
    assert made.numbers["excess_motor"] > 0.1
    assert made.numbers["excess_sheath"] > 0.1


@pytest.mark.slow
def test_a_chain_leaves_what_is_before_the_effect_as_it_was():
    sheath = case("chain", effect="sheath:backlash", seed=1, amplitude=0.3, step=COARSE)
    assert sheath.segment == "sheath"
    assert not np.any(effect_of(sheath, "x_in"))
    assert not np.any(effect_of(sheath, "u"))
    assert rms(effect_of(sheath)) > 0.01
    motor = case("chain", effect="motor:load_offset", seed=1, amplitude=0.1, step=COARSE)
    assert motor.segment == "motor"
    assert rms(effect_of(motor, "u")) > 0.01


@pytest.mark.parametrize("group", mostly_slow(GROUPS, "null", "single", "outside", "shape", "base_line"))
def test_every_group_chooses_by_seed(group):
    made = case(group, seed=11, protocol="sine", amplitude=0.02, step=COARSE)
    assert made.group == group
    assert made.seed == 11
    assert len(made.families) == len(made.truth)


def test_a_wrong_specification_is_refused():
    with pytest.raises(ValueError, match="groups are null, single"):
        case("nul")
    with pytest.raises(ValueError, match="no effect backlsh in group single, only backlash"):
        case("single", effect="backlsh")
    with pytest.raises(ValueError, match="no effect drift in group null"):
        case("null", effect="drift")


# ---- accuracy


@pytest.mark.parametrize(
    ("group", "name", "amplitude"),
    [
        ("null", "", None),
        pytest.param("single", "backlash", 0.3, marks=pytest.mark.slow),
        pytest.param("single", "nonlocal_memory", 0.1, marks=pytest.mark.slow),
        ("shape", "", None),
        pytest.param("single", "rate_limit", 1 / 100, marks=pytest.mark.slow),
        pytest.param("single", "resonance", 0.3, marks=pytest.mark.slow),
        pytest.param("outside", "telegraph", 0.1, marks=pytest.mark.slow),
        pytest.param("motor_closed", "coulomb_friction", 0.05, marks=pytest.mark.slow),
        pytest.param("motor_open", "coulomb_friction", 0.02, marks=pytest.mark.slow),
    ],
)
def test_half_the_step_gives_the_same(group, name, amplitude):
    coarse, fine = (case(group, effect=name, amplitude=amplitude, seed=3, step=step) for step in (1e-3, 5e-4))
    floors = coarse.floor if isinstance(coarse.floor, dict) else dict(x_out=coarse.floor)
    for signal, floor in floors.items():
        change = stacked(coarse.clean, signal) - stacked(fine.clean, signal)
        assert np.sqrt(np.mean(change**2)) < 0.025 * floor


@pytest.mark.parametrize("n", [1.0, 1.4])
def test_the_loop_obeys_its_differential_equation(n):
    plant = dict(A=-1.05, beta=2.9, gamma=-1.4, n=n)
    t = np.arange(6001) * 1e-3
    x = 40.0 * np.sin(1.3 * t) + 9.0 * np.sin(4.1 * t)
    z = hysteresis(x[:, None], np.array([0.1]), plant)[:, 0]

    def rate(at, z):
        v = np.deg2rad(52.0 * np.cos(1.3 * at) + 36.9 * np.cos(4.1 * at))
        return plant["A"] * v - abs(z) ** (n - 1) * (plant["beta"] * abs(v) * z + plant["gamma"] * v * abs(z))

    exact = solve_ivp(rate, (0.0, 6.0), [0.1], t_eval=t, rtol=1e-9, atol=1e-11, max_step=2e-3).y[0]
    assert np.abs(z - exact).max() < 2e-5


def test_the_position_loop_is_the_linear_one_where_nothing_saturates():
    step, motor = 2e-4, dict(K=np.array([1.9]), tau=np.array([0.021]))
    half = np.arange(2 * 5000 + 1) * step / 2
    reference = 0.2 * np.sin(7.0 * half) * np.minimum(half / 0.3, 1.0)
    u, x, _ = run_motor(reference[:, None], np.zeros(1), motor, step, 1)
    pd = np.array([KP * TF + KD, KP])
    plant = np.polymul([TF, 1.0], [0.021, 1.0, 0.0])
    closed = np.polyadd(plant, 1.9 * pd)
    _, exact, _ = lsim((1.9 * pd, closed), reference, half)
    _, effort, _ = lsim((np.polymul(pd, [0.021, 1.0, 0.0]), closed), reference, half)
    assert np.abs(x[:, 0] - exact[::2]).max() < 5e-6
    assert np.abs(u[:, 0] - effort[::2]).max() < 5e-4


def test_dry_friction_holds_and_slides_as_it_should():
    """From rest under 0.3 V against 0.5 V nothing moves; under 1 V the speed is that of 0.5 V."""
    motor = dict(K=np.array([2.0, 2.0]), tau=np.array([0.02, 0.02]), coulomb=np.array([0.5, 0.5]))
    voltage = np.tile([0.3, 1.0], (10001, 1))
    _, x, _ = run_motor(voltage, np.zeros(2), motor, 2e-4, 1, closed=False)
    t = np.arange(len(x)) * 2e-4
    assert not np.any(x[:, 0])
    assert np.abs(x[:, 1] - 1.0 * (t - 0.02 * -np.expm1(-t / 0.02))).max() < 2e-5


def test_elements_tend_to_what_they_should():
    u = np.concatenate([np.linspace(0, 10, 2001), np.linspace(10, -10, 4001)])[:, None]
    y = gap(u, np.array([1.0]), np.array([0.15]), np.array([0.0]))[:, 0]
    assert y[2000] == pytest.approx(10.0 - 1.15, abs=1e-6)
    assert y[-1] == pytest.approx(-10.0 + 1.15, abs=1e-6)
    assert np.ptp(y[2000:2390]) == 0.0, "it rests within the free travel of 2 (1.15 less the closing of 0.3)"
    assert iwan(u, 2.0, 0.0)[2000, 0] == pytest.approx(2.0, rel=1e-3)
    assert dahl(u, 2.0, 0.0)[-1, 0] == pytest.approx(-2.0, rel=0.05)
    slow = soft_rate(u, np.array([100.0]), 1e-3)[:, 0]
    assert np.abs(slow - u[:, 0])[:2000].max() < 1e-4
    fast = soft_rate(u * 100.0, np.array([100.0]), 1e-3)[:, 0]
    assert np.abs(np.diff(fast)).max() <= 0.1 * (1 + 1e-9)
