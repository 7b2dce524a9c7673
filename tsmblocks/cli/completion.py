r"""Print a script with which a shell completes commands, options, diagrams, blocks and files.

Write it where the shell looks for such scripts, and open a new shell:

  mkdir -p ~/.local/share/bash-completion/completions
  tsmblocks completion bash > \
      ~/.local/share/bash-completion/completions/tsmblocks

  tsmblocks completion zsh > ~/.zfunc/_tsmblocks
      (with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc)

  tsmblocks completion fish > ~/.config/fish/completions/tsmblocks.fish

For this shell alone: source <(tsmblocks completion bash)
"""

from __future__ import annotations

import argparse

from tsmblocks.cli import common

HELP = "print a script with which bash, zsh or fish completes what is typed"
NAMES = ("bash", "zsh", "fish")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.suggest(parser.add_argument("shell", metavar="SHELL", help="bash, zsh or fish"), NAMES)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    import tsmblocks.blocks  # noqa: F401 - importing it registers every block
    from tsmblocks.cli.shells import SHELLS, commands
    from tsmblocks.files.shipped import names
    from tsmblocks.model.block import REGISTRY

    shell = common.choose(args.shell, NAMES, "shell")
    known = commands(args.parsers()[1], args.helps)
    words = {common.DIAGRAMS: tuple(names()), common.BLOCKS: tuple(sorted(REGISTRY))}
    print(SHELLS[shell](known, words), end="")
    return 0
