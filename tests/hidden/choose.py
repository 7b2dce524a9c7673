"""What the seed chooses: the effect where none is named, its numbers off every grid, courses of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from .kinds import FAMILY, FRONT_EFFECTS, MOTOR_EFFECTS, OUTSIDE, SENSOR_FAULTS, SHEATH_EFFECTS, UNEXCITED, Spec
from .signals import TURN

POOLS = {
    "single": SHEATH_EFFECTS,
    "poor": SHEATH_EFFECTS,
    "outside": OUTSIDE,
    "front": FRONT_EFFECTS,
    "unexcited": UNEXCITED,
    "motor_open": MOTOR_EFFECTS,
    "motor_closed": MOTOR_EFFECTS,
}
SEGMENTS = {"motor": MOTOR_EFFECTS, "sheath": SHEATH_EFFECTS, "sensor": SENSOR_FAULTS}

SCALES = {
    "backlash": (0.2, 15.0, 2.0),
    "hysteresis": (0.02, 3.0, 2.0),
    "asymmetric_hysteresis": (0.005, 0.5, 2.0),
    "nonlocal_memory": (0.05, 1.5, 2.0),
    "position_dependent_friction": (0.03, 1.0, 2.0),
    "dead_time": (2.0, 80.0, 2.0),
    "first_order_lag": (2.0, 300.0, 2.0),
    "resonance": (0.03, 1.0, 2.0),
    "rate_dependence": (0.003, 0.3, 2.0),
    "dead_zone": (0.02, 0.95, 2.0),
    "saturation": (1 / 58, 1 / 20, 20.0),
    "even_nonlinearity": (0.2, 30.0, 2.0),
    "odd_nonlinearity": (0.3, 30.0, 2.0),
    "position_ripple": (0.08, 8.0, 2.0),
    "drift": (0.2, 30.0, 2.0),
    "jump": (0.15, 30.0, 2.0),
    "parameter_change": (0.02, 0.9, 2.0),
    "creep": (0.01, 0.9, 2.0),
    "periodic_disturbance": (0.08, 10.0, 2.0),
    "rate_limit": (1 / 160, 1 / 30, 12.0),
    "mixed_term": (0.1, 10.0, 2.0),
    "history_product": (0.1, 10.0, 2.0),
    "bursts": (0.15, 20.0, 2.0),
    "telegraph": (0.06, 20.0, 2.0),
    "chaos": (0.06, 20.0, 2.0),
}
"""Effect -> (first amplitude to try, largest that makes sense, power with which the excess grows near there)."""


MOTOR_SCALES = {
    "coulomb_friction": (0.03, 4.0, 2.0),
    "asymmetric_friction": (0.02, 2.0, 2.0),
    "stribeck_friction": (0.05, 4.0, 2.0),
    "presliding_friction": (0.03, 4.0, 2.0),
    "quadratic_drag": (0.005, 1.0, 2.0),
    "backlash": (0.001, 0.3, 2.0),
    "saturation": (1 / 9, 1.0, 6.0),
    "dead_zone": (0.03, 4.0, 2.0),
    "load_offset": (0.03, 5.0, 2.0),
    "position_ripple": (0.03, 5.0, 2.0),
    "dead_time": (0.3, 12.0, 2.0),
    "rate_limit": (1 / 150, 1 / 3, 4.0),
    "periodic_disturbance": (0.03, 5.0, 2.0),
}
"""The same in the motor: volts, rad for the gear's gap, 1/V, ms, s/V."""
SENSOR_SCALES = {"jump": (0.15, 30.0, 2.0), "position_ripple": (0.08, 8.0, 2.0), "parameter_change": (0.02, 0.5, 2.0)}


