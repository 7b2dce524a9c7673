"""Words that people search for, by the page that should be found first; hand-written pages have theirs at the top."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tsmblocks.model.aliases import OTHER_NAMES

FAMILIES: dict[str, tuple[str, ...]] = {
    "sources": ("Test signal", "Excitation", "Signal"),
    "arithmetic": ("Math operations", "Arithmetic"),
    "linear": ("Linear system", "Filter", "Lag"),
    "limits": ("Nonlinearity", "Limits"),
    "logic": ("If", "Condition", "Conditional subsystem"),
    "friction": ("Friction", "Stick-slip", "Stiction", "Static friction"),
    "hysteresis": ("Hysteresis", "Hysteresis loop", "Hysteresis model"),
    "control": ("Controller", "Control", "Compensator"),
    "motor": ("Motor", "Actuator", "Drive"),
    "discrete": ("Sampled", "Discrete time", "Discrete-time", "Sample time", "Digital controller"),
    "sensors": ("Sensor", "Measurement noise"),
    "hydraulics": ("Tank", "Hydraulic"),
}
"""Family of blocks -> words."""
BLOCKS: dict[str, tuple[str, ...]] = {
    "AsymmetricFriction": ("Direction-dependent friction",),
    "CoulombFriction": ("Coulomb", "Dry friction"),
    "DCMotor": ("DC motor", "Armature", "Gear motor"),
    "DahlFriction": ("Dahl", "Dahl model"),
    "Delay": ("Transport lag", "Latency"),
    "Disturbance": ("Mains hum",),
    "Encoder": ("Angle sensor",),
    "EndStops": ("Hard stop", "Bump stop", "Hunt-Crossley contact", "Kelvin-Voigt contact"),
    "FeedforwardCompensator": ("Feedforward", "Hysteresis compensation", "Inverse hysteresis"),
    "FirstOrderLag": ("Time constant", "RC filter"),
    "HysteresisObserver": ("Observer",),
    "LuGreFriction": ("LuGre", "LuGre model", "Bristle model"),
    "MotorTransferFunction": ("Motor model", "Servo motor"),
    "PID": ("PID", "PI controller", "PD controller"),
    "PIDController": ("Anti-windup", "Two degrees of freedom", "Setpoint weighting"),
    "PrandtlIshlinskii": ("Prandtl", "Play operator"),
    "Quantiser": ("Quantization", "Quantisation", "Resolution"),
    "Relay": ("Hysteresis switch", "Schmitt trigger", "Two-point controller"),
    "Ripple": ("Eccentricity", "Cogging", "Torque ripple"),
    "Saturation": ("Saturate", "Actuator limit"),
    "SlidingMass": ("Stick-slip", "Stiction", "Karnopp", "Set-valued friction", "Dry friction with sticking"),
    "StateMachine": ("Finite state machine", "Mode logic"),
    "StribeckFriction": ("Stribeck", "Stribeck curve", "Breakaway torque"),
    "ViscousFriction": ("Damping", "Damper", "Viscous damping"),
}
"""Block -> words that are not its name in another program."""


def of_block(name: str) -> list[str]:
    """Words by which the page of a block is found first: its name in words, its other names, what people type."""
    given = (*OTHER_NAMES.get(name, ()), *BLOCKS.get(name, ()))
    owned = {word.casefold() for words in FAMILIES.values() for word in words}
    words = (spelt for word in (_in_words(name), *given) if word.casefold() not in owned for spelt in spellings(word))
    return list(dict.fromkeys((name, *words)))


def _in_words(name: str) -> str:
    """``ZeroOrderHold`` as ``Zero order hold``."""
    parts = re.sub(r"(?<=[a-z])(?=[A-Z\d])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name).split()
    return " ".join([parts[0], *(part if part.isupper() else part.lower() for part in parts[1:])])


def spellings(word: str) -> Iterable[str]:
    """A term with a blank, with a hyphen, and in one word: ``dead band``, ``dead-band``, ``deadband``."""
    first, *rest = re.split(r"[ -]", word)
    yield word
    if rest:
        tail = " ".join(rest)
        yield from (f"{first} {tail}", f"{first}-{tail}", f"{first}{tail}", "-".join((first, *rest)))
