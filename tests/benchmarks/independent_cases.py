"""Cases of imagined test benches with a known truth: recordings, base models, noise, hidden effects of known excess.

    python independent_cases.py --group single --seeds 0:17 --out DIR

writes a folder for each case. Plants: ``independent_plants.py``. Written without knowledge of the method under test.
"""

import argparse
import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from independent_plants import BASES, DRIFT, EFFECTS, MOTOR, OUTSIDE, SINGLE, Array, Base, Bench, Plant, Rng, constants
from scipy.signal import lfilter

from tsmblocks.common.one_thread import on_one_thread

GROUPS = ("nulls", "single", "outside", "pairs", "motor")
LEVELS = (0.1, 0.35, 1.0, 3.0)
MOTIONS = ("sines", "chirp", "staircase", "band", "triangle", "paper", "teleoperation")
NOISES = ("white", "ar", "heavy", "quantised", "jitter", "input", "held", "bursts", "drift")
LAST = ("drift", "bias jump", "periodic disturbance")  # of the sensor: nothing comes behind them
FREE = {
    "play": ("gain.gain", "play.half_width", "offset.bias"),
    "symmetric": ("tsm.alpha_x", "tsm.A", "tsm.beta", "tsm.gamma", "tsm.n", "offset.bias"),
    "two_mass": ("motor.K", "motor.tau", "shaft.omega", "shaft.zeta"),
}

FAMILIES = {
    "soft-edged dead zone": "backlash",
    "friction offset with presliding distance": "friction",
    "Stribeck friction offset": "friction",
    "backlash with compliant faces": "backlash",
    "position ripple with second harmonic": "ripple",
    "base-excited resonance": "dynamics",
    "smooth saturation": "static curve",
    "dead time": "delay",
    "first-order lag": "dynamics",
    "creep, log-like": "creep",
    "gain drift in time": "change in time",
    "bias jump": "change in time",
    "periodic disturbance": "disturbance",
    "direction-dependent gain": "direction",
    "cubic stiffness": "static curve",
    "rate limit": "rate limit",
    "sudden change of a parameter": "change in time",
    "drift": "change in time",
    "cogging ripple": "ripple",
    "dry friction of the motor": "friction",
    "Stribeck friction of the motor": "friction",
    "presliding friction of the motor": "friction",
    "backlash behind the motor": "backlash",
    "missing resonance": "dynamics",
    "load disturbance": "disturbance",
    "smooth saturation of the amplifier": "static curve",
    **dict.fromkeys(OUTSIDE, "outside"),
}

FORMS = {
    "smooth saturation": ("algebraic", "arctan", "arctan"),
    "gain drift in time": ("ramp", "settling", "settling"),
    "smooth saturation of the amplifier": ("algebraic", "arctan", "arctan"),
    "load disturbance": ("step", "sine", "weight"),
    "periodic disturbance": ("hum of 50.03 Hz", "breathing", "breathing"),
}


@dataclass(frozen=True)
class Case:
    """Base diagram (TOML text), recordings, truth, and the rms noise of the output in the output's unit.

    `hold` is how the input runs between samples; `free` names parameters that can be told apart, if not all can
    (Gain in front of Play, for example): both are known to the owner of a bench, and no part of the truth.
    """

    name: str
    group: str
    base: str
    recordings: dict[str, dict[str, Any]]
    truth: dict[str, Any]
    sigma: float
    hold: str = "cubic"
    free: tuple[str, ...] | None = None


