"""The command line: ``tsmblocks run``, ``draw``, ``check``, ``blocks``, ``demo``. One module per command."""

from tsmblocks.cli.entry import main

__all__ = ["main"]
