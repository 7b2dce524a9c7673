"""Checks of an effect: its names, null and trial values, and how it scales with signals and steps."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, TsmError, in_words
from tsmblocks.effects import Effect, Trials
from tsmblocks.files import dumps, loads
from tsmblocks.model.block import Block, is_reference, map_leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.testing.effect_bench import Bench
from tsmblocks.testing.promises import broken_promises, need
from tsmblocks.testing.suites import Suite

EFFECT_CHECKS = Suite()
FAR = (1e-3, 1e3)
"""Factors by which signals are scaled. Chosen: a micrometre or a kilometre where a metre is usual."""
MOST_CHANGE = 100.0
"""How many times larger or smaller an effect may become, of its signal, where that is scaled. Chosen: generous."""
LEAST_CHANGE = 1e-6
"""Share of a signal from which a change counts. Chosen: above rounding, below what is ever measured."""
SMALL = 1e-3
"""Share of a strength that still has to show. Chosen."""
LINEAR = 1e-2
"""How much of its proportional part a small size has to keep. Chosen: a square keeps SMALL of it."""
STEP_SHARE = 0.1
"""Share of an effect that may depend on the step of the run. Chosen: above what kinks make at these steps."""
MOST_SHAPES = 3
"""Shapes of the trials that are run. Chosen: first, last and some between."""
LARGEST = 1e6
"""Size of an output, of its signal, from which parameters made it diverge. Chosen."""
STILL = 0.7
"""Value of a constant signal. Chosen: away from zero, where most states begin."""
MOST_WORDS = 100
"""Characters of an effect's words. Chosen: they are a part of a sentence."""


def check_effect(effect: Effect, *, skip: Collection[str] = ()) -> None:
    """Check an effect of your own: its null, its trial values, how it scales, and its block.

    Parameters
    ----------
    effect : Effect
        The effect.
    skip : list of str, default ()
        Names of checks that do not apply.

    Raises
    ------
    ChecksFailed
        Where checks fail; ``error.broken`` says what was wrong, by check.
    ParameterError
        For anything that is no effect, and for the name of a check that there is not.

    Examples
    --------
    >>> from tsmblocks.blocks import Bias
    >>> from tsmblocks.effects import Effect, Trials
    >>> from tsmblocks.testing import ChecksFailed, check_effect
    >>> offset = Effect(
    ...     name="offset",
    ...     family="map",
    ...     words="an offset",
    ...     place="output",
    ...     block=Bias(bias=0.0),
    ...     null={"bias": 0.0},
    ...     free=("bias",),
    ...     trials=lambda scales: Trials({"bias": 0.1}),
    ... )
    >>> try:
    ...     check_effect(offset)
    ... except ChecksFailed as error:
    ...     print(*error.broken)
    trials_scale_with_the_signal
    """
    if not isinstance(effect, Effect):
        raise ParameterError(f"check_effect takes an effect, got {in_words(effect)}.")
    EFFECT_CHECKS.run(f"effect '{effect.name}'", Bench(effect), skip)


def _sets(trials: Trials, strengths: Mapping[str, float] | None = None) -> Iterator[dict[str, float]]:
    """Parameters of the block that are tried: some of the shapes, with one strength at a time."""
    chosen = np.unique(np.linspace(0, len(trials.shapes) - 1, MOST_SHAPES).round().astype(int))
    given = trials.strengths if strengths is None else strengths
    for k in chosen:
        for name, value in given.items() or ((None, 0.0),):
            yield {**trials.fixed, **trials.shapes[k], **({name: value} if name else {})}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _said(parameters: Mapping[str, float]) -> str:
    return ", ".join(f"{k} = {v:g}" for k, v in parameters.items())


def _needed(bench: Bench) -> Trials:
    """Trials, which signals with lines in several experiments have to excite."""
    made = bench.trials()
    need(made is not None, "it has no trials: trials gave None for signals that are slow, fast and at rest.")
    assert made is not None
    return made


# ---- the checks


@EFFECT_CHECKS.add
def names_read_well(bench: Bench) -> None:
    """The words are a part of a sentence, and the family is a name."""
    effect, words = bench.effect, bench.effect.words
    need(isinstance(words, str) and words.strip(), "it has no words.")
    need(words == words.strip(" ."), f"words are a part of a sentence, without a full stop or blanks: {words!r}.")
    need(len(words) <= MOST_WORDS and "\n" not in words, f"words have more than {MOST_WORDS} characters.")
    family = effect.family
    need(family.isidentifier() and family == family.lower(), f"its family is no name in small letters: {family!r}.")


@EFFECT_CHECKS.add
def null_passes_the_signal(bench: Bench) -> None:
    """With its null the block gives its input u back, bit for bit, on every backend."""
    for backend in ("llvm", "casadi"):
        away = np.abs(bench.run(dict(bench.effect.null), backend=backend) - bench.waves["u"])
        need(
            not away.any(),
            f"at its null it changes the signal by up to {away.max():.3g}, of {np.ptp(bench.waves['u']) / 2:.3g}.",
        )


