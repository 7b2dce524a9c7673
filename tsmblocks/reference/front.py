"""The first page: an overview, with pictures that link to the parts."""

from __future__ import annotations

from tsmblocks.blocks import AsymmetricBoucWen
from tsmblocks.html.pages import part
from tsmblocks.reference import effects, examples, figures, rst, uses

FIRST = "fig16_feedforward_feedback"
PARTS = ("concepts", "blocks", "diagrams", "effects", "python", "commands")


def pages() -> dict[str, str]:
    """The first page."""
    words = (
        "Block diagrams for mechanisms with friction, backlash and hysteresis: assemble a model and its controller "
        "from blocks, run it at a fixed step, fit it to recordings, find effects that it lacks, compensate them."
    )
    index = rst.page(
        rst.heading("tsmblocks"),
        words,
        rst.html(uses.linked_picture(uses.shipped()[FIRST], up="")),
        f"The paper's Fig. 16 (:doc:`diagrams/{FIRST}`); each block leads to its page.",
        rst.html(_cards()),
        rst.contents(f"{name}/index" for name in PARTS),
    )
    return {"index": index}


def _cards() -> str:
    run = examples.run(AsymmetricBoucWen)
    loop = figures.over_another(run["x"], run["y"], ("motor end [rad]", "tool end [rad]"))
    gap = effects.traces(effects.placed(uses.effects()["backlash"][0])).over_position()
    words = {
        "blocks": "Equations, ports, numbers with units and bounds, an example of each.",
        "effects": f"{len(uses.effects())} effects that a model may lack, their insertion points and their residuals.",
        "diagrams": f"{len(uses.shipped())} files that come with the toolbox: the paper's figures, plants for fits.",
        "concepts": "How a diagram becomes equations, what a fixed step means at a kink, how fits and diagnoses "
        "decide, and when not to believe them.",
        "python": "Every public name, by task.",
        "commands": "The commands of the terminal.",
    }
    return part("contents", words, {"blocks": loop, "effects": gap})
