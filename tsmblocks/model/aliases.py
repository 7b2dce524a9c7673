"""Names of blocks and of their parameters in other programs, for hints in messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from tsmblocks.common.errors import clip, known_here, near, nearest
from tsmblocks.model.fields import Field

OTHER_NAMES: dict[str, tuple[str, ...]] = {
    "Abs": ("Absolute value",),
    "AsymmetricGain": ("Direction-dependent gain",),
    "Chirp": ("Chirp signal", "Sweep", "Swept sine"),
    "Comparison": ("Relational operator", "Compare to constant", "Comparator"),
    "Convert": ("Unit conversion", "Radians to degrees"),
    "CoulombFriction": ("Dry friction",),
    "DeadZone": ("Dead band", "Deadspace"),
    "Delay": ("Transport delay", "Time delay", "Pure delay"),
    "DiscreteIntegrator": ("Discrete-time integrator",),
    "DiscretePID": ("Discrete PID controller",),
    "DiscreteTransferFunction": ("Discrete transfer fcn", "Discrete filter"),
    "Enable": ("Enabled subsystem", "Enable port"),
    "Encoder": ("Incremental encoder", "Rotary encoder"),
    "FilteredDerivative": ("DT1", "High pass", "High pass filter"),
    "FirstOrderLag": ("PT1", "Low pass", "Low pass filter"),
    "Gain": ("Gear", "Gear ratio", "Gearbox", "Scale", "Proportional", "Spring"),
    "Integrator": ("Integral", "1/s"),
    "LeadLag": ("Lead compensator", "Lag compensator", "Lead lag filter"),
    "Logic": ("Logical operator",),
    "LookupTable": ("Lookup", "1-D lookup table", "Interpolation table", "Characteristic"),
    "LookupTable2D": ("2-D lookup table", "Lookup 2D", "Characteristic map", "Interpolation2D"),
    "Play": ("Backlash", "Gear backlash", "Hysteresis"),
    "Product": ("Multiply", "Multiplier"),
    "Quantiser": ("ADC", "Rounding", "Quantizer"),
    "Ramp": ("Clock", "Time"),
    "Random": ("Gaussian noise", "White noise", "Band limited white noise", "Random number"),
    "RateLimit": ("Slew rate", "Slew rate limiter", "Rate limiter"),
    "Recorded": ("From workspace", "From file", "Signal from file"),
    "Relay": ("Bang-bang", "On-off controller"),
    "Saturation": ("Limiter", "Limit", "Clip", "Clamp"),
    "SecondOrderLag": ("PT2", "Mass spring damper"),
    "Sign": ("Signum",),
    "Sine": ("Sine wave", "Signal generator"),
    "SlidingMass": ("Mass with stop and friction", "Translational friction"),
    "StateMachine": ("Stateflow", "Chart"),
    "StateSpace": ("ss", "LTI system"),
    "StribeckFriction": ("Joint friction", "Coulomb & viscous friction"),
    "Sum": ("Add", "Adder", "Subtract", "Summing junction"),
    "Switch": ("Manual switch",),
    "TransferFunction": ("Transfer fcn", "tf"),
    "Triangle": ("Triangle wave",),
    "Trigger": ("Triggered subsystem", "Trigger port", "Function call subsystem"),
    "TriggeredHold": ("Sample and hold",),
    "UnitDelay": ("Memory", "One sample delay", "Register"),
    "ViscousFriction": ("Damper", "Dashpot", "Translational damper", "Rotational damper"),
    "ZeroOrderHold": ("ZOH", "Sampler"),
    "ZeroPoleGain": ("zpk", "Zero pole"),
}
"""Block -> its names in other programs."""

OTHER_PARAMETER_NAMES: dict[str, tuple[str, ...]] = {
    "after": ("value", "final value", "amplitude", "height"),
    "before": ("initial value",),
    "den": ("denominator",),
    "gain": ("K", "static gain"),
    "high": ("upper", "upper limit", "max", "maximum"),
    "kd": ("D", "derivative gain"),
    "ki": ("I", "integral gain"),
    "kp": ("P", "proportional gain"),
    "low": ("lower", "lower limit", "min", "minimum"),
    "num": ("numerator",),
    "omega": ("omega0", "wn", "natural frequency"),
    "period": ("Ts", "sample time", "dt"),
    "time": ("step time", "start time"),
    "time_constant": ("T", "tau"),
    "zeta": ("damping", "damping ratio"),
}
"""Parameter -> its names in other programs."""
MOST_FIELDS = 20
"""Parameters of a block that a message lists, at most. Chosen: more than any block of the toolbox has."""


def _letters_and_digits(name: str) -> str:
    """A name without case, blanks and signs."""
    return "".join(c for c in name.casefold() if c.isalnum())


PARAMETERS = {(_letters_and_digits(name), here) for here, names in OTHER_PARAMETER_NAMES.items() for name in names}
BLOCK_NAMES = {_letters_and_digits(name): block for block, names in OTHER_NAMES.items() for name in names}


def block_hint(name: str, known: Collection[str], otherwise: str = "") -> str:
    """A hint with the block that has another name elsewhere; else the near miss, as ``errors.near``."""
    here = BLOCK_NAMES.get(_letters_and_digits(name))
    return f" Its name here is '{here}'." if here and here in known else near(name, known, otherwise=otherwise)


def field_hint(name: str, fields: Mapping[str, Field]) -> str:
    """A hint with the parameter that has another name elsewhere, or the near miss; else all, the states last."""
    return _field_near(name, fields) or _all_fields(fields)


def unknown_fields(owner: str, names: Iterable[str], fields: Mapping[str, Field]) -> str:
    """The message for all names of parameters that a block lacks; what it has is listed once."""
    hints = {name: _field_near(name, fields) for name in names}
    lost = [f"'{clip(name)}'" for name, hint in hints.items() if not hint]
    said = [f"{owner} has no parameter '{clip(name)}'.{hint}" for name, hint in hints.items() if hint]
    if lost:
        said.append(f"{owner} has no parameter {' and no '.join(lost)}.{_all_fields(fields)}")
    return " ".join(said)


def _field_near(name: str, fields: Mapping[str, Field]) -> str:
    close = nearest(name, fields)
    here = [field for field in fields if (_letters_and_digits(name), field) in PARAMETERS]
    if len(here) == 1 and close.casefold() != name.casefold():
        return f" Its name here is '{here[0]}'."
    return f" Did you mean '{clip(close)}'?" if close else ""


def _all_fields(fields: Mapping[str, Field]) -> str:
    return known_here(sorted(fields, key=lambda k: (fields[k].kind == "state", k)), MOST_FIELDS)
