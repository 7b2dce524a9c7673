"""The first page: an overview, with pictures that link to the parts."""

from __future__ import annotations

from tsmblocks.blocks import AsymmetricBoucWen
from tsmblocks.html.pages import part
from tsmblocks.reference import blocks, effects, examples, figures, gallery, rst, uses

FIRST = "fig09a_without_feedforward"
PAPER = (
    "*Hysteresis modeling and position control of tendon-sheath mechanism in flexible endoscopic systems* "
    "(Mechatronics)"
)
PARTS = (
    "installation", "getting_started", "tutorials/index", "howto/index", "gallery/index", "concepts/index",
    "blocks/index", "diagrams/index", "effects/index", "python/index", "commands/index", "glossary", "comparison",
)  # fmt: skip
"""Pages of the sidebar, in its order."""


def pages() -> dict[str, str]:
    """The first page."""
    words = (
        "Block diagrams in Python for mechanisms with friction, backlash and hysteresis: assemble a model and its "
        "controller from blocks, run it compiled at a fixed step, fit it to recordings, find the effects that it "
        "lacks, and compensate for them."
    )
    index = rst.page(
        rst.heading("tsmblocks"),
        words,
        rst.html(part("gallery", _begin())),
        rst.html(uses.linked_picture(uses.shipped()[FIRST], up="")),
        f"Fig. 9(a) (:doc:`diagrams/{FIRST}`) of the source paper, {PAPER}; each block leads to its page.",
        rst.html(part("gallery", _parts())),
        rst.contents(PARTS),
    )
    return {"index": index}


Card = tuple[str, str, str, str]
"""Address, title, words and picture."""


def _begin() -> list[Card]:
    """Where a new user begins."""
    return [
        ("installation.html", "Installation", "Python 3.11 or newer and pip; no compiler.", ""),
        ("getting_started.html", "Getting started", "A loop with backlash in a few lines.", ""),
        ("howto/response.html", "Step response of a loop", "Plot it, and measure overshoot and settling time.", ""),
        ("tutorials/recording.html", "Diagnose a recording", "A CSV file, one command, and its report explained.", ""),
        ("tutorials/index.html", "Tutorials", "From recordings to a compensator; your own block and effect.", ""),
        ("howto/index.html", "How-to guides", "Fit, diagnose, tune, draw a Bode plot, export C: one task a page.", ""),
    ]


def _parts() -> list[Card]:
    run = examples.run(AsymmetricBoucWen)
    loop = figures.over_another(run["x"], run["y"], ("motor end [rad]", "tool end [rad]"))
    gap = effects.traces(effects.placed(uses.effects()["backlash"][0])).over_position()
    count = sum(map(len, blocks.families().values()))
    words = {
        "blocks": f"{count} blocks with equations, ports, parameters, and an example of each.",
        "effects": f"{len(uses.effects())} effects that a model may lack, their insertion points and their residuals.",
        "gallery": f"{len(list(gallery.listed()))} examples; most with their output.",
        "diagrams": f"{len(uses.shipped())} files that come with the package: the paper's figures, plants for fits.",
        "concepts": "How a diagram becomes equations, what a fixed step costs, how fits and diagnoses decide.",
        "python": "Every public name, by task, with its arguments.",
        "commands": "The commands of the terminal.",
    }
    pictures = {"blocks": loop, "effects": gap}
    found = [(f"{k}/index.html", k.capitalize(), text, pictures.get(k, "")) for k, text in words.items()]
    terms = ("glossary.html", "Glossary", "Terms in the results of a fit and of a diagnosis.", "")
    return [*found, terms, ("comparison.html", "Comparison with other tools", "Features and speed, measured.", "")]
