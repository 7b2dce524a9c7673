"""Views of a value: notebook card, drawing, figure, text or report, by modules that know its class.

A class offers a view of itself without importing the module that makes it, so that the import graph has no cycles.
Each module named here has a ``view``, a ``functools.singledispatch`` function over the classes it can show; it is
imported when a view is first used, and with it no more than that package of classes needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tsmblocks.common.errors import TsmError, near
from tsmblocks.common.tables import listed

CARDS = ("analysis", "data", "diagnosis", "fitting", "model", "optimal", "simulation", "studies", "tuning")
FIGURES = ("analysis", "data", "diagnosis", "fitting", "simulation", "studies", "tuning")
TEXTS = ("diagnosis", "fitting")
PROVIDERS = {
    "details": {"diagnosis": "tsmblocks.diagnosis.details"},
    "html": {package: f"tsmblocks.html.{package}_cards" for package in CARDS},
    "plot": dict.fromkeys(FIGURES, "tsmblocks.plots"),
    "report": {"diagnosis": "tsmblocks.html.report_files"},
    "svg": {"model": "tsmblocks.draw"},
    "text": {package: f"tsmblocks.{package}.text" for package in TEXTS},
}
"""Kind of view -> package of the value's class -> module that provides it."""


def view(kind: str, value: Any, **options: Any) -> Any:
    """Return a view of a value.

    Parameters
    ----------
    kind : {"details", "html", "plot", "report", "svg", "text"}
        Kind of view: details as text, a notebook card, a figure, files in a folder, a drawing, or text for a
        terminal.
    value : object
        The value. Its class, or one that it derives from, must be registered with the ``view`` of the module that
        provides this kind.
    **options
        Passed on to the function registered for the class.

    Returns
    -------
    object
        The result of that function: text for ``"details"``, ``"html"``, ``"svg"`` and ``"text"``, a matplotlib
        figure for ``"plot"``, the path of the folder for ``"report"``.

    Raises
    ------
    TsmError
        There is no view of this kind, or none of this class.
    """
    if kind not in PROVIDERS:
        raise TsmError(f"there is no view '{kind}'.{near(kind, PROVIDERS)}")
    make = _registered(kind, type(value))
    if make is None:
        others = [other for other in PROVIDERS if _registered(other, type(value)) is not None]
        raise TsmError(f"{type(value).__name__} has no view '{kind}'{f', but {listed(others)}' if others else ''}.")
    return make(value, **options)


def _registered(kind: str, cls: type) -> Any:
    """The function that is registered for a class, None where there is none."""
    for base in cls.__mro__:
        root, _, inner = base.__module__.partition(".")
        module = PROVIDERS[kind].get(inner.partition(".")[0]) if root == "tsmblocks" else None
        made = import_module(module).view.dispatch(cls) if module else no_view
        if made is not no_view:
            return made
    return None


def no_view(value: object, **options: Any) -> Any:
    """Base case of every ``view``: the class is not registered."""
    raise NotImplementedError(type(value).__name__)


class SignalViews:
    """Views of signals over time, of a recording or a run."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return view("html", self)

    def plot(self, *names: str, ax: Any = None, after: float | None = None, width: float | None = None) -> Any:
        """Plot signals over time, angles in degrees. Needs matplotlib.

        Nothing is shown yet: in a script ``plt.show()`` of ``matplotlib.pyplot`` shows the figure and its own
        ``savefig`` writes it to a file, with or without a screen; a notebook shows the figure that a cell ends with.

        Parameters
        ----------
        *names : str
            Signals, or expressions of them such as ``"x_in - x_out"``; where none is given, all signals of a recording
            or the outputs of the diagram of a run.
        ax : matplotlib.axes.Axes or None, default None
            Axes to draw into, by default those of a new figure.
        after : float or None, default None
            Time [s] at which the plot begins.
        width : float or None, default None
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        TsmError
            For an unknown signal.
        """
        return view("plot", self, names=names, ax=ax, after=after, width=width)
