"""Measured data: files of several kinds in, one checked record out. Nothing here knows diagrams or runs.

Reading order: ``record`` (what a measurement is), ``files`` (from a file to a record), ``table`` and ``repair`` (faults
of the numbers; ``repair_time`` those of the time), then quantities computed from a record: ``noise_floor``,
``filters``, ``conditioning``. Formats: ``text`` for CSV and its relatives, ``containers`` for NPZ, MAT, HDF5 and
pandas, with ``structures`` for nested structures of MAT files, ``writing`` for output. Further methods of a record are
in ``parts``, ``signals``, ``resampling``, ``filters`` and ``conditioning``.
"""

from tsmblocks.common.headings import heading, split_heading
from tsmblocks.data.files import from_pandas, read
from tsmblocks.data.input_cautions import cautions
from tsmblocks.data.noise_floor import Noise, noise
from tsmblocks.data.record import Record

__all__ = ["Noise", "Record", "cautions", "from_pandas", "heading", "noise", "read", "split_heading"]
