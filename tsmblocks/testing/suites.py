"""Suites of checks: each check is a function with a name and a docstring that state the requirement."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from tsmblocks.common.errors import ParameterError, TsmError, in_words, near
from tsmblocks.testing.promises import BrokenPromise


class ChecksFailed(BrokenPromise):
    """Checks that failed.

    Parameters
    ----------
    subject : str
        What was checked: ``"effect 'offset'"``.
    broken : mapping of str to str
        What was wrong, by check.
    """

    def __init__(self, subject: str, broken: Mapping[str, str]) -> None:
        self.subject, self.broken = subject, dict(broken)
        count = "1 check" if len(broken) == 1 else f"{len(broken)} checks"
        super().__init__("\n".join([f"{subject} fails {count}:", *(f"  {k}: {v}" for k, v in broken.items())]))

    def __reduce__(self) -> Any:
        return type(self), (self.subject, self.broken)


class Suite(dict[str, Callable[..., None]]):
    """Checks by name, in the order in which they are made."""

    def add(self, check: Callable[..., None]) -> Callable[..., None]:
        """Add a check under the name of its function; a decorator."""
        self[check.__name__] = check
        return check

    def run(self, subject: str, given: Any, skip: Collection[str]) -> None:
        """Make all checks but those that are skipped. Raises ChecksFailed, with all that are broken."""
        if isinstance(skip, str) or not all(isinstance(name, str) for name in skip):
            raise ParameterError(f"skip is a list of names of checks, got {in_words(skip)}.")
        for name in skip:
            if name not in self:
                raise ParameterError(f"skip: there is no check {in_words(name)}.{near(name, self)}")
        broken = {}
        for name, check in self.items():
            if name in skip:
                continue
            try:
                check(given)
            except BrokenPromise as error:
                broken[name] = str(error)
            except TsmError as error:
                broken[name] = f"{type(error).__name__}: {error}"
            except Exception as error:  # any error that it makes is a fault of what is checked
                broken[name] = f"{type(error).__name__}, which is not an error of this package: {error}"
        if broken:
            raise ChecksFailed(subject, broken)
