"""``compare``: several models fitted to the same recordings and ranked by their error on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tsmblocks.common import arguments
from tsmblocks.common.errors import NotFinite, RunError, TsmError, in_words, near
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.data import Record
from tsmblocks.fitting.above_noise import output_noise
from tsmblocks.fitting.comparison import Comparison, Row
from tsmblocks.fitting.experiments import Window
from tsmblocks.fitting.fit import fit
from tsmblocks.fitting.recordings import Data, recordings, training_windows, with_adopted_units, without_units
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.scale_notes import scale_notes_before
from tsmblocks.fitting.score import Difference, Differences, score
from tsmblocks.fitting.summary import rough_inputs
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import equations

SHIPPED = "tendon_sheath_"
"""Prefix of the shipped diagrams that are compared when no models are given."""

Models = Mapping[str, Any] | Iterable[Any] | None


def compare(
    models: Models,
    data: Data,
    *,
    train: Any = None,
    held_out: Iterable[str] = (),
    free: Mapping[str, Iterable[str]] | None = None,
    start_states: bool = True,
    outputs: Iterable[str] | None = None,
    method: str = "gauss-newton",
    starts: int = 8,
    seed: int = 0,
    step: float | None = None,
    integrator: str = "rk4",
    hold: Hold = AUTO,
    progress: Callable[[str, int, float], None] | None = None,
    backend: str = "",
) -> Comparison:
    """Fit several models to the same recordings and rank them by their error on held-out data.

    Every simulation runs through from the start of its recording.

    Parameters
    ----------
    models : dict of str to Diagram, list of Diagram, path or str, or None
        Diagrams, files, and names of ready-made ones, in full or as shown (``"tendon_sheath_play"`` or ``"play"``);
        None takes all ready-made ones.
    data : Record, path, DataFrame, list or dict of str to these
        One recording or several experiments, by name.
    train : float or (float, float), optional
        Share of each recording that is fitted, from its start (1 holds nothing out), or a window (start, stop) in s;
        the rest after it is held out, or, where nothing follows, the part before. By default 0.5, and 1 where
        ``held_out`` names experiments.
    held_out : list of str, optional
        Experiments that are not fitted at all.
    free : dict of str to list of str, optional
        Parameters to estimate by model; by default all but initial states.
    start_states : bool, default True
        Estimate the initial state of every state in each experiment.
    outputs : list of str, optional
        Outputs to compare; by default all that were measured.
    method : {"gauss-newton", "ipopt", "ga"}
        As for ``fit``.
    starts : int, default 8
        Number of starting points.
    seed : int, default 0
        Seed of all random numbers.
    step : float, optional
        Step of the simulation in s; by default one that resolves the diagram.
    integrator : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    hold : {"auto", "zero", "linear", "cubic"} or dict of str to these
        Interpolation between samples of the inputs, one for all or by input. By default it is found from the samples:
        zero-order hold where an input is piecewise constant, else linear or a cubic spline.
    progress : callable, optional
        Called as ``progress(model, evaluations, rms)``.
    backend : {"", "llvm", "casadi"}
        Machine code or CasADi's evaluator; by default machine code where llvmlite is installed.

    Returns
    -------
    Comparison
        The ranking. A model that cannot be fitted comes last, with the reason.

    Raises
    ------
    DataError
        For recordings or parts of them that cannot be used.
    RunError
        For arguments that are not models, and if no model can be fitted.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.arange(0, 10, 0.01)
    >>> signals = {"x_in": np.sin(2 * t), "x_out": 0.8 * np.sin(2 * t) + 0.1}
    >>> data = tsm.Record("sweep", t, signals, {"x_in": "rad", "x_out": "rad"})
    >>> comparison = tsm.compare(["linear"], data)
    >>> comparison.best.name, comparison.best.parameters
    ('linear', 2)
    """
    candidates, records = _models(models), recordings(data)
    apart = arguments.as_names("held_out", held_out, "bend 60")
    fitted, tested = training_windows(records, default_train(apart) if train is None else train, apart)
    given = arguments.as_mapping("free", free, "'play': ['play.*']")
    for name in given:
        if name not in candidates:
            raise RunError(f"free: there is no model '{name}'.{near(name, candidates)}")
    chosen = None if outputs is None else arguments.as_names("outputs", outputs, "x_out")
    report = arguments.as_callback(progress, "model, evaluations and rms")
    common: Any = dict(outputs=chosen, step=step, integrator=integrator, hold=hold, backend=backend)
    search: Any = dict(start_states=start_states, method=method, starts=starts, seed=seed, window=fitted, **common)
    training, rows, interrupted = {k: records[k] for k in fitted}, list[Row](), False
    candidates, notes = _with_units(candidates, records, chosen)
    notes += [text for one in candidates.values() for text in scale_notes_before(one, training, **common)]
    for name, diagram in candidates.items():

        def report_model(_: str, count: int, rms: float, name: str = name) -> None:
            report(name, count, rms)

        try:
            found = fit(diagram, training, free=given.get(name), progress=report_model, **search)
            rows.append(_validated(name, found, records, tested, common))
            notes += [f"{k}: {text}" for k, r in records.items() for text in rough_inputs(r, equations(diagram))]
        except TsmError as error:
            if len(candidates) == 1:
                raise
            rows.append(Row(name, None, None, None, str(error)))
        except KeyboardInterrupt:  # before this model was searched, or after it
            if not rows:
                raise
            interrupted = True
        if interrupted or rows[-1].interrupted:
            break
    return _ranked(rows, tuple(dict.fromkeys(notes)), records, candidates, interrupted)


def default_train(held_out: Sequence[str]) -> float:
    """The share of each recording that is fitted by default: all of it where others are held out whole."""
    return 1.0 if held_out else 0.5


def _with_units(
    models: Mapping[str, Diagram], records: Mapping[str, Record], outputs: Iterable[str] | None
) -> tuple[dict[str, Diagram], list[str]]:
    """The models in the units of the recordings, and notes on units."""
    adopted = {name: with_adopted_units(diagram, records) for name, diagram in models.items()}
    notes = [text for _, some in adopted.values() for text in some]
    for diagram, _ in adopted.values():
        notes += without_units(records, diagram, [k for k in diagram.outputs if outputs is None or k in outputs])
    return {name: diagram for name, (diagram, _) in adopted.items()}, notes


def _validated(name: str, found: Fit, records: Mapping[str, Record], parts: Mapping[str, Window], common: Any) -> Row:
    """A fitted model with its residuals on held-out data, or why these are not known."""
    made = list[Difference]()
    try:
        for experiment, window in parts.items():
            diagram = found.diagrams.get(experiment, found.diagram)
            made += score(diagram, {experiment: records[experiment]}, window=window, **common)
    except NotFinite as error:
        return Row(name, found, found.differences, None, f"with the fitted parameters, {error}")
    held_out = Differences(found.diagram.title, tuple(made)) if parts else None
    return Row(name, found, found.differences, held_out)


def _ranked(
    rows: list[Row],
    notes: tuple[str, ...],
    records: Mapping[str, Record],
    models: Mapping[str, Diagram],
    interrupted: bool,
) -> Comparison:
    """The models from best to worst; ``interrupted`` before all had a row. Raises RunError if none could be fitted."""
    if all(row.fit is None for row in rows):
        reasons = {row.fault: row.name for row in rows}
        faults = [fault if len(reasons) == 1 else f"{name}: {fault}" for fault, name in reasons.items()]
        raise RunError(f"none of the models could be fitted. {' '.join(faults)}")
    unit = next((row.train.unit for row in rows if row.train is not None), "")
    ranked = tuple(sorted(rows, key=lambda row: row.figure))
    noise = _noise(ranked[0], records, models[ranked[0].name].inports)
    return Comparison(ranked, unit, interrupted or rows[-1].interrupted, notes, *noise)


def _noise(best: Row, records: Mapping[str, Record], inputs: Iterable[str]) -> tuple[float, str]:
    """Noise of the compared output and how it was estimated; NaN for several outputs, or without an estimate."""
    own = list(best.train or ())
    if len({d.output for d in own}) != 1:
        return float("nan"), ""
    return output_noise(own, records, inputs)


def ready_made() -> list[str]:
    """Names of the diagrams that are compared when no models are given."""
    from tsmblocks.files.shipped import shipped_names

    return [name for name in shipped_names() if name.startswith(SHIPPED)]


def in_full(name: str) -> str:
    """The name by which ``load`` finds a ready-made model that comparisons show under a short one.

    What exists as a file, and any other name, is left as it is.
    """
    full = f"{SHIPPED}{name}"
    return full if full in ready_made() and not Path(name).is_file() else name


def _models(given: Models) -> dict[str, Diagram]:
    """Models by name. Raises RunError for anything that is not a diagram, or when there is none."""
    from tsmblocks.files import load

    if given is None:
        given = ready_made()
    if isinstance(given, (str, Path, Diagram)):
        given = [given]
    if not isinstance(given, Iterable):
        raise RunError(f"models must be diagrams, a list or a mapping of them, got {in_words(given)}.")
    pairs = given.items() if isinstance(given, Mapping) else [("", one) for one in given]
    made: dict[str, Diagram] = {}
    for name, one in pairs:
        if not isinstance(one, (str, Path, Diagram)):
            raise RunError(f"a model must be a diagram, a diagram file or the name of one, got {in_words(one)}.")
        file = "" if isinstance(one, Diagram) else in_full(one) if isinstance(one, str) else one
        diagram = one if isinstance(one, Diagram) else load(file)
        label = str(name or Path(file).stem or diagram.title).removeprefix(SHIPPED)
        if label in made:
            raise RunError(f"two models are named '{label}'; give a mapping with different names.")
        made[label] = diagram
    if not made:
        raise RunError("there are no models to compare.")
    return made
