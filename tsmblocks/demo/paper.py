"""The paper's tracking experiments: three signals, without compensation, with feedforward, with feedback as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import attrs

from tsmblocks.blocks import MultiSine, Recorded, Sine
from tsmblocks.common import units
from tsmblocks.data import Record
from tsmblocks.files import load
from tsmblocks.metrics.tracking import TrackingError, tracking_error
from tsmblocks.simulation.simulate import simulate

DIAGRAMS = {
    "fig09a_without_feedforward": "without compensation",
    "fig09b_feedforward": "feedforward",
    "fig16_feedforward_feedback": "feedforward + PID",
}
"""Diagrams that are run, and their names in tables."""
STEP, STOP = 1e-3, 40.0
"""Step and duration of the simulation [s]: 8 periods of the slowest sine, the second half of them settled."""
WHY = (
    "The paper measured a real sheath. Its equations with its parameters reproduce the error without compensation, but "
    "not the one with feedforward. Even with a perfect model and an ideal motor the feedforward leaves 13 deg: it "
    "evaluates the hysteresis state and the slope at the reference (Eq. 14), but those of the plant follow the motor, "
    "which moves much further than the reference around a reversal, so that the plant's hysteresis switches sooner."
)
"""Why the simulated errors differ from those measured in the paper."""
HEADINGS = ("signal", "diagram", "peak to peak [deg]", "rms [deg]", "largest [deg]", "paper, peak to peak [deg]")


@attrs.define
class Case:
    """One reference signal: the source that makes it, the runs on it, and what the paper measured [deg]."""

    key: str
    words: str
    source: Any
    stop: float = STOP
    paper: tuple[float | None, ...] = (None, None, None)
    runs: dict[str, Any] = attrs.field(factory=dict)

    @property
    def settled(self) -> float:
        """Instant from which on the error counts [s]."""
        return self.stop / 2

    def error(self, diagram: str) -> TrackingError | None:
        """Tracking error of one diagram in deg, None when it was not run."""
        run = self.runs.get(diagram)
        return tracking_error(run, after=self.settled).to("deg") if run is not None else None


def cases() -> list[Case]:
    """The paper's three signals."""
    one = Sine(amplitude=math.radians(55.0), frequency=0.2, unit="rad")
    tones: dict[str, Any] = dict(amplitudes=(math.radians(28.0),) * 2, phases=(0.0, 0.0), unit="rad")
    two = MultiSine(frequencies=(0.2, 0.5), **tones)
    no_period = MultiSine(frequencies=(0.25, 0.25 * math.sqrt(3)), **tones)
    return [
        Case("sine", "55 deg at 0.2 Hz", one, paper=(27.0, 8.0, 5.8)),
        Case("two_sines", "28 deg at 0.2 and 0.5 Hz", two, paper=(27.0, 8.5, None)),
        Case("no_period", "28 deg at 0.25 and 0.25√3 Hz", no_period, paper=(28.0, 9.2, None)),
    ]


def measured_case(record: Record, name: str, unit: str) -> Case:
    """A measured reference, as a recorded signal that begins at t = 0; ``unit`` is its unit where the record has none.

    Raises UnitError where that is no angle.
    """
    values = record.values(name, "rad") if record.unit(name) else record[name] * units.factor(unit, "rad")
    t = record.t - record.t[0]
    stop = math.floor(float(t[-1]) / STEP) * STEP
    source = Recorded(times=tuple(t), values=tuple(values), hold="cubic", unit="rad")
    return Case("measured", f"{name} as measured, {stop:.4g} s", source, stop=stop)


def run(chosen: Sequence[Case], progress: Callable[[float], None] | None = None) -> bool:
    """Run every diagram on every signal; False when Ctrl-C came in between."""
    plans = [(case, name) for case in chosen for name in DIAGRAMS]
    diagrams = {name: load(name) for name in DIAGRAMS}
    for k, (case, name) in enumerate(plans):
        if progress:
            progress(k / len(plans))
        made = simulate(diagrams[name].replace("ref", case.source), stop=case.stop, step=STEP, log="outputs")
        if not made.complete:
            return False
        case.runs[name] = made
    return True


def rows(chosen: Sequence[Case]) -> list[list[str]]:
    """The table as a file holds it: one row for each signal and diagram."""
    made = [list(HEADINGS)]
    for case in chosen:
        for name, paper in zip(DIAGRAMS, case.paper, strict=True):
            error = case.error(name)
            if error is not None:
                numbers = (error.peak_to_peak, error.rms, error.largest)
                made.append([case.words, name, *(f"{x:.6g}" for x in numbers), "" if paper is None else f"{paper:g}"])
    return made


def compared(chosen: Sequence[Case]) -> list[tuple[str, ...]]:
    """The table as people read it: one row for each signal, peak-to-peak errors in deg beside the paper's."""
    made = []
    for case in chosen:
        errors = [case.error(name) for name in DIAGRAMS]
        shown = ["-" if e is None else f"{e.peak_to_peak:.1f}" for e in errors]
        paper = " / ".join("-" if p is None else f"{p:g}" for p in case.paper)
        made.append((case.words, *shown, paper if any(case.paper) else "-"))
    return made
