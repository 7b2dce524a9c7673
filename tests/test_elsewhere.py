"""Blocks looked for by the names they have in other programs."""

import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import TsmError
from tsmblocks.model.aliases import CALLED, HERE
from tsmblocks.model.block import REGISTRY


def test_every_name_leads_to_a_block_and_is_none_itself():
    assert set(CALLED) <= set(tsm.blocks.__all__) & set(REGISTRY)
    assert len(HERE) == sum(map(len, CALLED.values()))
    assert not {name.casefold() for name in REGISTRY} & set(HERE)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Backlash", "there is no block type 'Backlash'. Here that is 'Play'."),
        ("Transport Delay", "there is no block type 'Transport Delay'. Here that is 'Delay'."),
        ("gear", "there is no block type 'gear'. Here that is 'Gain'."),
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
    assert str(caught.value) == "tsmblocks.blocks has no 'TransferFcn'. Here that is 'TransferFunction'."
