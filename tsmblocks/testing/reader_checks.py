"""Checks of a reader: a function that takes the path of a file and returns a Record."""

from __future__ import annotations

import gc
import random
import tempfile
import warnings
from collections.abc import Callable, Collection
from functools import cached_property
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import CONTROLS, DataError, ParameterError, TsmError, in_words
from tsmblocks.common.tables import few
from tsmblocks.data.files import read
from tsmblocks.data.record import Record
from tsmblocks.testing.promises import BrokenPromise, need
from tsmblocks.testing.suites import Suite

READER_CHECKS = Suite()
SPOILT = 40
"""Spoilt files that a reader is given. Chosen: a second or so."""
TIME_NAMES = ("t", "time")
"""Names that the time may have, which is no signal."""
LONGEST_STEP = 1e5
"""Seconds between two samples from which times are in another unit. Chosen: a day is 86,400 s."""
SHORTEST_STEP = 1e-12
"""Seconds between two samples below which they are. Chosen: faster than any recorder."""
BRACKETS = "[]()"
"""Characters that end a name where a unit begins."""


@attrs.frozen(eq=False)
class Reading:
    """A reader and a good file."""

    reader: Callable[[Any], Any]
    path: Path

    @cached_property
    def record(self) -> Record:
        """The record that it reads. Raises BrokenPromise for anything that is no record."""
        made = self.reader(self.path)
        need(isinstance(made, Record), f"a reader returns a Record, got {in_words(made)}.")
        return made  # type: ignore[no-any-return]


def check_reader(reader: Callable[[Any], Record], path: str | Path, *, skip: Collection[str] = ()) -> None:
    """Check a reader of your own: a function from the path of a file to a Record.

    Parameters
    ----------
    reader : callable
        The reader.
    path : str or Path
        A good file, which is not changed. Spoilt copies of it are read, too.
    skip : list of str, default ()
        Names of checks that do not apply.

    Raises
    ------
    ChecksFailed
        Where checks fail; ``error.broken`` says what was wrong, by check.
    ParameterError
        For a reader that is no function, and for the name of a check that there is not.
    DataError
        For a file that is not there.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> from tsmblocks.testing import check_reader
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> path = tsm.Record("sine", t, {"x": np.sin(t)}, {"x": "rad"}).save("sine.csv")
    >>> check_reader(tsm.read, path)
    """
    if not callable(reader):
        raise ParameterError(f"a reader is a function from a path to a Record, got {in_words(reader)}.")
    if not Path(path).is_file():
        raise DataError(f"there is no file {path} to check the reader with.")
    name = getattr(reader, "__name__", type(reader).__name__)
    READER_CHECKS.run(f"reader '{name}'", Reading(reader, Path(path).resolve()), skip)


@READER_CHECKS.add
def gives_a_record(reading: Reading) -> None:
    """It returns a Record with a name, at least two samples and at least one signal."""
    record = reading.record
    need(len(record) > 1, f"the record has {len(record)} samples.")
    need(record.names, "the record has no signals.")
    need(record.name, "the record has no name.")


@READER_CHECKS.add
def times_are_seconds_that_increase(reading: Reading) -> None:
    """Times are finite, increase, and are in seconds."""
    steps = np.diff(reading.record.t)
    need(np.isfinite(reading.record.t).all(), "a time is not finite.")
    bad = np.flatnonzero(steps <= 0)
    need(not len(bad), f"the time does not increase at samples {few(map(str, bad + 1))}: sort it, and drop repeats.")
    step = float(np.median(steps))
    need(SHORTEST_STEP < step < LONGEST_STEP, f"samples are {step:g} s apart: times have to be in seconds.")


@READER_CHECKS.add
def signals_are_named_without_units(reading: Reading) -> None:
    """A name contains no unit, which is in ``units``, and the time is no signal."""
    for name in reading.record.names:
        need(name and name == name.strip(), f"signal {name!r} has blanks about its name.")
        need(not any(c in name for c in BRACKETS), f"signal {name!r} has its unit in its name; give it in units.")
        need(name.lower() not in TIME_NAMES, f"signal {name!r} is the time, which is the record's t.")
        need(not CONTROLS.search(name), f"signal {name!r} has control characters in its name.")


@READER_CHECKS.add
def units_are_known(reading: Reading) -> None:
    """Every unit is one that can be read and converted, and belongs to a signal."""
    for name, unit in reading.record.units.items():
        need(name in reading.record, f"a unit is given for {name!r}, which is no signal.")
        try:
            units.parse(unit)
        except units.UnitError as error:
            raise BrokenPromise(f"{name}: {error}") from None


