"""A block made of a plain Python function, where the toolbox has no such block."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from tsmblocks.common.errors import BlockError, EquationError, in_words, near
from tsmblocks.common.units import UnitError, parse
from tsmblocks.model.block import Block, Input, Output, block, parameter


def function_block(
    function: Callable[..., Any] | None = None,
    *,
    outputs: tuple[str, ...] = ("y",),
    units: Mapping[str, str] | None = None,
    about: Mapping[str, str] | None = None,
    register: bool = True,
) -> Any:
    """Make a block from a Python function.

    A decorator, with or without arguments; the block class has the name of the function. Arguments without a default
    are input ports, arguments with one are parameters; a first argument ``t`` is the time [s]. The function uses
    operators and ``casadi`` functions only.

    Parameters
    ----------
    function : callable or None, default None
        The function; None where the decorator is used with arguments.
    outputs : tuple of str, default ("y",)
        Names of the values that the function returns (a tuple where there are several).
    units : mapping of str to str, optional
        Units of inputs, parameters and outputs by name.
    about : mapping of str to str, optional
        Meaning of inputs, parameters and outputs by name.
    register : bool, default True
        Whether files may name the block.

    Returns
    -------
    type or callable
        The block class, or a decorator where ``function`` is None.

    Raises
    ------
    BlockError
        For arguments that cannot be ports and parameters.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> @tsm.function_block(units={"u": "rad", "y": "rad"}, register=False)
    ... def cubic(u, k=0.3):
    ...     return k * u**3
    >>> cubic(k=0.5)
    cubic(k=0.5)
    """
    if function is None:
        return functools.partial(function_block, outputs=outputs, units=units, about=about, register=register)
    name = getattr(function, "__name__", "")
    if not inspect.isfunction(function) or not name.isidentifier():
        raise BlockError(f"function_block needs a function made by def, with a name, got {in_words(function)}.")
    outputs, units, about = (outputs,) if isinstance(outputs, str) else tuple(outputs), units or {}, about or {}
    inputs, numbers, timed = _signature(function, name)
    _check_names(name, [*inputs, *numbers, *outputs], units, about)
    made: dict[str, Any] = {
        "__module__": function.__module__,
        "__qualname__": function.__qualname__,
        "__doc__": inspect.getdoc(function) or f"The Python function {name}{inspect.signature(function)}.",
        "source": f"Python function {function.__module__}.{function.__qualname__}",
        "symbol": name[:12],
        "function": staticmethod(function),
    }
    made |= {key: Input(about.get(key, f"input {key}"), units.get(key, "")) for key in inputs}
    made |= {key: Output(about.get(key, f"output {key}"), units.get(key, "")) for key in outputs}
    for key, value in numbers.items():
        made[key] = parameter(default=value, about=about.get(key, f"parameter {key}"), unit=units.get(key, ""))
    made["outputs"] = _equations(function, name, tuple(numbers), outputs, timed)
    return block(type(name, (Block,), made), register=register)


def _equations(
    function: Callable[..., Any], name: str, numbers: tuple[str, ...], names: tuple[str, ...], timed: bool
) -> Callable[..., dict[str, Any]]:
    """Make the block's ``outputs``, which call the function once."""

    def outputs(self: Any, t: Any, _: Any, u: Any) -> dict[str, Any]:
        values = {key: getattr(self, key) for key in numbers}
        result = function(*((t, *u) if timed else u), **values)
        results = result if isinstance(result, tuple) else (result,)
        if result is None or len(results) != len(names):
            got = "nothing" if result is None else f"{len(results)} value{'s' if len(results) != 1 else ''}"
            raise EquationError(f"{name} must return {', '.join(names)}, got {got}.")
        return dict(zip(names, results, strict=True))

    return outputs


def _signature(function: Callable[..., Any], name: str) -> tuple[list[str], dict[str, Any], bool]:
    """Input names, parameters with their defaults, and whether the function takes the time first."""
    inputs, numbers = list[str](), dict[str, Any]()
    for key, argument in inspect.signature(function).parameters.items():
        if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD):
            stars = "*" if argument.kind is argument.VAR_POSITIONAL else "**"
            raise BlockError(f"{name}({stars}{key}) cannot be a block: name each input and each parameter.")
        if argument.default is not argument.empty:
            if argument.kind is argument.POSITIONAL_ONLY:
                raise BlockError(
                    f"{name}: parameter '{key}' is positional only ('/'), but parameters are given by name."
                )
            if not _is_default(argument.default):
                raise BlockError(
                    f"{name}: the default of '{key}' must be a number or a tuple of numbers, "
                    f"got {in_words(argument.default)}. Without a default it would be an input."
                )
            numbers[key] = argument.default
        elif argument.kind is argument.KEYWORD_ONLY:
            raise BlockError(f"{name}: '{key}' is keyword only ('*') and has no default. Give it a number as default.")
        else:
            inputs.append(key)
    timed = inputs[:1] == ["t"]
    if "t" in inputs[1:]:
        raise BlockError(f"{name}: 't' is the time and must be the first argument.")
    return inputs[1:] if timed else inputs, numbers, timed


def _is_default(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(_is_default(v) for v in value)
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _check_names(name: str, names: list[str], units: Mapping[str, str], about: Mapping[str, str]) -> None:
    """Raise BlockError for a name that is taken or repeated, a unit or meaning of an unknown name, an unknown unit."""
    for key in names:
        if not key.isidentifier() or key.startswith("_") or hasattr(Block, key) or key in ("function", "t"):
            raise BlockError(f"{name}: '{key}' cannot name an input, a parameter or an output. Choose another name.")
        if names.count(key) > 1:
            raise BlockError(
                f"{name}: '{key}' is used twice. Choose another name, or name the outputs: outputs=('…',)."
            )
    for what, given in (("units", units), ("about", about)):
        for key in given:
            if key not in names:
                raise BlockError(f"{name}: {what} names '{key}', which it does not have.{near(key, names)}")
    for key, unit in units.items():
        try:
            parse("1" if unit.startswith("?") else unit)
        except UnitError as error:
            raise BlockError(f"{name}: unit of '{key}': {error}") from None
