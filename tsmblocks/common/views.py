"""How a value is shown: as a notebook card, a drawing, a figure, text, or a report, by modules that know its class.

A class offers a view of itself without importing the module that makes it, so that the import graph has no cycles.
Each module named here has a ``view``, a ``functools.singledispatch`` function over the classes it can show; it is
imported when a view is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PROVIDERS = {
    "html": "tsmblocks.html.cards",
    "svg": "tsmblocks.draw",
    "plot": "tsmblocks.plots",
    "report": "tsmblocks.html.report_files",
    "text": "{package}.text",
}
"""Module that provides each kind of view; ``{package}`` is the package of the value's class."""


def view(kind: str, value: Any, **options: Any) -> Any:
    """Return a view of a value.

    Parameters
    ----------
    kind : {"html", "svg", "plot", "report", "text"}
        What is wanted: a notebook card, a drawing, a figure, files in a folder, or text for a terminal.
    value : object
        What is shown. Its class must be registered with the ``view`` of the module that provides this kind.
    **options
        Passed on to the function registered for the class.

    Returns
    -------
    object
        What that function returns: text for ``"html"``, ``"svg"`` and ``"text"``, a matplotlib figure for
        ``"plot"``, the path of the folder for ``"report"``.

    Raises
    ------
    NotImplementedError
        The class offers no view of this kind.
    """
    package = type(value).__module__.rpartition(".")[0]
    return import_module(PROVIDERS[kind].format(package=package)).view(value, **options)


def no_view(value: object, **options: Any) -> Any:
    """Raise NotImplementedError: the base case of every ``view``."""
    raise NotImplementedError(f"there is no such view of {type(value).__name__}.")