def motor_numbers_of(name: str, spec: Spec, listed, starts) -> dict[str, float]:
    """Numbers of an effect in the motor, or of a fault of its encoder ("sensor:jump"), besides its amplitude."""
    rng = spec.rng(f"effect {name}")
    phases = dict(phase=rng.uniform(0.0, TURN), phase2=rng.uniform(0.0, TURN))
    made = {
        "asymmetric_friction": lambda: dict(side=rng.choice([-1.0, 1.0])),
        "stribeck_friction": lambda: dict(speed=rng.uniform(0.15, 0.4)),
        "presliding_friction": lambda: dict(distance=rng.uniform(0.02, 0.08)),
        "backlash": lambda: dict(start=rng.uniform(-0.8, 0.8)),
        "load_offset": lambda: dict(side=rng.choice([-1.0, 1.0])),
        "position_ripple": lambda: dict(cycles=rng.uniform(7.2, 15.0), **phases),
        "periodic_disturbance": lambda: dict(frequency=off_grid_frequency(rng, 0.7, 3.0), **phases),
        "sensor:jump": lambda: dict(at=instant(rng, listed, starts)),
        "sensor:position_ripple": lambda: dict(cycles=rng.uniform(5.2, 11.0), **phases),
        "sensor:parameter_change": lambda: dict(at=instant(rng, listed, starts)),
    }
    return {k: float(v) for k, v in made.get(name, dict)().items()}


def resolved(spec: Spec) -> Spec:
    """The same with the effect named, chosen by the seed where it is left open."""
    protocol = spec.protocol
    if spec.group == "poor" and protocol == "rich":
        protocol = "paper"
    effect = spec.effect
    rng = spec.rng("effect")
    if not effect and spec.group == "two":
        while not effect:
            one, two = rng.choice(SHEATH_EFFECTS, 2, replace=False)
            if FAMILY[one] != FAMILY[two]:
                effect = f"{one}+{two}"
    elif not effect and spec.group == "base_line":
        effect = "hysteresis"
    elif not effect and spec.group in POOLS:
        effect = str(rng.choice(POOLS[spec.group]))
    elif spec.group in ("chain", "sensor") and effect != "none":
        effect = _placed(effect, spec.group, rng)
    if effect == "none":
        effect = ""
    if spec.group == "unexcited" and effect == "position_ripple":
        protocol = "small"
    return replace(spec, effect=effect, protocol=protocol)


def allowed_effects(group: str) -> tuple[str, ...]:
    """Names that may stand in the specification of a group."""
    if group in ("chain", "sensor"):
        return tuple(f"{place}:{name}" for place, names in SEGMENTS.items() for name in names)
    more = {"null": (), "base_line": ("hysteresis",)}
    return more.get(group, POOLS.get(group, SHEATH_EFFECTS))


def _placed(effect, group, rng) -> str:
    """An effect of a chain with its segment in front, as in "motor:saturation"."""
    if ":" in effect:
        return effect
    if group == "sensor":
        segment = "sensor"
    elif effect:
        segment = "sheath" if effect in SHEATH_EFFECTS else "motor"
    else:
        segment = str(rng.choice(["motor", "sheath"]))
    return f"{segment}:{effect or rng.choice(SEGMENTS[segment])}"


def off_grid_frequency(rng, low, high) -> float:
    """A frequency at least 8 mHz away from every twentieth of a hertz, where the inputs have theirs."""
    while True:
        f = rng.uniform(low, high)
        if abs(f / 0.05 - round(f / 0.05)) * 0.05 > 0.008:
            return float(f)


def instant(rng, listed, starts) -> float:
    """An instant within a record, not near its ends; never within the first or last record of several [s]."""
    k = 0 if len(listed) == 1 else int(rng.integers(1, max(len(listed) - 1, 2)))
    return float(starts[k] + listed[k].stop * rng.uniform(0.25, 0.75))


