"""Cautions on the parameters of a diagnosed model: those on initial states of many experiments are merged."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import attrs
import numpy as np

from tsmblocks.blocks import changes
from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.partition import PIECE_SEPARATOR, experiment_of
from tsmblocks.diagnosis.signal_paths import source_of
from tsmblocks.fitting.identifiability import NO_INFLUENCE, UNCERTAIN
from tsmblocks.fitting.recorded_range import beyond_range
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.text import estimate_cautions, tangled

OF_TIME = (
    changes.GainChange,
    changes.GainDrift,
    changes.SettlingGain,
    changes.HeatedGain,
    changes.TemporaryGain,
    changes.Jump,
    changes.Drift,
    changes.SettlingOffset,
    changes.TemporaryOffset,
)
"""Blocks that change a signal over time."""
MAX_STATE_CAUTIONS = 2
"""Cautions on initial states that are given one by one. Chosen: more of them hide the others."""

INCOMPLETE = "Confidence intervals account for noise only: the model error that remains is not included."
"""The caution on the parameters of a model that lacks something."""
MAYBE = "A part of the residual may be a model error; confidence intervals account for noise only."
"""The caution where no effect is found, and slow noise and a model error are indistinguishable."""
FAR_ABOVE = 1.5
"""Residual over the noise floor from which it is given. Chosen: more than the error of a noise floor."""
TIMES = ("time_constant", "time")
"""Parameters of lags and delays, which add up where they follow one another."""
MIN_SHARE_KEPT = 0.02
"""Time of a block of the model, as a share of that of an effect and of its own before the fit, below which it went to
zero. Chosen."""
MIN_LOSS_ACROSS = 0.05
"""Share of the variance above the noise floor by which an effect makes it larger on experiments held out, from which it
is reported. Chosen: below it the estimates of the other parameters may be the cause."""


def do_not_carry_over(across: Mapping[str, float | None]) -> list[str]:
    """A caution on effects that make the error of whole experiments held out larger.

    ``across`` has the share of the variance above the noise floor that each removes there, by the name of its block.
    """
    worse = [block for block, share in across.items() if share is not None and share < -MIN_LOSS_ACROSS]
    if not worse:
        return []
    verb, its = ("makes", "its") if len(worse) == 1 else ("make", "their")
    return [
        f"{listed(worse, 4)} {verb} the error of experiments that are held out whole larger: {its} parameters, fitted "
        "to the others, do not carry over to them."
    ]


def taken_over(fit: Fit, effects: Collection[str]) -> list[str]:
    """A caution where an effect does what a block of the model did, whose own parameter went to zero.

    ``effects`` are the names of the blocks that were added. A dead zone behind a lag is found in front of it, and then
    the lag in front of the dead zone.
    """
    known, said = {e.name: e for e in fit}, []
    others = [name for name in fit.diagram.blocks if name not in effects]
    for added, one, parameter in itertools.product(effects, others, TIMES):
        own, new = known.get(f"{one}.{parameter}"), known.get(f"{added}.{parameter}")
        if own and new and abs(own.value) < MIN_SHARE_KEPT * min(abs(new.value), abs(own.start)):
            said.append(
                f"{own.name} went to zero beside {added}, which takes its place: the model may lack no further "
                f"{parameter.replace('_', ' ')}, but have {one} at another place."
            )
    return said


def changes_in_a_row(fit: Fit, effects: Collection[str]) -> list[str]:
    """A caution where one change over time follows another on a signal: both may be parts of a change of another form.

    ``effects`` are the names of the blocks that were added. A coil whose resistance rises with the heat of its current
    is nearly one whose gain changes twice.
    """
    changing = {name for name in effects if isinstance(fit.diagram.blocks.get(name), OF_TIME)}
    sources = {name: source_of(fit.diagram, f"{name}.u").partition(".")[0] for name in changing}
    return [
        f"{before} and {name} change one signal over time: together they may be a change of another form, gradual or "
        "caused by what was not recorded, whose instants they are not."
        for name, before in sources.items()
        if before in changing
    ]


def cautions(fit: Fit, across: Mapping[str, float | None], complete: bool = True) -> list[str]:
    """Cautions on effects and estimates, a sentence each; initial states in one if many, or of pieces.

    ``across`` is that of ``do_not_carry_over``, for each block that was added; ``complete`` is False where the model
    leaves more than noise. Of correlations those with a parameter of an effect count: others do not bear on it.
    """
    fit = without(_with_correlations_of(fit, across), _idle(fit))
    every, others = estimate_cautions(fit), estimate_cautions(without(fit, _states(fit)))
    pieces = any(PIECE_SEPARATOR in name for name in _states(fit))
    few = len(every) - len(others) <= MAX_STATE_CAUTIONS and not pieces
    estimates = every if few else [*others, *_on_states(fit)]
    first = [
        *taken_over(fit, across),
        *changes_in_a_row(fit, across),
        *do_not_carry_over(across),
        *([] if complete else [INCOMPLETE]),
    ]
    return [*first, *estimates, *beyond_range(fit)]


def _with_correlations_of(fit: Fit, blocks: Collection[str]) -> Fit:
    """The fit without the correlations between parameters that are none of these blocks'."""
    own = np.array([name.partition(".")[0] in blocks for name in fit.names], dtype=bool)
    kept = own[:, None] | own[None, :] | np.eye(len(own), dtype=bool)
    return attrs.evolve(fit, covariance=np.where(kept, fit.covariance, 0.0))