@EFFECT_CHECKS.add
def trials_fit_the_block(bench: Bench) -> None:
    """Trial values are finite and within all bounds, for small and large, slow and fast signals."""
    for size, slow in ((1.0, 1.0), *((s, 1.0) for s in FAR), *((1.0, s) for s in FAR)):
        trials = Bench(bench.effect, size, slow).trials()
        if trials is None:
            continue
        tried = set(trials.strengths) | set().union(*trials.shapes)
        missing = set(bench.effect.free) - tried
        need(not missing, f"no trial value is given for {', '.join(sorted(missing))}, which is free.")
        for made in _sets(trials):
            where = f"at signals of {size:g} drawn out {slow:g} times"
            need(all(map(math.isfinite, made.values())), f"{_said(made)} is tried {where}.")
            for name in set(made) & set(trials.bounds):
                low, high = trials.bounds[name]
                inside = (low is None or made[name] >= low) and (high is None or made[name] <= high)
                need(inside, f"{name} = {made[name]:g} is tried {where}, outside its bounds {low} to {high}.")
            bench.diagram.with_parameters({f"effect.{k}": v for k, v in made.items()})  # within those of the block


@EFFECT_CHECKS.add
def trials_are_repeatable(bench: Bench) -> None:
    """The same scales give the same trials."""
    need(bench.trials() == bench.trials(), "trials differ between two calls with the same scales.")


@EFFECT_CHECKS.add
def trials_show(bench: Bench) -> None:
    """Trial values change the signal, and the output stays finite."""
    for made in _sets(_needed(bench)):
        change = bench.change(made)
        need(np.isfinite(change).all(), f"{_said(made)} gives values that are not finite.")
        need(
            np.abs(change).max() > LEAST_CHANGE * bench.scales.wire.reach,
            f"{_said(made)} is tried, and does not change the output.",
        )


