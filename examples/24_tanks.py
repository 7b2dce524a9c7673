"""What if a plant has an effect that is in no catalogue?  Two tanks that overflow, and a user-defined effect.

A pump fills an upper tank, which empties into a lower one, whose level is measured. The residual of linear tanks is
half a volt. A catalogue of friction and backlash has no overflow of a tank; a user-defined effect is a candidate like
any other. It is inserted on one wire, reads the level of a tank, and a part of the overflow of the upper tank enters
the lower one. Measured data: Schoukens and others (nonlinearbenchmark.org), in the folder cascaded_tanks/ of the one
that TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path
from textwrap import fill

import tsmblocks as tsm
from tsmblocks.blocks import Overflow, Sum
from tsmblocks.effects import Effect, Trials, registered

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit(
        "Set TSMBLOCKS_DATA to a folder that holds cascaded_tanks/ with dataBenchmark.csv of nonlinearbenchmark.org."
    )


def recorded(name):
    """Voltage of the pump and of the level gauge, 4 s apart: ``name`` is Est or Val."""
    path = Path(os.environ["TSMBLOCKS_DATA"]) / "cascaded_tanks/dataBenchmark.csv"
    return tsm.read(path, step=4.0, map={"u": f"u{name}", "y": f"y{name}"}, only=["u", "y"])


def rims(scales):
    """Initial heights of the rim: in the upper part of the range of levels."""
    level = scales.other
    return Trials({}, tuple({"rim": level.middle + share * level.reach} for share in (0.95, 0.8, 0.6)))


def shared_rims(scales):
    """The same, with none or half of the overflow entering the lower tank."""
    return Trials({}, tuple({**rim, "caught": share} for rim in rims(scales).shapes for share in (0.0, 0.5)))


def caught(diagram, name):
    """The diagram in which a part of the overflow of the upper tank runs into the lower one."""
    return diagram.insert("inflow", Sum(signs="++"), before="lower_flow.plus", wires=[f"{name}.spilt -> inflow.plus2"])


null = {"rim": float("inf")}  # no overflow
upper = Effect(
    name="overflow",
    variant="upper",
    family="vessel",
    words="an overflow of the upper tank",
    place="pump -> upper_flow.plus",  # one wire of this diagram
    block=Overflow(),
    null=null,
    free=("rim", "caught"),
    trials=shared_rims,
    reads="upper",
    adds=caught,
    excites="high levels",
)
lower = Effect(
    name="overflow",
    variant="lower",
    family="vessel",
    words="an overflow of the lower tank",
    place="upper_outlet -> lower_flow.plus",
    block=Overflow(),
    null=null,
    free=("rim",),
    trials=rims,
    reads="lower",
    excites="high levels",
)
tanks = tsm.load(Path(__file__).with_suffix(".toml"))
held = {"hold": "zero", "step": 0.5}
with registered(upper, lower):
    found = tsm.diagnose(
        tanks, recorded("Est"), free=["pump.gain", "*_outlet.gain", "gauge.bias"], noise_floor=0.05, **held
    )

print(fill(found.sentence, 79))
(gap,) = found.worst.gaps
print("V, fitted  ", *(f"{rms:6.3f}" for rms in gap.train))
print("V, held out", *(f"{rms:6.3f}" for rms in gap.held_out))
for words, diagram in {"base": found.base, "augmented": found.augmented}.items():
    start = tsm.fit(diagram, recorded("Val"), free=["upper.integral", "lower.integral"], window=(0.0, 200.0), **held)
    print(f"V, validation, {words}: {tsm.score(start.diagram, recorded('Val'), **held)['y'].rms:.3f}")
