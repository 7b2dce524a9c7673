"""Effects at the sheath and out of the catalogue. Every form differs from the package's block of the same name.

An effect is a function of (bench, y, amplitude (lanes,), numbers) giving the new output, or, inside the hysteresis,
of (bench, amplitude, numbers) giving (factor on the drive (rows, lanes) or None, added |v| term).
"""

from __future__ import annotations

import numpy as np

from .contact import dahl, gap, iwan, soft_limit, soft_rate
from .numerics import delayed, filtered, smooth_step
from .signals import TURN

# ---- inside the loop


def asymmetry_inside(bench, a, p):
    """A share of |v| drives the state too."""
    return None, p["delta"] * a


def friction_grows(bench, a, p):
    """Drive of the loop grows with position as a rope's friction grows with its wrap, exponentially."""
    return np.exp(a * np.clip((bench.x - p["centre"]) / 55.0, -1.2, 1.2)), 0.0


def curvature_inside(bench, a, p):
    """From an instant on the loop is wider."""
    return 1.0 + a * smooth_step(bench.session, p["at"], 0.15), 0.0


INSIDE = {
    "asymmetric_hysteresis": asymmetry_inside,
    "position_dependent_friction": friction_grows,
    "parameter_change": curvature_inside,
}

# ---- on the output


def asymmetry(bench, y, a, p):
    """Slopes of loading and unloading, changed over faster than by tanh(v) and without exponentials."""
    return y + 0.5 * a * bench.x * bench.v / np.sqrt(bench.v**2 + p["speed"] ** 2)


def curvature(bench, y, a, p):
    """With the loop the gain changes, a little."""
    return y + a * p["gain"] * bench.x * smooth_step(bench.session, p["at"], 0.15)


def nonlocal_memory(bench, y, a, p):
    """Three elements that yield smoothly, in parallel with the loop."""
    parts = [iwan(bench.x, p[f"radius{i}"], p[f"start{i}"]) * w for i, w in ((1, 0.5), (2, 0.3), (3, 0.2))]
    return y + a * sum(parts)


def loop(bench, y, a, p):
    """A loop where the base has none: part of the motion is lost in a stretch."""
    return y - a * dahl(bench.x, p["radius"], p["start"])


def rate_dependence(bench, y, a, p):
    """Stretch that grows a little slower than speed."""
    return y + a * bench.v * (bench.v**2 + 1.0) ** ((0.85 - 1.0) / 2.0)


def mixed_term(bench, y, a, p):
    """Position times speed. Out of the catalogue."""
    return y + a * (bench.x - p["centre"]) / 30.0 * bench.v / 60.0


def history_product(bench, y, a, p):
    """Position times its own past of three seconds. Out of the catalogue."""
    past = filtered((1.0,), (3.0, 1.0), bench.x, bench.step)
    return y + a * (past / 15.0) * np.sin(bench.x / 20.0)


def slack(bench, y, a, p):
    """Beyond an edge on one side the slope falls, over a few degrees."""
    over = p["side"] * y - p["edge"]
    return y - p["side"] * a * p["width"] * np.logaddexp(0.0, over / p["width"])


def saturation(bench, y, a, p):
    """Soft limit; the amplitude is the limit's inverse."""
    return soft_limit(y, 1.0 / a, 12)


def even_map(bench, y, a, p):
    """A hyperbola or a cosine about a centre."""
    s = y - p["centre"]
    return y + a * np.where(p["kind"] > 0.5, np.sqrt(1.0 + (s / 20.0) ** 2) - 1.0, 1.0 - np.cos(s / 42.0))


def odd_map(bench, y, a, p):
    """An arcus tangens or a sine."""
    return y + a * np.where(p["kind"] > 0.5, np.arctan(y / 16.0), np.sin(y / 33.0))


def ripple(bench, y, a, p):
    """Eccentric scale, with a weak second harmonic."""
    phase = np.deg2rad(y) * p["cycles"]
    return y + a * (np.cos(phase + p["phase"]) + 0.25 * np.cos(2.0 * phase + p["phase2"]))


def backlash(bench, y, a, p):
    """Free travel between two contacts that stiffen as they close."""
    return gap(y, a, 0.15 * a, p["start"] * a)


def resonance(bench, y, a, p):
    """Part of the motion passes over a spring, the rest directly."""
    omega, zeta = TURN * p["frequency"], p["damping"]
    num = [(zeta[j] * omega[j], omega[j] ** 2) for j in range(len(omega))]
    den = [(1.0, 2.0 * zeta[j] * omega[j], omega[j] ** 2) for j in range(len(omega))]
    return y + a * (filtered(num, den, y, bench.step) - y)


def creep(bench, y, a, p):
    """Two slow parts."""
    short = filtered([(1.0,)] * len(a), [(s, 1.0) for s in p["short"]], y, bench.step)
    long = filtered([(1.0,)] * len(a), [(s, 1.0) for s in p["long"]], y, bench.step)
    return y + a * (0.5 * short + 0.5 * long)


def rate_limit(bench, y, a, p):
    """Soft limit on the rate; the amplitude is the limit's inverse."""
    return soft_rate(y, 1.0 / a, bench.step)


def lag(bench, y, a, p):
    """Two lags in a row; the amplitude is their sum in milliseconds."""
    whole = 1e-3 * a
    den = [((0.6 * w) * (0.4 * w), w, 1.0) for w in whole]
    return filtered([(1.0,)] * len(a), den, y, bench.step)


def dead_time(bench, y, a, p):
    """Exact; the amplitude is the delay in milliseconds."""
    return delayed(y, 1e-3 * a / bench.step)


def drift(bench, y, a, p):
    """Warming up over the session: slightly curved."""
    share = bench.session / bench.total[None, :]
    return y + a * -np.expm1(-p["bend"] * share) / -np.expm1(-p["bend"])


def jump(bench, y, a, p):
    """Counts lost over one sample."""
    return y + a * smooth_step(bench.session, p["at"], 0.01)


def disturbance(bench, y, a, p):
    """Breathing: a line of the clock with a weak second harmonic."""
    phase = TURN * p["frequency"] * bench.session
    return y + a * (np.cos(phase + p["phase"]) + 0.2 * np.cos(2.0 * phase + p["phase2"]))


def given(bench, y, a, p):
    """A course of time that was drawn beforehand (bursts, telegraph, chaos). Out of the catalogue."""
    return y + a * np.column_stack([f(bench.session[:, j]) for j, f in enumerate(p["course"])])


OUTPUT = {
    "asymmetric_hysteresis": asymmetry,
    "parameter_change": curvature,
    "hysteresis": loop,
    "nonlocal_memory": nonlocal_memory,
    "rate_dependence": rate_dependence,
    "mixed_term": mixed_term,
    "history_product": history_product,
    "creep": creep,
    "dead_zone": slack,
    "backlash": backlash,
    "resonance": resonance,
    "saturation": saturation,
    "rate_limit": rate_limit,
    "even_nonlinearity": even_map,
    "odd_nonlinearity": odd_map,
    "first_order_lag": lag,
    "dead_time": dead_time,
    "position_ripple": ripple,
    "drift": drift,
    "jump": jump,
    "periodic_disturbance": disturbance,
    "bursts": given,
    "telegraph": given,
    "chaos": given,
}
ORDER = list(OUTPUT)
