"""Completion in shells: bash is run; zsh and fish are run where they are installed."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import shtab

import tsmblocks.blocks  # noqa: F401 - importing it registers every block
from tsmblocks.cli import common, completion, main
from tsmblocks.cli.entry import COMMANDS, parsers
from tsmblocks.common.interpolation import HOLD_WORDS
from tsmblocks.engine.methods import METHODS
from tsmblocks.files.shipped import shipped_names
from tsmblocks.fitting import fit as estimate
from tsmblocks.model import simulation
from tsmblocks.model.block import REGISTRY

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")


def script(shell, capsys):
    assert main(["completion", shell]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    return told.out


@pytest.fixture
def offered(tmp_path, monkeypatch, capsys):
    """What bash offers for the last of some words, in a folder with a few files."""
    monkeypatch.chdir(tmp_path)
    for name in ("mine.toml", "bend 60.csv", "bend90.csv", "notes.md"):
        Path(name).write_text("", encoding="utf-8")
    Path("results").mkdir()
    Path("tsmblocks.bash").write_text(script("bash", capsys), encoding="utf-8", newline="\n")

    def ask(*words):
        typed = " ".join(f"'{word}'" for word in ("tsmblocks", *words))
        code = (
            "set -u; source ./tsmblocks.bash; complete -p tsmblocks >&2; "
            f"COMP_WORDS=({typed}); COMP_CWORD={len(words)}; _tsmblocks; "
            'for one in "${COMPREPLY[@]+"${COMPREPLY[@]}"}"; do printf "%s\\n" "$one"; done'
        )
        done = subprocess.run(["bash", "--norc", "-c", code], capture_output=True, text=True, timeout=120, check=True)
        assert done.stderr == "complete -F _tsmblocks tsmblocks\n"
        return done.stdout.splitlines()

    return ask


@needs_bash
def test_commands_are_offered(offered):
    assert offered("") == [*COMMANDS, "--help", "--version"]
    assert offered("d") == ["diagnose", "draw", "diagrams", "demo"]
    assert offered("nothing", "") == []


@needs_bash
@pytest.mark.parametrize("command", COMMANDS)
def test_all_options_of_a_command_are_offered(command, offered):
    assert offered(command, "-") == parsers()[1][command].options()


@needs_bash
def test_diagrams_are_offered_with_files_beside_them(offered):
    assert offered("run", "fig0") == [name for name in shipped_names() if name.startswith("fig0")]
    assert offered("draw", "mi") == ["mine.toml"]
    assert offered("check", "fig09b_feedforward", "fig16") == ["fig16_feedforward_feedback"]
    assert offered("compare", "tendon_sheath_pl") == ["tendon_sheath_play"]
    assert offered("run", "fig16_feedforward_feedback", "fig") == [], "it takes one diagram"
    assert set(shipped_names()) | {"mine.toml"} <= set(offered("fit", ""))


@needs_bash
def test_blocks_and_words_are_offered(offered):
    assert offered("blocks", "Bou") == [name for name in sorted(REGISTRY) if name.startswith("Bou")]
    assert offered("run", "x", "--method", "") == ["euler", "heun", "rk4", "sdirk2", "sdirk3", "sdirk4"]
    assert offered("run", "x", "--method", "=", "h") == ["heun"]
    assert offered("run", "x", "--method", "=") == ["euler", "heun", "rk4", "sdirk2", "sdirk3", "sdirk4"]
    assert offered("fit", "x", "--data", "bend90.csv", "--tail", "d") == ["drop"]
    assert offered("demo", "--hide", "back") == ["backlash"]
    assert offered("completion", "") == ["bash", "zsh", "fish", "powershell"]


@needs_bash
def test_files_and_folders_are_offered_as_they_are(offered):
    assert sorted(offered("run", "x", "--data", "bend")) == ["bend 60.csv", "bend90.csv"]
    assert offered("demo", "--out", "") == ["results"]
    assert offered("study", "no") == ["notes.md"]
    assert offered("run", "x", "--stop", "") == [], "nobody can foretell a number"


@needs_bash
def test_an_option_that_takes_several_goes_on_until_the_next(offered):
    assert offered("fit", "x", "--data", "a.csv", "bend9") == ["bend90.csv"]
    assert offered("fit", "x", "--data", "a.csv", "--se") == ["--set", "--segments", "--seed"]
    assert offered("run", "--data", "a.csv", "fig08") == ["fig08_slope"]
    assert offered("run", "--json", "fig08") == ["fig08_slope"]


def test_what_is_offered_is_what_is_known():
    assert set(completion.NAMES) <= set(shtab.SUPPORTED_SHELLS)
    assert tuple(METHODS) == common.METHODS
    assert set(METHODS) == set(simulation.METHODS)
    assert HOLD_WORDS == common.HOLDS
    assert estimate.METHODS == common.FITS


def test_an_unknown_shell_is_refused(capsys):
    assert main(["completion", "bahs"]) == 2
    assert "there is no shell 'bahs'. Did you mean 'bash'?" in capsys.readouterr().err


@pytest.mark.parametrize("shell", ["zsh", "fish", "powershell"])
def test_scripts_name_every_command_and_option(shell, capsys):
    text = script(shell, capsys)
    for name, parser in parsers()[1].items():
        assert name in text
        for option in parser.options():
            flag = f" -{'l' if option[:2] == '--' else 's'} {option.strip('-')} "
            assert (flag if shell == "fish" else option) in text
    assert all(name in text for name in (*shipped_names(), *REGISTRY))


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish_offers_commands_options_and_diagrams(capsys, tmp_path):
    (tmp_path / "a.fish").write_text(script("fish", capsys), encoding="utf-8")

    def ask(line):
        done = subprocess.run(
            ["fish", "--no-config", "-c", f"source a.fish; complete -C '{line}'"],
            text=True,
            capture_output=True,
            timeout=120,
            check=True,
            cwd=tmp_path,
        )
        assert done.stderr == ""
        return [one.partition("\t")[0] for one in done.stdout.splitlines()]

    assert ask("tsmblocks d") == ["demo", "diagnose", "diagrams", "draw"]
    assert ask("tsmblocks run fig08") == ["fig08_slope"]
    assert ask("tsmblocks run x --met") == ["--method"]
    assert ask("tsmblocks run x --method ") == ["euler", "heun", "rk4", "sdirk2", "sdirk3", "sdirk4"]
    assert ask("tsmblocks blocks PID") == ["PID", "PIDController"]
    assert ask("tsmblocks check fig08_slope a.f") == ["a.fish"]
    assert ask("tsmblocks fit x --data one.csv a.f") == ["a.fish"]
    assert ask("tsmblocks fit x --data one.csv --se") == ["--seed", "--segments", "--set"]
    assert ask("tsmblocks run x --stop ") == []


ZSH = """
zmodload zsh/zpty
zpty shell zsh -f -i
zpty -w shell 'fpath=($PWD $fpath); autoload -Uz compinit && compinit -u -D'
zpty -w shell 'show() { print -r -- "<<$BUFFER>>"; BUFFER=; zle accept-line }; zle -N show; bindkey "^X" show'
zpty -w shell 'PROMPT=; print REA""DY'
zpty -r -m shell out '*READY*'
for typed in "$@"; do
    zpty -w -n shell "$typed"$'\\t\\x18'
    zpty -r -m shell out '*<<*>>*'
    print -r -- "$out"
