"""Recordings of imagined test benches with a known truth, for the test of a diagnosis.

All is simulated here, with NumPy and SciPy alone, at about 1 ms, and then sampled. The excess of a hidden effect is the
mean square error of the best fit of the base model (parameters and initial memories free) to the noiseless outputs,
divided by the variance of the noise. Angles are in rad inside.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import bilinear, lfilter, lfilter_zi
from scipy.special import erf

Array, Rng = np.ndarray, np.random.Generator


class Bench:
    """A recording on its fine grid t (0 at the first sample): motion x, its rate v, indices of samples, random seed."""

    def __init__(self, t: Array, x: Array, at: Array, seed: tuple[int, ...]) -> None:
        self.t, self.x, self.dt, self.at, self.seed = t, x, t[1] - t[0], at, seed
        self.v = np.gradient(x, self.dt)
        self.part = np.maximum(t, 0) / t[-1]

    @property
    def rng(self) -> Rng:
        """Random numbers of this recording, the same at every call."""
        return np.random.default_rng((*self.seed, 5))


def pad(rows: list[Array]) -> Array:
    """Rows of one length, their last values repeated."""
    n = max(len(r) for r in rows)
    return np.array([np.pad(r, (0, n - len(r)), mode="edge") for r in rows])


def affine(a: Array, b: Array, start: Any) -> Array:
    """z[k] = a[k] z[k-1] + b[k] along the last axis from z[0] = start, by doubling."""
    a, b = np.array(np.broadcast_arrays(a, b))
    a[..., 0], b[..., 0], step = 0.0, start, 1
    while step < b.shape[-1]:
        b[..., step:] += a[..., step:] * b[..., :-step]
        a[..., step:] *= a[..., :-step]
        step *= 2
    return b


def play(u: Array, w: Any, memory: Any) -> Array:
    """Backlash of half width w along the last axis: clamps are composed by doubling."""
    low, high, step = u - np.abs(w), u + np.abs(w), 1
    low[..., 0] = high[..., 0] = np.clip(memory, low[..., 0], high[..., 0])
    while step < u.shape[-1]:
        floor, roof = low[..., step:].copy(), high[..., step:].copy()
        low[..., step:], high[..., step:] = (np.clip(z[..., :-step], floor, roof) for z in (low.copy(), high.copy()))
        step *= 2
    return low


def dahl(u: Array, distance: float) -> Array:
    """Friction state in [-1, 1] that reverses over a presliding distance."""
    du = np.diff(u, prepend=u[:1])
    a = np.exp(-np.abs(du) / distance)
    return affine(a, np.sign(du) * (1 - a), 0.0)


def lag(u: Array, dt: float, tau: float) -> Array:
    """First-order lag that starts at rest."""
    a = np.exp(-dt / tau)
    return lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0]


def wander(rng: Rng, t: Array, slow: float, fast: float = 0.0) -> Array:
    """Random function of unit rms with periods from `slow` to `fast`, or else with a random walk's spectrum."""
    f = np.exp(rng.uniform(np.log(1 / slow), np.log(1 / (fast or slow / 20)), 40))
    weight = np.ones(40) if fast else 1 / np.sqrt(f)
    return weight @ np.sin(2 * np.pi * (np.outer(f, t) + rng.random((40, 1)))) / np.sqrt(np.sum(weight**2) / 2)


# Base models: simulate(P (batch, parameters, 1 or time), memory (batch, q), x, v (batch, time), dt (batch), hold)
def _asymmetric(P: Array, m: Array, x: Array, v: Array, *_: Any) -> Array:
    alpha1, alpha2, A, theta, delta, bias = P.swapaxes(0, 1)
    dx = np.diff(x, axis=-1, prepend=x[:, :1])
    a = np.exp(-theta * np.abs(dx))
    zeta = affine(a, (A * np.sign(dx) + delta) / theta * (1 - a), m[:, 0])
    return 0.5 * ((1 + np.tanh(v)) * alpha1 + (1 - np.tanh(v)) * alpha2) * x + zeta + bias


