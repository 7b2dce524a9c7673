"""Every example runs from top to bottom, without warnings, and prints what it answers."""

import re
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import tsmblocks as tsm
from tsmblocks.model.block import REGISTRY
from tsmblocks.testing import broken_promises

SLOW_NEEDS = ["optimal", "fitting", "diagrams/*", "examples/15_*", "examples/19_*"]
FOLDER = Path(__file__).parents[1] / "examples"
PLANNED = "15_beyond_the_paper"
MOST_LINES = 40
APART = ("04_python_control", "05_two_link_arm", "07_c_export", PLANNED, "21_an_effect_of_your_own")
"""Examples whose answers have tests of their own below."""
EXAMPLES = sorted(FOLDER.glob("[0-9]*.py"))
ANSWERS = {
    "01_feedforward": [28.34, 10.74, 13.7, 2.67],
    "06_design_study": [
        *(0.0, 11.85, 8.56, 20.53, 0.8, 0.5, 10.24, 7.13, 16.87, 0.7, 1.0, 9.0, 5.85, 14.2, 0.9),
        *(1.5, 7.99, 5.40, 12.24, 1.9, 2.0, 7.2, 5.01, 10.78, 3.6, 2.5, 6.7, 4.94, 9.56, 6.4),  # 7.99: as in Fig 17
        *(3.0, 6.22, 4.9, 8.35, 9.1, 3.5, 5.67, 4.63, 8.3, 12.8, 4.0, 5.24, 4.35, 7.78, 14.4),
        *(4.5, 4.89, 4.1, 8.04, 19.1, 5.0, 4.69, 3.89, 8.04, 22.1, 5.5, 4.53, 3.71, 7.94, 24.0),
        *(6.0, 4.5, 3.55, 8.09, 24.0),
    ],
    "08_paper_loops": [
        0.2,
        26.47,
        27.01,
        28.67,
        0.2,
        0.5,
        26.43,
        26.98,
        28.94,
        0.25,
        0.43,
        26.57,
        27.11,
        29.11,
        18.48,
        20.53,
        21.10,
        18.48,
        17.19,
        18.52,
        0.91,
        0.87,
        0.88,
        0.91,
        0.94,
        0.92,
        0.76,
        0.0,
        1.55,
        4.14,
        0.0,
        2.58,
        2.27,
        64.97,
    ],
    "09_paper_models": [
        0.8972,
        0.9008,
        0.885,
        0.916,
        0.9487,
        0.9392,
        0.924,
        0.954,
        0.8745,
        0.8303,
        0.893,
        0.767,
        5.034,
        5.199,
        4.365,
        6.031,
        0.1452,
        0.0309,
        0.008,
        0.069,
        0.2,
        1.59,
        0.64,
        0.2,
        0.5,
        1.49,
        0.71,
        0.25,
        0.43,
        1.52,
        0.65,
        5.1,
    ],
    "10_paper_tracking": [
        0.2,
        27.0,
        28.3,
        8.0,
        13.7,
        13.17,
        13.7,
        0.2,
        0.5,
        27.0,
        28.3,
        8.5,
        15.1,
        4.25,
        13.85,
        15.0,
        0.25,
        0.43,
        28.0,
        28.4,
        9.2,
        14.9,
        4.6,
        13.87,
        14.7,
    ],
    "11_paper_feedback": [8.0, 13.6, 5.8, 8.0, 8.1, 11.8, 9.8],
    "12_why_not_zero": [13.0, 0.8],
    "13_observer_on_the_motor": [13.7, 2.7, 6.5, 0.5],
    "03_sampled_controller": [0.23, 0.23, 0.23, 0.23, 0.23, 0.24, 0.24, 0.35],
    "02_a_block_of_your_own": [1.5],
    "16_identify_the_paper": [
        1.82,
        1.78,
        1.60,
        134.0,
        1.25,
        1.53,
        1.28,
        78.4,
        0.24,
        0.25,
        0.25,
        18.9,  # without offset: the order of the paper's Table 1, which is last in each row
        1.42,
        1.28,
        1.18,
        1.23,
        1.52,
        1.27,
        0.24,
        0.25,
        0.25,
        *3 * [0.901, 0.939, 0.830, 5.199, 0.031],  # by every method
    ],
    "20_emps": [
        95.1,
        203.5,
        20.4,
        3.2,
        4.08,
        5.98,
        95.11,
        203.50,
        20.39,
        3.16,
        4.08,
        5.98,
        95.18,
        205.64,
        20.29,
        3.17,
        4.28,
        5.05,
        166.7,
        240.4,
        3.11,
        3.11,
    ],
    "18_multiple_shooting": [4.0, 4.0, 3.99, 4.01, 4.0, 4.01, 3.99, 4.03, 0.5, 0.503, 0.499, 0.507],
    "17_identifiability": [
        1.482,
        0.029,
        1.396,
        0.014,
        0.975,
        0.019,
        1.499,
        0.095,
        0.650,
        0.039,
        0.16,
        0.732,
        0.008,
        0.878,
        0.004,
        0.146,
        0.002,
    ],
    "14_gains_tuned": [
        8.87,
        5.65,
        0.2,
        10.5,  # the loop that hunts; how often differs from one processor to another
        8.867,
        6.497,
        1.5,
        1.548,
        0.1,
        18.78,
        0.004,
        0.1,
        0.2,
        7.994,
        5.545,
        0.2,
        0.5,
        8.778,
        6.497,
        0.25,
        0.43,
        8.867,
        6.224,
        0.2,
        3.108,
        3.394,
        0.2,
        0.5,
        5.449,
        5.977,
        0.25,
        0.43,
        5.32,
        5.836,
        0.2,
        10.52,
        14.85,
        0.2,
        0.5,
        37.73,
        49.96,
        0.25,
        0.43,
        26.86,
        37.09,
        0.2,
        7.95,
        7.98,
        5.51,
        5.54,
        10.61,
        11.32,
        14.79,
        15.25,
        0.2,
        0.5,
        8.75,
        8.77,
        6.47,
        6.49,
        37.42,
        37.72,
        49.44,
        49.92,
        0.25,
        0.43,
        8.83,
        8.86,
        6.19,
        6.21,
        26.66,
        26.89,
        36.73,
        37.11,
    ],
}
FIGURES = {
    "06_design_study": ["design_study.png"],
    "08_paper_loops": ["figs_3_5_6.png"],
    "09_paper_models": ["figs_10_11_12.png"],
    "10_paper_tracking": ["fig_13.png", "fig_14.png", "fig_15.png"],
    "11_paper_feedback": ["fig_17.png"],
}
"""What examples write into the folder they are given."""
CYCLING = {"06_design_study": 25}
"""Examples whose loop cycles irregularly from a number of their answers on: a change of a gain by 1e-15 then changes
the extremes of 10 s by up to a tenth."""
MEASURED = tuple(path.stem for path in EXAMPLES if "TSMBLOCKS_DATA" in path.read_text(encoding="utf-8"))
"""Examples that need measured data."""
ONE_SIGNAL = {
    "(1.5, 3.0, 6.0)": "(3.0,)",
    "step=STEP,\n        periodic": "step=0.01,\n        periodic",
    "SIGNALS.items()": "[*SIGNALS.items()][:1]",
    "STEP, PREVIEW = 7.0, 2.0, 0.01, 0.8": "STEP, PREVIEW = 4.6, 2.0, 0.02, 0.8",
}
"""Changes of the plans beyond the paper: one signal, and that shorter and with longer steps."""
ONE_BEND = {"in (0, 60, 120, 180, 240)": "in (240,)"}
"""Changes of the measured tendon sheath."""
BEFORE = {
    "linear": [12.12, 11.53, 10.32, 8.42, 6.59],
    "play": [1.12, 1.36, 1.25, 0.95, 0.75],
    "symmetric": [0.82, 1.02, 1.01, 0.93, 1.10],
    "asymmetric": [2.41, 2.85, 2.87, 2.95, 2.64],
}


