"""The candidates of a diagnosis as tables, one for each round of the search."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tsmblocks.common.tables import columns, table_width
from tsmblocks.diagnosis.lines import cut, filled
from tsmblocks.diagnosis.presentation import by_removed
from tsmblocks.diagnosis.rejection import LEFT_OUT
from tsmblocks.diagnosis.segment import RankedCandidate, Segment
from tsmblocks.diagnosis.variants import explained
from tsmblocks.diagnosis.verdict_text import candidate_title, in_table, nothing_to_remove

NUMBERS_WIDTH = 32
"""Characters of the columns of numbers in a table of candidates. Measured."""
MIN_TITLE_WIDTH, MIN_REASON_WIDTH = 14, 24
"""Characters that a table of candidates has at least for their names, and for reasons in a column. Chosen."""
MAX_ROWS = 8
"""Candidates of a round that are reported. Chosen."""
MAX_ROWS_UNNAMED = 3
"""The same for a round in which no effect was named, if others were. Chosen."""


def candidate_tables(segment: Segment) -> list[str]:
    """The candidates that were fitted, by round, and how many were screened out."""
    parts, variants = list[str](), set[str]()
    for number in sorted({r.round for r in segment.ranking}):
        here = [r for r in segment.ranking if r.round == number]
        fitted = by_removed(r for r in here if r.fitted)
        if not fitted:
            continue
        most = MAX_ROWS_UNNAMED if segment.effects and not any(r.named for r in fitted) else MAX_ROWS
        shown = [r for k, r in enumerate(fitted) if k < most or r.named or r.in_set or r.why_not in LEFT_OUT]
        rest = len(here) - len(shown)
        more = f"\nOther candidates, screened out or with a smaller reduction: {rest}." if rest else ""
        key = "* named, ~ indistinguishable from it" if any(r.named for r in here) else "none named"
        remarks = filter(None, [nothing_to_remove(fitted), explained(shown, variants)])
        legend = "".join(f"\n{filled(text)}" for text in remarks)
        key += f"; critical t: {shown[0].line:.1f}"
        key += "; beside the effects named later" if _is_beside_later(segment, number, shown) else ""
        parts.append(f"candidates, round {number} ({key}):\n{_candidate_table(segment, shown)}{legend}{more}")
    if not parts:
        return []
    new = " (new exp.: whole experiments)" if len(segment.gaps[0].experiments) > 1 else ""
    key_words = (
        f"removes: share of the variance above the noise floor that is removed from held-out time blocks{new}; < 0 %: "
        "the residual grows. t: t-statistic of the reduction; critical t: value that the largest t of a round exceeds "
        "by chance in 5 % of cases. The reduction also has to exceed that of surrogate noise."
    )
    return [*parts, filled(key_words)]


def _is_beside_later(segment: Segment, number: int, rows: Sequence[RankedCandidate]) -> bool:
    """Whether candidates of a round were placed beside effects that were named after it: it was then repeated."""
    later = {one.block for one in segment.effects[number:]}
    return any(later & set(re.findall(r"\w+(?=\.)", one.wire)) for one in rows)


def _candidate_table(segment: Segment, shown: Sequence[RankedCandidate]) -> str:
    """Candidates of a round, and why each was not named: beside it, or on narrow terminals below the table."""
    several = len(segment.gaps[0].experiments)
    numbers = NUMBERS_WIDTH - (0 if several > 1 else len("  new exp."))
    wires = [cut(r.wire.strip(), table_width() - numbers - MIN_TITLE_WIDTH) for r in shown]
    beside = table_width() - numbers - max(map(len, wires)) - max(len(candidate_title(r)) for r in shown)
    wide = beside >= MIN_REASON_WIDTH + 2
    head = ["  candidate", "on", "removes", *["new exp."][: several - 1], "t", *["why not"] * wide]
    rows = [
        [
            f"{'*' if r.named else '~' if r.in_set else ' '} {candidate_title(r)}",
            wire,
            in_table(r.share),
            *[in_table(share_across_experiments(r, several))][: several - 1],
            f"{r.t:.1f}",
            *[r.why_not] * wide,
        ]
        for r, wire in zip(shown, wires, strict=True)
    ]
    table = columns([head, *rows], left=(0, 1, len(head) - 1) if wide else (0, 1))
    return table if wide else "\n".join([table, *_reasons(shown)])


def _reasons(shown: Sequence[RankedCandidate]) -> list[str]:
    """Why candidates were not named, those of one reason together."""
    found: dict[str, list[str]] = {}
    for one in shown:
        if one.why_not and not one.in_set:
            found.setdefault(one.why_not, []).append(candidate_title(one))
    texts = [f"{reason}: {', '.join(dict.fromkeys(names))}" for reason, names in found.items()]
    return ["why not named:", *(filled(text, "- ", "  ") for text in texts)] if texts else []


def share_across_experiments(one: RankedCandidate, experiments: int) -> float:
    """The share that a candidate removes with whole experiments held out; NaN where there is only one."""
    return one.new if experiments > 1 else float("nan")
