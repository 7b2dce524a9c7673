"""Rate-independent and rate-limited elements, advanced step by step over lanes."""

from __future__ import annotations

import numpy as np


def gap(u, half, soft, start):
    """Output of a gap of half width `half` whose contacts close over a travel of 2 `soft` (rows, lanes).

    Within the free travel the output rests. In contact the distance d = u - y tends to half + soft exponentially with
    travel, as a spring does that stiffens until it carries the load; that law is solved exactly for each step.
    """
    du = np.diff(u, axis=0)
    distance = np.empty_like(u)
    distance[0] = d = start
    for k in range(len(du)):
        d = gap_moved(d, du[k], half, soft)
        distance[k + 1] = d
    return u - distance


def gap_moved(d, du, half, soft):
    """Distance in the gap after the input went on by `du`."""
    side, travel = np.sign(du), np.abs(du)
    along = side * d
    free = np.minimum(travel, np.maximum(half - soft - along, 0.0))
    left = half + soft - along - free
    return np.where(side == 0.0, d, side * (half + soft - left * np.exp((free - travel) / (2.0 * soft))))


def iwan(x, radius, start):
    """Stretch of an element that is stiff when it turns back and yields smoothly towards `radius` (rows, lanes)."""
    dx = np.diff(x, axis=0) / radius
    side = np.sign(dx)
    s = np.empty_like(x)
    s[0] = now = start + 0.0 * x[0]
    for k in range(len(dx)):
        middle = now + 0.5 * dx[k] * _left(side[k] * now)
        now = now + dx[k] * _left(side[k] * middle)
        s[k + 1] = now
    return s * radius


def dahl(x, radius, start, power=1.4):
    """Stretch that tends to `radius` in the direction of travel, by the law ds = dx |1 - s sgn(dx) / radius|**power."""
    dx = np.diff(x, axis=0) / radius
    side = np.sign(dx)
    s = np.empty_like(x)
    s[0] = now = start + 0.0 * x[0]
    for k in range(len(dx)):
        middle = now + 0.5 * dx[k] * np.abs(1.0 - side[k] * now) ** power
        now = now + dx[k] * np.abs(1.0 - side[k] * middle) ** power
        s[k + 1] = now
    return s * radius


def _left(load):
    load = np.maximum(load, 0.0)
    load = load * load
    return 1.0 - load * load


def soft_limit(y, limit, sharpness):
    """Bends towards +-limit; the higher `sharpness` (even), the sharper the bend."""
    q = y / limit
    return y / (1.0 + np.abs(q) ** sharpness) ** (1.0 / sharpness)


def soft_rate(u, rate, step, catch=40.0):
    """Follows `u` at no more than `rate` per second: y' = rate s((u' + catch (u - y)) / rate), s a soft limit."""
    h = step
    du = np.diff(u, axis=0) / h
    y = np.empty_like(u)
    y[0] = now = u[0]

    def speed(k, ahead, at):
        q = (du[k] + catch * (u[k] + ahead * du[k] - at)) / rate
        q8 = q * q
        q8 = q8 * q8
        q8 = q8 * q8
        return rate * q / np.sqrt(np.sqrt(np.sqrt(1.0 + q8)))

    for k in range(len(du)):
        middle = now + 0.5 * h * speed(k, 0.0, now)
        now = now + h * speed(k, 0.5 * h, middle)
        y[k + 1] = now
    return y