def printed(path, capsys, monkeypatch, *arguments):
    """What an example prints, run as its own command."""
    return run_example(path.stem, capsys, monkeypatch, *arguments)[1]


def run_shorter(name, changes, capsys, monkeypatch):
    """What an example prints that does less: some of its text is changed."""
    text = (FOLDER / f"{name}.py").read_text("utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.py"
        path.write_text(text, "utf-8")
        return run_example(name, capsys, monkeypatch, path=path)[1]


def run_example(name, capsys, monkeypatch, *arguments, path=None):
    """Names that an example leaves behind, and what it prints."""
    path = path or FOLDER / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(path), *arguments])
    assert tsm.blocks  # the package's own are there before an example adds one
    before = dict(REGISTRY)
    with tempfile.TemporaryDirectory() as elsewhere, monkeypatch.context() as there:
        there.chdir(elsewhere)
        if not arguments:
            there.setitem(sys.modules, "matplotlib", None)  # only pictures need it
        found = runpy.run_path(str(path))
        assert not list(Path(elsewhere).iterdir())
    for name in set(REGISTRY) - set(before):
        del REGISTRY[name]  # an example's own block is no block of the package
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 80
    assert len(said.splitlines()) <= MOST_LINES
    return found, said


@pytest.mark.parametrize("path", [p for p in EXAMPLES if p.stem in ANSWERS], ids=lambda p: p.stem)
def test_example(path, capsys, monkeypatch, request, tmp_path):
    if path.stem in MEASURED:
        request.getfixturevalue("measured")
    folder = tmp_path / "made by the example"
    said = printed(path, capsys, monkeypatch, *([str(folder)] if path.stem in FIGURES else []))
    assert sorted(p.name for p in folder.glob("*")) == FIGURES.get(path.stem, [])
    found = [float(x) for x in re.findall(r"(?<![\w.])\d+\.\d+", said)]
    steady = CYCLING.get(path.stem, len(ANSWERS[path.stem]))
    assert found[:steady] == pytest.approx(ANSWERS[path.stem][:steady], abs=0.06)
    assert found[steady:] == pytest.approx(ANSWERS[path.stem][steady:], rel=0.15)


