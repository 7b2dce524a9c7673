"""Branch coverage of the tests that run, at little cost: ``python -m pytest -p tests.branches``.

Tracing takes as long again as a test itself. So what is imported while tests are collected is traced, and of each test,
with all of its cases, the first part of a second; the tests in ``WHOLE`` go from end to end through what else would be
reached by long tests only. Coverage is that much, or more. Data are written where ``COVERAGE_FILE`` says, one file for
each process: ``coverage combine`` and ``coverage report`` read them.
"""

import signal
import time
from collections import Counter

import coverage
import pytest

SECONDS = 0.3
"""Time of the processor for which a test is traced, in each process [s]: a busy machine traces as much as an idle one.
Chosen: tests take about a sixth longer."""
WHOLE = (
    "tests/test_cli_diagnose.py::",
    "tests/test_data_formats.py::",
    "tests/test_hostile_files.py::test_each_mistake_is_said_once_in_its_line",
    "tests/test_hostile_files.py::test_what_",
    "tests/test_diagnosis_axis.py::test_the_delay_that_is_missing_is_named",
    "tests/test_diagnosis_window.py::",
    "tests/test_errors.py::",
    "tests/test_events.py::test_a_relay_in_sliding_mode_warns_once_and_goes_on_plainly",
    "tests/test_kernel_forms.py::",
    "tests/test_report.py::",
)
TRACED = coverage.Coverage(branch=True, source=["tsmblocks"], data_suffix=True, messages=False)
TRACED.start()  # here: hooks of configuration import parts of the package
SPENT: Counter[str] = Counter()
"""Time for which the cases of each test have been traced [s]."""


def pytest_configure(config):
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        TRACED.stop()
        TRACED.save()  # what plugins import; its workers import that before they come here
        config.pluginmanager.unregister(name=__name__)  # it runs no tests itself
        return
    signal.signal(signal.SIGPROF, lambda *_: TRACED.stop())


def pytest_collection_finish():
    TRACED.stop()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    name = item.nodeid.partition("[")[0]
    whole = name.startswith(WHOLE)
    remaining = SECONDS - SPENT[name]
    if not whole and remaining <= 0:
        return (yield)
    began = time.process_time()
    TRACED.start()
    if not whole:
        signal.setitimer(signal.ITIMER_PROF, max(remaining, 1e-3))
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        TRACED.stop()
        SPENT[name] += time.process_time() - began


def pytest_sessionfinish():
    TRACED.stop()
    TRACED.save()
