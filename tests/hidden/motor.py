"""The motor, open or in its position loop, at 5 kHz: lag and integrator solved exactly per step, dry friction implicit.

Angles in rad, voltages in V, losses as the voltage they cost. One step: positions and speeds are taken half a step
ahead with the voltage of the step before, the controller is read there, and the whole step is made with that voltage.
"""

from __future__ import annotations

import numpy as np

from .contact import gap_moved, soft_limit
from .signals import TURN

KP, KD, TF, LIMIT = 60.0, 1.0, 0.002, 24.0
"""Position controller: gains [V/rad, V s/rad], derivative filter [s], limit of its output [V]. Known to everybody."""


def run_motor(drive_or_reference, start, motor, step, keep, effects=None, closed=True):
    """Rows of u [V] and x_in [rad] as the loop sees it, and of the true x_in [rad], one every `keep` steps.

    drive_or_reference  reference [rad], or voltage if not `closed`, at every half step (2 * steps + 1, lanes)
    start               instant of the session at which each lane starts [s]
    motor               K, tau, coulomb of each lane
    effects             name -> (amplitudes (lanes,), numbers, (lanes,) each); faults of the encoder as "sensor:jump"
    """
    parts = _Parts(effects or {}, motor, start, step)
    given = drive_or_reference
    steps = (len(given) - 1) // 2
    lanes = given.shape[1]
    rows = steps // keep + 1
    kept = {name: np.empty((rows, lanes)) for name in ("u", "x_in", "x")}
    shaft = given[0] + 0.0 if closed else np.zeros(lanes)
    x, speed, smooth, last = parts.at_rest(shaft, closed)
    half_tau, whole_tau = np.exp(-0.5 * step / motor["tau"]), np.exp(-step / motor["tau"])
    half_tf, whole_tf = np.exp(-0.5 * step / TF), np.exp(-step / TF)
    for k in range(steps + 1):
        t = k * step
        seen = parts.seen(x, t)
        error = given[2 * k] - seen if closed else None
        if k % keep == 0:
            row = k // keep
            kept["x"][row], kept["x_in"][row] = x, seen
            kept["u"][row] = command(error, smooth) if closed else given[2 * k]
        if k == steps:
            break
        ahead, shaft_half = parts.moved(speed, last, shaft, t, half_tau, 0.5 * step)
        x_half = parts.geared(shaft, shaft_half, x, commit=False)
        if closed:
            error_half = given[2 * k + 1] - parts.seen(x_half, t + 0.5 * step)
            smooth_half = 0.5 * (error + error_half)
            smooth_half = smooth_half + (smooth - smooth_half) * half_tf
            voltage = command(error_half, smooth_half)
            smooth = error_half + (smooth - error_half) * whole_tf
        else:
            voltage = given[2 * k + 1]
        last = parts.driven(voltage, k)
        speed, shaft_next = parts.moved(speed, last, shaft, t, whole_tau, step, (ahead, shaft_half))
        x = parts.geared(shaft, shaft_next, x, commit=True)
        shaft = shaft_next
    return kept["u"], kept["x_in"], kept["x"]


def command(error, smooth):
    """Voltage of the position controller [V]."""
    wanted = KP * error + KD * (error - smooth) / TF
    return np.minimum(np.maximum(wanted, -LIMIT), LIMIT)


def _rubbed(speed, free, push, rub):
    """Speed at the end of a step with dry friction, and the share of the step in which it kept its sign.

    `free` is the speed without friction, `push` what the force adds from standstill, `rub` what friction takes in a
    whole step. Where the speed reaches zero within the step, the rest starts from standstill, or stays there.
    """
    side = np.sign(speed)
    slid = free - side * rub
    turns = side * slid <= 0.0
    share = np.where(turns, speed / np.where(speed == slid, 1.0, speed - slid), 1.0)
    rest = (1.0 - share) * push
    started = np.sign(rest) * np.maximum(np.abs(rest) - (1.0 - share) * rub, 0.0)
    return np.where(turns, started, slid), share


