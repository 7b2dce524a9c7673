"""Values computed once for each object, and kept as long as it lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

V = TypeVar("V")


class KeptFor(Generic[V]):
    """A function of one immutable object, whose value is kept for that object: found by identity, not by equality.

    Comparing two diagrams takes longer than a short run of one; that an object is the same is seen at once.
    """

    def __init__(self, make: Callable[[Any], V]) -> None:
        self._make = make
        self._kept: dict[int, tuple[weakref.ref[Any], V]] = {}

    def __call__(self, given: Any) -> V:
        """The value for an object."""
        key = id(given)
        found = self._kept.get(key)
        if found is not None and found[0]() is given:
            return found[1]
        value = self._make(given)
        self._kept[key] = (weakref.ref(given, lambda _: self._kept.pop(key, None)), value)
        return value