def _symmetric(P: Array, m: Array, x: Array, *_: Any) -> Array:
    zeta, z = np.empty_like(x), m[:, 0]
    rows = np.moveaxis(np.broadcast_to(P, (*P.shape[:2], x.shape[-1])), -1, 0)
    for k, d in enumerate(np.diff(x, axis=-1, append=x[:, -1:]).T):
        zeta[:, k], (_, A, beta, gamma, n, _) = z, rows[k].T
        turn, slope, last = beta * np.sign(d), 0.0, 0.0
        for share, weight in ((0, 1), (0.5, 2), (0.5, 2), (1, 1)):
            y = zeta[:, k] + share * d * slope
            slope = A - np.abs(y) ** (n - 1) * (turn * y + gamma * np.abs(y))
            last = last + weight / 6 * slope
        z = z + d * last
    return P[:, 0] * x + 0.6576 * zeta + P[:, 5]


def _motor(
    P: Array, m: Array, u: Array, _v: Array, dt: Array, hold: str, e: dict[str, Any] | None = None, load: Any = 0.0
) -> Array:
    """K / (s (tau s + 1)), with four parameters a second-order lag behind it; e is an effect, its size in V or rad."""
    n, h = P.shape[1], np.broadcast_to(dt, len(P))[:, None]
    G, M = P[:, 0] / P[:, 1], np.zeros((len(P), n + 6, n + 6))
    M[:, 0, 1], M[:, 1, 1:2], M[:, 1, n : n + 2], M[:, n - 1, n + 2 : n + 3] = 1, -1 / P[:, 1], G, G
    M[:, n : n + 3, n + 3 :] = np.eye(3) / h[..., None]
    if n == 4:
        w, c = P[:, 2, 0] ** 2, 2 * P[:, 2, 0] * P[:, 3, 0]
        M[:, 2, 3], M[:, 3, 0], M[:, 3, 2], M[:, 3, 3] = 1, w, -w, -c
    E, z, out = expm(M * h[..., None])[:, :n], np.pad(m, ((0, 0), (0, 6))), np.empty_like(u)
    slope = np.diff(u, append=u[:, -1:]) * (hold != "zero")
    kind, s, q, f = (e["name"], e["size"], e["q"], np.zeros(len(u))) if e else ("", 0.0, {}, 0.0)
    for k in range(u.shape[1]):  # inputs of a step: voltage, force on the motor, force on the load, rise of each
        out[:, k], z[:, n], z[:, n + 3] = z[:, n - 2], u[:, k], slope[:, k]
        mid = z[:, :n:2] + h / 2 * z[:, 1:n:2]  # angles in the middle of the step
        if kind == "cogging ripple":
            z[:, n + 1] = s * np.sin(round(q["teeth"]) * mid[:, 0] + q["phase"])
        elif kind == "load disturbance":
            z[:, n + 2] = -s * (np.sin(mid[:, -1] + q["phase"]) if q["form"] == 2 else load[:, k])
        elif kind == "presliding friction of the motor":
            f = f + h[:, 0] * (z[:, 1] - np.abs(z[:, 1]) * f) / q["distance"]
            z[:, n + 1] = -s * f
        elif kind == "backlash behind the motor" and n == 4:  # the shaft's spring has a gap
            z[:, n + 2] = -np.clip(mid[:, 0] - mid[:, 1], -s, s) * w / G[:, 0]
        z[:, :n] = np.einsum("bij,bj->bi", E, z)
        if kind in {"dry friction of the motor", "Stribeck friction of the motor"}:
            rise = q["rise"] * (kind[0] == "S")
            brake = s * G[:, 0] * h[:, 0] * (1 + rise * np.exp(-((z[:, 1] / q["v0"]) ** 2))) / (1 + rise)
            slower = np.sign(z[:, 1]) * np.maximum(np.abs(z[:, 1]) - brake, 0)
            z[:, 0], z[:, 1] = z[:, 0] + h[:, 0] / 2 * (slower - z[:, 1]), slower
    return play(out, s, out[:, 0]) if kind == "backlash behind the motor" and n == 2 else out


