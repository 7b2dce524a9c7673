"""What a shell may offer at every place of a command line, read off the parsers, as scripts for bash, zsh and fish."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from tsmblocks.cli.common import BLOCKS, DIAGRAMS, FILES, FOLDERS

KINDS = {"DIAGRAM": DIAGRAMS, "FILE": FILES, "STUDY": FILES, "DIR": FOLDERS}
"""What is offered for a value, by the word that stands for it in the help."""
Words = Mapping[str, tuple[str, ...]]
"""Names that stand for kinds: those of diagrams and of blocks."""


class Place(NamedTuple):
    """An option, or a place for a word without one: what it takes, and how many; ``kind`` is "" where it takes none.

    ``words`` are offered as they are; for other kinds see KINDS. ``kind`` "any" is for what nobody can foretell.
    """

    names: tuple[str, ...]
    about: str
    kind: str
    words: tuple[str, ...]
    many: bool


class Command(NamedTuple):
    """A command with its options and its places for words."""

    name: str
    about: str
    options: tuple[Place, ...]
    places: tuple[Place, ...]


def commands(parsers: Mapping[str, argparse.ArgumentParser], abouts: Mapping[str, str]) -> list[Command]:
    """Every command, as its parser has it."""
    made = []
    for name, parser in parsers.items():
        places = [_place(action) for action in parser._actions]
        made.append(
            Command(name, abouts[name], tuple(p for p in places if p.names), tuple(p for p in places if not p.names))
        )
    return made


def _place(action: argparse.Action) -> Place:
    given: Any = getattr(action, "suggests", None) or tuple(map(str, action.choices or ()))
    words = given if isinstance(given, tuple) else ()
    kind = "" if action.nargs == 0 else "words" if words else given or KINDS.get(str(action.metavar), "any")
    about = "" if action.help in (None, argparse.SUPPRESS) else str(action.help)
    return Place(tuple(action.option_strings), _brief(about), kind, words, action.nargs in ("+", "*"))


def _brief(about: str) -> str:
    """The first part of a help text, without what argparse fills in."""
    return re.split(r"[;:(]| - ", about.replace("%%", "%"))[0].strip()


# ---- bash -----------------------------------------------------------------------------------------

BASH = r"""# Completion of tsmblocks for bash, 3.2 and later. Made by: tsmblocks completion bash

_tsmblocks_words() {  # $1: words apart by spaces
    local word
    while IFS= read -r word; do COMPREPLY+=("$word"); done < <(compgen -W "$1" -- "$cur")
}

_tsmblocks_paths() {  # $1: f for files, d for folders
    local path
    compopt -o filenames 2>/dev/null
    while IFS= read -r path; do COMPREPLY+=("$path"); done < <(compgen "-$1" -- "$cur")
}

_tsmblocks_offer() {  # $1: kind
    case $1 in
        diagrams) _tsmblocks_words "@DIAGRAMS@"; _tsmblocks_paths f ;;
        blocks) _tsmblocks_words "@BLOCKS@" ;;
        files) _tsmblocks_paths f ;;
        folders) _tsmblocks_paths d ;;
        words:*) _tsmblocks_words "${1#words:}" ;;
    esac
}

_tsmblocks() {
    local cur=${COMP_WORDS[COMP_CWORD]} command= option= takes= count=0 kind= k word
    COMPREPLY=()
    [[ $cur == "=" ]] && cur=
    for ((k = 1; k < COMP_CWORD; k++)); do
        word=${COMP_WORDS[k]}
        [[ $word == "=" ]] && continue
        if [[ -z $command ]]; then
            [[ $word == -* ]] || command=$word
        elif [[ $word == -* ]]; then
            option=$word takes=
            case "$command $option" in
@TAKES@
            esac
        elif [[ $takes == one ]]; then
            takes=
        elif [[ -z $takes ]]; then
            count=$((count + 1))
        fi
    done
    if [[ -z $command ]]; then
        _tsmblocks_words "@COMMANDS@ --help --version"
    elif [[ -n $takes && ! ($takes == many && $cur == -*) ]]; then
        case "$command $option" in
@VALUES@
        esac
    elif [[ $cur == -* ]]; then
        case $command in
@OPTIONS@
        esac
    else
        case "$command $count" in
@PLACES@
        esac
    fi
    [[ -n $kind ]] && _tsmblocks_offer "$kind"
    return 0
}

complete -F _tsmblocks tsmblocks
"""


def bash(known: Iterable[Command], names: Words) -> str:
    """The script for bash."""
    takes, values, options, places = list[str](), list[str](), list[str](), list[str]()
    listed = list(known)
    for command in listed:
        options.append(f'            {command.name}) _tsmblocks_words "{" ".join(_flags(command))}" ;;')
        for one in (p for p in command.options if p.kind):
            pattern = " | ".join(f'"{command.name} {name}"' for name in one.names)
            takes.append(f"                {pattern}) takes={'many' if one.many else 'one'} ;;")
            values.append(f'            {pattern}) kind="{_kind(one)}" ;;')
        for k, one in enumerate(command.places):
            number = "*" if one.many else str(k)
            places.append(f'            "{command.name} "{number}) kind="{_kind(one)}" ;;')
    parts = {
        "@DIAGRAMS@": " ".join(names[DIAGRAMS]),
        "@BLOCKS@": " ".join(names[BLOCKS]),
        "@TAKES@": "\n".join(takes),
        "@VALUES@": "\n".join(values),
        "@OPTIONS@": "\n".join(options),
        "@PLACES@": "\n".join(places),
        "@COMMANDS@": " ".join(c.name for c in listed),
    }
    return _filled(BASH, parts)


def _flags(command: Command) -> list[str]:
    return [name for one in command.options for name in one.names]


def _kind(one: Place) -> str:
    return f"words:{' '.join(one.words)}" if one.kind == "words" else "" if one.kind == "any" else one.kind


def _filled(script: str, parts: Mapping[str, str]) -> str:
    for mark, text in parts.items():
        script = script.replace(mark, text)
    return script


# ---- zsh ------------------------------------------------------------------------------------------

ZSH = r"""#compdef tsmblocks
# Completion of tsmblocks for zsh. Made by: tsmblocks completion zsh

