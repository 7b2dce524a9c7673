"""What all tests share: machine code kept in a folder of the test run, and the measured data where it is there."""

import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Times say nothing of a test on a machine that does other things as well.
# The gate (CI is set) draws the same examples every time: what passed on one machine passes on the next.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=bool(os.environ.get("CI"))
)
settings.load_profile("any machine")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Neighbouring tests stay in one process, which has set up for them, until another is idle."""
    if config.getvalue("dist") != "load":  # what -n stands for
        return None
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.fixture(scope="session", autouse=True)
def _machine_code_store(tmp_path_factory):
    """Compile into a folder of this run, so that no test depends on what earlier ones left; its workers share it."""
    before, own = os.environ.get("TSMBLOCKS_CACHE"), tmp_path_factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    os.environ["TSMBLOCKS_CACHE"] = str(shared / "machine-code")
    yield
    if before is None:
        del os.environ["TSMBLOCKS_CACHE"]
    else:
        os.environ["TSMBLOCKS_CACHE"] = before


@pytest.fixture(scope="session", autouse=True)
def _ctrl_c_as_at_a_terminal():
    """A shell that starts a command in the background has it ignore Ctrl-C, and so would every test of it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _no_figure_stays_open():
    """A test that uses pyplot leaves it loaded, and pyplot keeps every figure made from then on."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(scope="session")
def measured() -> Path:
    """The folder of measured data, named by TSMBLOCKS_DATA."""
    named = os.environ.get("TSMBLOCKS_DATA", "")
    if not named:
        pytest.skip(
            "needs measured data: set TSMBLOCKS_DATA to a folder with tendon_sheath/ (files of the repository "
            "nhoyh/hysteresis_compensation_ROS) and bouc_wen/, emps/, cascaded_tanks/, silverbox/ "
            "(nonlinearbenchmark.org)"
        )
    folder = Path(named)
    assert folder.is_dir(), f"TSMBLOCKS_DATA names {folder}, which is not a folder"
    return folder
