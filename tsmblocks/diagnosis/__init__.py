"""Diagnosis: find which effect a model lacks, name it, add its block, and validate it on held-out data.

How a diagnosis decides, in reading order: ``effects/effect.py`` (what an effect is), ``diagnose.py`` (the steps),
``search_rounds.py`` (what they pass on), ``forward_selection.py`` (one effect after another),
``screened_candidates.py`` and ``round_fits.py`` (which are fitted, and how), ``cross_validation.py`` (held-out
losses), ``decision.py`` (which candidate is named), ``exchange.py`` (early choices again), ``acceptance.py`` (how many
of them hold).
"""

from tsmblocks.diagnosis.diagnose import diagnose
from tsmblocks.diagnosis.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
