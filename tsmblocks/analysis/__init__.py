"""Analysis: operating points, linear models, and how a nonlinear loop answers sines of different size."""

from tsmblocks.analysis.linear import linearize as linearize
from tsmblocks.analysis.linear import loop_gain as loop_gain
from tsmblocks.analysis.linear import opened as opened
from tsmblocks.analysis.point import Point as Point
from tsmblocks.analysis.point import trim as trim
from tsmblocks.analysis.sweep import FrequencyResponse as FrequencyResponse
from tsmblocks.analysis.sweep import SettlingWarning as SettlingWarning
from tsmblocks.analysis.sweep import frequency_response as frequency_response
