"""Tuning: the parameters of a controller that make a metric small, within limits, for the worst of several plants."""

from tsmblocks.tuning.result import Tuned as Tuned
from tsmblocks.tuning.tune import tune as tune
