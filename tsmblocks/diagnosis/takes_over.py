"""An effect in parallel with the model that takes its place: the model itself is fitted away."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tsmblocks.diagnosis.model import Model
from tsmblocks.effects import Effect, Relative
from tsmblocks.model.diagram import Diagram

PARALLEL = "parallel"
"""The place of effects in parallel with the model."""
LEFT_OF_MODEL = 0.1
"""Share of a gain that is left, below which what it multiplies is switched off. Chosen: a diagram was drawn for more,
and where two gains in a row share the loss, less than a hundredth of their product is left."""


def switches_off(fitted: Model, base: Model, effects: Iterable[Effect | Relative], given: Mapping[str, float]) -> bool:
    """Whether a model with a branch in parallel has lost a gain of its base: only the branch is left.

    ``effects`` are those that the search tries, ``given`` the parameters of the diagram: a gain that is near these is
    not lost, however far the base without the branch was from them.
    """
    own = [one.block for one in effects if isinstance(one, Effect) and one.place == PARALLEL]
    branches = {one.title for one in own if isinstance(one, Diagram)}
    blocks = fitted.diagram.blocks.values()
    if not any(isinstance(one, Diagram) and one.title in branches for one in blocks):
        return False
    before, after = base.parameters(), fitted.parameters()
    least = {k: min(abs(value), abs(given.get(k, value))) for k, value in before.items() if k.endswith(".gain")}
    return any(abs(after[k]) < LEFT_OF_MODEL * value for k, value in least.items() if k in after)
