"""The glossary: a page written by hand, with the words and limits that the code has for its terms."""

from __future__ import annotations

import inspect
import textwrap

from tsmblocks.data.noise_floor import CONTENT
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.variants import VARIANT_WORDS
from tsmblocks.fitting.score import Difference
from tsmblocks.fitting.text import CLOSE
from tsmblocks.reference import hand_written, rst


def pages() -> dict[str, str]:
    """The page by its path; a mark such as ``@fit@`` gives way to what the code says."""
    text = (hand_written.FOLDER / "glossary.rst").read_text(encoding="utf-8")
    said = {
        "fit": inspect.cleandoc(Difference.fit_percent.__doc__ or ""),
        "floors": _listed(CONTENT),
        "variants": _listed(VARIANT_WORDS),
        "reduction": f"{100 * MIN_VARIANCE_REDUCTION:g}",
        "close": f"{CLOSE:g}",
    }
    for name, words in said.items():
        text = text.replace(f"@{name}@", textwrap.indent(words, " " * 6).strip())
    return {"glossary": text}


def _listed(words: dict[str, str]) -> str:
    return rst.listed(f"*{name}*: {text}" for name, text in words.items())
