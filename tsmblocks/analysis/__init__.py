"""Analysis: operating points, linear models, and the frequency response of nonlinear diagrams.

Reading order: ``operating_point`` (trim), ``linearization`` (continuous time, and loops opened at a wire),
``discrete_time`` (sampled blocks); ``frequency_response`` is independent of them.
"""

from tsmblocks.analysis.frequency_response import FrequencyResponse as FrequencyResponse
from tsmblocks.analysis.frequency_response import SettlingWarning as SettlingWarning
from tsmblocks.analysis.frequency_response import frequency_response as frequency_response
from tsmblocks.analysis.linearization import linearize as linearize
from tsmblocks.analysis.linearization import loop_gain as loop_gain
from tsmblocks.analysis.linearization import opened as opened
from tsmblocks.analysis.operating_point import Point as Point
from tsmblocks.analysis.operating_point import trim as trim
