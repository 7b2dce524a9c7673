"""Analysis: operating points, linear models, and the frequency response of nonlinear diagrams.

Reading order: ``operating_point`` (trim), ``linearization`` (continuous time), ``discrete_time`` (sampled
blocks), ``loops`` (opened at a wire) and ``crossings`` (their margins); ``frequency_response`` is independent of them.
"""

from tsmblocks.analysis.frequency_response import FrequencyResponse as FrequencyResponse
from tsmblocks.analysis.frequency_response import SettlingWarning as SettlingWarning
from tsmblocks.analysis.frequency_response import frequency_response as frequency_response
from tsmblocks.analysis.linearization import linearize as linearize
from tsmblocks.analysis.loops import Margins as Margins
from tsmblocks.analysis.loops import OperatingPointWarning as OperatingPointWarning
from tsmblocks.analysis.loops import loop_gain as loop_gain
from tsmblocks.analysis.loops import margins as margins
from tsmblocks.analysis.loops import opened as opened
from tsmblocks.analysis.operating_point import Point as Point
from tsmblocks.analysis.operating_point import trim as trim
