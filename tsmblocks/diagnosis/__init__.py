"""Find what a model misses: where it and the data disagree, which effect explains it, and how the gap shrinks."""

from tsmblocks.diagnosis.diagnose import diagnose
from tsmblocks.diagnosis.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