@READER_CHECKS.add
def samples_are_numbers_or_filled(reading: Reading) -> None:
    """No sample is NaN or infinite; one that was not measured is interpolated and marked in ``filled``."""
    for name in reading.record.names:
        bad = np.flatnonzero(~np.isfinite(reading.record[name]))
        said = f"samples {few(map(str, bad))} of {name} are not finite"
        need(not len(bad), f"{said}: interpolate them, and mark them in filled.")


@READER_CHECKS.add
def reads_the_same_again(reading: Reading) -> None:
    """The file gives the same record each time, whether its path is a text or a Path."""
    for path in (reading.path, str(reading.path)):
        need(
            _same(reading.record, reading.reader(path)),
            f"read again as {type(path).__name__}, the file gives another record.",
        )


@READER_CHECKS.add
def reads_a_copy_elsewhere(reading: Reading) -> None:
    """A copy of the file in another folder gives the same signals: nothing else is read, and no name is built in."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"copy of it{reading.path.suffix}"
        copy.write_bytes(reading.path.read_bytes())
        need(_same(reading.record, reading.reader(copy)), "a copy of the file in another folder gives another record.")


@READER_CHECKS.add
def leaves_the_file_alone(reading: Reading) -> None:
    """The file is as it was, and closed."""
    before = reading.path.read_bytes()
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        reading.reader(reading.path)
        gc.collect()
    need(reading.path.read_bytes() == before, "it changes the file.")
    left = [
        str(w.message) for w in heard if issubclass(w.category, ResourceWarning) and reading.path.name in str(w.message)
    ]
    need(not left, "it leaves the file open: use with open(...).")


@READER_CHECKS.add
def says_what_is_missing(reading: Reading) -> None:
    """For a file that is not there it raises an error of this package, with the name of the file."""
    missing = reading.path.with_name(f"no such file{reading.path.suffix}")
    said = _refusal(reading, missing)
    need(said is not None, "it reads a file that is not there.")
    need("no such file" in str(said), f"its error does not name the file that is not there: {said}")


@READER_CHECKS.add
def refuses_spoilt_files(reading: Reading) -> None:
    """For a file that is cut short or changed it gives a record, or an error of this package that names the file."""
    content, rng = reading.path.read_bytes(), random.Random(1)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / f"spoilt{reading.path.suffix}"
        for k in range(SPOILT):
            path.write_bytes(_spoilt(content, k, rng))
            said = _refusal(reading, path)
            need(said is None or "spoilt" in str(said), f"its error does not name the spoilt file: {said}")


@READER_CHECKS.add
def survives_a_file(reading: Reading) -> None:
    """The record can be written as CSV and read back."""
    with tempfile.TemporaryDirectory() as folder:
        path = reading.record.save(Path(folder) / "again.csv")
        again = read(path)
    need(again.names == reading.record.names, f"written as CSV, its signals are called {', '.join(again.names)}.")
    need(_same(reading.record, again), "written as CSV and read back, it differs.")


def _spoilt(content: bytes, k: int, rng: random.Random) -> bytes:
    """An empty file, one that is cut short, or one with some bytes changed or doubled."""
    place = rng.randrange(len(content) + 1)
    if k == 0:
        return b""
    if k % 3 == 0:
        return content[:place]
    if k % 3 == 1:
        return (
            content[:place]
            + bytes(rng.randrange(256) for _ in range(rng.randint(1, 8)))
            + content[place + rng.randint(0, 8) :]
        )
    return content[:place] + content[max(place - 20, 0) : place] * rng.randint(1, 5) + content[place:]


def _refusal(reading: Reading, path: Path) -> TsmError | None:
    """The error of this package that a file gives; None where it is read. Raises BrokenPromise for any other."""
    try:
        made = reading.reader(path)
    except TsmError as error:
        return error
    except Exception as error:
        raise BrokenPromise(
            f"{path.name} gives {type(error).__name__}: {error}. Raise a DataError, which names the file."
        ) from error
    need(isinstance(made, Record), f"{path.name} gives {in_words(made)} instead of a Record.")
    return None


def _same(one: Record, other: Any) -> bool:
    """Whether two records have the same times, signals and units."""
    if not isinstance(other, Record) or one.names != other.names or dict(one.units) != dict(other.units):
        return False
    return np.array_equal(one.t, other.t) and all(np.array_equal(one[k], other[k], equal_nan=True) for k in one.names)
