"""The tables of the benchmark of the diagnosis: acceptance, confusion, power, chance, places, times, other methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from tests.hidden.kinds import FAMILY

Row = dict[str, Any]
SEEN, CLEAR = 0.1, 0.3
"""Excess from which an effect is to be found, and from which it is to be named."""
BINS = ((0.0, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, 3.0), (3.0, np.inf))
EDGE = 0.98
"""What is made to have an excess of 0.1 has about that; such cases belong to the bin above."""
SURE = 0.8
"""Share removed from which a name is said without reserve."""
MOTOR = ("friction", "backlash", "saturation", "load_offset", "position_ripple", "dead_time")
"""What is to be named in the motor: a family, and effects."""
LINES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Lines of materiality, in variances of the noise."""


def interval(hits: int, of: int) -> tuple[float, float]:
    """Clopper and Pearson's interval that holds a share with at least 95 %."""
    from scipy.stats import beta

    low = beta.ppf(0.025, hits, of - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, of - hits) if hits < of else 1.0
    return float(low), float(high)


def share(hits: int, of: int) -> str:
    """A share in percent with its interval."""
    if not of:
        return "no cases"
    low, high = interval(hits, of)
    return f"{100 * hits / of:.1f} % ({hits}/{of}; {100 * low:.1f} to {100 * high:.1f})"


def table(title: str, head: Sequence[str], body: Iterable[Sequence[str]]) -> None:
    """Print a Markdown table."""
    every = [[str(c) for c in row] for row in body]
    widths = [max(len(r[k]) for r in [list(head), *every]) for k in range(len(head))]
    print(f"\n**{title}**\n")
    for k, row in enumerate([list(head), *every]):
        print("| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |")
        if not k:
            print("|" + "|".join("-" * (w + 2) for w in widths) + "|")


# ---- what a case says


def names(row: Row) -> list[str]:
    """The effects named."""
    return [e["name"] for e in row["effects"]]


def first(row: Row) -> str:
    """The first name, or the verdict where there is none."""
    return row["effects"][0]["name"] if row["effects"] else row["verdict"]


def printed(row: Row) -> set[str]:
    """The first name and all that is said to be possible as well."""
    return {row["effects"][0]["name"], *row["effects"][0]["also"]} if row["effects"] else set()


def removed(row: Row, least: float = 1.0) -> float:
    """Share removed, on data held out, of what is above ``least`` times the variance of the noise."""
    before, after, noise = (v**2 for v in row["held_out"])
    return min((before - after) / max(before - least * noise, 1e-300), 1.0)


def left_by_nulls(nulls: Sequence[Row]) -> dict[str, float]:
    """What the base leaves held out where nothing is hidden, in variances of the noise, by protocol."""
    found: dict[str, list[float]] = {}
    for row in nulls:
        found.setdefault(row["protocol"], []).append((row["held_out"][0] / row["held_out"][2]) ** 2)
    return {protocol: float(np.mean(values)) for protocol, values in found.items()}


def right(row: Row) -> bool:
    """Whether the one effect hidden is named first."""
    return first(row) == row["truth"][0]


def related(row: Row) -> bool:
    """Whether the first name is of the family of what is hidden."""
    return FAMILY.get(first(row)) == row["families"][0]


def located(row: Row) -> bool:
    """Whether the segments that differ are those in which something is hidden; an encoder between them is in both."""
    parts = row["segments"]
    motor, sheath = (next(p for k, p in parts.items() if k.endswith(end)) for end in ("x_in", "x_out"))
    hidden = dict(motor=(True, False), sheath=(False, True), sensor=(True, True))[row["at"]]
    return tuple(p["verdict"] != "none" for p in (motor, sheath)) == hidden


# ---- tables


def tables(every: Sequence[Row]) -> None:
    """Everything that the results tell."""
    failed = [r for r in every if "error" in r]
    good = [r for r in every if "error" not in r]
    acceptance(good)
    motors(good)
    power(_of(good, "single"))
    confusion(_of(good, "single"))
    chance(good)
    places(good)
    others(good)
    times(good)
    if failed:
        table("Cases that failed", ["case", "message"], [(r["key"], r["error"][:150]) for r in failed])


def _of(rows: Iterable[Row], group: str, floor: str = "given") -> list[Row]:
    return [r for r in rows if r["spec"]["group"] == group and r["floor"] == floor]


def _count(rows: Sequence[Row], test: Callable[[Row], bool]) -> str:
    return share(sum(test(r) for r in rows), len(rows))


