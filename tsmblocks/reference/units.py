"""The page on units: written by hand, with the units and spellings that the code knows."""

from __future__ import annotations

from collections.abc import Iterable

from tsmblocks.common.units import NAMES, by_quantity, spellings
from tsmblocks.reference import hand_written, rst

MARK = "@units@"
"""What gives way to the table of units on the page."""


def pages() -> dict[str, str]:
    """The page by its path."""
    text = (hand_written.FOLDER / "concepts" / "units.rst").read_text(encoding="utf-8")
    return {"concepts/units": text.replace(MARK, _table())}


def _table() -> str:
    """The units of each quantity with their sizes, and what else may be written for them."""
    rows = []
    for base, sizes in by_quantity().items():
        others = ", ".join(f"{rst.code(label)} {size:.6g}" for label, size in sizes.items() if label != base)
        rows.append((rst.code(base), others, _spelled(sizes)))
    products = [label for label in spellings() if label not in NAMES]
    rows.append((", ".join(map(rst.code, products)), "", _spelled(products)))
    return rst.table(("Unit", "Others, and their size in it", "Also written"), rows, (14, 46, 40))


def _spelled(labels: Iterable[str]) -> str:
    known = spellings()
    return "; ".join(f"{rst.code(k)}: {', '.join(map(rst.code, known[k]))}" for k in labels if known.get(k))
