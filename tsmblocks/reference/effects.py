"""Pages of effects: what each is, its insertion points, its parameters, and its residual."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from typing import Any

import attrs
import numpy as np

from tsmblocks.blocks import MultiSine
from tsmblocks.common.errors import TsmError
from tsmblocks.common.tables import listed, unique_names
from tsmblocks.diagnosis.candidates import unit_of_signal, whole_turn
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.presentation import in_display_units, unit_of
from tsmblocks.diagnosis.variants import VARIANT_WORDS, parts_of
from tsmblocks.effects import Effect, Scales, Trials, span_of
from tsmblocks.html import block_facts
from tsmblocks.model.arguments import Inlet
from tsmblocks.model.block import Block, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.plots.panels import shown
from tsmblocks.reference import figures, rst, uses
from tsmblocks.reference.blocks import LETTERS, bounds, default_text, own_unit
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate

STOP, STEP = 20.0, 2e-3
PLACES = {
    "output": "on the wire of a measured output",
    "input": "on the wire of a measured input, in front of the model",
    "loop": "inside a control loop: on the control error, on the command, or on what is fed back",
    "balance": "on the wire that fills a measured level or heats a measured part: one integration before it",
    "element": "on the wire into a gain or a viscous friction inside the model, such as a spring or a damper",
    "branch": "on the wire from a measured input to one of several blocks, from there to a sum, or behind a sensor",
    "across": "on the wire of a measured output, where it reads the input as well",
    "mode": "on the wire of a measured output, where it reads the force or voltage that drives it",
    "parallel": "on the wire of a measured output, where it reads an input that acts on it through a lag or integrator",
    "drive": "on the wire that sets the output in motion (a force, a voltage)",
    "load": "on the force or the voltage that sets the output in motion; it reads the motion of the output",
    "brake": "on the force or the voltage that sets the output in motion, where that is a speed",
    "transmission": "inside the model, on a wire with a position, from one part of a transmission to the next",
    "deflection": "on the deflection of an elastic part, the difference of two positions that its force moves",
}
FAMILIES = {
    "friction": "Forces that resist a motion, subtracted from the force or voltage that drives it.",
    "loop": "Play and hysteresis that a model lacks or describes by another form.",
    "delay": "Dynamics of the transmission: dead time, lag, resonance, dependence on the speed.",
    "map": "Static characteristics of position: slack, limits, bends, ripple.",
    "load": "Forces that depend on position, and constant loads.",
    "time": "Parameters, offsets and disturbances that are not constant.",
    "limit": "Limits of speed.",
}
TITLES = {
    "loop": "Hysteresis and backlash",
    "delay": "Delays and dynamics",
    "map": "Static characteristics",
    "load": "Loads",
    "time": "Changes over time",
    "limit": "Rate limits",
}
"""Headings of families whose name says too little."""
PLANTS = {
    "output": "tendon_sheath_asymmetric",
    **dict.fromkeys(("drive", "load", "brake", "parallel", "mode"), "motor_linear"),
    "branch": "fig07_observer",
    "loop": "fig09a_without_feedforward",
    "transmission": "belt_drive",
    "deflection": "flexible_joint",
    "balance": "two_tanks",
    "element": "flexible_joint",
}
"""Shipped diagrams into which the pages insert effects, by place: those on signals where no other is given."""
SPEED = {"v": "motor.v"}
"""The measured output of the motor where that is a speed."""
REFERENCE = "ref"
"""The source of the reference of a control loop, in whose place there is a measured input."""
INPUTS = {
    "x_in": MultiSine(amplitudes=(0.6, 0.3), frequencies=(0.15, 0.4), unit="rad"),
    "u": MultiSine(amplitudes=(1.5, 1.5), frequencies=(0.2, 0.5), phases=(math.pi / 2, math.pi / 2), unit="V"),
    "v": MultiSine(amplitudes=(0.6, 0.3), frequencies=(0.15, 0.4), unit="rad/s"),
    "torque": MultiSine(amplitudes=(6.0, 3.0), frequencies=(0.2, 0.5), unit="N*m"),
    "voltage": MultiSine(amplitudes=(1.5, 0.8), frequencies=(0.05, 0.15), unit="V"),
}
REST = {"voltage": 3.0}
"""Inputs that vary about another value than zero: a pump turns one way only."""
PLACE_IN_TRIALS = {"position_ripple": 1 / 8}
"""Which of the trials of an effect its page shows, as a share of their list, where it is not the one in the middle: of
ripples, one of a few periods over the range."""
LINE = 0.7
"""Frequency of a disturbance on the pages [Hz]."""


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    found = uses.effects()
    parts = [
        rst.heading("Effects"),
        "What a model may lack. ``tsm.diagnose`` inserts each of these at every admissible signal and fits it together "
        f"with the model; how it decides: {rst.link('/concepts/diagnosis')}. An effect of your own takes part when it "
        f"is registered: {rst.link('/python/diagnosis')}.",
    ]
    for family in dict.fromkeys(some[0].family for some in found.values()):
        rows = [
            (
                rst.link(f"/effects/{name}", name),
                rst.words(_words(some)),
                ", ".join(dict.fromkeys(e.place for e in some)),
            )
            for name, some in found.items()
            if some[0].family == family
        ]
        parts += [rst.heading(_title(family), 1), FAMILIES.get(family, "")]
        parts.append(rst.table(("Effect", "What it is", "Places"), rows, (28, 52, 20)))
    plants = []
    for name, diagram in uses.shipped().items():
        if diagram.inputs:
            wires = ", ".join(f"{site.place} ``{site.words(diagram)}``" for site in _sites(diagram))
            plants.append((rst.link(f"/diagrams/{name}", name), wires))
    index = rst.page(
        *parts,
        rst.section("Places", ("Place", "Where that is"), PLACES.items(), (18, 82)),
        "In the shipped diagrams that recordings can drive:",
        rst.table(("Diagram", "Places and their wires"), plants, (34, 66)),
        rst.contents(found),
    )
    return {"effects/index": index, **{f"effects/{name}": page(name, some) for name, some in found.items()}}


def _title(family: str) -> str:
    return TITLES.get(family, family.capitalize())


def _words(some: list[Effect]) -> str:
    """What an effect is, in all its variants, whether in front of the model or not."""
    said = (e.words.removesuffix(" in front of the model").removesuffix(",") for e in some)
    return "; ".join(dict.fromkeys(said))


def _links(folder: str, names: Iterable[str]) -> str:
    return ", ".join(rst.link(f"/{folder}/{name}", name) for name in dict.fromkeys(names))


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def page(name: str, some: list[Effect]) -> str:
    """The page of one effect, with all its variants."""
    first = some[0]
    contains = _links("effects", (k for e in some for k in e.contains))
    facts = [
        f":Family: {_title(first.family)}",
        f":Excited by: {rst.words(first.excites)}",
        f":Often confused with: {_links('effects', (k for e in some for k in e.confused)) or 'nothing else here'}",
        f":Distinguished by: {rst.words(first.separates)}",
        *([f":Contains: {contains}"] if contains else []),
    ]
    has_letters = any("?" in _fields(e.block)[k].unit for e in some for k in e.free)
    opening = f"{rst.words(_capital(_words(some)))}."
    alike = [[one for one in some if _is_separate(one, effect)] for effect in some]
    titles, equations = _titles(some), _equations(some)
    shown = [k for k, effect in enumerate(some) if not any(effect in others for others in alike)]
    return rst.page(
        rst.heading(name),
        opening,
        "\n".join(facts),
        LETTERS * has_letters,
        *(_variant(some[k], titles[k], equations[k], alike[k]) for k in shown),
    )


def _is_separate(one: Effect, shared: Effect) -> bool:
    """Whether a variant is another with separate values in each recording, which looks the same on a page."""
    alike = (one.place, one.block, one.free) == (shared.place, shared.block, shared.free)
    return alike and bool(one.local) and not shared.local


def _titles(some: list[Effect]) -> list[str]:
    """The headings of the variants of an effect: place and words, and in what it differs from one with the same."""
    said: dict[str, set[str]] = {}
    found = []
    for effect in some:
        title, parts = f"{_capital(effect.place)}: {effect.words}", parts_of(effect.variant)
        more = [VARIANT_WORDS[part] for part in parts if part not in said[title]] if title in said else []
        said.setdefault(title, set()).update(parts)
        found.append(", ".join([title, *more]))
    return found


def _equations(some: list[Effect]) -> list[str]:
    """The equation of each variant that is one block, at the first one of its class; else nothing."""
    classes = [type(effect.block) for effect in some]
    return [
        block_facts.words(cls)[1] if issubclass(cls, Block) and cls not in classes[:k] else ""
        for k, cls in enumerate(classes)
    ]


def _variant(effect: Effect, title: str, equation: str, separate: list[Effect]) -> str:
    """The section of a variant; ``separate`` are those that differ by separate values in each recording alone."""
    made = placed(effect)
    types = list(dict.fromkeys(uses.types_in(effect.block)))
    names = [rst.code(name) for name in separate[0].local] if separate else []
    own = f" Tried with a separate value of {listed(names, 9)} in each recording as well." if names else ""
    return rst.page(
        rst.heading(title, 1),
        f"Its place is {PLACES[effect.place]}. Block{'s' if len(types) > 1 else ''}: {_links('blocks', types)}.{own}",
        rst.formula(equation) if equation else "",
        rst.html(uses.linked_picture(effect.block)) if isinstance(effect.block, Diagram) else "",
        _numbers(effect, made),
        _residual(made),
    )


def _numbers(effect: Effect, made: Placed) -> str:
    fields, bounded = _fields(effect.block), made.trials.bounds
    rows = []
    for name in effect.free:
        field, null = fields[name], effect.null.get(name)
        ends = zip(("from", "to"), bounded.get(name, (None, None)), strict=True)
        searched = " ".join(f"{words} {made.displayed(name, v)}" for words, v in ends if v is not None)
        none = "" if null is None else default_text(null)
        rows.append((rst.code(name), own_unit(field.unit), none, bounds(field), searched, rst.words(field.about)))
    within = ""
    if effect.within:
        names = " or ".join(map(rst.code, effect.within))
        within = f" Its estimate must not end at a bound of {names}: there it is another effect."
    return rst.page(
        rst.table(
            ("Fitted", "Unit", "Value without effect", "Bounds", "Search range in the example", "Meaning"),
            rows,
            (17, 8, 11, 14, 18, 32),
        ),
        f"With the values under *Value without effect* the effect passes its signal on bit for bit.{within}",
    )


def _fields(block: Block | Diagram, prefix: str = "") -> dict[str, Any]:
    """The declaration of each parameter of an effect's block, by the name that the effect uses."""
    if isinstance(block, Block):
        return {
            prefix + leaf: block.fields()[key]
            for key, value in block.parameters.items()
            for leaf, _ in leaves(value, key)
        }
    found: dict[str, Any] = {}
    for name, inner in block.blocks.items():
        found |= _fields(inner, f"{prefix}{name}.")
    leafs = [b for b in block.blocks.values() if isinstance(b, Block)]
    for name in block.values:  # a shared value is declared by the block that uses it
        found[prefix + name] = next(b.fields()[k] for b in leafs for k, v in b.parameters.items() if v == f"${name}")
    return found


