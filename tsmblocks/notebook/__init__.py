"""What notebooks show: small pieces of HTML without scripts or requests, in the ink of the page they stand on.

A class says ``_repr_html_`` and asks here for its card. Numbers are as in print, angles in degrees; signals are drawn
as SVG text, so nothing of this needs matplotlib. Cards stay small whatever they show.
"""

from tsmblocks.notebook.analyses import control_card, frequency_card
from tsmblocks.notebook.blocks import block_card
from tsmblocks.notebook.fits import comparison_card, differences_card, fit_card
from tsmblocks.notebook.found import diagnosis_card
from tsmblocks.notebook.sets import study_card, tuned_card
from tsmblocks.notebook.signals import batch_card, record_card, responses_card, run_card

__all__ = [
    "batch_card", "block_card", "comparison_card", "control_card", "diagnosis_card", "differences_card", "fit_card",
    "frequency_card", "record_card", "responses_card", "run_card", "study_card", "tuned_card",
]  # fmt: skip
