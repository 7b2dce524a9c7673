"""Diagram files: TOML in and out, with the line of every fault."""

from tsmblocks.files.storage import dumps, load, load_beside, loads, save

__all__ = ["dumps", "load", "load_beside", "loads", "save"]