@dataclass(frozen=True)
class Base:
    """A base model: names and typical values of parameters, number of memories, diagram, and simulation."""

    name: str
    typical: dict[str, float]
    memories: int
    port: str
    wires: str
    blocks: str
    simulate: Callable[..., Array]

    def toml(self, values: Array) -> str:
        """Text of the base diagram with these parameters."""
        text = self.blocks
        for key, value in zip(self.typical, values, strict=True):
            text = text.replace(f"<{key.split('.')[1]}>", f"{key.split('.')[1]} = {value:.6g}")
        u, unit, y = ("u", "V", "x") if "motor" in self.port else ("x_in", "rad", "x_out")
        wires, end = (f'wires = ["{self.wires}"]\n', self.wires.split()[-1]) if self.wires else ("", "motor.y")
        return (
            f'format = 1\ntitle = "Bench, {self.name}"\n{wires}\n[blocks]\n{text}\n\n[inputs]\n'
            f'{u} = {{ ports = "{self.port}", unit = "{unit}" }}\n\n[outputs]\n{y} = "{end}"\n'
        )


_GAIN, _BIAS = 'gain = { type = "Gain", <gain>, unit = "rad" }\n', '\noffset = { type = "Bias", <bias> }'
_DRIVE = 'motor = { type = "MotorTransferFunction", <K>, <tau> }\n'
BASES = {
    b.name: b
    for b in (
        Base(
            "linear",
            {"gain.gain": 0.92, "offset.bias": 0},
            0,
            "gain.u",
            "gain -> offset",
            _GAIN + _BIAS,
            lambda P, m, x, *_: P[:, 0] * x + P[:, 1],
        ),
        Base(
            "play",
            {"gain.gain": 0.92, "play.half_width": 0.15, "offset.bias": 0},
            1,
            "gain.u",
            "gain -> play -> offset",
            _GAIN + 'play = { type = "Play", <half_width> }' + _BIAS,
            lambda P, m, x, *_: play(P[:, 0] * x, P[:, 1], m[:, 0]) + P[:, 2],
        ),
        Base(
            "asymmetric",
            {
                "tsm.alpha1": 0.8972,
                "tsm.alpha2": 0.9487,
                "tsm.A": -0.8745,
                "tsm.theta": 5.034,
                "tsm.delta": 0.145,
                "offset.bias": 0,
            },
            1,
            "tsm.x",
            "tsm -> offset",
            'tsm = { type = "AsymmetricBoucWen", <alpha1>, <alpha2>, <A>, <theta>, <delta> }' + _BIAS,
            _asymmetric,
        ),
        Base(
            "symmetric",
            {
                "tsm.alpha_x": 0.9225,
                "tsm.A": -1.495,
                "tsm.beta": 4.206,
                "tsm.gamma": -2.272,
                "tsm.n": 1.2,
                "offset.bias": 0,
            },
            1,
            "tsm.x",
            "tsm -> offset",
            'tsm = { type = "BoucWen", <alpha_x>, <A>, <beta>, <gamma>, <n> }' + _BIAS,
            _symmetric,
        ),
        Base("motor", {"motor.K": 2, "motor.tau": 0.05}, 2, "motor.u", "", _DRIVE, _motor),
        Base(
            "two_mass",
            {"motor.K": 2, "motor.tau": 0.05, "shaft.omega": 30, "shaft.zeta": 0.08},
            4,
            "motor.u",
            "motor.y -> shaft",
            _DRIVE + 'shaft = { type = "SecondOrderLag", <omega>, <zeta> }',
            _motor,
        ),
    )
}


