"""How a diagram answers sines of different frequency and size, by simulation: gain, phase and harmonics."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.discrete_time import HELD
from tsmblocks.blocks import Sine
from tsmblocks.common.arguments import as_integer, as_number, as_positive
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.frames import dataset, frame, need
from tsmblocks.common.tables import few, listed
from tsmblocks.common.units import for_people
from tsmblocks.common.views import view
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram, as_inputs
from tsmblocks.simulation.batch import batch_of
from tsmblocks.simulation.compiled import equations
from tsmblocks.simulation.run_options import RunOptions

SETTLED = 1e-4
"""Change of a signal from one period to the next, as a share of its size, that counts as none."""
LONGEST = 1024
"""Periods that are left out at most."""
MOST_STEPS = 20_000_000
"""Steps of one run at most."""
TONE = "tone"
"""Name of the source that takes the place of an input."""
STILL = 1e-12
"""Motion of the output, as a share of that of the input and of its own size in numbers, below which it stands still."""


class SettlingWarning(UserWarning):
    """Answers to some sines never become periodic."""


@attrs.frozen(eq=False)
class FrequencyResponse:
    """Answers to sines: ``response`` (amplitudes, frequencies) is complex, output over input at the sine's frequency.

    ``frequencies`` are in Hz, ``amplitudes`` in ``unit``, that of the input (``""`` where it is not known).
    ``harmonics`` (amplitudes, frequencies, n) are sizes at 2, 3, … times the frequency as shares of that at the
    frequency itself. An answer is NaN where it never becomes periodic or a run is not finite; where the output stands
    still it is 0, with no phase and no harmonics (NaN).
    """

    title: str
    driven: str
    output: str
    frequencies: np.ndarray
    amplitudes: np.ndarray
    response: np.ndarray = attrs.field(repr=False)
    harmonics: np.ndarray = attrs.field(repr=False)
    unit: str = ""

    @property
    def gain(self) -> np.ndarray:
        """Size of the output over that of the input, shape (amplitudes, frequencies)."""
        return np.abs(self.response)

    @property
    def phase(self) -> np.ndarray:
        """Phase of the output after the input in deg, shape (amplitudes, frequencies), unwrapped along frequency."""
        made = np.full(self.response.shape, np.nan)
        for row, answers in zip(made, self.response, strict=True):
            there = np.isfinite(answers) & (answers != 0)
            row[there] = np.degrees(np.unwrap(np.angle(answers[there])))
        return made

    @property
    def distortion(self) -> np.ndarray:
        """Root of the sum of squares of the harmonics, shape (amplitudes, frequencies)."""
        return np.sqrt((self.harmonics**2).sum(axis=2))

    def to_pandas(self) -> Any:
        """A frame with a row per amplitude and frequency: gain, phase [deg], distortion. Needs pandas."""
        axes = [self.amplitudes, self.frequencies]
        index = need("pandas").MultiIndex.from_product(axes, names=["amplitude", "frequency"])
        columns = {"gain": self.gain, "phase": self.phase, "distortion": self.distortion}
        return frame({name: v.ravel() for name, v in columns.items()}, index, units={"phase": "deg"})

    def to_xarray(self) -> Any:
        """A data set over ``amplitude`` and ``frequency`` [Hz]: gain, phase [deg], distortion. Needs xarray."""
        dims = ("amplitude", "frequency")
        found = {"gain": self.gain, "phase": self.phase, "distortion": self.distortion}
        coords = {"amplitude": (dims[:1], self.amplitudes, ""), "frequency": (dims[1:], self.frequencies, "Hz")}
        return dataset(
            {k: (dims, v, "deg" if k == "phase" else "") for k, v in found.items()},
            coords,
            {"title": self.title, "driven": self.driven, "output": self.output},
        )

    def __repr__(self) -> str:
        sizes, f = few(f"{a:.3g}" for a in self.amplitudes), self.frequencies
        return (
            f"FrequencyResponse({self.title!r}, {self.output} over {self.driven}, {len(f)} frequencies, sizes {sizes})"
        )

    def _repr_html_(self) -> str:
        return view("html", self)

    def plot(self, ax: Any = None) -> Any:
        """Gain, phase and distortion over frequency, a line for each amplitude. Needs matplotlib."""
        return view("plot", self, ax=ax)


def frequency_response(
    diagram: Diagram,
    frequencies: Sequence[float] | np.ndarray,
    amplitudes: Sequence[float] | float = 1.0,
    *,
    driven: str | None = None,
    output: str | None = None,
    bias: float | None = None,
    inputs: Mapping[str, Any] | None = None,
    settle: int = 4,
    periods: int = 2,
    samples: int = 200,
    harmonics: int = 5,
    step: float = 1e-3,
    method: str = "rk4",
    threads: int | None = None,
    backend: str = "",
) -> FrequencyResponse:
    """Drive a diagram with sines and see what comes out, once all is periodic.

    ``frequencies`` are in Hz. ``driven`` is an input of the diagram (the only one), or a Sine block in it, ``output`` a
    signal (its only output). The sines go around ``bias`` (zero for an input, a Sine block's own offset); other
    ``inputs`` are constant. Of each run the first ``settle`` periods are left out, and the next ``periods`` taken apart
    into harmonics; where the answer still changes from period to period, more are left out, up to ``LONGEST``, and it
    is NaN where it changes even then, with a SettlingWarning. A period has ``samples`` steps at least, and no step is
    longer than ``step`` [s]. Outputs of sampled blocks are taken as they are held; where such jumps are delayed or
    added to what moves, the phase is known to half a step. Raises RunError for what is no input or output, and where
    sampled blocks do not fit into the period.
    """
    diagram = as_diagram(diagram)
    tuned, source = _driven(diagram, driven, None if bias is None else as_number("bias", bias))
    shown = _output(tuned, output)
    held = _is_held(equations(tuned), shown)
    f, a = _positive("frequencies", frequencies), _positive("amplitudes", amplitudes)
    count, rest, most = (
        as_integer("periods", periods, 1),
        as_integer("settle", settle, 0),
        as_integer("harmonics", harmonics, 1),
    )
    longest, least = as_positive("step", step), as_integer("samples", samples, 4 * most)
    constant, kept = as_inputs(inputs), list(dict.fromkeys([f"{source}.y", shown]))
    response = np.full((len(a), len(f)), np.nan, dtype=complex)
    over = np.full((len(a), len(f), most - 1), np.nan)
    for k, one in enumerate(f):
        n, left_out = max(least, math.ceil(1.0 / (one * longest))), rest
        if n * (rest + count) > MOST_STEPS:
            raise RunError(
                f"a run at {one:g} Hz would take {n * (rest + count):,} steps. Take a longer step, or leave "
                "such frequencies out."
            )
        waiting = np.arange(len(a))
        while len(waiting):
            sets = {f"{source}.amplitude": a[waiting], f"{source}.frequency": np.full(len(waiting), one)}
            stop = (left_out + count) / one
            options = RunOptions(stop, 1.0 / (one * n), 0.0, method, constant, "zero", backend=backend)
            batch = batch_of(tuned, sets, options, kept)
            found = batch.results(0, batch.count, _Harmonics(f"{source}.y", shown, n, count, most, held), threads)
            settled = ~(found["change"] > SETTLED)
            done = waiting[settled]
            response[done, k] = found["response"][settled]
            for m in range(2, most + 1):
                over[done, k, m - 2] = found[f"harmonic {m}"][settled]
            waiting, left_out = waiting[~settled], 4 * max(left_out, 1)
            if left_out > LONGEST or n * (left_out + count) > MOST_STEPS:
                break
    name, unit = driven or (next(iter(diagram.inputs)) if source == TONE else source), tuned.unit(f"{source}.y")
    _warn_of_unsettled(shown, f, a, np.isnan(response), unit)
    return FrequencyResponse(diagram.title, name, shown, f, a, response, over, unit)


def _warn_of_unsettled(shown: str, f: np.ndarray, a: np.ndarray, where: np.ndarray, unit: str) -> None:
    if not where.any():
        return
    factor, label = for_people(unit)
    points = [f"{factor * a[i]:.3g} {label}".rstrip() + f" at {f[k]:.3g} Hz" for i, k in np.argwhere(where)]
    warnings.warn(
        f"the answer of '{shown}' to {len(points)} of {where.size} sines never becomes periodic: {listed(points, 3)}. "
        "It is NaN there. A loop that hunts at a frequency of its own does that, and a signal that drifts; "
        "tsm.simulate shows which.",
        SettlingWarning,
        stacklevel=3,
    )


@attrs.frozen
class _Harmonics:
    """Takes the last periods of runs apart: ``n`` steps each, ``count`` of them."""

    driven: str
    shown: str
    n: int
    count: int
    most: int
    held: bool = False
    """Whether the output is that of samples: it stands still over a step, and is taken apart as such."""

    def __call__(self, t: np.ndarray, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        x, y = (signals[name][-self.n * self.count - 1 : -1] for name in (self.driven, self.shown))
        last, before = (signals[self.shown][len(t) - 1 - k * self.n : len(t) - 1 - (k - 1) * self.n] for k in (1, 2))
        turns = np.exp(-2j * np.pi * np.outer(np.arange(1, self.most + 1), np.arange(len(x))) / self.n)
        with np.errstate(all="ignore"):
            into, out = turns[:1] @ x, turns @ y
            if self.held:
                angles = 2j * np.pi * np.arange(1, self.most + 1) / self.n
                out = out * ((1.0 - np.exp(-angles)) / angles)[:, None]  # the integral over a step, not its begin
            size = np.maximum(np.abs(last - last.mean(axis=0)).max(axis=0), STILL * np.abs(x).max(axis=0))
            change = np.abs(last - before).max(axis=0) / size if len(before) == len(last) else np.inf * size
            reach = np.maximum(np.abs(x).max(axis=0), np.abs(y).max(axis=0))
            still = np.abs(y - y.mean(axis=0)).max(axis=0) <= STILL * reach
            made = {"response": np.where(still, 0.0, out[0] / into[0]), "change": np.where(still, 0.0, change)}
            return made | {
                f"harmonic {m}": np.where(still, np.nan, np.abs(out[m - 1] / out[0])) for m in range(2, self.most + 1)
            }


def _driven(diagram: Diagram, name: str | None, bias: float | None) -> tuple[Diagram, str]:
    """The diagram with a sine that can be tuned, and the sine's name."""
    tones = [k for k, b in diagram.blocks.items() if isinstance(b, Sine)]
    known = [*diagram.inputs, *tones]
    if name is None:
        if len(diagram.inputs) != 1 and (diagram.inputs or len(tones) != 1):
            raise RunError(f"say which input of '{diagram.title}' is driven: driven='…'.{near('', known)}")
        name = known[0]
    if name in diagram.inputs:
        ports = diagram.inputs[name].ports
        others = {k: v for k, v in diagram.inputs.items() if k != name}
        tone = Sine(unit=diagram.inports[name].unit or "", offset=bias or 0.0)
        if TONE in diagram.blocks:
            raise RunError(f"'{diagram.title}' has a block '{TONE}', which is the name of the source put in here.")
        return diagram.rewire(
            blocks={**diagram.blocks, TONE: tone}, inputs=others, add=[f"{TONE} -> {', '.join(ports)}"]
        ), TONE
    if name not in tones:
        raise RunError(f"'{diagram.title}' has no input and no Sine block '{name}'.{near(name, known)}")
    return diagram if bias is None else diagram.with_parameters({f"{name}.offset": bias}), name


def _is_held(eq: Equations, name: str) -> bool:
    """Whether a signal is made of held outputs of sampled blocks alone."""
    signal = eq.aliases.get(name, name)
    if signal not in eq.y:
        return False
    given = dict(zip(("t", "x", "d", "u", "q", "p"), eq.rhs.sx_in(), strict=True))
    made = eq.rhs.call(list(given.values()))[1][eq.y.index(signal)]
    others = [given["d"][k] for k, name in enumerate(eq.d) if not name.endswith(HELD)]
    moving = ca.vertcat(*(given[k] for k in ("t", "x", "u", "q")), *others)
    return bool(ca.depends_on(made, given["d"]) and not ca.depends_on(made, moving))


def _output(diagram: Diagram, name: str | None) -> str:
    if name is not None:
        return name
    if len(diagram.outputs) != 1:
        raise RunError(f"say which signal of '{diagram.title}' is looked at: output='…'.{near('', diagram.outputs)}")
    return next(iter(diagram.outputs))


def _positive(what: str, values: Any) -> np.ndarray:
    try:
        array = np.atleast_1d(np.asarray(values, dtype=float)) if not isinstance(values, str) else np.empty(0)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != 1 or not len(array) or not (np.isfinite(array) & (array > 0)).all():
        raise RunError(f"{what} must be positive numbers, got {in_words(values)}.")
    return array
