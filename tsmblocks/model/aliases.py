"""Names of blocks in other programs, for hints in messages."""

from __future__ import annotations

from collections.abc import Collection

from tsmblocks.common.errors import near

OTHER_NAMES: dict[str, tuple[str, ...]] = {
    "Play": ("Backlash", "Gear backlash", "Hysteresis"),
    "Delay": ("Transport delay", "Time delay", "Pure delay"),
    "DeadTime": ("Variable transport delay", "Totzeit"),
    "UnitDelay": ("Memory", "One sample delay", "Register"),
    "DeadZone": ("Dead band", "Deadspace"),
    "Gain": ("Gear", "Gear ratio", "Gearbox", "Scale", "Proportional"),
    "Sum": ("Add", "Adder", "Subtract", "Difference", "Summing junction", "Comparator"),
    "Product": ("Multiply", "Multiplier"),
    "FirstOrderLag": ("PT1", "Low pass", "Low pass filter"),
    "SecondOrderLag": ("PT2", "Mass spring damper"),
    "FilteredDerivative": ("DT1", "High pass", "High pass filter"),
    "Saturation": ("Limiter", "Limit", "Clip", "Clamp"),
    "RateLimit": ("Slew rate", "Slew rate limiter"),
    "Quantiser": ("ADC", "Rounding"),
    "SensorNoise": ("White noise", "Band limited white noise", "Random number"),
    "LookupTable": ("Lookup", "1-D lookup table", "Interpolation table", "Characteristic"),
    "LookupTable2D": ("2-D lookup table", "Lookup 2D", "Characteristic map", "Interpolation2D"),
    "Enable": ("Enabled subsystem", "Enable port"),
    "Trigger": ("Triggered subsystem", "Trigger port", "Function call subsystem"),
    "TransferFunction": ("Transfer fcn", "tf"),
    "DiscreteTransferFunction": ("Discrete transfer fcn", "Discrete filter"),
    "StateSpace": ("ss", "LTI system"),
    "ZeroPoleGain": ("zpk", "Zero pole"),
    "Recorded": ("From workspace", "From file", "Signal from file"),
    "Sine": ("Sine wave", "Signal generator"),
    "Ramp": ("Clock", "Time"),
    "StribeckFriction": ("Joint friction",),
}
"""Block -> its names in other programs."""


def _letters_and_digits(name: str) -> str:
    """A name without case, blanks and signs."""
    return "".join(c for c in name.casefold() if c.isalnum())


BLOCK_NAMES = {_letters_and_digits(name): block for block, names in OTHER_NAMES.items() for name in names}


def block_hint(name: str, known: Collection[str], otherwise: str = "") -> str:
    """A hint with the block that has another name elsewhere; else the near miss, as ``errors.near``."""
    here = BLOCK_NAMES.get(_letters_and_digits(name))
    return f" Its name here is '{here}'." if here and here in known else near(name, known, otherwise=otherwise)
