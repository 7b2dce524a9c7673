"""C code against the engine: compiled without warnings, the same numbers to rounding; and what cannot be written."""

import re
import shutil
import subprocess

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import (
    Abs,
    Constant,
    DeadTime,
    Delay,
    DiscretePID,
    FirstOrderLag,
    Gain,
    LookupTable2D,
    MovingAverage,
    Play,
    PrandtlIshlinskii,
    Product,
    Quantiser,
    RateLimit,
    Relay,
    Saturation,
    SensorNoise,
    Sine,
    Step,
    Sum,
    Tanh,
    UnitDelay,
)
from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.export import to_c

GCC = shutil.which("gcc") or shutil.which("cc")
FLAGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror", "-O2", "-ffp-contract=off"]
MAIN = """
#include <stdio.h>
#include <stdlib.h>
#include "NAME.h"
int main(int n, char **given)
{
    NAME c;
    NAME_inputs u;
    NAME_outputs y;
    const long steps = atol(given[1]);
    const int inputs = atoi(given[2]);
    const int outputs = atoi(given[3]);
    long k;
    int i;
    (void)n;
    NAME_init(&c);
    for (k = 0; k < steps; k++) {
        for (i = 0; i < inputs; i++) {
            if (scanf("%lf", (double *)&u + i) != 1) {
                return 1;
            }
        }
        NAME_step(&c, &u, &y);
        for (i = 0; i < outputs; i++) {
            printf("%.17g ", *((double *)&y + i));
        }
        printf("\\n");
    }
    return 0;
}
"""
needs_compiler = pytest.mark.skipif(GCC is None, reason="needs a C compiler (gcc or cc)")


def compiled(code, folder, begun=""):
    """The program; ``begun`` are statements after everything has its start values."""
    code.save(folder)
    (folder / "main.c").write_text(MAIN.replace("NAME_init(&c);", f"NAME_init(&c); {begun}").replace("NAME", code.name))
    command = [GCC, *FLAGS, f"{code.name}.c", "main.c", "-lm", "-o", "run"]
    made = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    assert not made.stderr
    return folder / "run"


def c_rows(diagram, folder, values, step, steps, begun="", **how):
    """Outputs of the C code, one row per instant."""
    program = compiled(to_c(diagram, step=step, **how), folder, begun)
    given = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in values)
    counts = [str(steps), str(values.shape[1]), str(len(diagram.outputs))]
    out = subprocess.run([program, *counts], input=given, capture_output=True, text=True, check=True).stdout
    return np.array([line.split() for line in out.splitlines()], dtype=float)


def engine_rows(diagram, names, values, step, steps, method):
    t = step * np.arange(steps)
    inputs = {name: (t, values[:, k]) for k, name in enumerate(names)}
    run = tsm.simulate(diagram, inputs=inputs, stop=t[-1], step=step, method=method, hold="zero")
    return np.column_stack([run[name] for name in diagram.outputs])


def one(block, *, ins=None, **more):
    ins = ins or list(block.inports)
    return tsm.Diagram(
        title="one",
        blocks={"b": block, **more},
        inputs={f"i{k}": f"b.{p}" for k, p in enumerate(ins)},
        outputs={f"o{k}": f"b.{p}" for k, p in enumerate(block.outports)},
    )


