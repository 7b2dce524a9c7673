"""The diagnosis with default options on benches that were made without knowledge of its method.

    python tests/benchmarks/independent.py --group nulls --seeds 0:36 [--workers 2] [--floor] [--out FILE.jsonl]

Cases (``independent_cases.py``) have forms, noise and initial states of their own. Holds and free parameters are not
given, and the noise only with ``--floor``. A name is correct where it is one of ``RIGHT``. Each case is written to
FILE.jsonl when it is done; the command run again does those that are missing.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin on problems of this size

import tsmblocks as tsm  # noqa: E402 - after the threads are set

FRICTION = "coulomb_friction asymmetric_friction stribeck_friction presliding_friction"
LOOPS = "backlash hysteresis nonlocal_memory presliding_friction coulomb_friction"
RIGHT = {
    "soft-edged dead zone": "dead_zone",
    "friction offset with presliding distance": LOOPS,
    "Stribeck friction offset": f"{LOOPS} stribeck_friction rate_dependence",
    "backlash with compliant faces": "backlash hysteresis nonlocal_memory",
    "position ripple with second harmonic": "position_ripple",
    "base-excited resonance": "resonance",
    "smooth saturation": "saturation odd_nonlinearity",
    "smooth saturation of the amplifier": "saturation odd_nonlinearity",
    "dead time": "dead_time",
    "first-order lag": "first_order_lag",
    "creep, log-like": "creep",
    "gain drift in time": "parameter_change drift",
    "bias jump": "jump parameter_change",
    "drift": "drift",
    "periodic disturbance": "periodic_disturbance",
    "direction-dependent gain": "asymmetric_hysteresis asymmetric_friction position_dependent_friction hysteresis",
    "cubic stiffness": "odd_nonlinearity even_nonlinearity",
    "rate limit": "rate_limit",
    "sudden change of a parameter": "parameter_change jump",
    "dry friction of the motor": FRICTION,
    "Stribeck friction of the motor": FRICTION,
    "presliding friction of the motor": FRICTION,
    "backlash behind the motor": "backlash",
    "missing resonance": "resonance",
    "cogging ripple": "position_ripple",
    "load disturbance": "load_offset jump periodic_disturbance parameter_change",
}
"""Effect in plain words -> names of the catalogue that say the same. What is not here is outside of the catalogue."""


def main(arguments: list[str] | None = None) -> int:
    """Diagnose what is not in the file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--group", default="nulls", help="nulls, single, outside, pairs or motor")
    parser.add_argument("--seeds", default="0:9", metavar="A:B", help="first seed, and the one after the last (0:9)")
    parser.add_argument("--workers", type=int, default=2, help="processes side by side (2)")
    parser.add_argument("--floor", action="store_true", help="give the noise of the sensor")
    parser.add_argument("--out", type=Path, default=Path("independent.jsonl"), metavar="FILE", help="one case a line")
    args = parser.parse_args(arguments)
    wanted = [(args.group, seed, args.floor) for seed in range(*map(int, args.seeds.split(":")))]
    done = {(row["group"], row["seed"], row.get("floor", False)): row for row in rows(args.out)}
    todo = [case for case in wanted if case not in done]
    context = multiprocessing.get_context("spawn")
    with context.Pool(args.workers, maxtasksperchild=4) as pool, args.out.open("a", encoding="utf-8") as file:
        for row in pool.imap_unordered(diagnosed, todo):
            done[row["group"], row["seed"], row["floor"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(line(row), flush=True)
    table([done[case] for case in wanted])
    return 0


def rows(path: Path) -> list[dict[str, Any]]:
    """The results in a file, if there is one."""
    return [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def diagnosed(which: tuple[str, int, bool]) -> dict[str, Any]:
    """One case: its truth, and what the diagnosis says of it."""
    import independent_cases

    group, seed, floor = which
    case = independent_cases.build(group, seed)
    records = {k: tsm.Record(k, r["t"], r["signals"], r["units"]) for k, r in case.recordings.items()}
    row: dict[str, Any] = dict(
        group=group, seed=seed, floor=floor, base=case.truth["base"], noise=case.truth["noise"]["kind"]
    )
    row |= dict(truth=[e["effect"] for e in case.truth["effects"]], excess=case.truth["excess"], sigma=case.sigma)
    began = time.perf_counter()
    try:
        base = tsm.loads(case.base)
        unit = next(r for r in records.values()).unit(next(iter(base.outputs)))
        found = tsm.diagnose(base, records, noise_floor=f"{case.sigma}{unit}" if floor else None)
    except tsm.errors.TsmError as fault:
        return row | dict(verdict="error", names=[str(fault)], seconds=time.perf_counter() - began)
    names = [[e.name, *e.also_possible] for e in found.effects]
    return row | dict(verdict=found.verdict, names=names, seconds=time.perf_counter() - began)


def judged(row: dict[str, Any]) -> str:
    """What a verdict is worth."""
    if row["verdict"] == "error":
        return "error"
    known = [set(RIGHT[name].split()) for name in row["truth"] if name in RIGHT]
    if not row["truth"]:
        return "right" if row["verdict"] == "none" else f"false alarm: {row['verdict']}"
    if row["verdict"] != "named":
        return "right: unknown" if not known and row["verdict"] == "unknown" else row["verdict"]
    first = [names[0] for names in row["names"]]
    if all(any(name in right for name in first) for right in known) and known:
        return "right" if len(first) == len(known) else "right, and more"
    also = {name for names in row["names"] for name in names}
    return "in the set" if known and all(also & right for right in known) else "wrong name"


def line(row: dict[str, Any]) -> str:
    """A case in one line."""
    what = f"{row['group']} {row['seed']} {row['base']} {row['noise']}: {' + '.join(row['truth']) or 'nothing'}"
    said = ", ".join("/".join(names) if isinstance(names, list) else names for names in row["names"])
    return f"{what}, excess {row['excess']:.2f}: {row['verdict']} {said} ({judged(row)}, {row['seconds']:.0f} s)"


def table(every: list[dict[str, Any]]) -> None:
    """How many of each outcome, by the size of what is hidden."""
    parts = {"nothing hidden": [r for r in every if not r["truth"]]}
    for low, high in ((0.0, 0.2), (0.2, 0.6), (0.6, 1.8), (1.8, float("inf"))):
        parts[f"excess {low:g} to {high:g}"] = [r for r in every if r["truth"] and low <= r["excess"] < high]
    for what, some in parts.items():
        if some:
            counts = ", ".join(f"{n} {outcome}" for outcome, n in Counter(map(judged, some)).most_common())
            seconds = sorted(r["seconds"] for r in some)
            print(f"{what}: {len(some)} cases: {counts}; median {seconds[len(seconds) // 2]:.0f} s")


if __name__ == "__main__":
    raise SystemExit(main())