def acceptance(good: Sequence[Row]) -> None:
    """The rows that decide, with the least that is asked and the aim."""
    nulls, singles = _of(good, "null"), _of(good, "single")
    seen, clear = ([r for r in singles if r["excess"] >= EDGE * least] for least in (SEEN, CLEAR))
    matched = [r for r in singles if r["covered"] is not None]
    body = [
        ("false alarms on nulls", "<= 3 %, bound <= 5 %", "<= 1 %", _count(nulls, _alarm)),
        ("the same, floor looked for", "", "", _count(_of(good, "null", "found"), _alarm)),
        ("detection, excess >= 0.1", ">= 95 %", "99 %", _count(seen, _alarm)),
        *_naming(clear, "excess >= 0.3"),
        *_naming([r for r in _of(good, "single", "found") if r["excess"] >= EDGE * CLEAR], "floor looked for"),
        *_outside(_of(good, "outside")),
        *_shares([r for r in clear if r["effects"]], left_by_nulls(nulls)),
        *_pairs(_of(good, "two")),
        ("segment (motor, sheath, encoder)", ">= 98 %", "100 %", _count(_placed(good), located)),
        ("95 % intervals, matched form", "88-98 %", "92-97 %", _count(matched, lambda r: r["covered"])),
        ("not excited: nothing said", "", "", _count(_of(good, "unexcited"), lambda r: not _alarm(r))),
        ("other loop shape: nothing said", "", "", _count(_of(good, "shape"), lambda r: not _alarm(r))),
        ("line as base: hysteresis first", "", "", _count(_of(good, "base_line"), right)),
        ("backlash in front of the sheath: named", "", "", _count(_of(good, "front"), right)),
        ("the same, and placed there", "", "", _count(_of(good, "front"), lambda r: right(r) and _in_front(r))),
        *_naming([r for r in _of(good, "poor") if r["excess"] >= EDGE * CLEAR], "poor excitation"),
    ]
    table("Acceptance", ["quantity", "gate", "stretch", "measured (95 % interval)"], body)


def _in_front(row: Row) -> bool:
    return all(e["wire"].startswith("x_in") for e in row["effects"])


def _alarm(row: Row) -> bool:
    return row["verdict"] != "none"


def _naming(rows: Sequence[Row], what: str) -> list[tuple[str, str, str, str]]:
    """Name, family, set and its size."""
    if not rows:
        return []
    sizes = [len(printed(r)) for r in rows if r["effects"]]
    return [
        (f"exact name, {what}", ">= 92 %", "97 %", _count(rows, right)),
        (f"exact name and nothing else, {what}", "", "", _count(rows, lambda r: names(r) == r["truth"])),
        (f"family, {what}", ">= 97 %", "99 %", _count(rows, related)),
        (f"truth in printed set, {what}", ">= 98 %", "99 %", _count(rows, lambda r: r["truth"][0] in printed(r))),
        (f"mean size of the set, {what}", "<= 1.4", "<= 1.2", f"{np.mean(sizes):.2f}" if sizes else "no names"),
        (f"unknown instead, {what}", "", "", _count(rows, lambda r: r["verdict"] == "unknown")),
    ]


def _outside(rows: Sequence[Row]) -> list[tuple[str, str, str, str]]:
    rows = [r for r in rows if r["excess"] >= EDGE * CLEAR]
    return [
        ("out of catalogue: unknown", ">= 95 %", "100 %", _count(rows, lambda r: r["verdict"] == "unknown")),
        (
            "out of catalogue: wrong name, confident",
            "<= 3 %",
            "0 %",
            _count(rows, lambda r: r["verdict"] == "named" and removed(r) >= SURE),
        ),
    ]


def _shares(rows: Sequence[Row], least: dict[str, float]) -> list[tuple[str, str, str, str]]:
    """Of the excess over the noise, and over what the same base leaves of the same protocol with nothing hidden."""
    made = []
    for what, known in (("the noise", None), ("what nulls leave", least)):
        shares = [
            removed(r, 1.0 if known is None else max(known[r["protocol"]], 1.0))
            for r in rows
            if known is None or r["protocol"] in known
        ]
        said = f"{np.median(shares):.3f} / {np.quantile(shares, 0.1):.3f}" if shares else "no cases"
        gate = ("", "") if known is None else (">= 0.97 / 0.90", ".99 / .95")
        made.append((f"share removed held out, over {what}: median / 10 % quantile", *gate, said))
    return made


def _pairs(rows: Sequence[Row]) -> list[tuple[str, str, str, str]]:
    return [
        ("two effects: both", ">= 85 %", "95 %", _count(rows, lambda r: set(r["truth"]) <= set(names(r)))),
        ("two effects: exact pair", ">= 70 %", "85 %", _count(rows, lambda r: sorted(r["truth"]) == sorted(names(r)))),
        ("two effects: both in the printed sets", "", "", _count(rows, lambda r: set(r["truth"]) <= _sets(r))),
        ("two effects: at least one", "", "", _count(rows, lambda r: bool(set(r["truth"]) & set(names(r))))),
    ]


def _sets(row: Row) -> set[str]:
    """All names that are printed, those that are also possible too."""
    return {name for e in row["effects"] for name in (e["name"], *e["also"])}


def _placed(good: Sequence[Row]) -> list[Row]:
    return [r for r in good if r["spec"]["group"] in ("chain", "sensor") and r["truth"]]


