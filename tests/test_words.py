"""The words of the field: no private idiom in messages, docstrings, comments and pages."""

import io
import itertools
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
IDIOM = {
    r"foretell\w*|foretold": "predict",
    r"(?:cannot|can not|could not|hard to|can) be told(?: apart| from)?|tell\w* apart|told apart": "indistinguishable",
    r"(?:is|are|was|were|be|been) (?:told|said)\b": "reported, named, given",
    r"what is left\b|what was left\b": "residual",
    r"runs away|left the finite numbers": "diverges",
    r"start values?": "initial state",
    r"begins anew|stands? for\b|by itself\b": "restarts; denotes; alone",
    r"numbers of (?:a|the) (?:diagram|model)": "parameters",
    r"what the data cannot tell|no slope leads": "not identifiable; nonsmooth",
    r"goes with it|its own scatter|what chance stays below": "correlation; t-statistic; critical value",
    r"folds? of time": "cross-validation blocks",
    r"in the place of|for good\b|what is wrong": "instead of, replaces; permanently; fault",
    r"(?:bent|drawn|formed|computed|placed|numbered|solved for) anew": "again",
    r"stands? and jumps?|runs? ahead of|keeps? silent": "piecewise constant; leads; reports nothing",
    r"(?:an |the )?(?:expression|text|comparison|number|wire)s? (?:is|are) wanted": "expected",
    r"more is missing than|something is missing in": "unmodelled effect, unexplained residual",
    r"stands? in for another": "explained by another",
    r"stands? inside (?:each other|another|diagrams)": "nested",
}
"""Pattern -> the standard term."""
SOURCES = sorted((ROOT / "tsmblocks").rglob("*.py"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted(p for kind in ("*.md", "*.rst", "*.html") for p in (ROOT / "tsmblocks").rglob(kind))


def room_of(path):
    return path.relative_to(ROOT).parts[:2][-1]


ROOMS = {room: list(paths) for room, paths in itertools.groupby(sorted([*SOURCES, *PAGES], key=room_of), room_of)}
"""Package, top module or page -> its files."""


def words_of(path):
    """(line, text) of every comment and string of a module; every line of another file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from enumerate(text.splitlines(), 1)
        return
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in kinds:
            yield from enumerate(token.string.splitlines(), token.start[0])


@pytest.mark.parametrize("room", ROOMS)
def test_no_private_idiom(room):
    found = [
        f"{path.relative_to(ROOT)}:{number}: '{hit.group()}', say: {standard}"
        for path in ROOMS[room]
        for number, text in words_of(path)
        for pattern, standard in IDIOM.items()
        for hit in re.finditer(rf"\b(?:{pattern})", text, re.IGNORECASE)
    ]
    assert found == []