# ---- residuals -------------------------------------------------------------------------------------


@attrs.frozen(eq=False)
class Placed:
    """An effect in a shipped diagram, at ``sizes`` from which a diagnosis starts; ``base`` is that diagram alone.

    ``block`` is the name of its block.
    """

    block: str
    plant: str
    base: Diagram
    site: InsertionPoint
    trials: Trials
    sizes: dict[str, float]
    diagram: Diagram

    def displayed(self, name: str, value: float) -> str:
        """A value of a parameter of the effect with its unit."""
        return in_display_units(value, unit_of(self.diagram, f"{self.block}.{name}"))


@functools.cache
def placed(effect: Effect) -> Placed:
    """An effect on its wire in a shipped diagram. Raises TsmError where there is no such wire."""
    plant = PLANTS.get(effect.place, PLANTS["output"])
    base = uses.shipped()[plant]
    if effect.place in ("brake", "parallel"):
        base = base.rewire(outputs=SPEED)
    elif effect.place == "loop":
        base = _with_measured_reference(base)
    site = next((s for s in _sites(base) if s.place == effect.place), None)
    if site is None:
        raise TsmError(f"there is no place '{effect.place}' in the diagram {plant}.")
    trials = effect.trials(attrs.evolve(_scales(base, site), one_clock=not effect.local))
    if trials is None:
        raise TsmError(f"effect {effect.name} has nothing to try in the diagram {plant}.")
    shape = trials.shapes[int(len(trials.shapes) * PLACE_IN_TRIALS.get(effect.name, 1 / 2))]
    sizes = {**shape, **trials.strengths}
    name = unique_names([*base.blocks, effect.name])[-1]
    made = site.put(base, name, effect.block)
    made = made.with_parameters({f"{name}.{k}": v for k, v in {**trials.fixed, **sizes}.items()})
    return Placed(name, plant, base, site, trials, sizes, made)