def fit(base: Base, P: Array, benches: list[Bench], targets: list[Array], hold: str) -> tuple[Array, float]:
    """Best parameters and mean square error of the base model; each recording has initial memories of its own."""
    R, p, q, B = len(benches), len(P), base.memories, 1 + len(P) + base.memories
    x, v, y = (pad(rows) for rows in ([b.x[b.at] for b in benches], [b.v[b.at] for b in benches], targets))
    mask = np.arange(y.shape[1]) < np.array([[len(r)] for r in targets])
    dt = np.array([b.dt * (b.at[1] - b.at[0]) for b in benches])
    start = np.zeros((R, q))
    if q > 1:
        start[:, ::2], start[:, 1::2] = y[:, :1], (y[:, 1:2] - y[:, :1]) / dt[:, None]
    elif q:
        start[:, 0] = y[:, 0] - P[-1] - (0 if base.name == "play" else P[0] * x[:, 0])

    def simulate(theta: Array, change: Array) -> Array:
        rows, many = np.repeat(np.arange(R), len(change)), np.tile(change, (R, 1))
        memory = theta[p:].reshape(R, q)[rows] + many[:, p:]
        y = base.simulate((theta[:p] + many[:, :p])[..., None], memory, x[rows], v[rows], dt[rows], hold)
        return y.reshape(R, len(change), -1) * mask[:, None]

    def jacobian(theta: Array) -> Array:
        out = simulate(theta, np.vstack([np.zeros(B - 1), 1e-5 * np.eye(B - 1)]))
        out, J = (out[:, 1:] - out[:, :1]).swapaxes(1, 2) / 1e-5, np.zeros((*y.shape, p + R * q))
        for r in range(R):
            J[r, :, :p], J[r, :, p + r * q : p + (r + 1) * q] = out[r, :, :p], out[r, :, p:]
        return J.reshape(y.size, -1)

    with np.errstate(all="ignore"):  # a trial step may be too long for the symmetric model; it is then refused
        best = least_squares(
            lambda theta: (simulate(theta, np.zeros((1, B - 1)))[:, 0] - y * mask).ravel(),
            np.r_[P, start.ravel()],
            jacobian,
            ftol=1e-4,
            x_scale="jac",
            max_nfev=15,
        )
    return best.x[:p], float(2 * best.cost / mask.sum())


# Hidden effects: apply(u, s, q, bench), s their size, q constants drawn once for a case
def constants(rng: Rng) -> dict[str, Any]:
    """What an effect has besides its size."""
    span = dict(
        distance=(0.02, 0.12),
        soft=(0.15, 0.5),
        centre=(-0.2, 0.2),
        period=(0.3, 1.2),
        phase=(0, 6),
        second=(0.3, 0.7),
        zeta=(0.05, 0.3),
        feed=(0.1, 0.9),
        v0=(0.05, 0.5),
        rise=(0.3, 1.5),
        at=(0.25, 0.75),
        breath=(0.2, 0.4),
        stick=(2, 6),
        teeth=(6, 24),
        which=(0, 1),
    )
    q = {k: round(float(rng.uniform(*v)), 4) for k, v in span.items()}
    return q | dict(form=int(rng.integers(3)), everywhere=bool(rng.integers(2)))


def _after(q: dict[str, Any], b: Bench) -> Array:
    """0 before the instant of a change, 1 behind it, in one recording or in all."""
    return (q["everywhere"] or b.seed[-1] == 0) * 0.5 * (1 + erf((b.t - q["at"] * b.t[-1]) / 0.01))


