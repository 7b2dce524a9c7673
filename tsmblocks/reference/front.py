"""The first page: an overview, with pictures that link to the parts."""

from __future__ import annotations

from tsmblocks.blocks import AsymmetricBoucWen
from tsmblocks.reference import effects, examples, figures, rst, uses

FIRST = "fig16_feedforward_feedback"
PARTS = ("concepts", "blocks", "diagrams", "effects", "python", "commands")


def pages() -> dict[str, str]:
    """The first page, and the index of the concepts."""
    return {"index": _index()}


def _index() -> str:
    return rst.page(
        rst.heading("tsmblocks"),
        "Block diagrams for mechanisms with friction, backlash and hysteresis: assemble a model and its controller "
        "from blocks, run it at a fixed step, fit it to recordings, find effects that it lacks, compensate them.",
        rst.html(uses.linked_picture(uses.shipped()[FIRST], up="")),
        f"The paper's Fig. 16 (:doc:`diagrams/{FIRST}`); each block leads to its page.",
        rst.html(_cards()),
        rst.contents(f"{name}/index" for name in PARTS),
    )


def _cards() -> str:
    run = examples.run(AsymmetricBoucWen)
    loop = figures.over_another(run["x"], run["y"], ("motor end [rad]", "tool end [rad]"))
    gap = effects.traces(effects.placed(uses.effects()["backlash"][0]))
    cards = [
        ("blocks/index", "Blocks", "Equations, ports, numbers with units and bounds, an example of each.", loop),
        (
            "effects/index",
            "Effects",
            f"{len(uses.effects())} effects that a model may lack, their insertion points and their residuals.",
            gap.over_position(),
        ),
        (
            "diagrams/index",
            "Diagrams",
            f"{len(uses.shipped())} files that come with the toolbox: the paper's figures, plants for fits.",
            "",
        ),
        (
            "concepts/index",
            "Concepts",
            "How a diagram becomes equations, what a fixed step means at a kink, how fits "
            "and diagnoses decide, and when not to believe them.",
            "",
        ),
        ("python/index", "Python", "Every public name, by task.", ""),
        ("commands/index", "Commands", "The commands of the terminal.", ""),
    ]
    drawn = [f"<figure>{picture}</figure>" if picture else "" for *_, picture in cards]
    made = [
        f'<a class="card" href="{path}.html"><b>{title}</b><span>{words}</span>{figure}</a>'
        for (path, title, words, _), figure in zip(cards, drawn, strict=True)
    ]
    return f'<div class="cards front">{"".join(made)}</div>'