def motors(good: Sequence[Row]) -> None:
    """The motor's segment, open and in its loop, alone and in the chain."""
    body = []
    for group in ("motor_open", "motor_closed", "chain", "sensor"):
        rows = _of(good, group)
        nulls, hidden = [r for r in rows if not r["truth"]], [r for r in rows if r["truth"]]
        asked = [r for r in hidden if MOTOR[0] in r["families"] or r["truth"][0] in MOTOR]
        body.append(
            (
                group,
                _count(nulls, _alarm),
                _count(hidden, _alarm),
                _count(hidden, right),
                _count(hidden, related),
                _count(hidden, lambda r: r["truth"][0] in printed(r)),
                _count(asked, right),
            )
        )
    head = [
        "group",
        "false alarms",
        "detected",
        "exact name",
        "family",
        "truth in set",
        "exact: friction, gap, limit, load, ripple, delay",
    ]
    table("Motor and chain", head, [row for row in body if set(row[1:]) != {"no cases"}])


def power(rows: Sequence[Row]) -> None:
    """How often an effect is seen and named, against its size."""
    body = []
    for low, high in BINS:
        some = [r for r in rows if EDGE * low <= r["excess"] < EDGE * high]
        body.append(
            (
                f"{low:g} to {high:g}",
                _count(some, _alarm),
                _count(some, right),
                _count(some, related),
                _count(some, lambda r: r["truth"][0] in printed(r)),
            )
        )
    table("Power: single effects against excess", ["excess", "detected", "exact name", "family", "truth in set"], body)


def confusion(rows: Sequence[Row]) -> None:
    """What is said first, for each effect hidden with an excess of 0.3 at least."""
    clear = [r for r in rows if r["excess"] >= EDGE * CLEAR]
    body = []
    for truth in sorted({r["truth"][0] for r in clear}):
        mine = [r for r in clear if r["truth"][0] == truth]
        said = Counter(first(r) for r in mine)
        wrong = ", ".join(f"{k} {n}" for k, n in said.most_common() if k != truth)
        more = Counter(k for r in mine for k in names(r)[1:])
        body.append(
            (
                truth,
                f"{said[truth]}/{len(mine)}",
                wrong or "-",
                ", ".join(f"{k} {n}" for k, n in more.most_common()) or "-",
            )
        )
    table("Confusion: single effects, excess >= 0.3", ["hidden", "named first", "named instead", "named besides"], body)


def chance(good: Sequence[Row]) -> None:
    """False alarms against detections, for every line that the fall held out might have to pass."""
    nulls = [r["gain"] for r in _of(good, "null")]
    seen = [r["gain"] for r in _of(good, "single") if r["excess"] >= EDGE * SEEN]
    body = [
        (f"{x:g}", share(sum(g > x for g in nulls), len(nulls)), share(sum(g > x for g in seen), len(seen)))
        for x in LINES
    ]
    table("Line of materiality, alone [variances of the noise]", ["line", "nulls above it", "singles above it"], body)


def places(good: Sequence[Row]) -> None:
    """Where something is hidden, and where it is said to be."""
    said = Counter(
        (r["at"], tuple(k.split(" -> ")[1] for k, p in r["segments"].items() if p["verdict"] != "none"))
        for r in _placed(good)
    )
    table(
        "Segments",
        ["hidden in", "segments that differ", "cases"],
        [(at, "; ".join(where) or "none", str(n)) for (at, where), n in sorted(said.items())],
    )


def others(good: Sequence[Row]) -> None:
    """The same cases, as sparse regression of the residual and as BIC see them."""
    nulls = _of(good, "null")
    clear = [r for r in _of(good, "single") if r["excess"] >= EDGE * CLEAR]
    body = [
        ("tsmblocks", _count(nulls, _alarm), _count(clear, right), _count(clear, related)),
        (
            "BIC with N samples, our candidates",
            _count(nulls, lambda r: bool(r["bic"])),
            _count(clear, lambda r: r["bic"] == r["truth"][0]),
            _count(clear, lambda r: FAMILY.get(r["bic"]) == r["families"][0]),
        ),
    ]
    with_them = [r for r in clear if r.get("baselines")]
    for name in sorted({k for r in with_them for k in r["baselines"]}):
        mine = [r for r in with_them if name in r["baselines"]]
        quiet = [r for r in nulls if name in (r.get("baselines") or {})]
        body.append(
            (
                name,
                _count(quiet, lambda r: bool(r["baselines"][name]["names"])),  # noqa: B023
                _count(mine, lambda r: r["truth"][0] in r["baselines"][name]["names"]),  # noqa: B023
                _count(mine, lambda r: r["families"][0] in {FAMILY[k] for k in r["baselines"][name]["names"]}),  # noqa: B023
            )
        )
    table("Others on the same data", ["method", "named on nulls", "right name, excess >= 0.3", "right family"], body)


def times(good: Sequence[Row]) -> None:
    """Seconds for a case, on one core of those that worked side by side."""
    body = []
    for group in dict.fromkeys(r["spec"]["group"] for r in good):
        took = [r["seconds"] for r in good if r["spec"]["group"] == group]
        body.append((group, str(len(took)), f"{np.median(took):.1f}", f"{max(took):.1f}"))
    table("Time per case [s]", ["group", "cases", "median", "longest"], body)
