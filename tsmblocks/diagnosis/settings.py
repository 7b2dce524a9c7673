"""Settings and provenance of a diagnosis: simulation settings, recordings, options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs

from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.data import Record, heading
from tsmblocks.data.noise_floor import Noise


@attrs.frozen
class Simulated:
    """How the last model was simulated: all that is needed to reproduce its errors.

    ``start_states`` holds the estimated initial states by experiment, in the diagram's units, ``steps`` [s] the steps.
    ``conditioned`` are the inputs whose noise was filtered out (``Record.conditioned``), ``outputs`` those compared.
    ``pieces`` holds, for each piece (``experiment#1``) at which the simulation restarts, the first instant [s], the
    first that is compared and the last; empty where there are none.
    """

    start_states: Mapping[str, Mapping[str, float]]
    steps: Mapping[str, float]
    outputs: tuple[str, ...]
    conditioned: tuple[str, ...] = ()
    integrator: str = "rk4"
    hold: Hold = AUTO
    pieces: Mapping[str, tuple[float, float, float]] = attrs.field(factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, numbers with all digits."""
        return {
            "steps": dict(self.steps),
            "integrator": self.integrator,
            "hold": dict(self.hold) if isinstance(self.hold, Mapping) else self.hold,
            "conditioned": list(self.conditioned),
            "outputs": list(self.outputs),
            "pieces": {name: list(one) for name, one in self.pieces.items()},
        }


@attrs.frozen
class FloorParts:
    """What an estimated noise floor consists of, in the unit of the output.

    ``value`` is the rms noise of the output with its 95 % interval ``low`` to ``high``; ``from_inputs`` the rms noise
    that noise of measured inputs causes in the simulated output. ``recordings`` holds what each recording alone shows.
    """

    value: float
    low: float
    high: float
    from_inputs: float
    recordings: Mapping[str, Noise]


@attrs.frozen
class Recording:
    """A recording that was diagnosed: experiment, file, signals with units, number of samples and sampling step [s].

    ``origin`` is the name of the file without its folder; empty for a record made in memory.
    """

    experiment: str
    origin: str
    signals: tuple[str, ...]
    samples: int
    step: float

    @property
    def words(self) -> str:
        """``run_big.csv: x_in [deg], x_out [deg]; 4000 samples, 0.01 s apart``."""
        file = f"{self.origin}: " if self.origin else ""
        return f"{file}{', '.join(self.signals)}; {self.samples} samples, {self.step:.4g} s apart"


@attrs.frozen
class Provenance:
    """Version, source of the diagram, recordings and options of a diagnosis."""

    version: str
    source: str
    recordings: tuple[Recording, ...]
    options: Mapping[str, str]


def recorded(records: Mapping[str, Record], used: Sequence[str]) -> tuple[Recording, ...]:
    """The recordings, with the signals that the diagram uses."""
    result = []
    for name, r in records.items():
        file = r.origin.replace("\\", "/").rpartition("/")[2]
        signals = tuple(heading(k, r.unit(k)) for k in r.names if k in used)
        result.append(Recording(name, file, signals, len(r), r.step))
    return tuple(result)
