"""Block diagrams for mechanisms with friction, backlash and hysteresis: model, control, diagnose.

Reading order for the whole idea: ``block``, ``blocks/limits``, ``diagram``, ``compile``, ``simulate``. How a diagram
becomes equations stands, step by step, in ``flatten``, ``structure`` and ``evaluate``; ``engine`` says its own order.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# These two stand before their modules of the same name, so they cannot wait to be asked for.
from tsmblocks.block import block as block
from tsmblocks.simulate import simulate as simulate

__version__ = "0.1.0"

_HOME = {
    "Batch": "batch",
    "Block": "block",
    "Comparison": "fitting.compare",
    "Diagnosis": "diagnosis.result",
    "Diagram": "diagram",
    "Differences": "fitting.differences",
    "Fit": "fitting.result",
    "Effect": "effects.effect",
    "Inlet": "diagram",
    "Input": "block",
    "Noise": "data",
    "OptimalControl": "optimal.outcome",
    "Output": "block",
    "Past": "block",
    "RecedingHorizon": "optimal.receding",
    "Record": "data",
    "Run": "run",
    "Samples": "block",
    "State": "block",
    "Stepper": "simulate",
    "Tape": "block",
    "TsmError": "errors",
    "block": "block",
    "cautions": "data",
    "compare": "fitting.compare",
    "diagnose": "diagnosis.diagnose",
    "dumps": "files",
    "equations": "simulate",
    "fit": "fitting.estimate",
    "from_control": "blocks.lti",
    "from_pandas": "data",
    "function_block": "blocks.function",
    "linearize": "analysis.linear",
    "load": "files",
    "loads": "files",
    "measure": "metrics",
    "noise": "data",
    "optimal_control": "optimal.control",
    "option": "block",
    "parameter": "block",
    "peak_to_peak": "measures",
    "read": "data",
    "read_study": "studies.results",
    "receding_horizon": "optimal.receding",
    "rms": "measures",
    "save": "files",
    "score": "fitting.differences",
    "sensitivities": "batch",
    "signals": "block",
    "simulate": "simulate",
    "simulate_batch": "batch",
    "state": "block",
    "study": "studies.study",
    "to_mermaid": "draw",
    "to_pdf": "draw",
    "to_png": "draw",
    "to_svg": "draw",
    "tracking_error": "measures",
    "trim": "analysis.point",
    "tune": "tuning.tune",
}
"""Where each public name lives; modules are imported when a name is first used."""

_ROOMS = ("blocks", "analysis", "studies", "export", "tuning", "errors")
"""Modules of which all names are public."""

__all__ = sorted([*_HOME, *_ROOMS])  # noqa: PLE0605 - one list of names is enough


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"tsmblocks.{name}")
    if name in _HOME:
        return getattr(import_module(f"tsmblocks.{_HOME[name]}"), name)
    from tsmblocks.errors import near

    rooms = _ROOMS if name.isidentifier() and not name.startswith("_") else ()
    where = [room for room in rooms if callable(getattr(import_module(f"tsmblocks.{room}"), name, None))]
    hint = f" It is tsmblocks.{where[0]}.{name}." if where else near(name, __all__)
    raise AttributeError(f"tsmblocks has no '{name}'.{hint}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


if TYPE_CHECKING:
    from tsmblocks import analysis as analysis
    from tsmblocks import blocks as blocks
    from tsmblocks import errors as errors
    from tsmblocks import export as export
    from tsmblocks import studies as studies
    from tsmblocks import tuning as tuning
    from tsmblocks.analysis.linear import linearize as linearize
    from tsmblocks.analysis.point import trim as trim
    from tsmblocks.batch import Batch as Batch
    from tsmblocks.batch import sensitivities as sensitivities
    from tsmblocks.batch import simulate_batch as simulate_batch
    from tsmblocks.block import Block as Block
    from tsmblocks.block import Input as Input
    from tsmblocks.block import Output as Output
    from tsmblocks.block import Past as Past
    from tsmblocks.block import Samples as Samples
    from tsmblocks.block import State as State
    from tsmblocks.block import Tape as Tape
    from tsmblocks.block import option as option
    from tsmblocks.block import parameter as parameter
    from tsmblocks.block import signals as signals
    from tsmblocks.block import state as state
    from tsmblocks.blocks.function import function_block as function_block
    from tsmblocks.blocks.lti import from_control as from_control
    from tsmblocks.data import Noise as Noise
    from tsmblocks.data import Record as Record
    from tsmblocks.data import cautions as cautions
    from tsmblocks.data import from_pandas as from_pandas
    from tsmblocks.data import noise as noise
    from tsmblocks.data import read as read
    from tsmblocks.diagnosis.diagnose import diagnose as diagnose
    from tsmblocks.diagnosis.result import Diagnosis as Diagnosis
    from tsmblocks.diagram import Diagram as Diagram
    from tsmblocks.diagram import Inlet as Inlet
    from tsmblocks.draw import to_mermaid as to_mermaid
    from tsmblocks.draw import to_pdf as to_pdf
    from tsmblocks.draw import to_png as to_png
    from tsmblocks.draw import to_svg as to_svg
    from tsmblocks.effects.effect import Effect as Effect
    from tsmblocks.errors import TsmError as TsmError
    from tsmblocks.files import dumps as dumps
    from tsmblocks.files import load as load
    from tsmblocks.files import loads as loads
    from tsmblocks.files import save as save
    from tsmblocks.fitting.compare import Comparison as Comparison
    from tsmblocks.fitting.compare import compare as compare
    from tsmblocks.fitting.differences import Differences as Differences
    from tsmblocks.fitting.differences import score as score
    from tsmblocks.fitting.estimate import fit as fit
    from tsmblocks.fitting.result import Fit as Fit
    from tsmblocks.measures import peak_to_peak as peak_to_peak
    from tsmblocks.measures import rms as rms
    from tsmblocks.measures import tracking_error as tracking_error
    from tsmblocks.metrics import measure as measure
    from tsmblocks.optimal.control import optimal_control as optimal_control
    from tsmblocks.optimal.outcome import OptimalControl as OptimalControl
    from tsmblocks.optimal.receding import RecedingHorizon as RecedingHorizon
    from tsmblocks.optimal.receding import receding_horizon as receding_horizon
    from tsmblocks.run import Run as Run
    from tsmblocks.simulate import Stepper as Stepper
    from tsmblocks.simulate import equations as equations
    from tsmblocks.studies.results import read_study as read_study
    from tsmblocks.studies.study import study as study
    from tsmblocks.tuning.tune import tune as tune
