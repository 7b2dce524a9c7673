"""A diagnosis made up by hand, so that what is said of it can be written down to the letter."""

import itertools

import attrs
import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.segment import (
    Consequence,
    DetectionLimit,
    Gap,
    NamedEffect,
    Quantity,
    RankedCandidate,
    ResidualCoordinate,
    Segment,
    Trace,
)
from tsmblocks.diagnosis.settings import Provenance, Recording, Simulated

DEG = np.pi / 180
NOISE = 0.1 * DEG
NOTES = (
    "full: x_in was filtered with zero phase, cut-off 9.5 Hz (chosen from its spectrum); 0.061 deg rms was removed.",
    "half: x_in was filtered with zero phase, cut-off 12 Hz (chosen from its spectrum); 0.06 deg rms was removed.",
    "half: x_in was held constant where it moves no more than its noise (3 % of the samples).",
    "the plant was started anew.",
)


def trace(name, size, n=400, seed=1, output="x_out", piece=0.0):
    """A motion, an error of 0.5 deg with the sign of the direction, and noise of 0.1 deg that stays afterwards."""
    rng = np.random.default_rng(seed)
    t = piece + np.arange(n) * 0.02
    x = size * np.sin(1.3 * t)
    noise = NOISE * rng.standard_normal(n)
    wrong = 0.5 * DEG * np.sign(np.cos(1.3 * t))
    measured = 0.9 * x
    before, after = measured - wrong - noise, measured - noise
    edges = np.linspace(0, n, 9).astype(int)
    excess = [[t[a], t[b - 1], np.mean((wrong + noise)[a:b] ** 2) / NOISE**2] for a, b in itertools.pairwise(edges)]
    return Trace(name, output, "rad", t, measured, before, after, x, "x_in", np.array(excess), "rad")


def ranked(name, share, *, number=1, named=False, in_set=False, fitted=True, variant="", across=None, **more):
    """A candidate; its gain is counted in an excess of 20 variances."""
    return RankedCandidate(
        number,
        "x_in -> x_out",
        name,
        variant,
        "loop",
        "offset.y -> x_out",
        20 * share,
        share,
        20 * share if across is None else across,
        9.5 if fitted else float("nan"),
        2.0,
        in_set,
        named,
        fitted,
        more.get("at_bound", ()),
        more.get("parameters", {}),
        why_not=more.get("why_not", ""),
        words=more.get("words", ""),
        new=share if across is None else across / 20,
    )


BACKLASH = NamedEffect(
    "backlash",
    "loop",
    "a backlash gap",
    "x_in -> x_out",
    "offset.y -> x_out",
    "backlash",
    {"half_width": Quantity(0.5 * DEG, 0.48 * DEG, 0.52 * DEG, "rad")},
    0.98,
    0.97,
    ("hysteresis",),
    "two amplitudes, minor loops, or an odd multisine",
    "diagram.insert('backlash', …, after='offset.y')",
    {"gap width": Quantity(1.0 * DEG, 0.96 * DEG, 1.04 * DEG, "rad")},
)
GAP = Gap(
    "x_out",
    "rad",
    NOISE,
    "given",
    (0.5 * DEG, 0.1 * DEG),
    (0.52 * DEG, 0.104 * DEG),
    {"full": (0.53 * DEG, 0.105 * DEG), "half": (0.51 * DEG, 0.103 * DEG)},
)
WHERE = (ResidualCoordinate("direction", 0.9, "the sign of the error depends on the direction"),)
LIMITS = (
    DetectionLimit(
        "backlash",
        "half_width",
        0.02 * DEG,
        "rad",
        "reversals at two amplitudes or more",
        "gap width",
        0.04 * DEG,
        "rad",
    ),
    DetectionLimit("drift", "rate", 1e-5, "", "a long session on one clock"),
    DetectionLimit("coulomb_friction", "friction.level", None, "", "reversals of the motion", cause="not excited"),
    DetectionLimit(
        "offset", "bias", None, "", "anything", cause="absorbed", absorbed_by={"offset.bias": "1 deg per deg"}
    ),
)
NAMED = Segment(
    "x_in -> x_out",
    ("x_in",),
    ("x_out",),
    "named",
    25.0,
    {"x_out": NOISE},
    (BACKLASH,),
    (GAP,),
    WHERE,
    (
        ranked("backlash", 0.98, named=True, in_set=True, parameters={"half_width": 0.5 * DEG}),
        ranked("hysteresis", 0.975, in_set=True, parameters={"loop.rho": 0.3}, at_bound=("loop.rho",)),
        ranked("dead_time", -3.0, across=2.0),
        ranked("drift", 0.01, fitted=False, variant="slow"),
        ranked("dead_time", 0.2, number=2),
    ),
    LIMITS,
    (trace("full", 0.8), trace("half", 0.4, seed=2)),
    0.9,
    "",
)
UNKNOWN = attrs.evolve(
    NAMED,
    verdict="unknown",
    effects=(),
    complete=False,
    predictable=(0.9, 0.9),
    ranking=(ranked("dead_time", 0.24),),
    gaps=(attrs.evolve(GAP, train=GAP.train[:1], held_out=GAP.held_out[:1], experiments={"full": (0.53 * DEG,)}),),
)
NONE = attrs.evolve(
    UNKNOWN,
    verdict="none",
    excess=0.07,
    where=(),
    gaps=(Gap("x_out", "rad", NOISE, "rests", (0.1 * DEG,), (0.103 * DEG,), {"full": (0.103 * DEG,)}),),
)


SIMULATED = Simulated(
    {"full": {"backlash.m": 0.1}, "half": {"backlash.m": -0.2}}, {"full": 0.01, "half": 0.01}, ("x_out",), ("x_in",)
)
PROVENANCE = Provenance(
    "0.1.0",
    "tendon_sheath_linear",
    (
        Recording("full", "full.csv", ("x_in [deg]", "x_out [deg]"), 400, 0.02),
        Recording("half", "", ("x_in [deg]", "x_out [deg]"), 400, 0.02),
    ),
    {"noise floor": "x_out 0.1 deg (given)", "seed": "3"},
)


def diagnosis(*segments, **changes):
    """The segments, by default the one with backlash, as a whole."""
    segments = segments or (NAMED,)
    base = tsm.load("tendon_sheath_linear")
    named = any(s.effects for s in segments)
    changed = base.with_parameters({"gain.gain": 0.91, "offset.bias": 0.01 * DEG})
    augmented = changed.insert("backlash", Play(half_width=0.5 * DEG), after="offset.y") if named else base
    found = Diagnosis(
        base.title,
        ("full", "half"),
        3,
        segments[0].verdict,
        "",
        tuple(e for s in segments for e in s.effects),
        segments,
        base,
        augmented,
        Consequence("rad", "full", (20 * DEG, 7 * DEG), (2 * DEG, 0.6 * DEG), (1 * DEG, 0.3 * DEG)) if named else None,
        NOTES,
        "done",
        given=base,
        simulated=SIMULATED if named else attrs.evolve(SIMULATED, start_states={"full": {}, "half": {}}),
        provenance=PROVENANCE,
    )
    return attrs.evolve(found, **changes)
