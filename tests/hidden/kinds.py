"""What the generator can make: groups, effects with their families, and the value that a case is."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np

FAMILIES = {
    "friction": "coulomb_friction asymmetric_friction stribeck_friction presliding_friction quadratic_drag",
    "loop": "backlash hysteresis asymmetric_hysteresis nonlocal_memory position_dependent_friction",
    "delay": "dead_time first_order_lag resonance rate_dependence",
    "map": "dead_zone saturation even_nonlinearity odd_nonlinearity position_ripple",
    "time": "drift jump parameter_change creep periodic_disturbance",
    "limit": "rate_limit",
    "load": "load_offset",
    "unknown": "unknown",
}
FAMILY = {name: family for family, names in FAMILIES.items() for name in names.split()}

SHEATH_EFFECTS = (
    "backlash",
    "asymmetric_hysteresis",
    "nonlocal_memory",
    "position_dependent_friction",
    "dead_time",
    "first_order_lag",
    "resonance",
    "rate_dependence",
    "dead_zone",
    "saturation",
    "even_nonlinearity",
    "odd_nonlinearity",
    "position_ripple",
    "drift",
    "jump",
    "parameter_change",
    "creep",
    "periodic_disturbance",
    "rate_limit",
)
MOTOR_EFFECTS = (
    "coulomb_friction",
    "asymmetric_friction",
    "stribeck_friction",
    "presliding_friction",
    "quadratic_drag",
    "backlash",
    "saturation",
    "dead_zone",
    "load_offset",
    "position_ripple",
    "dead_time",
    "rate_limit",
    "periodic_disturbance",
)
FRONT_EFFECTS = ("backlash",)
OUTSIDE = ("mixed_term", "bursts", "telegraph", "chaos", "history_product")
UNEXCITED = ("dead_zone", "saturation", "rate_limit", "position_ripple")
SENSOR_FAULTS = ("jump", "position_ripple", "parameter_change")
GROUPS = (
    "null",
    "single",
    "two",
    "outside",
    "shape",
    "base_line",
    "front",
    "poor",
    "unexcited",
    "motor_open",
    "motor_closed",
    "chain",
    "sensor",
)
PROTOCOLS = ("rich", "paper", "sine", "small")


@dataclass(frozen=True)
class Spec:
    """What to make.

    effect     empty: the seed chooses (null, shape: there is none); "none": there is none; "a+b" in group two;
               "motor:a", "sheath:a" in a chain
    size       excess asked for
    measure    what the base may absorb: "regression" on its signals, or also a "refit" of all its numbers (sheath)
    amplitude  given: the effect has this amplitude, in its own unit, and `size` is not looked at
    """

    group: str
    effect: str = ""
    size: float = 1.0
    seed: int = 0
    protocol: str = "rich"
    measure: str = "regression"
    amplitude: float | None = None

    def rng(self, purpose: str) -> np.random.Generator:
        """A stream of its own for each purpose, so that the same seed is the same plant at every size."""
        words = f"{self.group}|{self.effect}|{self.protocol}|{purpose}"
        return np.random.default_rng([self.seed, zlib.crc32(words.encode())])


@dataclass(frozen=True)
class Case:
    """One session of experiments, with what is hidden in it.

    truth      identifiers of the hidden effects; () where nothing (visible) is hidden, ("unknown",) out of catalogue
    families   their families, in the same order
    segment    where it is: "sheath", "motor", "sensor", or "" where nothing is
    size       excess asked for: mean square at the output that a regression of the base cannot absorb, over the noise's
    experiments  name -> signals as measured; "t" [s] runs on one clock through the session
    clean      the same without noise, quantisation and jitter
    without    the same as `clean`, without the effect
    floor      rms of an output sensor's noise, quantisation included; several outputs: name -> rms
    base       diagram to start from: one of the package's sheaths, or "motor_linear"; "motor_closed" is r less x_in
               -> PD with filter (kp, kd, tf) -> limit -> u -> K / (s (tau s + 1)) -> x_in; "chain" goes on from x_in
               through "tendon_sheath_symmetric"; "..._coulomb" has Coulomb friction (as a voltage) in the motor too
    numbers    true parameters; also "excess" (as reached), and "excess_refit" (with the base refitted in its
               nonlinear parameters too), or the excess of each segment or output
    """

    group: str
    truth: tuple[str, ...]
    families: tuple[str, ...]
    segment: str
    seed: int
    size: float
    experiments: dict[str, dict[str, np.ndarray]]
    clean: dict[str, dict[str, np.ndarray]]
    without: dict[str, dict[str, np.ndarray]]
    floor: float | dict[str, float]
    base: str
    numbers: dict[str, float]
    effect: str = ""
    protocol: str = "rich"
    units: dict[str, str] = field(default_factory=lambda: {"t": "s", "x_in": "deg", "x_out": "deg"})


def families_of(truth: tuple[str, ...]) -> tuple[str, ...]:
    """Family of each named effect."""
    return tuple(FAMILY[name] for name in truth)