def _with_measured_reference(loop: Diagram) -> Diagram:
    """A control loop with an input instead of the source of its reference, and the output that it controls."""
    ends = [".".join(x.target) for x in loop.links if x.source[0] == REFERENCE]
    blocks = {name: block for name, block in loop.blocks.items() if name != REFERENCE}
    cut = [f"{REFERENCE}.y -> {end}" for end in ends]
    return loop.rewire(cut=cut, blocks=blocks, inputs={"x_in": Inlet(ends, unit="rad")}, outputs={"x": "motor.y"})


@functools.cache
def _sites(base: Diagram) -> list[InsertionPoint]:
    return insertion_points(base, list(base.outputs))


@functools.cache
def _run(diagram: Diagram) -> Run:
    (name,) = diagram.inputs
    t = np.arange(0.0, STOP, STEP)
    source = INPUTS[name]
    tones = zip(source.amplitudes, source.frequencies, source.phases, strict=True)
    u = REST.get(name, 0.0) + sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    return simulate(diagram, inputs={name: (t, u)}, hold="cubic", stop=float(t[-1]), step=STEP, check_step=False)


def _scales(plant: Diagram, site: InsertionPoint) -> Scales:
    """The scales of the signals at an insertion point of a plant."""
    run = _run(plant)
    wire, other = (
        attrs.evolve(span_of([np.asarray(run[k])], [STEP]), turn=whole_turn(unit_of_signal(plant, k)))
        for k in (site.signal, site.other or site.signal)
    )
    return Scales(wire, other, 0.0, STOP, STEP, STOP, (LINE,))


