"""Effects that noise of measured inputs explains as well are left out."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.diagnosed_part import Omission
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.input_spectrum import ErrorsOfInputs, Likelihood
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.noise_filtering import filters_noise
from tsmblocks.diagnosis.rejection import LEFT_OUT_FOR_INPUTS
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

MIN_ERROR = 1.2
"""Mean square of a residual [that of the outputs' noise] from which noise of the inputs is looked for in it. Chosen."""


def beside_inputs(model: Model, errors: ErrorsOfInputs) -> Likelihood | None:
    """What noise of the inputs explains of a residual; None where no input is noisy, or the outputs' noise is all."""
    return errors.likelihood(model) if errors and _is_above_noise(model) else None


def _is_above_noise(model: Model) -> bool:
    """Whether a model leaves more than the noise of the outputs."""
    return bool(np.mean(model.differences**2) >= MIN_ERROR)


def exceeds_noise(errors: Callable[[], ErrorsOfInputs], before: Model, one: FittedCandidate, candidates: int) -> bool:
    """Whether an effect that was chosen among some candidates is more than noise of the inputs explains.

    It is where such noise is not enough, or where it makes the residual more likely, with noise of the most likely
    spectrum beside the model ``before`` it and the one with it, and does not just take that noise out of the input.
    Each parameter costs as much as in the criterion of Schwarz, and the choice as well.
    Source: Schwarz, Estimating the dimension of a model, Ann. Stat. 6 (1978).
    """
    found = errors()
    likely = beside_inputs(before, found)
    if likely is None or not likely.explains:
        return True
    if likely.deviance - found.likelihood(one.model).deviance <= _price(before, one.model, candidates):
        return False
    deviation = {name: float(np.std(np.concatenate(before.signals([name])))) for name in likely.noise}
    return not filters_noise(one.model, one.candidate, {k: share * deviation[k] for k, share in likely.noise.items()})


def without_effects_of_noise(
    rounds: Sequence[SearchRound], search: SearchContext, errors: ErrorsOfInputs
) -> tuple[list[SearchRound], list[Omission]]:
    """Rounds of the first effects that together exceed noise of the inputs most, and the effects after them.

    Effects stay without which such noise is not enough.
    """
    count = accepted_count(rounds, search)
    if not count or not errors or not _is_above_noise(rounds[0].base):
        return list(rounds), []
    found = [errors.likelihood(one.base) for one in rounds[: count + 1]]
    pairs = itertools.pairwise(rounds[: count + 1])
    prices = [_price(one.base, after.base, len(one.screening_scores)) for one, after in pairs]
    costs = [one.deviance + sum(prices[:k]) for k, one in enumerate(found)]
    kept = min((k for k, one in enumerate(found) if one.explains or k == count), key=costs.__getitem__)
    if kept == count:
        return list(rounds), []
    named, last = [one.verdict.named for one in rounds[kept:count] if one.verdict.named is not None], rounds[kept]
    closed = attrs.evolve(last, verdict=last.verdict.without_name)
    return [*rounds[:kept], closed], [Omission.of(rounds, one, LEFT_OUT_FOR_INPUTS) for one in named]


def _price(before: Model, after: Model, candidates: int) -> float:
    """What an effect has to gain: by the parameters that it adds, and the candidates among which it was chosen."""
    added = max(len(after.theta) - len(before.theta), 1)
    return float(added * np.log(len(after.r)) + 2 * np.log(max(candidates, 1)))
