"""Blocks looked for by the names they have in other programs."""

import subprocess
import sys

import pytest

import tsmblocks as tsm
from tsmblocks.cli import main
from tsmblocks.common.errors import TsmError
from tsmblocks.model.aliases import BLOCK_NAMES, OTHER_NAMES, OTHER_PARAMETER_NAMES, PARAMETERS
from tsmblocks.model.block import REGISTRY


def test_every_name_leads_to_a_block_and_is_none_itself():
    assert set(OTHER_NAMES) <= set(tsm.blocks.__all__) & set(REGISTRY)
    assert len(BLOCK_NAMES) == sum(map(len, OTHER_NAMES.values()))
    assert not {name.casefold() for name in REGISTRY} & set(BLOCK_NAMES)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Backlash", "there is no block type 'Backlash'. Its name here is 'Play'."),
        ("Transport Delay", "there is no block type 'Transport Delay'. Its name here is 'Delay'."),
        ("Damper", "there is no block type 'Damper'. Its name here is 'ViscousFriction'."),
        ("gear", "there is no block type 'gear'. Its name here is 'Gain'."),
        ("White noise", "there is no block type 'White noise'. Its name here is 'Random'."),
        ("Comparator", "there is no block type 'Comparator'. Its name here is 'Comparison'."),
        ("Gian", "there is no block type 'Gian'. Did you mean 'Gain'?"),
    ],
)
def test_a_file_that_uses_them_is_told(name, said):
    with pytest.raises(TsmError) as caught:
        tsm.loads(f'format = 1\n[blocks.a]\ntype = "{name}"\n')
    assert said in str(caught.value)


def test_a_script_that_uses_them_is_told():
    with pytest.raises(AttributeError) as caught:
        tsm.blocks.TransferFcn()
    assert str(caught.value) == "tsmblocks.blocks has no 'TransferFcn'. Its name here is 'TransferFunction'."


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("from tsmblocks.blocks import Gain, Backlash", "ImportError: {}"),
        ("import tsmblocks as tsm; tsm.blocks.Backlash()", "AttributeError: {}"),  # Python adds no other name
    ],
)
def test_a_program_that_ends_so_prints_the_name_here_and_no_other(code, said):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    last = done.stderr.splitlines()[-1]
    assert last == said.format("tsmblocks.blocks has no 'Backlash'. Its name here is 'Play'.")
    assert not hasattr(tsm.blocks, "Backlash")


def test_the_command_that_lists_blocks_says_the_name_here(capsys):
    assert main(["blocks", "Backlash"]) != 0
    assert "there is no block 'Backlash'. Its name here is 'Play'." in capsys.readouterr().err


def test_every_name_of_a_parameter_leads_to_one_of_a_block():
    assert set(OTHER_PARAMETER_NAMES) <= {name for block in REGISTRY.values() for name in block.fields()}
    assert len(PARAMETERS) == sum(map(len, OTHER_PARAMETER_NAMES.values()))


@pytest.mark.parametrize(
    ("block", "values", "said"),
    [
        ("FirstOrderLag", {"T": 1.0}, "FirstOrderLag has no parameter 'T'. Its name here is 'time_constant'."),
        ("Step", {"value": 2.0}, "Step has no parameter 'value'. Its name here is 'after'."),
        ("PID", {"KP": 2.0}, "PID has no parameter 'KP'. Did you mean 'kp'?"),
        ("DCMotor", {"gear_ratio": 50.0}, "DCMotor has no parameter 'gear_ratio'. Did you mean 'gear'?"),
        (
            "DCMotor",
            {"gear_ratio": 50.0, "poles": 2, "weight": 1},
            "DCMotor has no parameter 'gear_ratio'. Did you mean 'gear'? DCMotor has no parameter 'poles' and no "
            "'weight'. Known here: J, L, R, b, coulomb, drop_current, gear, kt, load, smoothing, voltage_drop, "
            "angle, current, speed.",
        ),
    ],
)
def test_a_block_given_them_is_told_of_all_at_once(block, values, said):
    with pytest.raises(TsmError) as caught:
        getattr(tsm.blocks, block)(**values)
    assert str(caught.value) == said
