"""Every registered block keeps every promise in tsmblocks.testing."""

import pkgutil
from importlib import import_module

import pytest

import tsmblocks.blocks
from tsmblocks.model.block import REGISTRY, Block
from tsmblocks.testing import PROMISES, checks_for

OURS = {name: cls for name, cls in REGISTRY.items() if cls.__module__.startswith("tsmblocks.")}
ALL = [check for cls in OURS.values() for check in checks_for(cls())]


@pytest.mark.parametrize("check", ALL, ids=str)
def test_promise(check):
    check()


def test_every_block_of_every_module_is_a_name_of_the_package():
    modules = [import_module(m.name) for m in pkgutil.iter_modules(tsmblocks.blocks.__path__, "tsmblocks.blocks.")]
    found = {v.__name__ for m in modules for v in vars(m).values() if isinstance(v, type) and issubclass(v, Block)}
    assert found - {"Block"} <= set(tsmblocks.blocks.__all__)


def test_every_block_in_the_package_is_registered():
    found = {cls for cls in Block.__subclasses__() if cls.__module__.startswith("tsmblocks.blocks.")}
    assert {cls.__name__ for cls in found} == set(OURS)
    assert len(OURS) > 60


def test_no_block_inherits_from_another():
    assert all(cls.__bases__ == (Block,) for cls in OURS.values())


def test_the_suite_has_no_gap_in_its_names():
    assert all(check.__doc__ for check in PROMISES.values())
    assert len(PROMISES) == 16
