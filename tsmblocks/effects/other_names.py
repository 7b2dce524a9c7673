"""Other names of effects, as people say them, for what is asked by a name that the catalogue does not have."""

from __future__ import annotations

from tsmblocks.common.errors import bare_name

_GIVEN = {
    "backlash": "play, gap, clearance, slack, lost motion",
    "capstan_friction": "sheath friction, belt friction, tendon friction",
    "coulomb_friction": "dry friction, friction, stick slip",
    "stribeck_friction": "stiction, static friction, breakaway",
    "presliding_friction": "dahl, lugre, presliding",
    "viscous_friction": "damping, damper",
    "dead_time": "delay, latency, transport delay",
    "dead_zone": "dead band",
    "end_stop": "bump stop, hard stop, snubber",
    "first_order_lag": "lag, low pass, sensor lag, time constant",
    "resonance": "second order lag, elasticity, vibration",
    "position_ripple": "eccentricity, cogging, torque ripple, kinematic error, runout",
    "periodic_disturbance": "hum, oscillation",
    "rate_limit": "slew rate",
    "saturation": "limit, clipping",
    "offset": "bias, zero",
    "gain_error": "gain, scale, scale factor",
    "jump": "step, slip",
    "drift": "wander, temperature drift",
    "parameter_change": "sudden change, fault, gain drift",
    "odd_nonlinearity": "cubic, hardening, nonlinear stiffness",
    "stiffness": "spring",
    "load_offset": "preload",
    "gravity": "weight, pendulum",
}
OTHER_NAMES = {bare_name(word): effect for effect, words in _GIVEN.items() for word in words.split(",")}
"""Another name, without case, spaces and punctuation, and the effect."""