def motion(kind: str, rng: Rng, t: Array, fast: float, period: float) -> Array:
    """Motion within about +-1, up to `fast` Hz; if `period` is not 0, sums of sines and triangles repeat after it."""

    def on_grid(f: Array) -> Array:
        return np.maximum(np.round(f * period), 1) / period if period else f

    if kind in {"sines", "band", "paper"}:
        f = on_grid(fast * np.exp(rng.uniform(np.log(0.08), 0, 4 if kind == "sines" else 30)))
        f = np.array([[0.2, 0.2], [0.2, 0.5], [0.25, 0.25 * 3**0.5]][rng.integers(3)]) if kind == "paper" else f
        x = np.sin(2 * np.pi * (np.outer(f, t) + rng.random((len(f), 1)))).sum(axis=0)
        return x / np.abs(x).max()
    if kind == "chirp":
        rate = np.log(fast / 0.08) / t[-1]
        turns = np.where(t < 0, 0.08 * t, 0.08 / rate * np.expm1(rate * np.maximum(t, 0)))
        return np.sin(2 * np.pi * (turns + rng.random()))
    if kind == "triangle":
        phase = on_grid(np.array([fast * rng.uniform(0.15, 0.5)])) * t + rng.random()
        return np.arcsin(0.998 * np.sin(2 * np.pi * phase)) * 2 / np.pi  # its corners are rounded
    now, level = t[0], rng.uniform(-1, 1)
    x = np.full_like(t, level)
    while now < t[-1]:
        now += rng.exponential(0.8) if kind == "teleoperation" else rng.uniform(0.3, 1.2)
        goal = rng.uniform(-1, 1) if kind == "staircase" else np.clip(level + rng.normal(0, 0.6), -1, 1)
        span = max(abs(goal - level), 0.1) * rng.uniform(0.6, 1.8) / fast
        s = np.clip((t - now) / span, 0, 1)
        x, level, now = x + (goal - level) * s**3 * (10 - 15 * s + 6 * s**2), goal, now + span
    return x


def noise(kind: str, rng: Rng, constants: Rng, n: int, dt: float) -> tuple[Array, dict[str, float]]:
    """Noise of about unit rms, and its constants, which all recordings of a bench share."""
    w = rng.standard_normal(n)
    if kind == "ar":
        tau, share = np.exp(constants.uniform(np.log(0.02), np.log(0.5))), constants.uniform(0.3, 0.8)
        a = np.exp(-dt / tau)
        slow = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n), zi=[a * rng.standard_normal()])[0]
        known = {"time constant [s]": tau, "slow share of variance": share}
        return np.sqrt(share) * slow + np.sqrt(1 - share) * w, known
    if kind == "heavy":
        nu = int(constants.integers(3, 6))
        outliers = rng.choice([-8.0, 0.0, 8.0], n, p=[0.0005, 0.999, 0.0005])
        return rng.standard_t(nu, n) / np.sqrt(nu / (nu - 2)) + outliers, {"degrees of freedom": nu}
    if kind == "bursts":
        f = constants.uniform(17, 45)
        for at in np.flatnonzero(rng.random(n) < dt / 4):
            k = np.arange(min(n - at, int(rng.uniform(0.05, 0.3) / dt)))
            w[at + k] += rng.uniform(3, 6) * np.sin(2 * np.pi * f * dt * k)
        return w, {"frequency [Hz]": f}
    return w, {}


