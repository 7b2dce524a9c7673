"""The demonstration on one mechanism: measured, identified, diagnosed, its compensators rebuilt."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import attrs

from tsmblocks.data import Record
from tsmblocks.demo import compensators
from tsmblocks.demo.compensators import Tracked
from tsmblocks.demo.mechanism import DEG, HIDDEN, INTERVAL, NOISE, Hidden, measured, model, truth
from tsmblocks.diagnosis.diagnose import diagnose
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.fitting.fit import fit
from tsmblocks.fitting.result import Fit
from tsmblocks.model.diagram import Diagram

FLOOR = math.hypot(NOISE, INTERVAL / math.sqrt(12))
"""Rms of noise and quantisation of the sensor at the tip [rad], as its data sheet would give it."""
FINE = 0.0025
"""Step of the models that are compared [s]. Chosen: a gap in front of one closes between two samples."""
TRACKED = "The mechanism itself was tracked, behind compensators on both models: see the page of the demonstration."
"""What the report of the diagnosis says of control, so that its numbers are those of the page."""
IDENTIFIED, AUGMENTED = "identified", "with what was found"
"""The two models compensators are built on."""


@attrs.frozen(eq=False)
class Story:
    """The recordings of a mechanism, the models identified from them, and the hidden effect.

    ``tracked`` are runs of the mechanism itself: first without compensation, then behind compensators on the model
    identified, and on that which the diagnosis gave.
    """

    name: str
    hidden: Hidden
    mechanism: Diagram = attrs.field(repr=False)
    records: Mapping[str, Record] = attrs.field(repr=False)
    fit: Fit = attrs.field(repr=False)
    diagnosis: Diagnosis = attrs.field(repr=False)
    tracked: tuple[Tracked, ...] = attrs.field(repr=False)

    def on(self, model: str) -> dict[str, Tracked]:
        """The runs behind compensators on one of the models, by the name of the compensator."""
        return {one.words: one for one in self.tracked if one.model == model}

    @property
    def models(self) -> tuple[str, ...]:
        """The models there are to build compensators on, in the order in which they were found."""
        return (IDENTIFIED, AUGMENTED) if self.diagnosis.effects else (IDENTIFIED,)


def build_story(name: str, seed: int, progress: Callable[[str, float], None] | None = None) -> Story:
    """Hide ``name`` (of ``HIDDEN``), measure, identify, diagnose, rebuild.

    ``progress`` is called with the stage and the share done.
    """
    progress = progress or (lambda *_: None)
    progress("measuring", 0.0)
    sheath = truth(HIDDEN[name])
    records = measured(sheath, seed)
    progress("identifying", 0.1)
    filtered = {name: record.conditioned(["x_in"]) for name, record in records.items()}
    found = fit(model(), filtered, seed=seed, step=FINE, start_states=True)  # as the diagnosis fits its base
    _raise_if_interrupted(found.status)
    progress("diagnosing", 0.2)
    diagnosis = diagnose(model(), records, noise_floor=f"{FLOOR / DEG}deg", seed=seed, step=FINE)
    _raise_if_interrupted(diagnosis.status)
    diagnosis = attrs.evolve(diagnosis, consequence=None, no_consequence=TRACKED if diagnosis.effects else "")
    progress("rebuilding the compensators", 0.7)
    tracked = [compensators.uncompensated(sheath), *compensators.compensated(sheath, found.diagram, IDENTIFIED)]
    if diagnosis.effects:
        progress("rebuilding the compensators", 0.85)
        tracked += compensators.compensated(sheath, diagnosis.augmented, AUGMENTED)
    return Story(name, HIDDEN[name], sheath, records, found, diagnosis, tuple(tracked))


def _raise_if_interrupted(status: str) -> None:
    """Raise KeyboardInterrupt where a search was stopped: the story needs complete results."""
    if status == "interrupted":
        raise KeyboardInterrupt
