"""Effects that noise of measured inputs explains as well are left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.diagnosed_part import Omission
from tsmblocks.diagnosis.input_spectrum import ErrorsByInput, Likelihood, likelihood
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.rejection import FROM_INPUTS
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

MIN_ERROR = 1.2
"""Mean square of a residual [that of the outputs' noise] from which noise of the inputs is looked for in it. Chosen."""


def beside_inputs(model: Model, errors: Mapping[int, ErrorsByInput]) -> Likelihood | None:
    """What noise of the inputs explains of a residual; None where no input is noisy, or the outputs' noise is all."""
    if not errors or np.mean(model.differences**2) < MIN_ERROR:
        return None
    return likelihood(model, errors)


def without_effects_of_noise(
    rounds: Sequence[SearchRound], search: SearchContext, errors: Mapping[int, ErrorsByInput]
) -> tuple[list[SearchRound], list[Omission]]:
    """Rounds of those effects that make the residual more likely than noise of the inputs does, and the others.

    The first effects are kept that make it most likely, with noise of the most likely spectrum beside each model. Every
    parameter costs as much as in the criterion of Schwarz, and every candidate among which one was chosen as well.
    Source: Schwarz, Estimating the dimension of a model, Ann. Stat. 6 (1978).
    """
    count = accepted_count(rounds, search)
    named = [one.verdict.named for one in rounds[: max(count, 1)] if one.verdict.named is not None]
    if not named or not errors:
        return list(rounds), []
    models = (
        [rounds[0].base, *(one.base for one in rounds[1 : count + 1])] if count else [rounds[0].base, named[0].model]
    )
    costs, penalty = list[float](), 0.0
    for k, model in enumerate(models):
        if k:
            added = max(len(model.theta) - len(models[k - 1].theta), 1)
            penalty += added * np.log(len(model.r)) + 2 * np.log(max(len(rounds[k - 1].screening_scores), 1))
        costs.append(likelihood(model, errors).deviance + penalty)
    kept = int(np.argmin(costs))
    if kept == len(named):
        return list(rounds), []
    last = rounds[kept]
    omitted = [Omission.of(rounds, one, FROM_INPUTS) for one in named[kept:]] if count else []
    closed = attrs.evolve(last, verdict=attrs.evolve(last.verdict, named=None, indistinguishable=()))
    return [*rounds[:kept], closed], omitted
