"""The command line: ``tsmblocks run``, ``fit``, ``compare``, ``draw`` and so on. One module per command."""

from tsmblocks.cli.entry import main

__all__ = ["main"]
