"""Linear algebra on one thread: results do not depend on how many threads a machine has.

With several threads a library of linear algebra adds in another order, and the last digits of a product differ. The
matrices of fits are too small for more than one thread to pay.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


@functools.cache
def _libraries() -> ThreadpoolController:
    """The libraries of linear algebra in this process: those of NumPy and SciPy, which have one each."""
    import scipy.linalg  # noqa: F401 - loads both

    return ThreadpoolController().select(user_api="blas")


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which has linear algebra on one thread while it runs."""

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with _libraries().limit(limits=1):
            return function(*args, **kwargs)

    return limited
