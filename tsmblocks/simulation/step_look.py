"""The quick look at a run: the run, or the beginnings of some segments of it, in other steps; what is in doubt then."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.engine.equations import Equations
from tsmblocks.engine.session import check_delays
from tsmblocks.simulation.repeated_steps import Part, Taken, largest_over_last, scale_of

TOLERANCE = 5e-4
"""Error of an output, as a share of its largest value, from which there is a warning. Chosen: not seen in a plot."""
WHOLE_STEPS = 8192
"""Steps up to which all of a run is taken again. Chosen: for speed, a millisecond."""
SAMPLED_STEPS = 1024
"""Steps of a longer run that are taken again, at least. Chosen: for speed."""
SAMPLED_SHARE = 0.06
"""Share of a longer run that is taken again. Chosen: for speed."""
SEGMENTS, SHORTEST_SEGMENT = 24, 4096
"""Segments of which the beginnings are taken again, at most, and the fewest steps of one. Chosen: for speed."""
FEWEST_ACTIVE, ACTIVE_SHARE = 2, 0.1
"""Segments of a longer run in which signals bend sharply that are taken again, at least, and the share of the run that
they are otherwise. Chosen: for speed."""
SHARP = 0.1
"""How sharp such a bend is, as a share of the sharpest one. Chosen."""
SHORTEST_LOOK = 64
"""Steps of a segment that are taken again, at least. Chosen: more than a transient of a plant that suits the step."""
DOUBLED, HALVED = 0.25, 0.5
"""Share of the tolerance that differences in doubled and in halved steps may take without doubt. Derived for halved
steps, which show half of the error at order 1. Chosen for doubled ones, whose error may be alike by chance."""
MARGIN = 5.0
"""How much smaller than the tolerance a difference must be in halved steps where these are not taken but concluded from
those at other places. Chosen: orders of convergence differ within a run."""
GROWING_LOOKS = 2
"""Parts with growing differences that are looked at more closely, those that grow most. Chosen: for speed."""
DECAY_STEPS = 16
"""Steps that are examined beyond the last one in doubt. Chosen: few."""
GROWING = 1.5
"""Ratio of differences in the last half of some steps and in the quarter before, from which they grow with time.
Chosen: below 2, that of a steady drift."""
FOLLOWED = 4
"""How many times as long parts in which differences grow are followed. Chosen: for speed."""
DRIFT_STEPS = 20_000
"""Steps from the start that are taken again where parts suggest a drift. Chosen: for speed."""
STATE_WEIGHT = 10.0
"""How much larger the error of a state that is no output may be. Chosen: with 0.5 % a signal inside still serves."""
JUMP, JUMP_RATIO = 0.05, 5.0
"""Share of its range by which an output changes in a step that jumps, and how many times as much as in the steps before
and after: then it is not compared. Chosen: a smooth signal changes by much in some steps, but not in one alone."""
EXAMINED_STEPS = 50_000
"""Steps that are taken again in halved steps, at most. Chosen: for speed."""
MOST_EXAMINED_NUMBERS = 4_000_000
"""Numbers of a run that is taken again, at most (32 MB). Chosen."""


# ---- what is compared


def state_weights(eq: Equations) -> tuple[tuple[int, ...], np.ndarray]:
    """Positions of the states in ``eq.y``, and how much of their largest values counts as one."""
    states, shown = tuple(eq.y.index(name) for name in eq.x), _shown(eq)
    return states, np.array([1.0 if one in shown else STATE_WEIGHT for one in states])


def with_outputs(run: Taken, parts: Sequence[Part]) -> Taken:
    """The run with the outputs that do not jump in these parts of it compared too; the parts are of one length."""
    others = sorted(_shown(run.session.eq).difference(run.watched))
    if not others:
        return run
    columns = [run.kept_signals.index(one) for one in others]
    firsts = [(part.k - run.k) // run.every for part in parts]
    length = min(parts[0].n // run.every + 1, len(run.rows) - max(firsts))
    rows = np.stack([run.rows[first : first + length, columns] for first in firsts])
    extent = np.ptp(run.sample[:, columns], axis=0)
    smooth = [one for one, jumps in zip(others, jump_in(rows, extent), strict=True) if not jumps]
    return attrs.evolve(run, watched=(*run.watched, *smooth), weights=np.append(run.weights, np.ones(len(smooth))))


def _shown(eq: Equations) -> set[int]:
    """Positions of the outputs of the diagram."""
    return {eq.y.index(signal) for signal in eq.aliases.values()}


def jump_in(y: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Which signals, of shape (parts, rows, signals), jump from a row to the next; ``extent`` is the range of each."""
    large = JUMP * extent
    change = np.abs(np.diff(y, axis=1))
    if change.shape[1] < 3 or not (change.max(axis=(0, 1)) > large).any():
        return np.zeros(len(large), dtype=bool)
    around = np.zeros_like(change)
    around[:, 1:] += change[:, :-1]
    around[:, :-1] += change[:, 1:]
    return np.asarray(((change > large) & (change > JUMP_RATIO * around)).any(axis=(0, 1)))