@EFFECT_CHECKS.add
def every_free_parameter_matters(bench: Bench) -> None:
    """Each parameter that is fitted changes the output somewhere, if only where others are not zero."""
    trials = _needed(bench)
    together = {**trials.fixed, **trials.shapes[len(trials.shapes) // 2], **trials.strengths}
    lifted, idle = {**together, **{k: 0.1 for k in bench.effect.free if not together[k]}}, []
    pairs = [(values, bench.run(values)) for values in (together, lifted)]
    for name in bench.effect.free:
        value = together[name]
        moved = value * 0.9 if value else 0.2
        if all(np.array_equal(bench.run({**values, name: moved}), before) for values, before in pairs):
            idle.append(name)
    need(not idle, f"the output does not depend on {', '.join(idle)}, which is free to be fitted.")


@EFFECT_CHECKS.add
def a_small_size_is_seen(bench: Bench) -> None:
    """A strength acts from its null on: a thousandth of it makes about a thousandth of the change."""
    trials = _needed(bench)
    if not trials.strengths:
        return
    for name, value in trials.strengths.items():
        null = bench.effect.null.get(name, 0.0)

        def size(share: float, name: str = name, null: float = null, value: float = value) -> float:
            sets = _sets(trials, {name: null + share * (value - null)})
            return max(_rms(bench.change(made)) for made in sets)

        need(
            size(SMALL) > LINEAR * SMALL * size(1.0),
            f"{name} acts as a power above one of its size: the search, which is linear at the null, would not see it.",
        )


@EFFECT_CHECKS.add
def trials_scale_with_the_signal(bench: Bench) -> None:
    """The effect of trial values is the same share of the signal for small and large, slow and fast signals."""

    def share(other: Bench) -> float | None:
        trials = other.trials()
        if trials is None:
            return None
        return max(_rms(other.change(made)) for made in _sets(trials)) / _rms(other.waves["u"])

    usual = share(bench)
    need(usual is not None, "it has no trials: trials gave None for signals that are slow, fast and at rest.")
    assert usual is not None
    others = ((FAR[0], 1.0, "small"), (FAR[1], 1.0, "large"), (1.0, FAR[0], "fast"), (1.0, FAR[1], "slow"))
    for size, slow, what in others:
        found = share(Bench(bench.effect, size, slow))
        if found is not None:
            fits = usual / MOST_CHANGE < found < usual * MOST_CHANGE
            seen = f"it changes {found:.2g} of {what} signals, and {usual:.2g} of others"
            need(fits, f"{seen}: take trials from the scales.")


@EFFECT_CHECKS.add
def bounds_keep_it_finite(bench: Bench) -> None:
    """Whatever value of a free parameter the block and the trials accept, the output stays finite."""
    trials, most = _needed(bench), LARGEST * max(1.0, np.abs(bench.waves["u"]).max())
    for made in _sets(trials):
        for name in bench.effect.free:
            value = made.get(name, bench.effect.null.get(name, 0.0))
            for other in (-abs(value) or -1.0, 0.0, 10 * value):
                if not _is_accepted(bench, trials, name, other):
                    continue
                try:
                    largest = np.abs(bench.run({**made, name: other}, method="sdirk2")).max()
                except TsmError:
                    largest = math.inf
                need(largest < most, f"with {name} = {other:g}, which its bounds allow, the output diverges.")


def _is_accepted(bench: Bench, trials: Trials, name: str, value: float) -> bool:
    """Whether the trials and the block accept a value."""
    low, high = trials.bounds.get(name, (None, None))
    if (low is not None and value < low) or (high is not None and value > high):
        return False
    try:
        bench.diagram.with_parameters({f"effect.{name}": value})
    except TsmError:
        return False
    return True


@EFFECT_CHECKS.add
def starts_where_the_signal_is(bench: Bench) -> None:
    """On a constant signal it gives one value from the start: its states begin there, or are ``settled``."""
    if bench.effect.family == "time":
        return  # it changes with time, whatever the signal
    still = {name: np.full(len(bench.t), STILL if name == "u" else 0.0) for name in bench.driven}
    initial = {f"effect.{name}": STILL for name in bench.effect.settled}
    for made in _sets(_needed(bench)):
        out = bench.run(made, waves=still, initial=initial)
        moved = np.abs(out - out[-1]).max()
        where = f"with {_said(made)} it moves by {moved:.3g} while the signal is constant at {STILL:g}"
        need(moved < SMALL * STILL, f"{where}: name in settled the states that have to begin there.")


@EFFECT_CHECKS.add
def does_not_depend_on_the_step(bench: Bench) -> None:
    """Run in steps of half the length it gives nearly the same."""
    for made in _sets(_needed(bench)):
        change = bench.change(made)
        finer = attrs.evolve(bench, finer=2 * bench.finer).change(made)
        apart, size = _rms(change - finer), _rms(finer)
        said = f"with {_said(made)} it changes the signal by {_rms(change):.3g}, in half the step by {size:.3g}"
        need(apart <= STEP_SHARE * max(size, LEAST_CHANGE), f"{said}, {apart:.3g} apart.")


@EFFECT_CHECKS.add
def friction_takes_energy(bench: Bench) -> None:
    """Friction on a drive opposes the motion."""
    if bench.effect.family != "friction" or bench.effect.place not in ("load", "brake"):
        return
    motion = bench.waves["x"]
    rate = np.gradient(motion, bench.t) if bench.effect.place == "load" else motion
    trials = _needed(bench)
    signed = {k: v for k, v in trials.strengths.items() if _has_one_sign(bench, trials, k)}
    for made in _sets(trials, signed) if signed else ():
        power = float(np.mean(bench.change(made) * rate))
        need(power < 0, f"with {_said(made)} it adds energy: its sign is wrong.")


def _has_one_sign(bench: Bench, trials: Trials, name: str) -> bool:
    """Whether a strength cannot be below its null."""
    return not _is_accepted(bench, trials, name, bench.effect.null.get(name, 0.0) - 1e-6 * trials.strengths[name])


@EFFECT_CHECKS.add
def both_sides_have_one_unit(bench: Bench) -> None:
    """Output y has the unit of input u, which it replaces."""
    block = bench.effect.block
    if isinstance(block, Block):
        u, y = block.inports["u"].unit, block.outports["y"].unit
        need(u == y, f"its input u is in {u or 'no unit'}, its output y in {y or 'no unit'}.")


@EFFECT_CHECKS.add
def survives_a_file(bench: Bench) -> None:
    """A diagram with its block in it can be written and read back, and so can every number that it may have."""
    trials = _needed(bench)
    for made in (dict(bench.effect.null), *_sets(trials)):
        diagram = bench.diagram.with_parameters({f"effect.{k}": v for k, v in made.items()})
        need(loads(dumps(diagram)) == diagram, f"a diagram with it, at {_said(made)}, differs when it is read back.")


@EFFECT_CHECKS.add
def its_block_keeps_its_promises(bench: Bench) -> None:
    """Its block passes the checks that all blocks have."""
    for block in _blocks(bench.effect.block):
        broken = broken_promises(block)
        need(not broken, f"{type(block).__name__}: " + "; ".join(f"{k}: {v}" for k, v in broken.items()))


def _blocks(block: Block | Diagram) -> Iterator[Block]:
    """Blocks of an effect, with numbers where they refer to values."""
    if isinstance(block, Block):
        yield block
        return
    for inner in block.blocks.values():
        if isinstance(inner, Block):
            yield with_numbers(inner, block.values)
        else:
            yield from _blocks(inner)


def with_numbers(block: Block, values: Mapping[str, float]) -> Block:
    """A block with the numbers themselves where it refers to values."""
    given = {
        name: map_leaves(lambda _, v: values[v[1:]] if is_reference(v) else v, value)
        for name, value in block.parameters.items()
    }
    return block.replace(**given)
