"""The table of mistakes, with the rows of every module."""

from tests.mistakes import (  # noqa: F401 - fill the table
    diagnosing,
    editing,
    equations,
    filing,
    fitting,
    kinds,
    parameters,
    running,
    wiring,
)
from tests.mistakes.table import TABLE

__all__ = ["TABLE"]
