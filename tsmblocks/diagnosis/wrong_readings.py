"""Wrong readings of a sensor: single samples far off their neighbours. They have no weight, as samples not measured."""

from __future__ import annotations

from collections.abc import Mapping

import attrs
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tsmblocks.common.interpolation import interpolation
from tsmblocks.data import Record
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.table import plural
from tsmblocks.diagnosis.decision import MAD_TO_STANDARD_DEVIATION
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.outliers import MIN_SHARE
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.recordings import as_recorded

FARTHEST = 8.0
"""Distance from the neighbours beyond which a sample of the residual is a wrong reading [median distance]. Chosen:
more than five standard deviations of a normal one."""
BESIDE = 3
"""Neighbours on either side. Chosen: fewer show little of how far noise goes, and more of how the motion bends."""
LOCAL_RATIO = 5.0
"""The same over the range of the neighbours about their line. Chosen: at kinks and jumps it is 2 at most."""
MIN_QUANTA = 4.0
"""The same in steps of a quantised signal. Chosen: one that rests near the edge of a step flickers by one."""
MAX_AT_JUMPS = 0.2
"""Share of an input's jumps with such a sample, from which it is the answer to them. Chosen."""
JUMP_RATIO = 6.0
"""Change of an input from sample to sample that is a jump [median change]. Chosen: of a sine none is."""
AFTER_JUMP = 3
"""Samples from a jump on that may be the answer to it. Chosen: one for a delay, and one before and behind."""


