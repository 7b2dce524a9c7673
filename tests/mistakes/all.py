"""The table of mistakes, with the rows of every module."""

from tests.mistakes import diagnosing, editing, equations, filing, fitting, kinds, parameters, running, wiring  # noqa: F401 - fill the table
from tests.mistakes.table import TABLE

__all__ = ["TABLE"]
