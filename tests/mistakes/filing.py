"""Mistakes in names of things outside: files, units, the package itself."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import tsmblocks as tsm
from tests.mistakes.table import mistake
from tsmblocks.common import units
from tsmblocks.common.errors import FileError
from tsmblocks.common.units import UnitError


@mistake(
    FileError,
    """
fig16_feedforward_feedbak has 1 problem:
  1. there is no file 'fig16_feedforward_feedbak', and no ready-made diagram of that name. Did you mean 'fig16_feedforward_feedback'?
""",
)
def a_diagram_that_is_on_no_shelf():
    tsm.load("fig16_feedforward_feedbak")


@mistake(
    FileError,
    """
<text> has 1 problem:
  1. <text>:4: block 'k': there is no block type 'Gian'. Did you mean 'Gain'?
""",
)
def a_block_type_that_is_misspelt():
    tsm.loads('format = 1\ntitle = "gains"\n[blocks]\nk = { type = "Gian" }\n')


@mistake(UnitError, "'rda/s' is not a unit known here. Did you mean 'rad'?")
def a_unit_that_is_misspelt():
    units.parse("rda/s")


@mistake(UnitError, "'rad' does not convert to 'V'.")
def units_that_do_not_convert():
    units.factor("rad", "V")


@mistake(UnitError, "'1/min' does not convert to 'rad/s'. Revolutions per minute are rpm, those per second rev/s.")
def a_speed_told_as_a_rate_of_anything():
    units.factor("1/min", "rad/s")


@mistake(AttributeError, "tsmblocks has no 'latin_hypercube'. It is tsmblocks.studies.latin_hypercube.")
def a_public_name_one_level_down():
    _ = tsm.latin_hypercube


@mistake(
    AttributeError,
    "tsmblocks has no 'bode'. It is control.bode, for the linear system of a diagram: tsm.analysis.loop_gain or "
    "linearize.",
)
def a_name_that_python_control_has():
    _ = tsm.bode


@mistake(AttributeError, "tsmblocks has no 'Diagrm'. Did you mean 'Diagram'?")
def a_name_the_package_does_not_have():
    _ = tsm.Diagrm
