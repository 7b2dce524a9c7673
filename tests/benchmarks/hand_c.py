"""The hand-written C of ``hand.c``: compiled where there is a compiler, called with a diagram's numbers."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

# strict IEEE arithmetic (fused multiply-add allowed, as in the engine); gcc's SLP vectoriser makes it slower
SAFE = ["-O3", "-fno-tree-slp-vectorize", "-fno-math-errno", "-fno-trapping-math"]
FLAGS = {"-march=native": [*SAFE, "-march=native"], "generic": SAFE, "plain -O2": ["-O2"]}

_TSM = ("alpha1", "alpha2", "A", "theta", "delta")
_COMMON = [
    *(f"ref.{k}" for k in ("amplitude", "frequency", "phase", "offset")),
    *(f"compensator.{k}" for k in _TSM),
    *(f"tsm.{k}" for k in _TSM),
    *(f"controller.{k}" for k in ("kp", "ki", "kd", "tau")),
    *("drive.low", "drive.high", "motor.K", "motor.tau"),
]
NUMBERS = {"fig09b": _COMMON, "fig16": [*_COMMON, *(f"pid.{k}" for k in ("kp", "ki", "kd", "tau"))]}
_LOG = (
    *("ref.y", "compensator.y", "error.y", "controller.y", "drive.y", "motor.y", "motor.v", "tsm.y"),
    *("controller.integral", "controller.smooth", "motor.angle", "motor.speed"),
    *("compensator.zeta", "tsm.zeta"),
)
LOG = {"fig09b": _LOG, "fig16": (*_LOG, "tip_error.y", "pid.y", "total.y", "pid.integral", "pid.smooth")}


def compiler() -> str | None:
    """The C compiler found, ``CC`` first."""
    return next(
        (path for name in (os.environ.get("CC", ""), "gcc", "cc", "clang") if name and (path := shutil.which(name))),
        None,
    )


def version(path: str) -> str:
    """First line of what the compiler says of itself."""
    said = subprocess.run([path, "--version"], capture_output=True, text=True, check=False).stdout
    return said.splitlines()[0] if said else path


def build(folder: Path) -> dict[str, ctypes.CDLL]:
    """The compiled library for each set of flags that the compiler takes; empty without a compiler."""
    path, made = compiler(), {}
    for name, flags in FLAGS.items() if path else ():
        library = folder / f"hand-{len(made)}.so"
        source = Path(__file__).with_name("hand.c")
        said = subprocess.run(
            [path, *flags, "-shared", "-fPIC", "-o", library, source, "-lm"], capture_output=True, check=False
        )
        if said.returncode == 0:
            made[name] = ctypes.CDLL(str(library))
    return made


def caller(
    library: ctypes.CDLL, figure: str, values: Mapping[str, float], steps: int, h: float
) -> Callable[[np.ndarray], None]:
    """A function that runs ``fig09b`` or ``fig16`` into an array of shape (steps + 1, signals)."""
    function = library[figure]
    function.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_long, ctypes.c_void_p]
    function.restype = None
    given = np.array([values.get(name, values.get(name.partition(".")[2], np.nan)) for name in NUMBERS[figure]])

    def run(log: np.ndarray) -> None:
        function(given.ctypes.data, h, steps, log.ctypes.data)

    return run


def log_for(figure: str, steps: int) -> np.ndarray:
    """An array for the log whose memory is there already."""
    return np.zeros((steps + 1, len(LOG[figure])))


def signals(figure: str, log: np.ndarray) -> dict[str, np.ndarray]:
    """The log's columns by the names that the diagram gives them."""
    return {name: log[:, k] for k, name in enumerate(LOG[figure])}