class _Parts:
    """The pieces of the motor in which something may be hidden, with their memories."""

    def __init__(self, effects, motor, start, step):
        self.effects, self.motor, self.start, self.step = effects, motor, start, step
        self.gain, self.coulomb = motor["K"], motor.get("coulomb", 0.0)
        self.bristle = self.gap = self.sent = self.before = self.limited = None
        self.loads = [getattr(self, f"_{name}") for name in effects if hasattr(self, f"_{name}")]
        self.dry = np.any(self.coulomb) or "coulomb_friction" in effects or "stribeck_friction" in effects

    def at_rest(self, shaft, closed):
        zero = np.zeros_like(shaft)
        if "backlash" in self.effects:
            half, numbers = self.effects["backlash"]
            self.gap = numbers["start"] * half
        if "presliding_friction" in self.effects:
            self.bristle = zero
        if "dead_time" in self.effects:
            late = 1e-3 * self.effects["dead_time"][0] / self.step
            self.whole, self.sent = np.floor(late).astype(int), np.zeros((1024, len(shaft)))
            self.rest = late - self.whole
        x = shaft if self.gap is None else shaft - self.gap
        smooth = shaft - self.seen(x, 0.0) if closed else zero
        return x, zero, smooth, zero

    # ---- sensor

    def seen(self, x, t):
        """Angle that the encoder gives [rad]."""
        for name, (a, p) in self.effects.items():
            if name == "sensor:jump":
                x = x + np.deg2rad(a) * np.clip((t + self.start - p["at"]) / 0.01, 0.0, 1.0)
            elif name == "sensor:position_ripple":
                phase = p["cycles"] * x
                x = x + np.deg2rad(a) * (np.cos(phase + p["phase"]) + 0.25 * np.cos(2.0 * phase + p["phase2"]))
            elif name == "sensor:parameter_change":
                x = x * (1.0 + a * np.clip((t + self.start - p["at"]) / 0.15, 0.0, 1.0))
        return x

    # ---- driver

    def driven(self, u, k):
        """Voltage at the motor for the one commanded [V]."""
        for name, (a, _) in self.effects.items():
            if name == "dead_zone":
                u = u - a * np.tanh(u / a)
            elif name == "saturation":
                u = soft_limit(u, 1.0 / a, 8)
            elif name == "rate_limit":
                u = self._slowed(u, self.step / a)
            elif name == "dead_time":
                u = self._late(u, k)
        return u

    def _slowed(self, u, most, catch=400.0):
        """As `contact.soft_rate`; the voltage does not go on by more than `most` a step."""
        if self.before is None:
            self.before = self.limited = u
        wanted = u - self.before + catch * self.step * (self.before - self.limited)
        self.limited = self.limited + soft_limit(wanted, most, 8)
        self.before = u
        return self.limited

    def _late(self, u, k):
        if k >= len(self.sent):
            self.sent = np.concatenate([self.sent, np.zeros_like(self.sent)])
        self.sent[k] = u
        lane = np.arange(len(u))
        near, far = np.maximum(k - self.whole, 0), np.maximum(k - self.whole - 1, 0)
        return self.sent[near, lane] * (1.0 - self.rest) + self.sent[far, lane] * self.rest

    # ---- losses

    def moved(self, speed, voltage, shaft, t, keep, span, middle=None):
        """Speed and shaft angle after `span` seconds; losses are read at `middle`, or where the step begins."""
        at_speed, at_shaft = middle or (speed, shaft)
        at_time = t + self.start + (0.5 * span if middle else 0.0)
        if self.bristle is not None:
            voltage = voltage - self._bristled(at_speed, span, commit=middle is not None)
        for load in self.loads:
            voltage = voltage - load(at_speed, at_shaft, at_time)
        final = self.gain * voltage
        after = final + (speed - final) * keep
        if not self.dry:
            return after, shaft + 0.5 * span * (speed + after)
        after, share = _rubbed(speed, after, final * (1.0 - keep), self.gain * self._level(at_speed) * (1.0 - keep))
        return after, shaft + 0.5 * span * (share * speed + (1.0 - share) * after + (share == 1.0) * after)

    def _level(self, speed):
        level = self.coulomb
        if "coulomb_friction" in self.effects:
            level = level + self.effects["coulomb_friction"][0]
        if "stribeck_friction" in self.effects:
            a, p = self.effects["stribeck_friction"]
            level = level + a * np.exp(-((np.abs(speed) / p["speed"]) ** 1.4))
        return level

    def _bristled(self, speed, span, commit):
        a, p = self.effects["presliding_friction"]
        end = p["distance"] * (1.0 + 0.15 * np.exp(-((speed / 2.0) ** 2)))
        fade = np.exp(-np.abs(speed) * span / end)
        after = self.bristle * fade + np.sign(speed) * end * (1.0 - fade)
        mean = 0.5 * (self.bristle + after)
        if commit:
            self.bristle = after
        return a * mean / p["distance"]

    def _asymmetric_friction(self, speed, shaft, t):
        a, p = self.effects["asymmetric_friction"]
        return a * speed * 0.5 * (1.0 + p["side"] * speed / np.sqrt(speed**2 + 0.04))

    def _quadratic_drag(self, speed, shaft, t):
        a, _ = self.effects["quadratic_drag"]
        return a * speed * np.abs(speed) ** 0.9

    def _load_offset(self, speed, shaft, t):
        a, p = self.effects["load_offset"]
        return a * p["side"] * (1.0 + 0.05 * np.sin(shaft))

    def _position_ripple(self, speed, shaft, t):
        a, p = self.effects["position_ripple"]
        phase = p["cycles"] * shaft
        return a * (np.cos(phase + p["phase"]) + 0.25 * np.cos(2.0 * phase + p["phase2"]))

    def _periodic_disturbance(self, speed, shaft, t):
        a, p = self.effects["periodic_disturbance"]
        phase = TURN * p["frequency"] * t
        return a * (np.cos(phase + p["phase"]) + 0.2 * np.cos(2.0 * phase + p["phase2"]))

    # ---- gear

    def geared(self, shaft, shaft_next, x, commit):
        """Angle behind the gear [rad]."""
        if self.gap is None:
            return shaft_next
        half, _ = self.effects["backlash"]
        d = gap_moved(self.gap, shaft_next - shaft, half, 0.15 * half)
        if commit:
            self.gap = d
        return shaft_next - d
