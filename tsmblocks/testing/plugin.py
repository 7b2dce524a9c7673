"""The pytest plugin: files ``*.tracking.toml`` are tests, and tests in Python have the fixture ``tracking``.

Light at import, since pytest loads it in every run: heavy modules are imported when a guard is run.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tsmblocks.common.interpolation import AUTO, Hold

ENDING = ".tracking.toml"
"""Ending of a guard file."""


class TrackingMoved(AssertionError):
    """A metric has changed by more than its tolerance; the message names it, its change and when signals deviate."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the options."""
    group = parser.getgroup("tracking", "regression tests on tracking error")
    group.addoption("--tracking-accept", action="store_true", help="write the present metrics as the new baselines")
    pictures = "folder for pictures of changed signals (default: tracking-failures)"
    group.addoption("--tracking-pictures", metavar="DIR", default="tracking-failures", help=pictures)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Files of guards are collected as tests."""
    return GuardFile.from_parent(parent, path=file_path) if file_path.name.endswith(ENDING) else None


class GuardFile(pytest.File):
    """A file of guards: an item for each case."""

    def collect(self) -> Iterator[pytest.Item]:
        """The cases of the file."""
        from tsmblocks.common.errors import FileError
        from tsmblocks.testing.guards import read_guards

        try:
            guards = read_guards(self.path)
        except FileError as error:
            raise self.CollectError(str(error)) from None
        stem = self.path.name.removesuffix(ENDING)
        for case, watched in guards.items():
            baseline = self.path.with_name(f"{stem}{f'.{_file_name(case)}' if case else ''}.baseline.toml")
            yield GuardItem.from_parent(self, name=case or stem, watched=watched, baseline=baseline)


class GuardItem(pytest.Item):
    """One guard as a test."""

    def __init__(self, *, watched: Any, baseline: Path, **more: Any) -> None:
        super().__init__(**more)
        self.watched, self.baseline = watched, baseline

    def runtest(self) -> None:
        """Run and compare."""
        checked(self.watched, self.baseline, self.config, self.nodeid)

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """The changes without a traceback; any other error with one."""
        from tsmblocks.common.errors import TsmError

        if isinstance(excinfo.value, (TrackingMoved, TsmError)):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """File, line and name of the test."""
        return self.path, None, f"tracking: {self.name}"


class Tracking:
    """The fixture ``tracking``, called as ``tracking(diagram, metrics, …)``."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        self._request, self._names = request, list[str]()

    def __call__(
        self,
        diagram: Any,
        metrics: Any = None,
        *,
        name: str = "",
        tolerance: Any = "normal",
        stop: float | None = None,
        step: float = 1e-3,
        method: str = "rk4",
        inputs: Any = None,
        hold: Hold = AUTO,
        parameters: Any = None,
    ) -> None:
        """Run a diagram and compare its metrics with their baseline, ``baselines/TEST_NAME.toml`` beside the test.

        ``metrics`` are those of ``measure``; ``tolerance`` is a class (exact, tight, normal, loose, coarse), or maps
        metrics to classes; ``parameters`` are changed in the diagram; ``name`` distinguishes several checks of one
        test. Other arguments as for ``simulate``. Raises TrackingMoved where a metric has changed by more than its
        tolerance class allows, or there is no baseline.
        """
        from tsmblocks.testing.tracking import guard

        how = {"stop": stop, "step": step, "method": method, "inputs": inputs, "hold": hold}
        watched = guard(diagram, metrics, tolerance, how, parameters)
        node = self._request.node
        mark = name or (str(len(self._names) + 1) if self._names else "")
        if mark in self._names:
            raise ValueError(f"tracking is called twice with name={mark!r} in this test; give each its own.")
        self._names.append(mark)
        parts = (node.path.stem, node.nodeid.partition("::")[2].replace("::", "."), *([mark] if mark else []))
        file = f"{'.'.join(map(_file_name, parts))}.toml"
        checked(watched, node.path.parent / "baselines" / file, self._request.config, node.nodeid)


@pytest.fixture
def tracking(request: pytest.FixtureRequest) -> Tracking:
    """Guard a diagram's metrics: ``tracking(diagram, {"error [deg]": "rms(x_ref - x_out)"}, stop=20.0)``."""
    return Tracking(request)


def checked(watched: Any, baseline: Path, config: pytest.Config, title: str) -> None:
    """Compare with a baseline, or write it with --tracking-accept. Raises TrackingMoved."""
    from tsmblocks.common.errors import TsmError
    from tsmblocks.testing.tracking import change_report, changes, draw, read_baseline

    now = watched.run()
    if config.getoption("--tracking-accept"):
        now.save(baseline)
        return
    if not baseline.exists():
        raise TrackingMoved(f"there is no baseline {_near(baseline)} yet: pytest --tracking-accept writes it.")
    before = read_baseline(baseline)
    found = changes(watched, before, now)
    if not found:
        return
    text = f"tracking has changed from {_near(baseline)}:\n\n{change_report(found, before, now)}\n"
    file = _file_name(title.replace("/", ".").replace("::", "."))
    picture = Path(config.getoption("--tracking-pictures")) / f"{file}.png"
    try:
        text += f"\nDrawn in {draw(found, before, now, picture, title.rpartition('::')[2])}."
    except (TsmError, OSError) as error:  # the change is reported in any case
        text += f"\nNot drawn: {error}"
    raise TrackingMoved(f"{text}\nIf this is intended: pytest --tracking-accept")


def _file_name(text: str) -> str:
    """A text as part of a file name; one that loses more than blanks gets a digest, so that names stay different."""
    made = re.sub(r"[^a-zA-Z0-9_.-]+", "_", text).strip("_")
    return made if made == text.replace(" ", "_") else f"{made}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"


def _near(path: Path) -> str:
    """A path relative to the working folder where it lies in it."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)
