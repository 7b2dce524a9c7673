"""Tables as a terminal shows them: one function for all that is printed; and columns whose titles are not alike."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def columns(rows: Iterable[Sequence[str]], indent: str = "", left: Collection[int] = (0,)) -> str:
    """Rows with their cells in columns; those in ``left`` (by default the first) are flush left."""
    table = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    lines = []
    for row in table:
        cells = [c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append((indent + "  ".join(cells)).rstrip())
    return "\n".join(lines)


def unlike(names: Iterable[str]) -> list[str]:
    """Names of which no two are alike: a second ``x`` is ``x_2``."""
    made: list[str] = []
    for name in names:
        one, k = name, 1
        while one in made:
            k += 1
            one = f"{name}_{k}"
        made.append(one)
    return made