# ---- parts


def can_be_doubled(run: Taken) -> bool:
    """Whether the run can be taken in steps of twice the length."""
    session = run.session
    held = any(s.function is None and s.hold == "zero" and len(s.t) > 2 for s, _ in session.signals)
    late = bool(session.eq.q) and min(check_delays(session.eq, run.begin.p, session.h)) < 4
    return run.k % 2 == 0 and not held and not late and all(n % 2 == 0 for n in session.hits)


def parts_of(run: Taken, finer: float) -> list[Part]:
    """The parts of a run, all of one length, that are looked at in steps ``finer`` times as short."""
    share = 1 if finer < 1 else 4
    whole, budget = WHOLE_STEPS // share, int(max(SAMPLED_STEPS, SAMPLED_SHARE * run.steps)) // share
    if run.steps <= whole or not run.session.marks:
        return [Part(run.begin, run.k, run.steps)]
    every, end, pair = run.session.mark_every, run.k + run.steps, 2 * run.every
    starts = [(run.k, run.begin), *run.session.marks]
    if run.complete:
        n = min(every, pair * -(-max(budget // len(starts), SHORTEST_LOOK) // pair))
        return [Part(memory, k, n) for k, memory in starts if k + n <= end]
    starts = [one for one in starts if one[0] + every <= end]
    count = max(2, min(len(starts), budget // every))
    chosen = sorted({round(i) for i in np.linspace(0, len(starts) - 1, count)})
    return [Part(starts[i][1], starts[i][0], every) for i in chosen]


def active_parts(run: Taken, parts: Sequence[Part]) -> list[Part]:
    """The segments, up to where logged signals bend most sharply and a little beyond, that the parts leave out."""
    if len(parts) == 1:
        return []
    starts, every = [(run.k, run.begin), *run.session.marks], run.session.mark_every
    bend = largest_over_last(np.abs(np.diff(run.sample, 2, axis=0)) / scale_of(run.sample))
    steps = np.arange(1, len(bend) + 1) * run.sampled_every * run.every
    bend[bend < SHARP * bend.max()] = 0.0
    for part in parts:
        bend[(steps > part.k - run.k) & (steps <= part.k - run.k + part.n)] = 0.0
    order = np.argsort(-bend)
    sharpest = dict[int, int]()
    for step in steps[order[bend[order] > 0]].tolist():
        sharpest.setdefault(step // every, step % every)
    count = max(FEWEST_ACTIVE, int(ACTIVE_SHARE * run.steps / every))
    within = [i for i in sharpest if (i + 1) * every <= run.steps]
    found = []
    for i in within[:count]:
        memory, k = starts[i][1], starts[i][0]
        unit = 2 * run.every if run.complete else every
        found.append(Part(memory, k, min(every, -(-(sharpest[i] + every // 8) // unit) * unit)))
    return found


# ---- looks


@attrs.frozen(eq=False)
class Look:
    """How far signals of a part differ in other steps, as a share of what counts as one: ``gap`` (rows,) where they are
    logged, each ``stride``-th step, and ``at_marks`` all states where the run has marks, if they are not logged.
    """

    run: Taken
    part: Part
    stride: int
    gap: np.ndarray
    at_marks: float

    @property
    def most(self) -> float:
        """The largest difference."""
        return max(float(self.gap.max(initial=0.0)), self.at_marks)

    @property
    def grown(self) -> float:
        """The last of a difference that grows from the second to the last quarters; 0 where it does not."""
        return grown(self.gap) if len(self.gap) else self.at_marks

    def doubt(self, allowed: float) -> Part | None:
        """The steps to examine where differences up to ``allowed`` are no doubt."""
        if self.at_marks > allowed:
            return self.part
        over = np.flatnonzero(self.gap > allowed)
        if not len(over):
            return None
        pair = 2 * self.run.every
        steps = pair * ((self.stride * int(over[-1]) + DECAY_STEPS) // pair + 1)
        return attrs.evolve(self.part, n=min(self.part.n, steps))


def looks_at(run: Taken, parts: Sequence[Part], finer: float) -> list[Look]:
    """Take parts of one length again in steps ``finer`` times as short."""
    stride, again = run.stride(finer), run.again(parts, finer)
    gaps, at_marks = np.empty((len(parts), 0)), [0.0] * len(parts)
    if run.columns:
        for gap, part in zip(again.rows, parts, strict=True):
            gap -= run.kept(part, stride)
        gaps = largest_over_last(np.abs(again.rows) / run.scale)
        gaps[np.isnan(gaps)] = np.inf
    if not run.complete:
        at_marks = [_gap_at_marks(run, part, x) for part, x in zip(parts, again.at_marks, strict=True)]
    found = zip(parts, gaps, at_marks, strict=True)
    return [Look(run, part, stride, gap, at) for part, gap, at in found]


def _gap_at_marks(run: Taken, part: Part, again: np.ndarray) -> float:
    """How far all states differ where the run has marks within a part."""
    marks = {k: memory.x for k, memory in run.session.marks} | {run.session.k: run.session.memory.x}
    within = [k for k in marks if part.k < k <= part.k + part.n]
    if len(again) < len(within):
        return np.inf
    scale = scale_of(np.array([run.begin.x, *marks.values()])) * run.weights[: len(run.begin.x)]
    gaps = [np.abs(x - marks[k]) / scale for k, x in zip(within, again, strict=False)]
    return float(np.nan_to_num(gaps, nan=np.inf).max(initial=0.0))


def grown(gap: np.ndarray) -> float:
    """The last of a difference over some steps that grows from the second to the last quarters; 0 if it does not."""
    quarter, half = len(gap) // 4, len(gap) // 2
    if quarter == half:
        return 0.0
    late = float(gap[half:].max())
    return late if late > GROWING * float(gap[quarter:half].max()) else 0.0


# ---- doubts


def doubts(run: Taken) -> list[Part]:
    """The steps in doubt."""
    finer = 0.5 if can_be_doubled(run) else 2.0
    allowed = TOLERANCE * (DOUBLED if finer < 1 else HALVED)
    parts = parts_of(run, finer)
    looks = looks_at(with_outputs(run, parts), parts, finer)
    others = [one for part in active_parts(run, parts) for one in looks_at(with_outputs(run, [part]), [part], finer)]
    found = _confirmed([*looks, *others], finer, allowed)
    if len(looks) > 1 and _drifts(run, looks, finer, allowed):
        found = _with_drift(run, found, finer, allowed)
    most = max(1, min(EXAMINED_STEPS, MOST_EXAMINED_NUMBERS // len(run.session.eq.x)))
    most = max(most - most % run.every, run.every)
    return [attrs.evolve(one, n=min(one.n, most)) for one in found]


def _confirmed(looks: list[Look], finer: float, allowed: float) -> list[Part]:
    """The doubts that are left of looks in doubled steps once they have been looked at in halved ones, the worst first.

    Differences at the others are taken to shrink in the same proportion, and are no doubt where they are small then.
    Where they still grow at the end of a part, it is made longer.
    """
    left = list[Part]()
    ratios = list[float]()
    for one in sorted(looks, key=lambda one: -one.most):
        part = one.doubt(allowed)
        if part is None or (ratios and one.most * max(ratios) <= TOLERANCE / MARGIN):
            break
        if finer > 1 or part.n == one.run.steps:
            left.append(part)
            continue
        halved = looks_at(one.run, [part], 2.0)[0]
        ratios.append(_shrinking(one, halved.most))
        if halved.most > (TOLERANCE if one.run.complete else HALVED * TOLERANCE):
            left.append(part)
        elif FOLLOWED * halved.grown > HALVED * TOLERANCE:
            left.append(_longer(one.run, part))
    return left


def _shrinking(look: Look, halved: float) -> float:
    """The ratio of differences in halved and in doubled steps, which say nothing where they leave the scale."""
    return halved / min(look.most, 1.0)


def _drifts(run: Taken, looks: list[Look], finer: float, allowed: float) -> bool:
    """Whether differences that grow in the parts of a run add up to more than is allowed.

    Those that grow most are looked at in halved steps, and followed for longer; the others are taken to behave alike.
    """
    all_of_it = run.steps / sum(one.part.n for one in looks)
    looks = sorted((one for one in looks if one.grown), key=lambda one: -one.grown)
    total = all_of_it * sum(one.grown for one in looks)
    if finer > 1 or total <= allowed:
        return total > allowed
    worst, others = looks[:GROWING_LOOKS], sum(one.grown for one in looks[GROWING_LOOKS:])
    run = worst[0].run
    halved = looks_at(run, [one.part for one in worst], 2.0)
    shrinking = max(_shrinking(one, after.most) for one, after in zip(worst, halved, strict=True))
    total = all_of_it * (sum(one.grown for one in halved) + shrinking * others)
    if total > HALVED * TOLERANCE and FOLLOWED * worst[0].part.n <= run.steps:
        followed = looks_at(run, [_longer(run, one.part) for one in worst], finer)
        total *= sum(one.grown for one in followed) / sum(FOLLOWED * one.grown for one in worst)
    return total > HALVED * TOLERANCE


def _longer(run: Taken, part: Part) -> Part:
    """A part that is ``FOLLOWED`` times as long, from the same step or the nearest before for which there is one."""
    n = min(FOLLOWED * part.n, run.steps)
    starts = [(run.k, run.begin), *run.session.marks]
    k, memory = max((one for one in starts if one[0] <= min(part.k, run.k + run.steps - n)), key=lambda one: one[0])
    return Part(memory, k, n)


def _with_drift(run: Taken, found: list[Part], finer: float, allowed: float) -> list[Part]:
    """The doubts where parts of a run suggest a drift: all of it if steps from the start on show it."""
    unit = 2 * run.every if run.complete else run.session.mark_every
    n = min(run.steps, DRIFT_STEPS) // unit * unit or run.steps
    longer = Part(run.begin, run.k, n)
    look = looks_at(with_outputs(run, [longer]), [longer], finer)[0]
    if look.grown * run.steps / n > allowed:
        return [Part(run.begin, run.k, run.steps)]
    doubt = look.doubt(TOLERANCE if finer < 1 else allowed)
    return found if doubt is None else [doubt, *(one for one in found if one.k >= run.k + n)]