def sampled():
    """A sampled controller on a continuous plant, with a delay of the bus."""
    blocks = {
        "e": Sum(signs="+-"),
        "pid": DiscretePID(period=0.01, kp=1.5, ki=2.0, low=-24.0, high=24.0),
        "sat": Saturation(low=-2.0, high=2.0),
        "bus": DeadTime(time=0.0234),
        "plant": FirstOrderLag(gain=2.0, time_constant=0.3),
    }
    return tsm.Diagram(
        title="sampled",
        blocks=blocks,
        wires=["e -> pid -> sat -> bus -> plant", "plant -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "plant", "u": "sat"},
    )


def sources():
    blocks = {
        "a": Sine(amplitude=2.0, frequency=0.7),
        "b": Step(time=0.5, after=0.3),
        "c": Constant(value=0.2),
        "s": Sum(signs="+++"),
        "g": FirstOrderLag(time_constant=0.1),
    }
    return tsm.Diagram(
        title="sources",
        blocks=blocks,
        wires=["a -> s.plus1", "b -> s.plus2", "c -> s.plus3", "s -> g"],
        outputs={"y": "g", "s": "s"},
    )


CASES = {
    "gain": lambda: one(Gain(gain=-0.3)),
    "bend": lambda: one(Tanh()),
    "product": lambda: one(Product()),
    "size": lambda: one(Abs()),
    "limit": lambda: one(Saturation(low=-0.4, high=np.inf)),
    "lag": lambda: one(FirstOrderLag(time_constant=0.05)),
    "play": lambda: one(Play(half_width=0.2)),
    "operators in parallel": lambda: one(PrandtlIshlinskii()),
    "rate limit": lambda: one(RateLimit(rising=1.0, falling=-2.0)),
    "relay": lambda: one(Relay(on=0.3, off=-0.3)),
    "surface of lines": lambda: one(LookupTable2D(outside="extend")),
    "smooth surface": lambda: one(LookupTable2D(interpolation="cubic")),
    "counts": lambda: one(Quantiser()),
    "dead time": lambda: one(DeadTime(time=0.0371)),
    "delay": lambda: one(Delay(time=0.05)),
    "sample": lambda: one(UnitDelay(period=0.02)),
    "average": lambda: one(MovingAverage()),
    "sampled loop": sampled,
    "sources": sources,
    "position loop": lambda: tsm.load("sampled_position_loop"),
    "motor": lambda: tsm.load("motor_linear"),
    "fig 16": lambda: tsm.load("fig16_feedforward_feedback"),
    "fig 9b of elements": lambda: tsm.load("fig09b_elementary"),
}


@needs_compiler
@pytest.mark.parametrize("method", ["rk4", "heun", "euler"])
@pytest.mark.parametrize("name", CASES)
def test_c_gives_the_engines_numbers(name, method, tmp_path):
    diagram, step, steps = CASES[name](), 1e-3 if "fig" in name or "position" in name else 5e-3, 600
    names = list(diagram.inputs)
    t = step * np.arange(steps)
    values = np.column_stack(
        [np.sin((2 + k) * t) + 0.3 * np.sin(11 * t + k) for k in range(len(names))] or [np.empty((steps, 0))]
    )
    found = c_rows(diagram, tmp_path, values, step, steps, method=method)
    expected = engine_rows(diagram, names, values, step, steps, method)
    assert np.ptp(expected) > 0.1
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-11)


@needs_compiler
def test_the_compensator_takes_the_slope_as_an_input(tmp_path):
    """Held over the step, so it agrees to first order in the step."""
    diagram, left = tsm.load("eq11_compensator"), []
    for step in (2e-3, 1e-3):
        t = np.arange(0, 5, step)
        values = np.column_stack([0.96 * np.sin(1.3 * t), 0.96 * 1.3 * np.cos(1.3 * t)])
        folder = tmp_path / f"{step}"
        folder.mkdir()
        found = c_rows(diagram, folder, values, step, len(t), name="ff")[:, 0]
        smooth = tsm.simulate(diagram, inputs={"x_r": (t, values[:, 0])}, stop=t[-1], step=step, hold="cubic")["x_ff"]
        left.append(np.abs(found - smooth).max())
    assert left[0] < 5e-3
    assert left[0] / left[1] == pytest.approx(2.0, rel=0.3)


@needs_compiler
def test_numbers_may_be_changed_in_the_code(tmp_path):
    code = to_c(one(Gain(gain=2.0)), step=0.1, name="g")
    main = (
        '#include <stdio.h>\n#include "g.h"\nint main(void)\n{\n    g c;\n    g_inputs u = {3.0};\n    g_outputs y;\n'
        '    g_init(&c);\n    c.p.b_gain = 5.0;\n    g_step(&c, &u, &y);\n    printf("%g", y.o0);\n    return 0;\n}\n'
    )
    code.save(tmp_path)
    (tmp_path / "main.c").write_text(main)
    subprocess.run([GCC, *FLAGS, "g.c", "main.c", "-lm", "-o", "run"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "run"], capture_output=True, text=True, check=True).stdout == "15"