def off_neighbours(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each sample (n,) is off the line through ``BESIDE`` on either side, and the range of these about it.

    The line is the median one through a pair. Of the neighbours that do not adjoin the sample the farthest from it is
    not in the range: it may be a wrong reading too. Samples with fewer neighbours are not off.
    """
    off, around = np.zeros(len(x)), np.full(len(x), np.inf)
    if len(x) > 2 * BESIDE:
        places = np.arange(1.0, BESIDE + 1)
        windows = sliding_window_view(x, 2 * BESIDE + 1)
        before, after = windows[:, BESIDE - 1 :: -1], windows[:, BESIDE + 1 :]
        middle, slope = np.median((before + after) / 2, axis=1), np.median((after - before) / (2 * places), axis=1)
        line = np.multiply.outer(slope, np.r_[-places, places])
        rest = np.hstack([before, after]) - middle[:, None] - line
        beside, others = rest[:, [0, BESIDE]], np.sort(np.delete(rest, [0, BESIDE], axis=1), axis=1)
        off[BESIDE:-BESIDE] = windows[:, BESIDE] - middle
        without_one = [np.ptp(np.hstack([beside, some]), axis=1) for some in (others[:, 1:], others[:, :-1])]
        around[BESIDE:-BESIDE] = np.minimum(*without_one)
    return off, around


def without_wrong_readings(base: Model, records: Mapping[str, Record]) -> tuple[dict[str, Record], list[str]]:
    """The recordings with wrong readings of the outputs interpolated, without weight, and a note on each output.

    A wrong reading is off its neighbours in the measured signal, and in the residual of the base, which follows fast
    motion. Others are left as they are: those at the jumps of an input may be the answer to it.
    """
    found, notes = dict(records), list[str]()
    for k, name in enumerate(base.setup.outputs):
        marks, largest = _marks(base, k, records)
        count = sum(int(mask.sum()) for mask in marks.values())
        if not count:
            continue
        found = {key: _interpolated(one, name, marks[key]) if key in marks else one for key, one in found.items()}
        notes.append(_note(name, count, sum(map(len, records.values())), largest, base, records))
    return found, notes


@attrs.frozen
class _Largest:
    """The wrong reading that is farthest off its neighbours: recording, instant [s] and distance."""

    record: str
    t: float
    distance: float


@attrs.frozen(eq=False)
class _Compared:
    """The samples of an output in an experiment as they were recorded: their places in the recording, instants [s],
    values, residual there, and the values of the inputs. The experiment may be on an even grid instead.
    """

    record: str
    places: np.ndarray
    t: np.ndarray
    y: np.ndarray
    r: np.ndarray
    inputs: tuple[np.ndarray, ...]


def _compared(base: Model, k: int, records: Mapping[str, Record]) -> list[_Compared]:
    """The samples of an output in each experiment."""
    found, name, weight = list[_Compared](), base.setup.outputs[k], base.problem.weights[k]
    rows, differences = base.problem.segments[k :: len(base.setup.outputs)], base.differences
    for experiment, part in zip(base.setup.experiments, rows, strict=True):
        own = experiment_of(experiment.name)
        record, simulated = records[own], experiment.measured[:, k] + differences[part] / weight
        margin = 1e-6 * record.step
        places = np.flatnonzero((record.t >= experiment.t[0] - margin) & (record.t <= experiment.t[-1] + margin))
        t, y = record.t[places], record.values(name, base.diagram.unit(name))[places]
        same = len(t) == len(experiment.t) and np.allclose(t, experiment.t, rtol=0, atol=margin)
        r = (simulated if same else interpolation(experiment.t, simulated, "cubic")(t)) - y
        inputs = tuple(record[one][places] for one in experiment.hold if one in record)
        found.append(_Compared(own, places, t, y, r, inputs))
    return found


def _marks(base: Model, k: int, records: Mapping[str, Record]) -> tuple[dict[str, np.ndarray], _Largest]:
    """Which samples of an output are wrong readings, by recording where there are some, and the largest.

    There are none where those together hold little: a single one may be a fast motion, and hardly changes a fit.
    """
    parts = _compared(base, k, records)
    off = [off_neighbours(one.r) for one in parts]
    typical = float(np.median(np.abs(np.concatenate([distance[BESIDE:-BESIDE] for distance, _ in off]))))
    marks, largest, held = dict[str, np.ndarray](), _Largest("", 0.0, 0.0), 0.0
    if not typical > 0:
        return {}, largest
    for one, (distance, around) in zip(parts, off, strict=True):
        far = _distances(one, (np.abs(distance) > FARTHEST * typical) & (np.abs(distance) > LOCAL_RATIO * around))
        if not far.any():
            continue
        held += square(distance[far > 0])
        mask = marks.setdefault(one.record, np.zeros(len(records[one.record]), dtype=bool))
        mask[one.places[far > 0]] = True
        most = int(np.argmax(far))
        largest = max(largest, _Largest(one.record, float(one.t[most]), float(far[most])), key=lambda x: x.distance)
    noise = sum(len(distance) for distance, _ in off) * (MAD_TO_STANDARD_DEVIATION * typical) ** 2
    return (marks if held >= MIN_SHARE * noise else {}), largest


def _distances(one: _Compared, off: np.ndarray) -> np.ndarray:
    """How far the wrong readings among samples whose residual is ``off`` are off in the recording; 0 for all others."""
    if not off.any():
        return np.zeros(len(off))
    far, around = off_neighbours(one.y)
    far = np.abs(far)
    wrong = off & (far > LOCAL_RATIO * around) & (far > MIN_QUANTA * (quantum_of(one.y) or 0.0))
    return np.where(wrong & ~_is_answer(wrong, [_jumps(x) for x in one.inputs]), far, 0.0)


def _jumps(x: np.ndarray) -> np.ndarray:
    """The samples at which an input jumps."""
    change = np.abs(np.diff(x))
    return 1 + np.flatnonzero(change > JUMP_RATIO * np.median(change)) if len(change) else np.zeros(0, dtype=int)


def _is_answer(wrong: np.ndarray, jumps: list[np.ndarray]) -> np.ndarray:
    """Which samples may be the answer to jumps of an input, since there is one at many of them."""
    result = np.zeros(len(wrong), dtype=bool)
    for at in jumps:
        near = np.minimum(at[:, None] + np.arange(AFTER_JUMP) - 1, len(wrong) - 1)
        if len(at) and wrong[near].any(axis=1).mean() > MAX_AT_JUMPS:
            result[near] = True
    return result


def _interpolated(record: Record, name: str, wrong: np.ndarray) -> Record:
    """A recording with some samples of a signal interpolated linearly, and marked as not measured."""
    x = np.where(wrong, np.interp(record.t, record.t[~wrong], record[name][~wrong]), record[name])
    gone = wrong | np.asarray(record.filled.get(name, False))
    return attrs.evolve(record, signals={**record.signals, name: x}, filled={**record.filled, name: gone})


def _note(name: str, count: int, samples: int, largest: _Largest, base: Model, records: Mapping[str, Record]) -> str:
    """A note on the wrong readings of an output."""
    distance = in_display_units(largest.distance, as_recorded(base.diagram, name, records.values()))
    one = count == 1
    return (
        f"{plural(count, 'sample')} of {name} ({100 * count / samples:.2g} %) "
        f"{'is far off its neighbours,' if one else 'are far off their neighbours, the farthest'} at t = "
        f"{largest.t:.6g} s of {largest.record} (by {distance}): taken for "
        f"{'a wrong reading' if one else 'wrong readings'}, without weight."
    )
