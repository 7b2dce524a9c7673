"""Tuning: the parameters of a controller that make a metric small, within limits, for the worst of several plants."""

from tsmblocks.tuning.tune import tune as tune
from tsmblocks.tuning.tuned import Tuned as Tuned