@attrs.frozen(eq=False)
class Traces:
    """The output of the plant without an effect, and the residual of a model without it, in display units."""

    t: np.ndarray
    signals: dict[str, np.ndarray]
    labels: dict[str, str]

    def over_time(self) -> str:
        """A chart of both over time."""
        return figures.over_time(self.t, self.signals, self.labels)

    def over_position(self) -> str:
        """A chart of the residual over the output."""
        (x, x_label), (y, y_label) = zip(self.signals.values(), self.labels.values(), strict=True)
        return figures.over_another(x, y, (x_label, y_label))


def traces(made: Placed) -> Traces:
    """Run the plant with and without the effect."""
    output = made.site.output
    unit_in = made.diagram.unit(output)
    (before, label), (after, _) = (shown(_run(one)[output], unit_in) for one in (made.base, made.diagram))
    labels = {output: f"{output} [{label}]", "residual": f"residual [{label}]"}
    return Traces(_run(made.base).t, {output: before, "residual": after - before}, labels)


def _residual(made: Placed) -> str:
    """Charts of the effect's contribution to the plant's output, over time and over position."""
    found = traces(made)
    sizes = ", ".join(f"``{k}`` = {made.displayed(k, v)}" for k, v in made.sizes.items())
    drawn = [found.over_time(), found.over_position()]
    return rst.page(
        "The residual of a model without it (what the effect adds to the output), in "
        f"{rst.link(f'/diagrams/{made.plant}', made.plant)} on the wire "
        f"``{made.site.words(made.base)}``, with {sizes}:",
        rst.html(figures.side_by_side(drawn, list(found.labels))),
    )
