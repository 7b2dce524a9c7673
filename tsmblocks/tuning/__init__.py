"""Tuning: the parameters of a controller that make a metric small, within limits, for the worst of several plants.

Reading order: ``tune`` (arguments), ``search`` (the searches), ``smooth_metrics`` (metrics with derivatives),
``constraints`` (limits and stability margins), ``hunting`` (a warning), ``result``.
"""

from tsmblocks.tuning.result import Tuned as Tuned
from tsmblocks.tuning.tune import tune as tune