@needs_compiler
@pytest.mark.parametrize("block", [Delay(time=0.05), DeadTime(time=0.05)], ids=["delay", "dead time"])
def test_a_delay_made_longer_than_there_is_room_for_is_the_longest_there_is(block, tmp_path):
    step, t = 5e-3, 5e-3 * np.arange(300)
    values = np.sin(2 * t)[:, None]
    found = c_rows(one(block), tmp_path, values, step, 300, begun="c.p.b_time = 0.7;")
    expected = engine_rows(one(block.replace(time=24 * step)), ["i0"], values, step, 300, "rk4")
    assert found == pytest.approx(expected, abs=1e-12)


@needs_compiler
def test_steps_are_counted_for_years(tmp_path):
    """Of 32 bits 2**31 steps would be too many: those of 25 days at 1 ms."""
    begun, step = "c.k = 1LL << 31;", 0.5
    diagram = tsm.Diagram(
        title="late",
        blocks={"s": Step(time=2.0**30 + 2, after=7.0), "z": UnitDelay(period=1.0)},
        wires=["s -> z"],
        outputs={"y": "s", "z": "z"},
    )
    found = c_rows(diagram, tmp_path, np.empty((8, 0)), step, 8, begun=begun)
    assert found.tolist() == [[7.0 * (k >= 4), 7.0 * (k >= 6)] for k in range(8)]
    assert "long long k;" in to_c(diagram, step=step).header


def test_nothing_is_allocated_and_nothing_but_math_is_needed():
    for make in CASES.values():
        code = to_c(make(), step=1e-3)
        assert re.findall(r"#include (.*)", code.source) == ['"controller.h"', "<math.h>"]
        assert not re.search(r"\b(malloc|calloc|realloc|free|static double \w+\[|static \w+ \w+ =)", code.source)
        assert max(map(len, code.header.splitlines())) < 400


def test_names_are_as_c_takes_them():
    blocks = {"int_": Gain(gain=1.0), "double": Gain(gain=2.0)}
    diagram = tsm.Diagram(
        title="a */ b", blocks=blocks, wires=["int_ -> double"], inputs={"while": "int_"}, outputs={"for": "double"}
    )
    header = to_c(diagram, step=0.1).header
    assert "double v_while;" in header
    assert "double v_for;" in header
    assert "a * / b" in header


