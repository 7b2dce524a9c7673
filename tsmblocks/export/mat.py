"""A diagram as a MAT file for MATLAB or Simulink."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tsmblocks.analysis import linearize, trim
from tsmblocks.common.atomic_write import replace_mat
from tsmblocks.common.errors import DataError, TsmError
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import equations, parameter_vector

MAX_NAME_LENGTH = 63
"""Characters of a name in MATLAB, at most (``namelengthmax``)."""


def to_mat(diagram: Diagram, path: str | Path) -> Path:
    """Write the parameters, wiring and linear model of a diagram to a .mat file.

    ``parameters`` is a structure of structures (``parameters.pid.kp``), ``states`` has the initial states, ``blocks``
    and ``wires`` are lists of texts, ``inputs`` and ``outputs`` names. Where the diagram has an equilibrium with its
    inputs at zero and a linear model there, ``A``, ``B``, ``C`` and ``D`` are those of ``linearize``.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    path : str or pathlib.Path
        The file, with the ending ``.mat``.

    Returns
    -------
    pathlib.Path
        The path of the file.

    Raises
    ------
    DataError
        The path has another ending or no folder, or two names would be one in MATLAB.

    Examples
    --------
    >>> import tempfile
    >>> import tsmblocks as tsm
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     tsm.export.to_mat(tsm.load("motor_linear"), f"{folder}/motor.mat").name
    'motor.mat'
    """
    diagram, target = as_diagram(diagram), Path(path)
    if target.suffix.lower() != ".mat":
        raise DataError(f"'{target}' must end in .mat.")
    if not target.resolve().parent.is_dir():
        raise DataError(f"'{target}' cannot be written: there is no such folder.")
    eq = equations(diagram)
    numbers = dict(zip(eq.p, parameter_vector(eq, diagram).tolist(), strict=True))
    kinds = [f"{name}: {type(block).__name__}" for name, block in diagram.blocks.items()]
    made: dict[str, Any] = {
        "title": diagram.title,
        "parameters": _nested({k: v for k, v in numbers.items() if k not in (*eq.x, *eq.d)}),
        "states": _nested({k: v for k, v in numbers.items() if k in (*eq.x, *eq.d)}),
        "blocks": _texts(kinds),
        "wires": _texts(map(str, diagram.links)),
        "inputs": _texts(diagram.inputs),
        "outputs": _texts(diagram.outputs),
    }
    replace_mat(target, {**made, **_linear(diagram)}, long_names=True)
    return target


def _linear(diagram: Diagram) -> dict[str, Any]:
    if not diagram.inputs or not diagram.outputs:
        return {}
    try:
        system = linearize(diagram, at=trim(diagram))
    except TsmError:
        return {}
    return {name: np.asarray(getattr(system, name)) for name in "ABCD"}


def _texts(values: Iterable[str]) -> np.ndarray:
    return np.array(["".join(v) for v in values], dtype=object)  # plain str: names from a file have a position


def _nested(numbers: dict[str, float]) -> dict[str, Any]:
    """Values by dotted names as structures inside structures; ``den[0]``, ``den[1]`` as ``den_0``, ``den_1``."""
    made: dict[str, Any] = {}
    for name, value in numbers.items():
        *path, last = [re.sub(r"[^a-zA-Z0-9_]+", "_", part).strip("_") for part in name.split(".")]
        place = made
        for part in path:
            place = place.setdefault(_short(part), {})
        if not isinstance(place, dict) or _short(last) in place:
            raise DataError(f"'{name}' would have the name of another parameter in MATLAB.")
        place[_short(last)] = value
    return made


def _short(name: str) -> str:
    return (name if name[:1].isalpha() else f"v_{name}")[:MAX_NAME_LENGTH]
