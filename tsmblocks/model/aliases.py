"""Names of blocks in other programs, for hints in messages."""

from __future__ import annotations

from collections.abc import Collection

from tsmblocks.common.errors import near

OTHER_NAMES: dict[str, tuple[str, ...]] = {
    "Abs": ("Absolute value",),
    "Chirp": ("Chirp signal", "Sweep", "Swept sine"),
    "Comparison": ("Relational operator", "Compare to constant"),
    "Convert": ("Unit conversion", "Radians to degrees"),
    "CoulombFriction": ("Coulomb & viscous friction",),
    "DeadTime": ("Variable transport delay", "Totzeit"),
    "DeadZone": ("Dead band", "Deadspace"),
    "Delay": ("Transport delay", "Time delay", "Pure delay"),
    "DiscreteIntegrator": ("Discrete-time integrator",),
    "DiscretePID": ("Discrete PID controller",),
    "DiscreteTransferFunction": ("Discrete transfer fcn", "Discrete filter"),
    "Enable": ("Enabled subsystem", "Enable port"),
    "Encoder": ("Incremental encoder", "Rotary encoder"),
    "FilteredDerivative": ("DT1", "High pass", "High pass filter"),
    "FirstOrderLag": ("PT1", "Low pass", "Low pass filter"),
    "Gain": ("Gear", "Gear ratio", "Gearbox", "Scale", "Proportional"),
    "Integrator": ("Integral", "1/s"),
    "LeadLag": ("Lead compensator", "Lag compensator", "Lead lag filter"),
    "Logic": ("Logical operator",),
    "LookupTable": ("Lookup", "1-D lookup table", "Interpolation table", "Characteristic"),
    "LookupTable2D": ("2-D lookup table", "Lookup 2D", "Characteristic map", "Interpolation2D"),
    "Play": ("Backlash", "Gear backlash", "Hysteresis"),
    "Product": ("Multiply", "Multiplier"),
    "Quantiser": ("ADC", "Rounding", "Quantizer"),
    "Ramp": ("Clock", "Time"),
    "Random": ("Gaussian noise",),
    "RateLimit": ("Slew rate", "Slew rate limiter", "Rate limiter"),
    "Recorded": ("From workspace", "From file", "Signal from file"),
    "Relay": ("Bang-bang", "On-off controller"),
    "Saturation": ("Limiter", "Limit", "Clip", "Clamp"),
    "SecondOrderLag": ("PT2", "Mass spring damper"),
    "SensorNoise": ("White noise", "Band limited white noise", "Random number"),
    "Sign": ("Signum",),
    "Sine": ("Sine wave", "Signal generator"),
    "StateMachine": ("Stateflow", "Chart"),
    "StateSpace": ("ss", "LTI system"),
    "StribeckFriction": ("Joint friction",),
    "Sum": ("Add", "Adder", "Subtract", "Difference", "Summing junction", "Comparator"),
    "Switch": ("Manual switch",),
    "TransferFunction": ("Transfer fcn", "tf"),
    "Triangle": ("Triangle wave",),
    "Trigger": ("Triggered subsystem", "Trigger port", "Function call subsystem"),
    "TriggeredHold": ("Sample and hold",),
    "UnitDelay": ("Memory", "One sample delay", "Register"),
    "ZeroOrderHold": ("ZOH", "Sampler"),
    "ZeroPoleGain": ("zpk", "Zero pole"),
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
