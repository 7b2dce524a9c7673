"""Relatives of transmissions with hysteresis: plays, Dahl and Bouc-Wen loops may replace one another."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import attrs

from tsmblocks.blocks import (
    AsymmetricBoucWen,
    BoucWen,
    DahlHysteresis,
    ElasticBacklash,
    GeneralizedBoucWen,
    Play,
    PrandtlIshlinskii,
    TaoBacklash,
)
from tsmblocks.effects.effect import parameters_of
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block

LOOP_SHARES = (0.25, 0.5, 0.75, 1.25, 2.0)
"""Half widths of the plays of a loop beside its own [half width of the loop]. Chosen: on both sides of it."""


@attrs.frozen
class Loop:
    """The common parameters of transmissions with hysteresis.

    Parameters
    ----------
    gain : float
        Slope of both branches.
    half_width : float
        Half of the loop's width, in the unit of the input.
    share : float
        Share of the travel that is lost just after a reversal.
    """

    gain: float
    half_width: float
    share: float = 1.0

    @property
    def rate(self) -> float:
        """Decay of the lost travel with travel, in 1 over the unit of the input."""
        return self.share / self.half_width


def loop_of(block: Any) -> Loop:
    """Return the common parameters of a transmission with hysteresis.

    Parameters
    ----------
    block : Block
        A block of one of the classes in ``LOOPS``.

    Returns
    -------
    Loop
        Its slope, half width and share of lost travel.
    """
    if isinstance(block, Play):
        gain, width, share = block.gain, block.half_width, 1.0
    elif isinstance(block, DahlHysteresis):
        gain, width, share = block.alpha_x, block.half_width / _positive(block.alpha_x), block.rho / block.alpha_x
    elif isinstance(block, BoucWen):
        full = abs(block.A) / _positive(block.beta + math.copysign(block.gamma, block.gamma * block.A))
        stretch = abs(block.alpha_zeta) * full ** (1 / block.n)
        gain, width, share = block.alpha_x, stretch / _positive(block.alpha_x), -block.alpha_zeta * block.A
        share = share / block.alpha_x
    else:
        gain = (block.alpha1 + block.alpha2) / 2
        width, share = abs(block.A) / (block.theta * gain), -block.A / gain
    return Loop(float(gain), max(abs(float(width)), 1e-9), min(max(abs(float(share)), 0.05), 2.0))


def _positive(value: float) -> float:
    return max(abs(value), 1e-9)


def _elastic(loop: Loop) -> Block:
    return ElasticBacklash(
        alpha_x=loop.gain,
        rho=max(loop.share, 0.5),
        half_width=loop.half_width,
        roundness=0.3,
        growth_up=0.0,
        growth_down=0.0,
    )


def _bouc_wen(loop: Loop) -> Block:
    return BoucWen(alpha_x=loop.gain, alpha_zeta=1.0, A=-loop.share * loop.gain, beta=loop.rate, gamma=0.0, n=1.0)


def _asymmetric(loop: Loop) -> Block:
    return AsymmetricBoucWen(alpha1=loop.gain, alpha2=loop.gain, A=-loop.share * loop.gain, theta=loop.rate, delta=0.0)


def _generalized(loop: Loop) -> Block:
    shape = {"beta1": loop.rate, **{f"beta{k}": 0.0 for k in range(2, 7)}}
    return GeneralizedBoucWen(alpha_x=loop.gain, alpha_zeta=1.0, A=-loop.share * loop.gain, n=1.0, **shape)


def _tao(loop: Loop) -> Block:
    return TaoBacklash(c1=loop.gain, c2=loop.gain, B1=loop.half_width, B2=loop.half_width)


def _loop_plays(loop: Loop) -> Block:
    radii = (loop.half_width, *(share * loop.half_width for share in LOOP_SHARES))
    weights = (0.8 * loop.gain, *(0.04 * loop.gain for _ in LOOP_SHARES))
    return PrandtlIshlinskii(weight0=0.0, radii=radii, weights=weights)


@attrs.frozen
class _Law:
    """A law of hysteresis: how it is made of a loop, its fitted parameters, and further values to start from."""

    made: Callable[[Loop], Block]
    free: tuple[str, ...]
    name: str
    words: str
    starts: tuple[dict[str, float], ...] = ({},)
    port: str = "x"


LAWS: dict[type[Block], _Law] = {
    BoucWen: _Law(_bouc_wen, ("alpha_x", "A", "beta", "gamma", "n"), "hysteresis", "Bouc-Wen hysteresis"),
    AsymmetricBoucWen: _Law(
        _asymmetric,
        ("alpha1", "alpha2", "A", "theta", "delta"),
        "asymmetric_hysteresis",
        "asymmetric Bouc-Wen hysteresis",
    ),
    GeneralizedBoucWen: _Law(
        _generalized,
        ("alpha_x", "A", "n", *(f"beta{k}" for k in range(1, 7))),
        "asymmetric_hysteresis",
        "generalised Bouc-Wen hysteresis",
    ),
    ElasticBacklash: _Law(
        _elastic,
        ("alpha_x", "rho", "half_width", "roundness", "growth_up", "growth_down"),
        "hysteresis",
        "backlash with rounded corners (elastic backlash)",
        ({"roundness": 0.1}, {"roundness": 0.4}),
    ),
    TaoBacklash: _Law(
        _tao, ("c1", "c2", "B1", "B2"), "asymmetric_hysteresis", "backlash with two slopes (Tao)", port="u"
    ),
    PrandtlIshlinskii: _Law(
        _loop_plays,
        ("weight0", *(f"weights[{k}]" for k in range(1 + len(LOOP_SHARES))), "radii[0]"),
        "nonlocal_memory",
        "several plays (Prandtl-Ishlinskii)",
        port="u",
    ),
}
"""Laws of hysteresis that may replace one another."""
LOOPS: dict[type[Block], tuple[str, tuple[type[Block], ...]]] = {
    Play: ("play", tuple(LAWS)),
    DahlHysteresis: ("Dahl hysteresis", tuple(LAWS)),
    BoucWen: ("Bouc-Wen hysteresis", tuple(k for k in LAWS if k is not BoucWen)),
    AsymmetricBoucWen: (
        "asymmetric Bouc-Wen hysteresis",
        (GeneralizedBoucWen, ElasticBacklash, TaoBacklash, PrandtlIshlinskii),
    ),
}
"""Transmissions with hysteresis that have relatives: in words, and the laws that may replace them."""


def _loop(of: type[Block], words: str, law: _Law) -> Relative:
    def block(old: Any, scales: Scales) -> Block:  # noqa: ARG001 - the arguments of a relative
        return law.made(loop_of(old))

    def trials(old: Any, scales: Scales) -> Trials:
        values = parameters_of(law.made(loop_of(old)))
        start = {name: float(values[name]) for name in law.free}
        return Trials({}, tuple({**start, **more} for more in law.starts), bounds=_loop_bounds(law, scales))

    own = "u" if of is Play else "x"
    confused = ("backlash", "hysteresis", "nonlocal_memory", "asymmetric_hysteresis")
    return Relative(
        of=of,
        name=law.name,
        family="loop",
        words=f"{words} replaced by {law.words}",
        block=block,
        trials=trials,
        free=law.free,
        ports={} if law.port == own else {own: law.port},
        excites="full loops, and small loops inside them",
        confused=tuple(k for k in confused if k != law.name),
        separates="full loops to both ends and small loops at several positions",
        variant=law.words,
    )


def _loop_bounds(law: _Law, scales: Scales) -> dict[str, tuple[float | None, float | None]]:
    """Bounds that keep a loop within the range of its input, and its decay from being too fast for the step."""
    reach, bounds = scales.other.reach, dict[str, tuple[float | None, float | None]]()
    for name in law.free:
        if name in ("half_width", "B1", "B2", "radii[0]"):
            bounds[name] = (1e-4 * reach, 5 * reach)
        elif name.startswith("growth"):
            bounds[name] = (-1 / reach, 1 / reach)
        elif name == "theta":
            bounds[name] = (0.3 / reach, 300 / reach)
    return bounds


RELATIVES_OF_LOOPS: tuple[Relative, ...] = tuple(
    _loop(of, words, LAWS[law]) for of, (words, laws) in LOOPS.items() for law in laws
)
"""Relatives of transmissions with hysteresis."""