def numbers_of(name: str, spec: Spec, listed, starts) -> dict[str, float]:
    """Numbers of an effect besides its amplitude."""
    rng = spec.rng(f"effect {name}")
    end = starts[-1] + listed[-1].stop
    phases = dict(phase=rng.uniform(0.0, TURN), phase2=rng.uniform(0.0, TURN))
    made = {
        "backlash": lambda: dict(start=rng.uniform(-0.8, 0.8)),
        "hysteresis": lambda: dict(radius=rng.uniform(6.0, 14.0), start=rng.uniform(-0.5, 0.5)),
        "asymmetric_hysteresis": lambda: dict(
            delta=rng.choice([-1, 1]) * rng.uniform(1.0, 2.0), speed=rng.uniform(10.0, 20.0)
        ),
        "nonlocal_memory": lambda: _radii(rng),
        "position_dependent_friction": lambda: dict(centre=rng.uniform(-8.0, 8.0)),
        "resonance": lambda: dict(frequency=rng.uniform(2.5, 6.0), damping=rng.uniform(0.08, 0.3)),
        "dead_zone": lambda: dict(
            side=rng.choice([-1.0, 1.0]), edge=rng.uniform(12.0, 28.0), width=rng.uniform(1.0, 2.5)
        ),
        "even_nonlinearity": lambda: dict(kind=float(rng.integers(2)), centre=rng.uniform(-6.0, 6.0)),
        "odd_nonlinearity": lambda: dict(kind=float(rng.integers(2))),
        "position_ripple": lambda: dict(cycles=rng.uniform(5.2, 11.0), **phases),
        "drift": lambda: dict(bend=rng.uniform(0.5, 1.2)),
        "jump": lambda: dict(at=instant(rng, listed, starts)),
        "parameter_change": lambda: dict(at=instant(rng, listed, starts), gain=rng.choice([-1, 1]) * 0.2),
        "creep": lambda: dict(short=rng.uniform(2.4, 3.6), long=rng.uniform(16.0, 25.0)),
        "periodic_disturbance": lambda: dict(frequency=off_grid_frequency(rng, 0.21, 0.39), **phases),
        "mixed_term": lambda: dict(centre=rng.uniform(-5.0, 5.0)),
        "bursts": lambda: dict(course=bursts(rng, end)),
        "telegraph": lambda: dict(course=telegraph(rng, end)),
        "chaos": lambda: dict(course=chaos(rng, end)),
    }
    return {k: v if callable(v) else float(v) for k, v in made.get(name, dict)().items()}


def _radii(rng):
    low, high = (2.5, 8.0, 18.0), (4.0, 12.0, 26.0)
    radii = {f"radius{i + 1}": rng.uniform(low[i], high[i]) for i in range(3)}
    return radii | {f"start{i + 1}": rng.uniform(-0.5, 0.5) for i in range(3)}


# ---- courses of time


def bursts(rng, end):
    """Silence, and now and then for about a second a rumble."""
    count = int(end / 5.0)
    at, width = rng.uniform(0.0, end, count), rng.uniform(0.4, 1.8, count)
    f, phase = rng.uniform(0.7, 4.0, 6), rng.uniform(0.0, TURN, 6)

    def course(t):
        window = np.zeros_like(t)
        for a, w in zip(at, width, strict=True):
            inside = np.clip((t - a) / w, 0.0, 1.0)
            window = np.maximum(window, np.minimum(1.0, 2.0 * np.sin(np.pi * inside)))
        return window * sum(np.sin(TURN * fi * t + p) for fi, p in zip(f, phase, strict=True))

    return course


def telegraph(rng, end):
    """Two levels, left at random instants, 1.3 s apart on average."""
    at = np.cumsum(0.06 + rng.exponential(1.3, int(end / 0.8)))
    level = np.where(np.arange(len(at)) % 2, 1.0, -1.0)
    times, levels = np.column_stack([at, at + 0.04]).ravel(), np.column_stack([-level, level]).ravel()
    return lambda t: np.interp(t, times, levels)


def chaos(rng, end):
    """The logistic map, every 0.6 s, joined smoothly."""
    values = [rng.uniform(0.2, 0.8)]
    for _ in range(int(end / 0.6) + 4):
        values.append(3.93 * values[-1] * (1.0 - values[-1]))
    return CubicSpline(0.6 * np.arange(len(values)), 2.8 * (np.array(values) - 0.5))
