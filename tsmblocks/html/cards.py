"""What notebooks show: small pieces of HTML without scripts or requests, in the ink of the page they stand on.

``view`` gives the card of a value; a class calls it by ``common.views``. Numbers are as in print, angles in degrees;
signals are drawn as SVG text, so nothing of this needs matplotlib. Cards stay small whatever they show.
"""

import functools

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.common.views import no_view
from tsmblocks.data.record import Record
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.fitting.compare import Comparison
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.score import Differences
from tsmblocks.html.analysis_cards import control_card, frequency_card
from tsmblocks.html.block_card import block_card
from tsmblocks.html.diagnosis_card import diagnosis_card
from tsmblocks.html.fit_cards import comparison_card, differences_card, fit_card
from tsmblocks.html.signal_cards import batch_card, record_card, responses_card, run_card
from tsmblocks.html.study_cards import study_card, tuned_card
from tsmblocks.model.block import Block
from tsmblocks.optimal.result import OptimalControl
from tsmblocks.simulation.batch_result import Batch
from tsmblocks.simulation.run import Run
from tsmblocks.studies.responses import Responses
from tsmblocks.studies.results import Results
from tsmblocks.tuning.result import Tuned

view = functools.singledispatch(no_view)
view.register(Batch, batch_card)
view.register(Block, block_card)
view.register(Comparison, comparison_card)
view.register(Diagnosis, diagnosis_card)
view.register(Differences, differences_card)
view.register(Fit, fit_card)
view.register(FrequencyResponse, frequency_card)
view.register(OptimalControl, control_card)
view.register(Record, record_card)
view.register(Responses, responses_card)
view.register(Results, study_card)
view.register(Run, run_card)
view.register(Tuned, tuned_card)
