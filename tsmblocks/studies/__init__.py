"""Studies: many runs of one diagram, each reduced to a few numbers.

Reading order: ``plans`` (which sets of parameters, drawn from ``distributions``), ``study`` (the one call), ``runner``
(lanes, threads, executors), ``store`` and ``saved_results`` (results on disk, and read again), ``results`` and
``influence`` (what is computed from them). ``responses`` keeps signals, ``files`` reads a study from TOML with
``page``.
"""

from tsmblocks.studies.distributions import Normal as Normal
from tsmblocks.studies.distributions import Uniform as Uniform
from tsmblocks.studies.plans import Plan as Plan
from tsmblocks.studies.plans import grid as grid
from tsmblocks.studies.plans import latin_hypercube as latin_hypercube
from tsmblocks.studies.plans import monte_carlo as monte_carlo
from tsmblocks.studies.plans import sweep as sweep
from tsmblocks.studies.plans import table as table
from tsmblocks.studies.responses import Responses as Responses
from tsmblocks.studies.responses import responses as responses
from tsmblocks.studies.results import Results as Results
from tsmblocks.studies.saved_results import read_study as read_study
from tsmblocks.studies.study import study as study
