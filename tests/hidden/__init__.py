"""Data in which an effect is hidden: a generator that shares nothing with the package under test but the names.

``case`` makes one case, ``cases`` many side by side. Only NumPy and SciPy are used; the forms of the effects, the
integrators and the step differ on purpose from those of the package.
"""

from .build import case, cases
from .kinds import GROUPS, MOTOR_EFFECTS, OUTSIDE, PROTOCOLS, SENSOR_FAULTS, SHEATH_EFFECTS, UNEXCITED, Case, Spec

__all__ = [
    "GROUPS",
    "MOTOR_EFFECTS",
    "OUTSIDE",
    "PROTOCOLS",
    "SENSOR_FAULTS",
    "SHEATH_EFFECTS",
    "UNEXCITED",
    "Case",
    "Spec",
    "case",
    "cases",
]