_tsmblocks_diagrams() {
    local -a names
    names=(@DIAGRAMS@)
    _alternative 'diagrams:ready-made diagram:compadd -a names' 'files:diagram file:_files -g "*.toml(-.)"'
}

_tsmblocks_blocks() {
    local -a names
    names=(@BLOCKS@)
    compadd -a names
}

_tsmblocks() {
    local curcontext=$curcontext state line
    typeset -A opt_args
    _arguments -C '(- *)--help[show help]' '(- *)--version[show the version]' '1:command:->command' '*::word:->word'
    case $state in
        command)
            local -a known
            known=(
@COMMANDS@
            )
            _describe -t commands command known
            ;;
        word)
            case $words[1] in
@CASES@
            esac
            ;;
    esac
}

if [[ $funcstack[1] == _tsmblocks ]]; then _tsmblocks "$@"; else compdef _tsmblocks tsmblocks; fi
"""
_ZSH = {DIAGRAMS: "_tsmblocks_diagrams", BLOCKS: "_tsmblocks_blocks", FILES: "_files", FOLDERS: "_files -/", "any": " "}


def zsh(known: Iterable[Command], names: Words) -> str:
    """The script for zsh."""
    cases, listed = [], list(known)
    for command in listed:
        specs = [
            *(_zsh_option(one, name) for one in command.options for name in one.names),
            *(
                _quoted(f"{'*' if one.many else k}:{one.kind}:{_zsh_action(one)}")
                for k, one in enumerate(command.places, start=1)
            ),
        ]
        if any(one.many for one in command.options) and not any(one.many for one in command.places):
            specs.append(_quoted("*:file:_files"))  # further words of an option that takes several
        lines = " \\\n                        ".join(specs)
        cases.append(
            f"                {command.name})\n                    _arguments \\\n"
            f"                        {lines}\n                    ;;"
        )
    said = "\n".join(f"                {_quoted(f'{c.name}:{c.about}')}" for c in listed)
    return _filled(
        ZSH,
        {
            "@DIAGRAMS@": " ".join(names[DIAGRAMS]),
            "@BLOCKS@": " ".join(names[BLOCKS]),
            "@COMMANDS@": said,
            "@CASES@": "\n".join(cases),
        },
    )


def _zsh_option(one: Place, name: str) -> str:
    about = re.sub(r"([\[\]:\\])", r"\\\1", one.about)
    if not one.kind:
        return _quoted(f"{name}[{about}]")
    value = f"{one.kind}:{_zsh_action(one)}"
    return _quoted(f"*{name}{'=' if name.startswith('--') else ''}[{about}]:{value}")


def _zsh_action(one: Place) -> str:
    return f"({' '.join(one.words)})" if one.kind == "words" else _ZSH[one.kind]


def _quoted(text: str) -> str:
    """A text as one word of zsh."""
    return "'" + text.replace("'", "'\\''") + "'"


# ---- fish -----------------------------------------------------------------------------------------

FISH = """# Completion of tsmblocks for fish. Made by: tsmblocks completion fish
complete -c tsmblocks -f
"""


def fish(known: Iterable[Command], names: Words) -> str:
    """The script for fish."""
    lines = ["complete -c tsmblocks -n __fish_use_subcommand -l version -d 'show the version'"]
    for command in known:
        lines.append(f"complete -c tsmblocks -n __fish_use_subcommand -a {command.name} -d {_fished(command.about)}")
        begin = f"complete -c tsmblocks -n '__fish_seen_subcommand_from {command.name}'"
        lines += [f"{begin} {_fish_value(one, names)}" for one in command.places if one.kind != "any"]
        for one in command.options:
            flags = " ".join(f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in one.names)
            value = f" -r {_fish_value(one, names)}" if one.kind else ""
            lines.append(f"{begin} {flags}{value} -d {_fished(one.about)}")
    return FISH + "\n".join(lines) + "\n"


def _fish_value(one: Place, names: Words) -> str:
    if one.kind in (FILES, "any"):
        return "-F" if one.kind == FILES else "-f"
    if one.kind == FOLDERS:
        return "-f -a '(__fish_complete_directories)'"
    words = one.words if one.kind == "words" else names[one.kind]
    return f"{'-F' if one.kind == DIAGRAMS else '-f'} -a {_fished(' '.join(words))}"


def _fished(text: str) -> str:
    """A text as one word of fish."""
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SHELLS = {"bash": bash, "zsh": zsh, "fish": fish}
"""Shells, and what makes the script of each."""