done
"""


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_completes_commands_options_and_diagrams(capsys, tmp_path):
    """A shell at a terminal of its own, what is typed into it, and the line after Tab."""
    (tmp_path / "_tsmblocks").write_text(script("zsh", capsys), encoding="utf-8", newline="\n")
    (tmp_path / "typed.zsh").write_text(ZSH, encoding="utf-8", newline="\n")
    lines = {
        "dem": "demo ",
        "run fig08": "run fig08_slope ",
        "run x --meth": "run x --method=",
        "run x --method eul": "run x --method euler ",
        "run x --method=eul": "run x --method=euler ",
        "blocks PIDC": "blocks PIDController ",
        "check fig08_slope fig16_feedforward_f": "check fig08_slope fig16_feedforward_feedback ",
        "fit x --data one.csv typ": "fit x --data one.csv typed.zsh ",
        "fit x --bounds a=1:2 --constr": "fit x --bounds a=1:2 --constraint=",
    }
    done = subprocess.run(
        ["zsh", "-f", "typed.zsh", *(f"tsmblocks {typed}" for typed in lines)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        cwd=tmp_path,
    )
    shown = re.findall("<<(.*?)>>", done.stdout)
    assert (shown, done.stderr) == ([f"tsmblocks {line}" for line in lines.values()], "")
