"""Blocks and effects of one's own on the command line: --with FILE."""

import json
import re
import subprocess
import sys

import pytest

from tsmblocks.cli import main
from tsmblocks.cli.entry import CLOSED, COMMANDS, parsers

SPRING = '''\
import tsmblocks as tsm
from tsmblocks.effects import Effect, Trials, register


@tsm.block
class TestedSpring(tsm.Block):
    """A spring that hardens."""

    k: float = tsm.parameter(default=1.0, about="stiffness at rest", above=0.0)
    k3: float = tsm.parameter(default=0.0, about="hardening", at_least=0.0)
    u = tsm.Input("deflection")
    y = tsm.Output("torque")

    def outputs(self, t, x, u):
        return dict(y=self.k * u.u + self.k3 * u.u**3)


register(Effect(name="tested_spring", family="springs", words="a spring that hardens", place="output",
                block=TestedSpring(), null={"k3": 0.0}, free=("k3",),
                trials=lambda scales: Trials({"k3": 0.1})))
'''
LOOP = """\
format = 1
title = "spring"
wires = ["two -> spring"]
[blocks]
two = { type = "Constant", value = 2.0 }
spring = { type = "TestedSpring", k = 3.0, k3 = 0.5 }
[outputs]
torque = "spring"
"""
STUDY = """\
format = 1
diagram = "loop.toml"
stop = 0.01
[metrics]
last = "final(torque)"
[vary]
"spring.k" = [1.0, 2.0]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a block, a diagram that has it and a study of that, in which a user works."""
    for name, text in (("tested_spring.py", SPRING), ("loop.toml", LOOP), ("study.toml", STUDY)):
        (tmp_path / name).write_text(text, encoding="utf-8", newline="\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(*words):
    """What a command printed on both streams, in a process of its own: blocks stay known to the one they are in."""
    done = subprocess.run(
        [sys.executable, "-m", "tsmblocks", *words], capture_output=True, text=True, timeout=120, check=False
    )
    return done.returncode, done.stdout + done.stderr


def test_every_command_that_reads_diagrams_takes_it():
    taking = {name for name, parser in parsers()[1].items() if "--with" in parser.options()}
    assert taking == set(COMMANDS) - CLOSED
    for name in CLOSED:
        assert "DIAGRAM" not in parsers()[1][name].format_usage()


def test_a_diagram_with_a_block_of_ones_own_runs(folder):
    status, said = typed("run", "--with", "tested_spring.py", "loop.toml", "--stop", "0.1")
    assert (status, said.splitlines()[-1].split()) == (0, ["torque", "10", "10", "10"])  # 3*2 + 0.5*2**3
    status, said = typed("blocks", "TestedSpring", "--with", str(folder / "tested_spring.py"))
    assert status == 0
    assert "TestedSpring (tested_spring)\nA spring that hardens." in said


def test_processes_that_share_a_study_know_it(folder):
    status, said = typed("study", "study.toml", "--with", "tested_spring.py", "--workers", "2")
    assert (status, said.splitlines()[-1].split()[:3]) == (0, ["last", "6", "6.1"])


CLUSTER = """
import os, subprocess, sys
from distributed import Client, LocalCluster

if __name__ == "__main__":
    alone = dict(n_workers=1, threads_per_worker=1, dashboard_address=None, local_directory=sys.argv[1])
    with LocalCluster(**alone) as cluster:
        with Client(cluster) as client:
            client.run(os.chdir, "/")
        for _ in range(2):
            subprocess.run([sys.executable, "-m", "tsmblocks", "study", "study.toml", "--with", "tested_spring.py",
                            "--dask", cluster.scheduler_address], check=True)
"""


def test_machines_that_share_a_study_are_sent_it(folder):
    """Workers are in another folder, so they have nothing but what they are sent; and they may be sent it again."""
    pytest.importorskip("distributed", reason="needs Dask: pip install 'tsmblocks[dask]'")
    (folder / "cluster.py").write_text(CLUSTER, encoding="utf-8", newline="\n")
    done = subprocess.run(
        [sys.executable, "cluster.py", str(folder / "dask")], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [line.split()[:3] for line in done.stdout.splitlines() if "last" in line] == [["last", "6", "6.1"]] * 2


def test_its_effects_take_part(folder):
    code = (
        "import sys; from tsmblocks.cli.extensions import import_files; "
        "import_files(['tested_spring.py']); import_files(['./tested_spring.py']); "
        "from tsmblocks.effects import catalogue; print(catalogue()[-1].name, len({e.name for e in catalogue()}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert (done.stdout.split()[0], done.stderr) == ("tested_spring", "")


def test_without_it_the_message_says_how(folder, capsys):
    assert main(["run", "loop.toml"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert said.startswith("tsmblocks: loop.toml:6: block 'spring': there is no block type 'TestedSpring'. Known here:")
    assert said.endswith("A block of your own is known once its module is imported (by a command: --with FILE.py).")


WRONG = {
    "gone.py": (None, "--with gone.py: there is no such file."),
    "spring.toml": (None, "--with takes Python files, and 'spring.toml' does not end in .py."),
    "my-own.py": ("", "--with my-own.py: 'my-own' is not a name that Python can import. Rename the file."),
    "numpy.py": ("", "--with numpy.py: there is a module named 'numpy' already. Rename the file."),
    "syntax_own.py": ("x = 1\ndef f(:\n", "syntax_own.py:2: SyntaxError: invalid syntax."),
    "near_own.py": (
        "import tsmblocks as tsm\ntsm.Blok\n",
        "near_own.py:2: AttributeError: tsmblocks has no 'Blok'. Did you mean 'Block'?",
    ),
    "deep_own.py": (
        "import json\ndef f():\n    return json.loads('{')\nf()\n",
        "deep_own.py:3: JSONDecodeError: Expecting property name enclosed in double quotes: line 1 column 2 (char 1).",
    ),
    "helped_own.py": ("import helper_own\n", "helped_own.py:1: SyntaxError: invalid syntax (helper_own.py, line 2)."),
    "leaves_own.py": ("raise SystemExit\n", "leaves_own.py:1: SystemExit."),
    "twice_own.py": (
        "import tsmblocks as tsm\n@tsm.block\nclass Gain(tsm.Block):\n    pass\n",
        "twice_own.py:2: A block named Gain exists already, in tsmblocks.blocks.arithmetic. Choose "
        "another name, or use @block(register=False).",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_cannot_be_run_is_refused(name, tmp_path, monkeypatch, capsys):
    text, said = WRONG[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    if text is not None:
        (tmp_path / name).write_text(text, encoding="utf-8", newline="\n")
    (tmp_path / "helper_own.py").write_text("x = 1\ndef f(:\n", encoding="utf-8", newline="\n")
    assert main(["check", "motor_linear", "--with", name]) == 2
    assert " ".join(capsys.readouterr().err.split()) == f"tsmblocks: {said}"


def test_a_file_that_defines_nothing_is_told(tmp_path, monkeypatch, capsys):
    (tmp_path / "nothing_own.py").write_text("x = 1\n", encoding="utf-8", newline="\n")
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert main(["check", "motor_linear", "--with", str(tmp_path / "nothing_own.py")]) == 0
    said = re.sub(r"\s+", " ", capsys.readouterr().err)
    assert said.startswith("note: ")
    assert said.endswith("nothing_own.py defines no block that files may name, and registers no effect. ")
    sys.modules.pop("nothing_own")


def test_what_a_file_prints_is_not_among_the_answers(folder):
    (folder / "loud_own.py").write_text("print('hello')\nimport tested_spring\n", encoding="utf-8", newline="\n")
    done = subprocess.run(
        [sys.executable, "-m", "tsmblocks", "run", "loop.toml", "--stop", "0.1", "--json", "--with", "loud_own.py"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert json.loads(done.stdout)["title"] == "spring"
    assert done.stderr == "hello\n"


def test_a_file_may_lie_in_a_folder_of_its_name(folder):
    (folder / "springs").mkdir()
    (folder / "tested_spring.py").rename(folder / "springs" / "springs.py")
    status, said = typed("check", "loop.toml", "--with", "springs/springs.py")
    assert (status, said[:14]) == (0, "loop.toml: ok;")
