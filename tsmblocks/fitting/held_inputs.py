"""Whether the recorded outputs agree with a simulation whose inputs are held between samples, or otherwise different.

A command with a new value at each sample, held until the next, has the samples of a smooth motion. The simulation with
the one or the other differs by half a sample of delay, and the outputs tell which is right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.statistics import moved, uncertainty
from tsmblocks.fitting.step_size import halved

MAX_DISTANCE = 0.4
"""Distance of the estimated share of an alternative from 1 up to which it is taken. Chosen: a lag or a dead time that
is longer than the half sample by which a hold delays is no hold."""
CLEAR = 4.0
"""Share of an alternative, in its standard deviations, from which it is clear of 0. Chosen: recordings are not read
otherwise on a doubt."""
EXCLUDED = 3.0
"""Distance of a share below 1, in its standard deviations, at which it cannot be 1. Chosen: 99.7 %, normal."""

MAX_REST = 0.5
"""Mean square of a fit with an input held, over that without, below which it is reported. Chosen: half a sample of
delay, which is all that a hold adds, seldom removes as much of what else a model lacks."""
ROUGH_TOLERANCE = 1e-2
"""Predicted gain [variances of a sample] at which that fit ends. Chosen: its residual is reported in two digits."""


def setup_held(setup: Setup, name: str) -> Setup | None:
    """The setup with an input held between samples; None where it is the same, or a rate of the input is needed."""
    if setup.eq.orders.get(name, 0) or all(one.hold[name] == "zero" for one in setup.experiments):
        return None
    made = (setup.prepared(e, hold={**one.hold, name: "zero"}) for e, one in enumerate(setup.experiments))
    return attrs.evolve(setup, experiments=tuple(made))


def problem_held(problem: Problem, setup: Setup, name: str) -> Problem | None:
    """The problem with an input held between samples; None where it is the same, or a rate of the input is needed."""
    held = setup_held(setup, name)
    return None if held is None else attrs.evolve(problem, experiments=held.experiments)


def residuals_held(problem: Problem, setup: Setup, theta: np.ndarray, name: str) -> np.ndarray | None:
    """Residuals (N,) with an input held between samples; None where ``problem_held`` is."""
    held = problem_held(problem, setup, name)
    return None if held is None else held.residuals(theta)


def resolving_holds(problem: Problem, setup: Setup, name: str) -> tuple[Problem, Setup] | None:
    """A problem at a quarter of its step where the hold of an input is hidden in a dead time at its own.

    A dead time knows its input at the steps alone, where the two holds differ by half a step of dead time. None where
    nothing delays the input, where it is held already, or where that many steps do not fit into memory.
    """
    if name not in setup.eq.delayed_inputs or all(one.hold[name] == "zero" for one in setup.experiments):
        return None
    half = halved(problem, setup)
    return None if half is None else halved(*half)


@attrs.frozen
class Alternative:
    """Another way to simulate inputs beside a model: its share in each output, and what it would leave.

    ``shares`` are 1 where it is right and 0 where the model is; ``errors`` are their standard deviations; ``rest`` is
    the sum of squares with it.
    """

    shares: tuple[float, ...]
    errors: tuple[float, ...]
    rest: float

    def is_near(self, distance: float, clear: float = CLEAR) -> bool:
        """Whether an output shows a share near 1, clear of 0 by ``clear`` errors, and no other clearly less.

        More than 1 is what a further lag or dead time of one output makes of it; a lag of one output alone leaves the
        others at 0.
        """
        shown = self._where(lambda share, error: abs(share) > clear * error)
        less = self._where(lambda share, error: 1 - share > max(distance, EXCLUDED * error))
        return any(abs(share - 1) <= distance for share in shown) and min(shown) >= 1 - distance and not less

    def is_refuted(self, distance: float) -> bool:
        """Whether the outputs show a share away from 0, and none of them one near 0."""
        shown = self._where(lambda share, error: abs(share) > CLEAR * error)
        near = self._where(lambda share, error: abs(share) <= distance and CLEAR * error < 1)
        return any(abs(share) > distance for share in shown) and not near

    def _where(self, condition: Callable[[float, float], bool]) -> list[float]:
        """The shares for which a condition on them and their standard deviations holds, of those that have one."""
        pairs = zip(self.shares, self.errors, strict=True)
        return [share for share, error in pairs if 0 < error < np.inf and condition(share, error)]


def alternative(
    J: Jacobian, r: np.ndarray, other: np.ndarray, segments: Sequence[slice], held: np.ndarray | None, count: int
) -> Alternative | None:
    r"""The alternative whose residuals are ``other`` (N,) beside a model with residuals ``r``; None where equal.

    It is added to the residuals of each output with a share :math:`\alpha` beside the parameters, to first order:

    .. math:: r + \alpha (r_\mathrm{other} - r) + J \, \Delta\theta

    ``J`` (N, p) is the Jacobian, ``held`` (m, p) the gradients of active bounds; the ``segments`` are those of each
    experiment, and in it of each of ``count`` outputs.
    """
    if not np.isfinite(other).all() or np.array_equal(other, r):
        return None
    n, change = J.shape[1], np.zeros((len(r), count))
    for k, rows in enumerate(segments):
        change[rows, k % count] = (other - r)[rows]
    columns = np.append(J.common_columns, n + np.arange(count))
    both = attrs.evolve(J, common=np.column_stack([J.common, change]), common_columns=columns)
    bounds = None if held is None else np.pad(held, ((0, 0), (0, count)))
    shares = moved(both, r, held=bounds)[n:]
    errors = uncertainty(both, r, segments, held=bounds).errors[n:]
    return Alternative(tuple(shares.tolist()), tuple(errors.tolist()), square(other + J @ moved(J, other, held=held)))


def held_input_notes(
    problem: Problem,
    setup: Setup,
    theta: np.ndarray,
    r: np.ndarray,
    J: Jacobian,
    bounds: np.ndarray | None,
    may_be_held: Iterable[str],
    *,
    far: bool,
) -> Iterator[str]:
    """A note on each of some inputs that the outputs show to be held between samples.

    Where the residual is ``far`` above the noise, the linear prediction may miss it: the fit is repeated with each.
    """
    for name in may_be_held:
        if (finer := resolving_holds(problem, setup, name)) is not None:
            problem, setup = finer
            r = problem.residuals(theta)
        held = problem_held(problem, setup, name)
        other = None if held is None else held.residuals(theta)
        one = None if other is None else alternative(J, r, other, problem.segments, bounds, len(setup.outputs))
        if one is not None and one.is_near(MAX_DISTANCE) and one.rest < square(r):
            yield (
                f"the outputs agree with {name} held between samples, as at the output of a sampled controller, and "
                f"not with a smooth {name}: the residual would be about {np.sqrt(one.rest / square(r)):.2g} of what it "
                "is. Fit with hold='zero', or --hold zero."
            )
        elif held is not None and far:
            yield from _note_of_refit(held, theta, r, name)


def _note_of_refit(held: Problem, theta: np.ndarray, r: np.ndarray, name: str) -> Iterator[str]:
    """A note on an input where a fit with it ``held`` leaves much less than without, from where that one ended."""
    try:
        end = gauss_newton(held, theta, tolerance=ROUGH_TOLERANCE)
    except RunError:  # it does not run there
        return
    if 2 * end.cost < MAX_REST * square(r):
        yield (
            f"with {name} held between samples, as at the output of a sampled controller, a fit leaves "
            f"{np.sqrt(2 * end.cost / square(r)):.2g} of this residual. If it was, give hold='zero' (--hold zero)."
        )
