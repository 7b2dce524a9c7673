"""Every example in the help of the commands runs as it is printed, in a folder with the files that it names."""

import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, FirstOrderLag, MotorTransferFunction
from tsmblocks.cli.entry import ABOUT, COMMANDS

SLOW_NEEDS = ["cli", "demo", "diagnosis", "reference", "diagrams/*"]
EXAMPLE = re.compile(r"^  (tsmblocks (?:.*\\\n)*.*)$", re.MULTILINE)
HELPS = {"": ABOUT, **{name: module.__doc__ for name, module in COMMANDS.items()}}
EXAMPLES = [(name, example) for name, text in HELPS.items() for example in EXAMPLE.findall(text)]
LONG = ("tsmblocks demo", "tsmblocks reference", "tsmblocks diagnose")
"""Commands whose examples take long, unless few effects are named."""
STUDY = """
format = 1
title = "Gains"
diagram = "fig16_feedforward_feedback"
stop = 1
[metrics]
error = "rms(x_ref - x_out)"
[vary]
"pid.kp" = { low = 0.1, high = 10, count = 5, scale = "log" }
"""


def drive():
    """A drive with an amplifier, a motor and a biased sensor, and two outputs."""
    return tsm.Diagram(
        title="Drive",
        blocks=dict(lag=FirstOrderLag(time_constant=0.01), motor=MotorTransferFunction(), offset=Bias()),
        wires=["lag -> motor", "motor.y -> offset"],
        inputs={"u": tsm.Inlet("lag.u", "V")},
        outputs={"v": "lag", "x": "offset"},
    )


def write(path, signals, heading=""):
    np.savetxt(path, np.column_stack(signals), delimiter=",", header=heading, comments="", fmt="%.9g")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that examples name, and the command on the path."""
    made = tmp_path_factory.mktemp("examples")
    t, noise = np.arange(0.0, 6.0, 0.02), np.random.default_rng(1)
    for names, size in ((("sheath", "a", "bend60"), 1.0), (("b", "bend90"), 0.5)):
        x = size * (0.8 * np.sin(2 * t) + 0.2 * np.sin(5 * t))
        y = tsm.simulate(tsm.load("tendon_sheath_play"), inputs={"x_in": (t, x)}, stop=t[-1], step=0.02)["x_out"]
        degrees = np.degrees([x, y + noise.normal(0.0, 0.001, len(t))])
        for name in names:
            write(made / f"{name}.csv", [t, *degrees], "t [s],x_in [deg],x_out [deg]")
            write(made / f"{name}.txt", [t, degrees[0], 0 * t, degrees[1]])
    u = 6 * np.sin(3 * t)
    run = tsm.simulate(drive(), inputs={"u": (t, u)}, stop=t[-1], step=0.005, every=4)
    noisy = [run["v"] + noise.normal(0.0, 0.005, len(t)), run["x"] + noise.normal(0.0, 2e-4, len(t))]
    write(made / "run.csv", [t, u, *noisy], "t [s],u [V],v [V],x [rad]")
    write(made / "drive.csv", [t, u, noisy[1]], "t [s],u [V],angle [rad]")
    tsm.save(drive(), made / "my_drive.toml")
    tsm.save(tsm.load("tendon_sheath_linear"), made / "my_model.toml")
    (made / "gains.toml").write_text(STUDY, encoding="utf-8")
    for there in (".local/share/bash-completion/completions", ".zfunc", ".config/fish/completions", "bin"):
        (made / there).mkdir(parents=True)
    command = made / "bin/tsmblocks"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m tsmblocks "$@"\n', encoding="utf-8")
    command.chmod(command.stat().st_mode | stat.S_IEXEC)
    return made


def examples():
    for name, example in EXAMPLES:
        long = example.startswith(LONG) and "--effects" not in example
        yield pytest.param(name, example, marks=[pytest.mark.slow] if long else [], id=" ".join(example.split())[10:])


def test_every_command_has_an_example():
    assert {name for name, _ in EXAMPLES} == set(HELPS)
    for name, example in EXAMPLES:
        assert not name or example.startswith(f"tsmblocks {name}")


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(("command", "example"), list(examples()))
def test_it_runs_as_it_is_printed(command, example, folder):
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    env = {**os.environ, "PATH": path, "HOME": str(folder), "MPLBACKEND": "Agg", "PYTHONWARNINGS": "ignore"}
    env["PYTHONPATH"] = str(Path(tsm.__file__).parent.parent)
    words = ["bash", "-c", example]
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, timeout=600, check=False)
    if "--dask" in example:  # there is no such machine
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("tsmblocks: no Dask scheduler answers at 'tcp://scheduler:8786'")
        return
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() or " > " in example
    for option in ("--out", "--plot"):
        if option in example:
            name = example.partition(f"{option} ")[2].split()[0]
            assert (folder / name).exists(), name