def test_every_example_has_its_answer():
    assert {p.stem for p in EXAMPLES} == {*ANSWERS, *MEASURED, *APART}


def test_the_list_of_examples_is_complete():
    rows = re.findall(r"^\| \[(\w+)\]\((\w+)\.py\) \| .+ \| \d+ s \|$", (FOLDER / "README.md").read_text("utf-8"), re.M)
    assert [name for name, _ in rows] == [path.stem for path in EXAMPLES]
    assert all(name == file for name, file in rows)
    marked = re.findall(r"^\| \[(\w+)\].*\(data\) \|", (FOLDER / "README.md").read_text("utf-8"), re.M)
    assert marked == [path.stem for path in EXAMPLES if path.stem in MEASURED]


@pytest.mark.parametrize("signals", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_what_a_plan_gains_over_the_paper(signals, capsys, monkeypatch):
    """Each scheme is better than the one before it, on every signal; planned, a tenth of the paper's error is left."""
    said, *tables = run_shorter(PLANNED, {} if signals == 4 else ONE_SIGNAL, capsys, monkeypatch).split("\n\n")
    best = [float(x) for x in re.findall(r"rad/s: (\d+\.\d+) deg", said)]
    known = [1.06, 0.94, 0.9]  # what others found: 1.06, 0.94, 0.85
    assert np.all(np.array(best) <= (known if signals == 4 else known[1:2]))
    assert best == sorted(best, reverse=True)
    for number, table in enumerate(tables):
        rows = [[float(x) for x in re.findall(r"(\d+\.\d\d) \(", line)] for line in table.splitlines()[2:]]
        figures = np.array(rows)
        assert figures.shape == (6, signals)
        assert np.all(np.diff(figures[:4], axis=0) < 0.2)
        assert np.all(figures[4] < figures[3])
        if number == 0:
            assert np.all(figures[5] < figures[4] + 0.1)
            most = [28.6, 13.6, 6.3, 6.0, 2.0, 1.2] if signals == 4 else [20.0, 8.3, 2.8, 2.5, 2.1, 1.6]
            assert np.all(figures[:, 0] <= most)


def bouc_wen(v, z, x):
    A, beta, gamma, n = -1.495, 4.206, -2.272, 1.0217
    return A * v - beta * abs(v) * abs(z) ** (n - 1) * z - gamma * v * abs(z) ** n


def song(v, z, x):
    signs = np.sign([v * z, v * x, x * z, v, z, x])
    return v * (-1.9542 - abs(z) ** 2.024 * signs @ [14.3384, -1.2423, -3.0037, -2.4624, 0.2032, 3.1268])


def proposed(v, z, x):
    return -0.8745 * v - 5.034 * abs(v) * z + 0.14522 * abs(v)


LOOPS = {
    "symmetric": (bouc_wen, lambda v, z, x: 0.9225 * x + 0.6576 * z),
    "generalized": (song, lambda v, z, x: 0.922 * x + 0.4033 * z),
    "asymmetric": (proposed, lambda v, z, x: (0.92295 - 0.02575 * np.tanh(v)) * x + z),
}


@pytest.mark.parametrize("model", LOOPS)
def test_the_loops_of_the_paper_by_scipy(model, capsys, monkeypatch):
    """The equations as printed (but for the sign of gamma), integrated apart: what of x_in is lost, and the widths."""
    said = printed(FOLDER / "08_paper_loops.py", capsys, monkeypatch)
    column = list(LOOPS).index(model)
    lines = [re.findall(r"-?\d+\.\d+", line)[-3:] for line in said.splitlines() if re.match("55 deg|near the", line)]
    lost, upper, lower = (float(line[column]) for line in lines)
    rate, output = LOOPS[model]
    size, w = np.deg2rad(55.0), 0.4 * np.pi
    x, v = (lambda t: size * np.sin(w * t)), (lambda t: size * w * np.cos(w * t))
    t = np.linspace(5.0, 10.0, 20001)  # the second period: the first has forgotten the start
    made = solve_ivp(lambda t, z: [rate(v(t), z[0], x(t))], (0.0, 10.0), [0.0], "DOP853", t, rtol=1e-7, max_step=0.02)
    y = np.rad2deg(output(v(t), made.y[0], x(t)))
    assert np.ptp(np.rad2deg(x(t)) - y) == pytest.approx(lost, abs=0.06)
    for width, share in ((upper, 0.75), (lower, -0.75)):
        level = (y.max() + y.min()) / 2 + share * np.ptp(y) / 2
        there = np.rad2deg(x(t))[np.flatnonzero(np.diff(np.sign(y - level)))]
        assert np.ptp(there) == pytest.approx(width, abs=0.08)


def described(L, h, size):
    """The closed loop L with play of half width h behind it, by the describing function: answer to a sine."""

    def play(A):
        k = 1 - 2 * h / A
        return (np.pi / 2 + np.arcsin(k) + 2 * k * np.sqrt(h / A * (1 - h / A))) / np.pi - 4j * h * (A - h) / (
            np.pi * A * A
        )

    A = brentq(lambda A: abs(L * size / (1 + L * play(A))) - A, 1.0001 * h, 10.0)
    return play(A) * L / (1 + L * play(A))


def test_backlash_bends_the_bode_plot_as_the_describing_function_says(capsys, monkeypatch, tmp_path):
    said = printed(FOLDER / "04_python_control.py", capsys, monkeypatch, str(tmp_path))
    assert [p.name for p in tmp_path.iterdir()] == ["bode.png"]
    rows = np.array([[float(x) for x in line.split()] for line in said.splitlines()[2:]])
    answers = rows[:, 1::2] * np.exp(1j * np.deg2rad(rows[:, 2::2]))
    s = 2j * np.pi * rows[:, 0]
    L = 2 / (s * (0.02 * s + 1)) * (0.3 * s + 6) / (0.005 * s + 1)
    for column in (0, 1):
        assert np.abs(answers[:, column] - L / (1 + L)).max() < 1.2e-3  # three digits, a tenth of a degree
    for column, degrees in enumerate((20.0, 10.0, 5.0), 2):
        expected = [described(one, np.deg2rad(1.0), np.deg2rad(degrees)) for one in L]
        assert answers[:, column] == pytest.approx(np.array(expected), abs=0.015)  # harmonics are neglected there
    assert np.abs(answers[:, 4] - answers[:, 0]).max() > 0.1


def lagrange(t, z, friction, known):
    """The arm and its control from the places of its masses: Jacobians instead of the mass matrix in closed form."""
    g, l1, l2, masses = np.array([0.0, 9.81]), 0.3, 0.25, (1.0, 0.5)
    q, v = z[:2], z[2:]
    a, b = q[0], q[0] + q[1]
    elbow, tip = (lambda x: np.array([-np.sin(x), np.cos(x)])), (lambda x: -np.array([np.cos(x), np.sin(x)]))
    J1 = np.column_stack([l1 * elbow(a), np.zeros(2)])
    J2 = np.column_stack([l1 * elbow(a) + l2 * elbow(b), l2 * elbow(b)])
    bent1 = l1 * tip(a) * v[0] ** 2
    bent2 = bent1 + l2 * tip(b) * (v[0] + v[1]) ** 2
    M = sum(m * J.T @ J for m, J in zip(masses, (J1, J2), strict=True))
    rest = sum(m * J.T @ (bent + g) for m, J, bent in zip(masses, (J1, J2), (bent1, bent2), strict=True))
    w, size = 2 * np.pi * np.array([0.5, 0.8]), np.array([0.6, 0.5])
    r, rv = np.array([-1.2, 0.9]) + size * np.sin(w * t), size * w * np.cos(w * t)
    wanted = -size * w**2 * np.sin(w * t) + 20 * (rv - v) + 100 * (r - q)
    torque = M @ wanted + rest + known * np.tanh(rv / 0.02) - friction * np.tanh(v / 0.02)
    return np.concatenate([v, np.linalg.solve(M, torque - rest)])


def test_the_arm_moves_as_its_masses_say_and_loses_no_energy(capsys, monkeypatch, tmp_path):
    found, said = run_example("05_two_link_arm", capsys, monkeypatch, str(tmp_path))
    rows = {line[:22].strip(): [float(x) for x in line[22:].split()] for line in said.splitlines()[2:]}
    for words, (friction, known) in found["CASES"].items():
        run = found["runs"][words]
        t = run.t[:3001:100]
        exact = solve_ivp(
            lagrange, (0.0, t[-1]), [-1.2, 0.9, 0.0, 0.0], "DOP853", t, args=(friction, known), rtol=1e-9, atol=1e-10
        )
        for k, name in enumerate(("q1", "q2")):
            assert np.abs(run[name][:3001:100] - exact.y[k]).max() < 4e-6
        work, heat, gained, missing = rows[words][2:]
        assert abs(missing) < 2e-4
        assert work - heat - gained == pytest.approx(0.0, abs=2e-3)
    assert rows["friction, all known"][:2] == pytest.approx(rows["no friction"][:2], abs=2e-3)
    assert [rows[w][1] for w in rows] == pytest.approx([0.001, 7.645, 2.615, 0.001], abs=2e-3)
    for name in ("TwoLinkArm", "ComputedTorque"):
        monkeypatch.setitem(REGISTRY, name, found[name])
        assert set(broken_promises(found[name]())) <= {"is_a_value"}  # run like this, it is in no module to pickle from


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
def test_the_c_code_moves_the_motor_as_the_simulation_does(capsys, monkeypatch):
    found, said = run_example("07_c_export", capsys, monkeypatch)
    errors = re.findall(r"(\d\.\d{6}) deg peak to peak", said)
    assert errors == ["1.021052"] * 2
    volts, radians = map(float, re.search(r"difference: (\S+) V, (\S+) rad", said).groups())
    assert volts < 1e-11
    assert radians < 1e-12
    assert len(found["u"]) == 10000
    assert np.ptp(found["u"]) > 1.0


def test_a_missing_compiler_is_said(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(SystemExit, match="found none of cc, gcc and clang"):
        runpy.run_path(str(FOLDER / "07_c_export.py"))


def test_an_effect_of_ones_own_is_named_before_the_whole_catalogue(capsys, monkeypatch):
    found, said = run_example("21_an_effect_of_your_own", capsys, monkeypatch)
    assert found["gap"].held_out[-1] == pytest.approx(found["NOISE"], rel=0.02)
    assert found["effect"].name == "warming"
    shares = [int(share) for share in re.findall(r"(\d+) %", said)]
    assert shares[0] >= 98
    assert max(shares[1:]) < 60
    for name, hidden in {"softening": 0.25, "time": 8.0}.items():
        assert found["effect"].parameters[name].low < hidden < found["effect"].parameters[name].high
    assert re.search(r"softening 0\.26\d ± 0\.04\d", said)


def test_only_pieces_reach_the_noise(capsys, monkeypatch):
    said = printed(FOLDER / "18_multiple_shooting.py", capsys, monkeypatch)
    whole, genetic, pieces = (int(x) for x in re.findall(r"residual +(\d+) times the noise", said))
    assert min(whole, genetic) > 10
    assert pieces == 1


@pytest.mark.parametrize("name", MEASURED)
def test_where_the_data_can_be_had_is_said(name, monkeypatch):
    monkeypatch.delenv("TSMBLOCKS_DATA", raising=False)
    with pytest.raises(SystemExit, match=r"^Set TSMBLOCKS_DATA to a folder that holds .*(nhoyh|nonlinearbenchmark)"):
        runpy.run_path(str(FOLDER / f"{name}.py"))


@pytest.mark.parametrize("bends", [1, pytest.param(5, marks=pytest.mark.slow)])
def test_models_of_the_measured_tendon_sheath(bends, measured, capsys, monkeypatch):
    """Every model no worse than before; the elastic backlash below 0.8 deg on every bend; a note for every repair."""
    said = run_shorter("19_measured_tendon_sheath", {} if bends == 5 else ONE_BEND, capsys, monkeypatch)
    notes, whole, half = said.split("\n\nrms error [deg], ")
    assert len(re.findall(r"rows repeated the time of the row before", notes)) == bends + 1
    rows = {
        name: [float(x) for x in figures.split()] for name, figures in re.findall(r"^(\w.*?)  +([\d. ]+)$", whole, re.M)
    }
    for model, figures in BEFORE.items():
        assert rows[f"{model}, before"] == figures
        assert np.all(np.array(rows[model][:bends]) <= figures[-bends:])
    assert max(rows["elastic_backlash"][:bends]) < 0.8
    assert len(re.findall(rf"^\w+(?: +\d+\.\d\d){{{bends + 1}}}$", half, re.M)) == len(rows) - len(BEFORE)


@pytest.mark.parametrize(("place", "bend"), [*enumerate((0, 60, 120, 180, 240))])
def test_no_model_is_worse_than_before_on_the_very_same_samples(measured, place, bend):
    """The first row of every time, as the figures of before were computed: a straight line gives just those."""
    rows = np.loadtxt(measured / f"tendon_sheath/calib/{bend}.txt", delimiter=",")
    t, first = np.unique(rows[:, 0], return_index=True)
    record = tsm.Record(
        "first rows", t, {"x_in": rows[first, 1], "x_out": rows[first, 3]}, {"x_in": "deg", "x_out": "deg"}
    )
    found = tsm.compare([f"tendon_sheath_{k}" for k in (*BEFORE, "elastic_backlash")], record, train=1.0)
    left = {row.name: np.rad2deg(row.figure) for row in found}
    assert left["linear"] == pytest.approx(BEFORE["linear"][place], abs=0.005)
    for model in ("play", "symmetric", "asymmetric"):
        assert left[model] <= BEFORE[model][place]
    assert left["elastic_backlash"] < 0.8