def _states(fit: Fit) -> set[str]:
    """Names of the initial states of experiments."""
    return {e.name for e in fit if e.is_start and "@" in e.name}


def _idle(fit: Fit) -> set[str]:
    """The initial states that change nothing: their values are of no use."""
    return {name for u in fit.undetermined if u.kind == NO_INFLUENCE for name in u.names} & _states(fit)


def without(fit: Fit, names: Collection[str]) -> Fit:
    """A fit without the correlations, active bounds and indistinguishable combinations of some unknowns."""
    some = set(names)
    own = np.array([name in some for name in fit.names], dtype=bool)
    if not own.any():
        return fit
    covariance = np.where(own[:, None] | own[None, :], 0.0, fit.covariance)
    undetermined = tuple(u for u in fit.undetermined if some.isdisjoint(u.names))
    active = tuple(text for text in fit.active if some.isdisjoint(text.split()))
    return attrs.evolve(fit, covariance=covariance, undetermined=undetermined, active=active)


def _on_states(fit: Fit) -> list[str]:
    """What is not known of initial states: those that matter only with parameters in one sentence, the others by state.

    States that are poorly determined in the same experiments share a sentence.
    """
    states = _states(fit)
    mixed = [u.names for u in fit.undetermined if u.kind not in (NO_INFLUENCE, UNCERTAIN) and not states >= {*u.names}]
    mixed = [names for names in mixed if not states.isdisjoint(names)]
    tied = list(dict.fromkeys(name for names in mixed for name in names if name not in states))
    vague = {name for u in fit.undetermined if u.names not in mixed for name in u.names if name in states}
    vague |= {name for a, b, _ in tangled(fit) for name in (a, b) if name in states}
    vague |= {name for text in fit.active for name in text.split() if name in states}
    said = [f"{', '.join(tied)} and some initial states are determined only together."] if tied else []
    alike = dict[frozenset[str], list[str]]()
    for parameter in sorted({name.partition("@")[0] for name in vague}):
        own = frozenset(name.partition("@")[2] for name in vague if name.partition("@")[0] == parameter)
        alike.setdefault(own, []).append(parameter)
    for own, names in alike.items():
        verb, noun = ("is", "value") if len(names) == 1 else ("are", "values")
        said.append(f"The initial {noun} of {listed(names)} {verb} poorly determined in {_where(fit, own)}.")
    return said


def _where(fit: Fit, own: Collection[str]) -> str:
    """Experiments in words: ``33 of the 40 pieces``, ``piece 5 of rec2``, ``2 of the 6 experiments (rec1, rec2)``."""
    whole, ordered = {name.partition("@")[2] for name in _states(fit)}, sorted(own, key=list(fit.records).index)
    if PIECE_SEPARATOR not in ordered[0]:
        return f"{len(own)} of the {len(whole)} experiments ({listed(ordered, 2)})"
    if len(own) > MAX_STATE_CAUTIONS:
        return f"{'each' if len(own) == len(whole) else len(own)} of the {len(whole)} pieces"
    return listed([f"piece {one.rpartition(PIECE_SEPARATOR)[2]} of {experiment_of(one)}" for one in ordered])
