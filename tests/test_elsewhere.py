"""Blocks looked for by the names they have in other programs."""

import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import TsmError
from tsmblocks.model.aliases import BLOCK_NAMES, OTHER_NAMES
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
        ("gear", "there is no block type 'gear'. Its name here is 'Gain'."),
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
