"""Measured data: files of several kinds in, one checked record out. Nothing here knows diagrams or runs."""

from tsmblocks.data.reading import from_pandas, read
from tsmblocks.data.record import Record, heading, split_heading

__all__ = ["Record", "from_pandas", "heading", "read", "split_heading"]