def recorded(rng: Rng, seed: tuple[int, ...], base: Base, coarse: int) -> tuple[list[Bench], list[str]]:
    """Three to eight recordings, some repeated or periodic, each with 3 s before its first sample."""
    rate, style = float(rng.choice([100, 125, 200] if base.memories > 1 else [50, 100, 200])), rng.random()
    benches, labels = [], []
    for j in range(int(rng.integers(3, 9))):
        again = bool(style < 0.3 and j % 2)
        if not again:
            n, kind, salt = int(rng.integers(1500, 3001)), str(rng.choice(MOTIONS)), int(rng.integers(1 << 30))
            size, centre = (1.0, rng.uniform(-0.2, 0.2)) if rng.random() < 0.6 else rng.uniform([0.3, -0.4], [0.6, 0.4])
            fast, rest = rng.uniform(0.4, 1.2) * (0.5 if rate == 50 else 1), bool(rng.random() < 0.4)
        m = max(4, int(np.ceil((200 if base.name == "symmetric" else 1000) / rate)))
        i = np.arange(-int(3 * rate) * m, (n - 1) * m + 1)
        t = i / rate / m
        run = 0.1 * np.logaddexp(0, t / 0.1) if rest else t
        x = size * motion(kind, np.random.default_rng(salt), run, fast, t[-1] / 3 if style > 0.7 else 0.0) + centre
        if base.memories > 1:  # the voltage that moves the motor about so
            x = np.gradient(x, t[1] - t[0]) / base.typical["motor.K"]
        if coarse:
            x = x[np.maximum(i // (coarse * m) * coarse * m - i[0], 0)]
        benches.append(Bench(t, x, -i[0] + m * np.arange(n), (*seed, j)))
        marks = {"repeated": again, "periodic": style > 0.7, "from rest": rest}
        labels.append(", ".join([kind, *(k for k, v in marks.items() if v)]))
        if rng.random() < 0.1 and base.memories < 2:
            rate = float(rng.choice([50.0, 100.0, 200.0]))
    return benches, labels


@on_one_thread  # sizes are searched for, and the search depends on the last digits
def build(group: str, seed: int) -> Case:
    """A case: its seed chooses noise (nulls) or effect and excess (other groups) in turn, and the rest at random."""
    rng = np.random.default_rng((GROUPS.index(group), seed, 2026))
    table = {"nulls": DRIFT, "outside": OUTSIDE, "motor": MOTOR}.get(group, SINGLE)
    kind = str(rng.choice(["white"] * 5 + ["ar", "ar", "heavy", "quantised", "bursts"]))
    kind = NOISES[seed % 9] if group == "nulls" else kind
    turn, which = divmod(seed, len(table))
    names, goals = [list(table)[which]], [LEVELS[(turn + which) % 4]]
    if group == "pairs":
        names.append(str(rng.choice([n for n in table if n != names[0]])))
        goals = [float(g) for g in rng.choice(LEVELS[1:], 2)]
    if names == ["nothing"] or (group == "nulls" and kind != "drift"):
        names = goals = []
    choices = ["linear", "play", "asymmetric", "asymmetric", "symmetric"] + ["motor"] * (group == "nulls")
    if group == "motor" or kind == "held":
        choices = ["motor", "two_mass"] + ["linear", "play"] * (kind == "held")
    base = BASES["motor" if "missing resonance" in names else str(rng.choice(choices))]
    hold, coarse = ("zero", int(rng.integers(3, 11))) if kind == "held" else ("cubic", 0)
    benches, labels = recorded(rng, (GROUPS.index(group), seed), base, coarse)
    plant = Plant(base, benches, rng, hold)
    effects = [_placed(name, base, rng) for name in sorted(names, key=lambda name: name in LAST)]
    spread = max(np.ptp(y[b.at]) for y, b in zip(plant.outputs([]), benches, strict=True))
    sigma = float(spread * np.exp(rng.uniform(np.log(0.002), np.log(0.008))))
    alone = []
    for e, goal in zip(effects, goals, strict=True):
        alone.append(reached := plant.scale(e, goal * sigma**2))
        if len(effects) == 1 and abs(np.log(reached / goal / sigma**2)) > 0.05:
            sigma = float(np.sqrt(reached / goal))  # the effect is not as large, so the noise is smaller
    error = plant.error(effects)
    records, noise_truth, rest, unit = _measured(rng, kind, plant, plant.outputs(effects), sigma)
    factor = 180 / np.pi if unit == "deg" else 1.0
    true_sigma = float(np.sqrt(np.mean(rest**2)))
    off = 1 + rng.choice([-1, 1], len(plant.P)) * rng.uniform(0.05, 0.2, len(plant.P))
    told = np.where([k == "offset.bias" for k in base.typical], 0.0, plant.P * off)
    told = np.maximum(told, [1.0 if k == "tsm.n" else -np.inf for k in base.typical])
    truth = {
        "label": "nothing" if not effects else " + ".join(e["name"] for e in effects),
        "effects": [
            {
                "effect": e["name"],
                "family": FAMILIES[e["name"]],
                "place": e["place"],
                "size": e["size"],
                "meaning of size": EFFECTS[e["name"]][0],
                "constants": _words(e, list(base.typical)),
                "excess alone": reached / true_sigma**2,
                "excess aimed at": goal,
            }
            for e, goal, reached in zip(effects, goals, alone, strict=True)
        ],
        "excess": error / true_sigma**2,
        "base": base.name,
        "noise": noise_truth,
        "motions": labels,
        "parameters": dict(zip(base.typical, plant.P.tolist(), strict=True)),
    }
    free = FREE.get(base.name)
    return Case(f"{group}-{seed:04d}", group, base.toml(told), records, truth, true_sigma * factor, hold, free)


def _placed(name: str, base: Base, rng: Rng) -> dict[str, Any]:
    """An effect of no size yet, before or behind the base model."""
    place = "out" if name in (*LAST, "position ripple with second harmonic") or rng.random() < 0.7 else "in"
    if base.memories > 1 and name.startswith(("smooth", "dead")):
        place = "in"
    place = "inside" if EFFECTS[name][-1] is None else place
    return dict(name=name, place=place, size=0.0, q=constants(rng), apply=EFFECTS[name][-1])


def _words(e: dict[str, Any], names: list[str]) -> dict[str, Any]:
    """The constants that an effect uses, its form and the parameter that it changes in words."""
    used = {k: e["q"][k] for k in EFFECTS[e["name"]][3].split()}
    if "form" in used:
        used["form"] = FORMS[e["name"]][used["form"]]
    if "which" in used:
        used["which"] = names[int(used["which"] * (len(names) - 1))]
    return used


def _measured(rng: Rng, kind: str, plant: Plant, ys: list[Array], sigma: float) -> tuple[dict, dict, Array, str]:
    """Recordings with noise, the noise's truth, the output's errors in rad, and the unit of recorded angles."""
    unit = "deg" if rng.random() < 0.3 and plant.base.name != "two_mass" else "rad"
    irregular = bool(kind == "jitter" and rng.integers(2))
    share, salt, ratio = rng.uniform(0.2, 0.6), int(rng.integers(1 << 30)), rng.uniform(1, 3) * (kind == "quantised")
    sizes = [(len(b.at), b.dt * (b.at[1] - b.at[0])) for b in plant.benches]
    made = np.random.default_rng
    drawn = [noise(kind, made((salt, j)), made(salt), *s) for j, s in enumerate(sizes)]
    true, scale = drawn[0][1], sigma / np.sqrt(1 + ratio**2 / 12)
    scale /= np.sqrt(np.mean(np.concatenate([w for w, _ in drawn]) ** 2))
    step = ratio * scale
    motor, factor = plant.base.memories > 1, (180 / np.pi if unit == "deg" else 1.0)
    records, rest = {}, []
    for j, (b, y) in enumerate(zip(plant.benches, ys, strict=True)):
        own, m, n = np.random.default_rng((salt, j, 1)), int(b.at[1] - b.at[0]), len(b.at)
        late = np.r_[0, own.integers(-(m // 4), m // 4 + 1, n - 2), 0] * (kind == "jitter")
        at = b.at + late * irregular
        measured = y[at] + scale * drawn[j][0]
        measured = np.round(measured / step) * step if step else measured
        rest.append(measured - y[at])
        x = b.x[at] + sigma * share * own.standard_normal(n) * (kind == "input")
        x, x_name, y_name = (x, "u", "x") if motor else (x * factor, "x_in", "x_out")
        records[f"r{j + 1}"] = dict(
            t=(b.at - b.at[0] + late) * b.dt,
            signals={x_name: x, y_name: measured * factor},
            units={x_name: "V" if motor else unit, y_name: unit},
        )
    if step:
        true = {"step [rad]": step, "rms before rounding [rad]": scale}
    if kind == "jitter":
        true = {"instants are irregular too, and stamped rightly": float(irregular)}
    if kind == "input":
        true = {"rms of the input's noise" + (" [V]" if motor else " [rad]"): sigma * share}
    return records, {"kind": kind, **true}, np.concatenate(rest), unit


def cases(group: str, seeds: range) -> Iterator[Case]:
    """Cases of a group, one for each seed."""
    for seed in seeds:
        yield build(group, seed)


def write(case: Case, folder: Path) -> None:
    """A CSV file for each recording, base.toml and truth.json, in a folder named like the case."""
    place = folder / case.name
    place.mkdir(parents=True, exist_ok=True)
    (place / "base.toml").write_text(case.base, encoding="utf-8")
    for name, record in case.recordings.items():
        with (place / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow(["t [s]", *(f"{k} [{record['units'][k]}]" for k in record["signals"])])
            rows = zip(record["t"], *record["signals"].values(), strict=True)
            out.writerows([f"{value:.9g}" for value in row] for row in rows)
    about = dict(name=case.name, group=case.group, sigma=case.sigma, hold=case.hold, free=case.free, truth=case.truth)
    (place / "truth.json").write_text(json.dumps(about, indent=1, default=float), encoding="utf-8")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--group", choices=GROUPS, required=True)
    parser.add_argument("--seeds", default="0:9", help="first:behind the last")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for case in cases(options.group, range(*map(int, options.seeds.split(":")))):
        write(case, options.out)
        print(f"{case.name}: {case.truth['base']}, {case.truth['label']}, excess {case.truth['excess']:.3g}")


if __name__ == "__main__":
    main()
