"""An effect that explains only a part of an error that repeats with the motion is another effect than the one named."""

from __future__ import annotations

from collections.abc import Sequence

from tsmblocks.diagnosis.acceptance import MIN_JOINT_SHARE, attained_noise
from tsmblocks.diagnosis.decision import mean_loss
from tsmblocks.diagnosis.evidence import Evidence
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.diagnosis.varying_factor import VaryingFactor

MIN_SHARE_OF_PREDICTED = 0.5
"""Share of what effects remove that was predicted from the motion, from which they act on that error. Chosen: most of
it; a jump beside a wrong curve removes nothing of what the curve leaves, and its name holds."""


def stands_in(
    rounds: Sequence[SearchRound],
    count: int,
    before: Evidence,
    left: Evidence,
    varying: VaryingFactor | None,
    search: SearchContext,
) -> bool:
    """Whether the ``count`` effects that were named leave so much of a repeating error that their names do not hold.

    A block differs in form from a real effect by a part of the error. Where more than 1 - ``MIN_JOINT_SHARE`` of the
    excess is left, and it is no noise since the motion predicts it (``left``; ``before`` without effects) or it is
    proportional to the motion (``varying``), the effect is another one.
    """
    if not count:
        return False
    loss, rest = (mean_loss(rounds[k].losses, search.blocks) for k in (0, count))
    explained = before.predicted - left.predicted
    shares = [varying.share] if varying is not None and varying.material else []
    shares += [left.share] if left.material and explained >= MIN_SHARE_OF_PREDICTED * (loss - rest) else []
    noise = min(attained_noise(rounds, search), (1 - max(shares, default=0.0)) * rest)
    return bool(shares) and loss - rest < MIN_JOINT_SHARE * (loss - noise)
