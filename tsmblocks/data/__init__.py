"""Measured data: files of several kinds in, one checked record out. Nothing here knows diagrams or runs."""

from tsmblocks.common.units import heading, split_heading
from tsmblocks.data.files import from_pandas, read
from tsmblocks.data.input_cautions import cautions
from tsmblocks.data.noise_floor import Noise, fast_noise, noise
from tsmblocks.data.record import Record

__all__ = ["Noise", "Record", "cautions", "fast_noise", "from_pandas", "heading", "noise", "read", "split_heading"]
