"""Block diagrams for mechanisms with friction, backlash and hysteresis: model, control, diagnose.

The packages form layers, and each imports only from the layers below it: ``common``; ``model`` (blocks and diagrams as
values); ``compiler`` (a diagram as one set of equations); ``engine`` (equations at a fixed step); ``simulation``; then
``fitting``, ``diagnosis`` and the other packages that use runs; at the top ``html``, ``plots`` and ``cli``, which
present the results.

How a diagram becomes machine code, in the order of reading:

1. ``model.block``: a block, its declarations and its three equations.
2. ``model.diagram``: named blocks and wires as a value.
3. ``compiler.dependencies``: the equations of a block as expressions, and which inputs each of them reads.
4. ``compiler.flatten``: nested diagrams as one level of blocks, with a symbol for each parameter.
5. ``compiler.evaluate``: expressions of all signals, formed in the order that these dependencies dictate.
6. ``compiler.compile``: x' = f(t, x, d, u, q, p) made from these expressions, as ``engine.equations`` holds it.
7. ``engine.kernel_frame``: the loop over steps in LLVM IR: arguments, time, logging, delays. ``engine.plan`` says for
   which equations, method and lanes; ``engine.program`` lists a function's scalar operations.
8. ``engine.register_kernel``: the stages within this loop, written from these lists; ``engine.jit`` compiles the text.
"""

import re
import sys
from importlib import import_module
from typing import Any

from tsmblocks.common import loading as _loading  # noqa: F401 - first: Ctrl-C while the others are imported

# isort: split
from tsmblocks.common import errors as errors
from tsmblocks.common.version import __version__ as __version__
from tsmblocks.model import block as _block_module
from tsmblocks.model.block import block as block  # before any module could take its name

_STUB = __spec__.loader.get_data(f"{__path__[0]}/__init__.pyi").decode()  # from an archive, too
_HOME = {name: home for home, name in re.findall(r"^from (\S+) import ([^_]\w*) as", _STUB, re.MULTILINE)}
"""Where each public name lives, as the stub has it; modules are imported when a name is first used."""

__all__ = sorted(_HOME)  # noqa: PLE0605 - one list of names is enough

sys.modules[f"{__name__}.block"] = _block_module  # ``from tsmblocks.block import Block`` is what many scripts have
sys.modules[f"{__name__}.errors"] = errors


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is not None:
        return import_module(f"{home}.{name}") if home == __name__ else getattr(import_module(home), name)
    packages = [p for p, home in _HOME.items() if home == __name__] if name.isidentifier() and name[0] != "_" else []
    where = [p for p in packages if callable(getattr(import_module(f"{__name__}.{p}"), name, None))]
    hint = f" It is tsmblocks.{where[0]}.{name}." if where else ""
    if packages and not hint and callable(getattr(import_module("control"), name, None)):
        hint = f" It is control.{name}, for the linear system of a diagram: tsm.analysis.loop_gain or linearize."
    hint = hint or errors.near(name, __all__)
    raise errors.no_such_name(__name__, name, hint)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