def _dead_zone(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    e, r = q["soft"] * s, u - q["centre"]
    return q["centre"] + e * (np.logaddexp(0, (r - s) / e) - np.logaddexp(0, (-r - s) / e))


def _resonance(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    damp = 2 * q["zeta"] / np.sqrt(s)
    num, den = bilinear([q["feed"] * damp, 1 / s], [1, damp, 1 / s], 1 / b.dt)
    return lfilter(num, den, u, zi=lfilter_zi(num, den) * u[0])[0]


def _rate_limit(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    y, step, out = float(u[0]), b.dt / s, []
    for value in u.tolist():
        y = min(max(value, y - step), y + step)
        out.append(y)
    return np.array(out)


def _disturbance(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    if q["form"] == 0:
        return u + s * np.sin(2 * np.pi * 50.03 * b.t + b.rng.uniform(0, 6))
    a = 2 * np.pi * q["breath"] * b.t + 6 * b.rng.random() + 0.4 * wander(b.rng, b.t, 30.0)
    return u + s * (np.sin(a) + 0.3 * np.sin(2 * a + q["phase"]))


def _sticking(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    rng, out, at = b.rng, u.copy(), 0
    while (at := at + int((0.3 + rng.exponential(q["stick"])) / b.dt)) < len(u) - 2:
        end = min(at + max(2, int(s * rng.uniform(0.3, 1.5) / b.dt)), len(u) - 1)
        out[at:end] = u[at]
        out[end:] += (u[at] - u[end]) * np.exp((b.t[end] - b.t[end:]) / 0.03)
        at = end
    return out


def _ripple(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    a = 2 * np.pi * u / q["period"]
    return u + s * (np.cos(a + q["phase"]) + q["second"] * np.cos(2 * a + 2.5 * q["phase"]))


def _second(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    w = wander(b.rng, b.t, 6.0, 0.8)
    return u + s * (w - 0.5 * dahl(w, 0.3) + 0.5 * w * np.cos(2 * u))


def _saturation(u: Array, s: float, q: dict[str, Any], b: Bench) -> Array:
    return np.arctan(np.pi / 2 * s * u) / (np.pi / 2 * s) if q["form"] else u / (1 + np.abs(s * u) ** 3) ** (1 / 3)


Table = dict[str, tuple[str, float, float, str, Callable[..., Array] | None]]
# name: (what its size is, first guess, largest size, constants that it uses, equation, None if inside the base's own)
SINGLE: Table = {
    "soft-edged dead zone": ("half width [rad]", 0.05, 0.5, "centre soft", _dead_zone),
    "friction offset with presliding distance": (
        "offset [rad]",
        0.02,
        0.6,
        "distance",
        lambda u, s, q, b: u - s * (0.6 * dahl(u, q["distance"]) + 0.4 * dahl(u, 3 * q["distance"])),
    ),
    "Stribeck friction offset": (
        "offset at rest [rad]",
        0.02,
        0.6,
        "v0 rise",
        lambda u, s, q, b: (
            u - s * dahl(u, 0.02) * (1 + q["rise"] * np.exp(-((np.gradient(u, b.dt) / q["v0"]) ** 2))) / (1 + q["rise"])
        ),
    ),
    "backlash with compliant faces": (
        "half width [rad]",
        0.03,
        0.6,
        "soft",
        lambda u, s, q, b: np.mean(
            [play(u, s * (1 + k * q["soft"]), u[0] + s * b.rng.uniform(-1, 1)) for k in np.linspace(-1, 1, 7)], axis=0
        ),
    ),
    "position ripple with second harmonic": ("amplitude [rad]", 0.01, 0.5, "period phase second", _ripple),
    "base-excited resonance": ("1/omega^2 [s^2]", 0.001, 0.04, "zeta feed", _resonance),
    "smooth saturation": ("1/limit [1/rad]", 0.3, 5.0, "form", _saturation),
    "dead time": ("delay [s]", 0.01, 0.6, "", lambda u, s, q, b: np.interp(b.t - s, b.t, u)),
    "first-order lag": ("time constant [s]", 0.01, 0.8, "", lambda u, s, q, b: lag(u, b.dt, s)),
    "creep, log-like": (
        "sum of seven lags of 0.1 to 30 s",
        0.05,
        2.0,
        "",
        lambda u, s, q, b: u + s * np.mean([lag(u, b.dt, tau) for tau in np.geomspace(0.1, 30, 7)], axis=0),
    ),
    "gain drift in time": (
        "relative change over a recording",
        0.03,
        1.0,
        "form",
        lambda u, s, q, b: u * (1 + s * (1 - np.exp(-2 * b.part) if q["form"] else b.part)),
    ),
    "bias jump": ("jump [rad]", 0.02, 2.0, "at everywhere", lambda u, s, q, b: u + s * _after(q, b)),
    "periodic disturbance": ("amplitude [rad]", 0.01, 1.0, "form breath", _disturbance),
    "direction-dependent gain": (
        "half difference",
        0.02,
        0.5,
        "distance",
        lambda u, s, q, b: u * (1 + s * dahl(u, q["distance"])),
    ),
    "cubic stiffness": (
        "coefficient [1/rad^2]",
        0.03,
        2.0,
        "centre",
        lambda u, s, q, b: u + s * (u - q["centre"]) ** 3,
    ),
    "rate limit": ("1/rate [s/rad]", 0.4, 20.0, "", _rate_limit),
    "sudden change of a parameter": ("relative change", 0.1, 0.9, "at everywhere which", None),
}
OUTSIDE: Table = {
    "random damper": (
        "median time constant [s]",
        0.02,
        0.8,
        "",
        lambda u, s, q, b: affine(a := np.exp(-b.dt / s / np.exp(0.8 * wander(b.rng, b.t, 8.0))), (1 - a) * u, u[0]),
    ),
    "multiplicative noise": ("rms", 0.02, 0.5, "", lambda u, s, q, b: u * (1 + s * wander(b.rng, b.t, 2.0, 0.2))),
    "unrecorded second input": ("rms [rad]", 0.01, 0.5, "", _second),
    "random walk in gain": ("rms", 0.02, 0.5, "", lambda u, s, q, b: u * (1 + s * wander(b.rng, b.t, 60.0))),
    "sticking now and then": ("mean duration [s]", 0.2, 3.0, "stick", _sticking),
    "product of position and filtered speed": (
        "coefficient [s/rad]",
        0.02,
        0.5,
        "",
        lambda u, s, q, b: u + s * u * lag(np.gradient(u, b.dt), b.dt, 0.08),
    ),
}
DRIFT: Table = {"drift": ("rms [rad]", 0.01, 1.0, "", lambda u, s, q, b: u + s * wander(b.rng, b.t, 120.0))}
MOTOR: Table = {
    "nothing": ("", 0, 0, "", None),
    "dry friction of the motor": ("[V]", 0.05, 1.0, "", None),
    "Stribeck friction of the motor": ("breakaway [V]", 0.05, 1.0, "v0 rise", None),
    "presliding friction of the motor": ("[V]", 0.05, 1.0, "distance", None),
    "backlash behind the motor": ("half width [rad]", 0.02, 0.4, "", None),
    "missing resonance": ("1/omega^2 [s^2]", 0.002, 0.04, "zeta", None),
    "cogging ripple": ("[V]", 0.05, 1.0, "teeth phase", None),
    "load disturbance": ("[V]", 0.02, 1.0, "form at everywhere breath phase", None),
    "smooth saturation of the amplifier": ("1/limit [1/V]", 0.3, 2.0, "form", _saturation),
    "dead time": SINGLE["dead time"],
    "position ripple with second harmonic": SINGLE["position ripple with second harmonic"],
}
EFFECTS = SINGLE | OUTSIDE | DRIFT | MOTOR


class Plant:
    """A base model with parameters, recordings and initial memories of its own, and effects of any size in it."""

    def __init__(self, base: Base, benches: list[Bench], rng: Rng, hold: str) -> None:
        self.base, self.benches, self.hold = base, benches, hold
        width = np.array([0.05 if "alpha" in key else 0.15 for key in base.typical])
        self.P = np.array(list(base.typical.values())) * (1 + width * rng.uniform(-1, 1, len(base.typical)))
        self.memory = rng.uniform(-0.15, 0.15, (len(benches), base.memories))
        if base.memories > 1:
            self.memory[:, ::2], self.memory[:, 1::2] = 4 * self.memory[:, :1], 0
        else:
            self.P[-1] = rng.uniform(-0.1, 0.1)
        if base.name == "play":
            self.memory += self.P[0] * np.array([[b.x[0]] for b in benches])

    def outputs(self, effects: list[dict[str, Any]]) -> list[Array]:
        """Fine outputs with these effects."""
        base, benches, P, memory, more = self.base, self.benches, self.P, self.memory, ()
        inner = next((e for e in effects if e["apply"] is None), None)
        for e in effects:
            if e["place"] == "in" and e["apply"]:
                benches = [Bench(b.t, e["apply"](b.x, e["size"], e["q"], b), b.at, b.seed) for b in benches]
        if inner and inner["name"] == "missing resonance":
            P, memory = np.r_[P, inner["size"] ** -0.5, inner["q"]["zeta"]], np.tile(memory, 2)
        P = np.tile(P[:, None], (len(benches), 1, 1))
        if inner and base.memories > 1:
            q, breath = inner["q"], 2 * np.pi * inner["q"]["breath"]
            load = [np.sin(breath * b.t + 6 * b.rng.random()) if q["form"] else _after(q, b) for b in benches]
            more = (inner, inner["size"] * pad(load))
        elif inner:
            change = 1 + inner["size"] * pad([_after(inner["q"], b) for b in benches])
            k = int(inner["q"]["which"] * (P.shape[1] - 1))
            P = np.repeat(P, change.shape[1], axis=2)
            P[:, k] *= change
        dt = np.array([b.dt for b in benches])
        ys = base.simulate(P, memory, pad([b.x for b in benches]), pad([b.v for b in benches]), dt, self.hold, *more)
        ys = [y[: len(b.t)] for y, b in zip(ys, benches, strict=True)]
        for e in effects:
            if e["place"] == "out" and e["apply"]:
                ys = [e["apply"](y, e["size"], e["q"], b) for y, b in zip(ys, benches, strict=True)]
        return ys

    def error(self, effects: list[dict[str, Any]]) -> float:
        """Mean square error of the best fit of the base to the noiseless samples."""
        sampled = [y[b.at] for y, b in zip(self.outputs(effects), self.benches, strict=True)]
        return fit(self.base, self.P, self.benches, sampled, self.hold)[1]

    def scale(self, effect: dict[str, Any], goal: float) -> float:
        """Size an effect by secants in logarithms until the base's best fit has this square error; that reached."""
        _, s, most, *_ = EFFECTS[effect["name"]]
        known: list[tuple[float, float]] = []
        for _ in range(12):
            effect["size"] = s
            known.append((np.log(s), np.log(max(self.error([effect]), 1e-18) / goal)))
            (a, low), (b, high) = known[-2:] if len(known) > 1 else (known[0], known[0])
            power = np.clip((high - low) / (b - a), 0.3, 20) if b != a else 2.0
            new = b - np.clip(high / power, -2, 2)
            left = max((x for x, error in known if error <= 0), default=-np.inf)
            right = min((x for x, error in known if error > 0), default=np.log(most))
            if not left < new < right:
                new = (left + right) / 2 if np.isfinite(left) and len(known) > 1 and right < np.log(most) else new
            s = min(most, float(np.exp(new)))
            if abs(high) < 0.02 or s == effect["size"]:
                break
        best = min(known, key=lambda point: abs(point[1]))
        effect["size"] = float(np.exp(best[0]))
        return goal * float(np.exp(best[1]))