REFUSED = {
    "noise": (
        lambda: to_c(one(SensorNoise(std=0.1)), step=0.1),
        RunError,
        "diagram 'one' cannot be written in C: b generates its signal for a whole run at once. Give this signal as "
        "an input instead.",
    ),
    "name": (
        lambda: to_c(one(Gain()), step=0.1, name="my loop"),
        ParameterError,
        "a name in C has letters, digits and underscores, and is none of C's own; got 'my loop'.",
    ),
    "word": (
        lambda: to_c(one(Gain()), step=0.1, name="while"),
        ParameterError,
        "a name in C has letters, digits and underscores, and is none of C's own; got 'while'.",
    ),
    "function": (
        lambda: to_c(one(Gain()), step=0.1, name="sin"),
        ParameterError,
        "a name in C has letters, digits and underscores, and is none of C's own; got 'sin'.",
    ),
    "step": (lambda: to_c(one(Gain()), step=-1), RunError, "step must be a positive number of seconds, got -1."),
    "method": (
        lambda: to_c(one(Gain()), step=0.1, method="rk5"),
        RunError,
        "there is no method 'rk5'. Did you mean 'rk4'?",
    ),
    "period": (
        lambda: to_c(one(UnitDelay(period=0.1)), step=0.03),
        RunError,
        "the sample period 0.1 s of b is not a multiple of the step 0.03 s.",
    ),
    "diagram": (lambda: to_c("fig16", step=0.1), RunError, "only a diagram can be run, got 'fig16'."),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_written(name):
    make, kind, said = REFUSED[name]
    with pytest.raises(kind) as found:
        make()
    assert str(found.value).startswith(said)


def test_a_mat_file_has_numbers_wiring_and_the_linear_model(tmp_path):
    from scipy.io import loadmat

    diagram = tsm.load("motor_linear")
    found = loadmat(tsm.export.to_mat(diagram, tmp_path / "m.mat"), simplify_cells=True)
    assert found["parameters"]["motor"]["K"] == diagram.parameters["motor.K"]
    assert found["states"]["motor"]["angle"] == 0.0
    assert found["blocks"] == "motor: MotorTransferFunction"
    assert found["A"].tolist() == [[0.0, 1.0], [0.0, -1 / diagram.parameters["motor.tau"]]]
    whole = loadmat(tsm.export.to_mat(tsm.load("fig16_feedforward_feedback"), tmp_path / "f.mat"), simplify_cells=True)
    assert (found["inputs"], found["outputs"]) == ("u", "x")
    assert whole["parameters"]["pid"]["kp"] == 1.5
    assert "A" not in whole
    assert "controller.y -> drive.u" in [w.strip() for w in whole["wires"]]
    with pytest.raises(tsm.errors.DataError, match=r"must end in \.mat"):
        tsm.export.to_mat(diagram, tmp_path / "m.txt")


def test_the_command_writes_c_and_mat(tmp_path, monkeypatch, capsys):
    from tsmblocks.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(["export", "eq11_compensator", "--out", "ff.c", "--step", "0.002"]) == 0
    assert capsys.readouterr().out == "wrote ff.h\nwrote ff.c\n"
    assert "one step of 0.002 s at a time (rk4)" in (tmp_path / "ff.h").read_text()
    assert main(["export", "motor_linear", "--out", "m.mat", "--set", "motor.K=3", "--json"]) == 0
    assert '"written": [\n    "m.mat"\n  ]' in capsys.readouterr().out
    for words, said in (
        (["motor_linear", "--out", "m.mat", "--step", "0.1"], "--step and --method are for C"),
        (["motor_linear", "--out", "m.py"], "'m.py' must end in .c or .mat."),
        (["motor_linear"], "the following arguments are required: --out"),
        (
            ["motor_linear", "--out", "my-motor.c"],
            "a name in C has letters, digits and underscores, and is none of C's own; got 'my-motor'.",
        ),
    ):
        assert main(["export", *words]) == 2
        assert said in capsys.readouterr().err


@needs_compiler
def test_initial_states_changed_after_init_take_effect_with_reset(tmp_path):
    """Of a continuous state, a memory and a delayed signal, each with an initial value that is a parameter."""
    blocks = {
        "lag": FirstOrderLag(time_constant=0.2, value=0.0),
        "late": Delay(time=0.05, initial=0.0),
        "hold": UnitDelay(period=0.02, initial=0.0),
    }
    outputs = {name: name for name in blocks}
    d = tsm.Diagram(title="starts", blocks=blocks, inputs={"u": [*blocks]}, outputs=outputs)
    values = np.random.default_rng(1).normal(size=(50, 1))
    begun = "c.p.lag_value = 1.5; c.p.late_initial = -2.0; c.p.hold_initial = 0.7;"
    changed = d.with_parameters({"lag.value": 1.5, "late.initial": -2.0, "hold.initial": 0.7})
    expected = engine_rows(changed, ["u"], values, 0.01, 50, "rk4")
    rows = c_rows(d, tmp_path, values, 0.01, 50, f"{begun} NAME_reset(&c);")
    assert np.abs(rows - expected).max() < 1e-12
    assert np.abs(c_rows(d, tmp_path, values, 0.01, 50, begun) - expected).max() > 0.1  # without it they do not
