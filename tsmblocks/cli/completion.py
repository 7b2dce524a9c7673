r"""Print a script with which a shell completes commands, options, diagrams, blocks and files.

Write it where the shell looks for such scripts, and open a new shell:

  mkdir -p ~/.local/share/bash-completion/completions
  tsmblocks completion bash > \
      ~/.local/share/bash-completion/completions/tsmblocks

  tsmblocks completion zsh > ~/.zfunc/_tsmblocks
      (with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc)

  tsmblocks completion fish > ~/.config/fish/completions/tsmblocks.fish

  tsmblocks completion powershell > tsmblocks.ps1
      (with '. FOLDER/tsmblocks.ps1' in your $PROFILE)

For this shell alone: source <(tsmblocks completion bash)
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from tsmblocks.cli import common

HELP = "print a script with which bash, zsh, fish or PowerShell completes what is typed"
NAMES = ("bash", "zsh", "fish", "powershell")
"""Shells; shtab knows tcsh too, whose rules offer one command the values of another."""
KINDS = {"DIAGRAM": common.DIAGRAMS, "FILE": common.FILES, "STUDY": common.FILES, "DIR": common.FOLDERS}
"""What is offered for a value, by its name in the help."""

BASH = r"""
# --option=VALUE is one argument, options may follow an option that takes several values, and nothing follows an
# unknown command.
_tsmblocks() {
    local current=${COMP_WORDS[COMP_CWORD]#=} k
    local -a typed=()
    for ((k = 0; k < COMP_CWORD; k++)); do [[ ${COMP_WORDS[k]} == "=" ]] || typed+=("${COMP_WORDS[k]}"); done
    [[ $current == -* ]] && typed=("${typed[@]:0:2}")
    COMPREPLY=()
    [[ -z ${typed[1]-} || " ${_shtab_tsmblocks_subparsers[*]} " == *" ${typed[1]} "* ]] || return 0
    local -a COMP_WORDS=("${typed[@]}" "$current")
    local COMP_CWORD=${#typed[@]}
    _shtab_tsmblocks
    [[ $COMP_CWORD == 1 && -z $current ]] && COMPREPLY+=(--help --version)
    return 0
}

complete -F _tsmblocks tsmblocks
"""
"""Wrapper of the function that shtab writes for bash, which does none of these."""

DIAGRAMS = {
    "bash": '_tsmblocks_diagram_files() {{ compgen -W "{0}" -- "$1"; compgen -f -- "$1"; }}',
    "zsh": (
        "_tsmblocks_diagrams() {{ _alternative "
        "'diagrams:ready-made diagram:({0})' 'files:diagram file:_files -g \"*.toml(-.)\"' }}"
    ),
    "powershell": (
        "function _tsmblocks_diagrams {{ param([string]$WordToComplete)\n"
        "  '{0}'.Split(' ') | Where-Object {{ $_ -like \"$WordToComplete*\" }}\n"
        "  _shtab_powershell_compgen_files $WordToComplete\n}}"
    ),
}
"""Functions that offer names of diagrams (``{0}``) with files beside them, by shell."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.add(parser, "shell", metavar="SHELL", help="bash, zsh, fish or powershell", suggests=NAMES)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    import shtab

    shell = common.known_name(args.shell, NAMES, "shell")
    parser, commands = args.parsers()
    offered = _offered()
    for name, command in commands.items():
        command.description = args.helps[name]
        for action in command._actions:
            _complete(action, shell, offered)
        if shell in {"zsh", "fish"}:
            _further_values(command)
    script = shtab.complete(parser, shell)
    if shell == "zsh":
        script = script.replace('"(*):', '"*:')  # all values of an argument that takes several, not the first alone
    print(script + (BASH if shell == "bash" else ""))
    return 0


def _offered() -> dict[str, Any]:
    """What shtab takes as the completion of each kind of value."""
    import shtab

    import tsmblocks.blocks  # noqa: F401 - importing it registers every block
    from tsmblocks.files.shipped import shipped_names
    from tsmblocks.model.block import REGISTRY

    listed = " ".join(shipped_names())
    diagrams = {
        "bash": "_tsmblocks_diagram_files",
        "zsh": "_tsmblocks_diagrams",
        "fish": f"{listed} (__fish_complete_path (commandline -ct))",
        "powershell": "_tsmblocks_diagrams",
        "preamble": {shell: text.format(listed) for shell, text in DIAGRAMS.items()},
    }
    return {
        common.DIAGRAMS: diagrams,
        common.BLOCKS: tuple(sorted(REGISTRY)),
        common.FILES: shtab.FILE,
        common.FOLDERS: shtab.DIRECTORY,
    }


def _complete(action: argparse.Action, shell: str, offered: Mapping[str, Any]) -> None:
    """Set what shtab offers for the value of an argument."""
    kind: str | Sequence[str] = getattr(action, "suggests", KINDS.get(str(action.metavar), ""))
    values = offered.get(kind) if isinstance(kind, str) else kind
    if isinstance(values, tuple):
        action.choices = values
    elif values is not None:
        vars(action)["complete"] = values
    if shell == "zsh" and action.nargs != 0:
        action.metavar = None  # a colon in it would end the message that _arguments shows
        action.option_strings = [f"{one}=" if one.startswith("--") else one for one in action.option_strings]


def _further_values(command: argparse.ArgumentParser) -> None:
    """Offer files after the first value of an option that takes several: shtab counts one for zsh and fish."""
    import shtab

    several = [action for action in command._actions if action.nargs in ("+", "*")]
    if several and all(action.option_strings for action in several):
        vars(command.add_argument("files", nargs="+", help="file"))["complete"] = shtab.FILE
