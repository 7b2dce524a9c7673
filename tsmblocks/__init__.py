"""Block diagrams for mechanisms with friction, backlash and hysteresis: model, control, diagnose.

The packages stand in layers, and each imports only what is below it: ``common``; ``model`` (blocks and diagrams as
values); ``compiler`` (a diagram as one set of equations); ``engine`` (equations at a fixed step); ``simulation``; then
``fitting``, ``diagnosis`` and what else is built on runs; at the top ``html``, ``plots`` and ``cli``, which show it.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tsmblocks.common import errors as errors
from tsmblocks.common.version import __version__ as __version__
from tsmblocks.model import block as _block_module
from tsmblocks.model.block import block as block  # before any module could take its name

_HOME = {
    "Batch": "simulation.batch_result",
    "Block": "model.block",
    "Comparison": "fitting.compare",
    "Diagnosis": "diagnosis.result",
    "Diagram": "model.diagram",
    "Differences": "fitting.score",
    "Fit": "fitting.result",
    "Effect": "effects.effect",
    "Inlet": "model.diagram",
    "Input": "model.block",
    "Noise": "data",
    "OptimalControl": "optimal.result",
    "Output": "model.block",
    "Past": "model.block",
    "RecedingHorizon": "optimal.receding_horizon",
    "Record": "data",
    "Run": "simulation.run",
    "Samples": "model.block",
    "State": "model.block",
    "Stepper": "simulation.stepper",
    "Tape": "model.block",
    "TsmError": "common.errors",
    "block": "model.block",
    "cautions": "data",
    "compare": "fitting.compare",
    "diagnose": "diagnosis.diagnose",
    "dumps": "files",
    "equations": "simulation.compiled",
    "fit": "fitting.fit",
    "from_control": "blocks.lti",
    "from_pandas": "data",
    "function_block": "blocks.function",
    "linearize": "analysis.linearization",
    "load": "files",
    "loads": "files",
    "measure": "metrics.metrics",
    "noise": "data",
    "optimal_control": "optimal.control",
    "option": "model.block",
    "parameter": "model.block",
    "peak_to_peak": "metrics.tracking",
    "read": "data",
    "read_study": "studies.results",
    "receding_horizon": "optimal.receding_horizon",
    "rms": "metrics.tracking",
    "save": "files",
    "score": "fitting.score",
    "sensitivities": "simulation.sensitivities",
    "signals": "model.block",
    "simulate": "simulation.simulate",
    "simulate_batch": "simulation.batch",
    "state": "model.block",
    "study": "studies.study",
    "to_mermaid": "draw",
    "to_pdf": "draw",
    "to_png": "draw",
    "to_svg": "draw",
    "tracking_error": "metrics.tracking",
    "trim": "analysis.operating_point",
    "tune": "tuning.tune",
}
"""Where each public name lives; modules are imported when a name is first used."""

_ROOMS = ("blocks", "analysis", "studies", "export", "tuning", "errors")
"""Modules of which all names are public."""

__all__ = sorted([*_HOME, *_ROOMS])  # noqa: PLE0605 - one list of names is enough


sys.modules[f"{__name__}.block"] = _block_module  # ``from tsmblocks.block import Block`` is what many scripts have
sys.modules[f"{__name__}.errors"] = errors


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"tsmblocks.{name}")
    if name in _HOME:
        return getattr(import_module(f"tsmblocks.{_HOME[name]}"), name)
    from tsmblocks.common.errors import near

    rooms = _ROOMS if name.isidentifier() and not name.startswith("_") else ()
    where = [room for room in rooms if callable(getattr(import_module(f"tsmblocks.{room}"), name, None))]
    hint = f" It is tsmblocks.{where[0]}.{name}." if where else near(name, __all__)
    raise AttributeError(f"tsmblocks has no '{name}'.{hint}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


if TYPE_CHECKING:
    from tsmblocks import analysis as analysis
    from tsmblocks import blocks as blocks
    from tsmblocks import export as export
    from tsmblocks import studies as studies
    from tsmblocks import tuning as tuning
    from tsmblocks.analysis.linearization import linearize as linearize
    from tsmblocks.analysis.operating_point import trim as trim
    from tsmblocks.blocks.function import function_block as function_block
    from tsmblocks.blocks.lti import from_control as from_control
    from tsmblocks.common.errors import TsmError as TsmError
    from tsmblocks.data import Noise as Noise
    from tsmblocks.data import Record as Record
    from tsmblocks.data import cautions as cautions
    from tsmblocks.data import from_pandas as from_pandas
    from tsmblocks.data import noise as noise
    from tsmblocks.data import read as read
    from tsmblocks.diagnosis.diagnose import diagnose as diagnose
    from tsmblocks.diagnosis.result import Diagnosis as Diagnosis
    from tsmblocks.draw import to_mermaid as to_mermaid
    from tsmblocks.draw import to_pdf as to_pdf
    from tsmblocks.draw import to_png as to_png
    from tsmblocks.draw import to_svg as to_svg
    from tsmblocks.effects.effect import Effect as Effect
    from tsmblocks.files import dumps as dumps
    from tsmblocks.files import load as load
    from tsmblocks.files import loads as loads
    from tsmblocks.files import save as save
    from tsmblocks.fitting.compare import Comparison as Comparison
    from tsmblocks.fitting.compare import compare as compare
    from tsmblocks.fitting.fit import fit as fit
    from tsmblocks.fitting.result import Fit as Fit
    from tsmblocks.fitting.score import Differences as Differences
    from tsmblocks.fitting.score import score as score
    from tsmblocks.metrics.metrics import measure as measure
    from tsmblocks.metrics.tracking import peak_to_peak as peak_to_peak
    from tsmblocks.metrics.tracking import rms as rms
    from tsmblocks.metrics.tracking import tracking_error as tracking_error
    from tsmblocks.model.block import Block as Block
    from tsmblocks.model.block import Input as Input
    from tsmblocks.model.block import Output as Output
    from tsmblocks.model.block import Past as Past
    from tsmblocks.model.block import Samples as Samples
    from tsmblocks.model.block import State as State
    from tsmblocks.model.block import Tape as Tape
    from tsmblocks.model.block import option as option
    from tsmblocks.model.block import parameter as parameter
    from tsmblocks.model.block import signals as signals
    from tsmblocks.model.block import state as state
    from tsmblocks.model.diagram import Diagram as Diagram
    from tsmblocks.model.diagram import Inlet as Inlet
    from tsmblocks.optimal.control import optimal_control as optimal_control
    from tsmblocks.optimal.receding_horizon import RecedingHorizon as RecedingHorizon
    from tsmblocks.optimal.receding_horizon import receding_horizon as receding_horizon
    from tsmblocks.optimal.result import OptimalControl as OptimalControl
    from tsmblocks.simulation.batch import simulate_batch as simulate_batch
    from tsmblocks.simulation.batch_result import Batch as Batch
    from tsmblocks.simulation.compiled import equations as equations
    from tsmblocks.simulation.run import Run as Run
    from tsmblocks.simulation.sensitivities import sensitivities as sensitivities
    from tsmblocks.simulation.simulate import simulate as simulate
    from tsmblocks.simulation.stepper import Stepper as Stepper
    from tsmblocks.studies.results import read_study as read_study
    from tsmblocks.studies.study import study as study
    from tsmblocks.tuning.tune import tune as tune
