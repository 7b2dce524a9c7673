"""How often a run is wrong without a warning of its step, and warned though it is right, on random diagrams.

    python tests/benchmarks/step_warnings.py --seeds 0:200 [--out FILE.jsonl]

The error of a run is the largest over its states of the largest error over time, as a share of the largest value of the
state. The reference is SciPy's LSODA on the evaluated right-hand side where the diagram has no memory, no delay and no
held input; else our own engine with RK4 in 200,000 steps or more. A reference that is not settled to 0.1 % (a chaotic
or an unstable case) is left out, and said.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

import step_cases  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402

import tsmblocks as tsm  # noqa: E402
from tsmblocks import blocks  # noqa: E402
from tsmblocks.common.errors import RunError  # noqa: E402
from tsmblocks.simulation.compiled import parameter_vector  # noqa: E402
from tsmblocks.simulation.stability import StepWarning  # noqa: E402

WRONG, RIGHT = 1e-2, 1e-4
"""Errors above which a run is wrong, and up to which it is right."""
SETTLED = 1e-3
"""Difference of two references, above which there is none."""
FINE_STEPS = 200_000
"""Steps of the engine's reference, at least."""
MOST_SECONDS = 20.0
"""Time for one solution by SciPy; a case that takes longer is left out."""
TINY = 1e-12


class TooSlow(Exception):
    """A reference takes too long."""


def relative(x: np.ndarray, right: np.ndarray) -> float:
    """The largest error of states over time, as a share of the largest value of each."""
    scale = np.abs(right).max(axis=0)
    scale = np.maximum(scale, TINY * scale.max())
    with np.errstate(all="ignore"):
        off = np.abs(x - right) / np.where(scale > 0, scale, 1.0)
    return float(np.nan_to_num(off, nan=np.inf).max())


def jumps(diagram: Any, stop: float) -> list[float]:
    """Instants at which the sources of a diagram jump or bend, within a run."""
    found = {0.0, stop}
    for one in diagram.blocks.values():
        if isinstance(one, blocks.Step):
            found.add(one.time)
        elif isinstance(one, blocks.Staircase):
            found.update(np.arange(one.dwell, stop, one.dwell))
        elif isinstance(one, blocks.Triangle):
            found.update(np.arange(0.25 / one.frequency, stop, 0.5 / one.frequency))
        elif isinstance(one, blocks.Chirp):
            found.add(one.duration)
    return sorted(t for t in found if 0 <= t <= stop)


def by_scipy(case: Any, t: np.ndarray, tolerance: float) -> np.ndarray:
    """States at instants ``t`` by LSODA, begun again wherever a source jumps."""
    eq = tsm.equations(case.diagram)
    p, buffers = parameter_vector(eq, case.diagram), eq.rhs.buffer()
    empty = np.empty(0)
    buffer, evaluate = buffers
    now, x, dx = np.zeros(1), np.zeros(len(eq.x)), np.zeros(len(eq.x))
    outs = [dx, *(np.zeros(eq.rhs.nnz_out(k)) for k in range(1, eq.rhs.n_out()))]
    for k, one in enumerate((now, x, empty, empty, empty, p)):
        buffer.set_arg(k, one.data)
    for k, one in enumerate(outs):
        buffer.set_res(k, one.data)
    late = time.perf_counter() + MOST_SECONDS
    last = math.inf

    def slope(at: float, state: np.ndarray) -> np.ndarray:
        now[0], x[:] = min(at, last), state
        evaluate()
        if time.perf_counter() > late:
            raise TooSlow
        return dx.copy()

    state = np.array(eq.start(p)[0]).ravel()
    made = np.empty((len(t), len(eq.x)))
    for a, c in itertools.pairwise(jumps(case.diagram, float(t[-1]))):
        if c - a < 1e-9 * case.stop:
            continue
        last = c - 1e-12 * max(1.0, c)
        inside = (t >= a) & (t <= c)
        instants = np.unique(np.append(t[inside], c))
        solved = solve_ivp(
            slope,
            (a, c),
            state,
            "LSODA",
            t_eval=instants,
            rtol=tolerance,
            atol=1e-3 * tolerance,
            max_step=case.stop / 300,
        )
        if not solved.success:
            raise TooSlow
        made[inside] = solved.y[:, : inside.sum()].T
        state = solved.y[:, -1]
    return made


def by_engine(case: Any, n: int, finer: int, locate: bool = False) -> np.ndarray:
    """States at the instants of ``n`` steps by our own engine, in steps so many times as short."""
    eq, h = tsm.equations(case.diagram), case.step / finer
    log = list(eq.x)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = tsm.simulate(
            case.diagram, stop=n * case.step, step=h, every=finer, log=log, locate=locate, check_step=False
        )
    return np.column_stack([run[name] for name in eq.x])


def reference(case: Any, t: np.ndarray) -> tuple[np.ndarray | None, str]:
    """States at the instants of a run, and where they are from; None where they are not settled."""
    eq, n = tsm.equations(case.diagram), len(t) - 1
    try:
        if eq.update is None and not eq.q and not eq.u:
            source, rough, fine = "scipy", by_scipy(case, t, 1e-8), by_scipy(case, t, 1e-10)
        else:
            finer = max(8, 2 ** math.ceil(math.log2(FINE_STEPS / n)))
            source, rough, fine = "engine", by_engine(case, n, finer // 2), by_engine(case, n, finer)
            if not eq.q and (relative(rough, fine) > SETTLED or case.kind == "reset"):
                source = "engine, located"
                rough, fine = by_engine(case, n, finer // 8, True), by_engine(case, n, finer // 4, True)
    except (TooSlow, RunError):
        return None, "none"
    off = relative(rough, fine)
    return (fine, source) if off <= SETTLED else (None, f"{source}, not settled ({off:.0e})")


def outcome(seed: int) -> dict[str, Any]:
    """One case: its error, and whether it was warned of."""
    case = step_cases.build(seed)
    eq = tsm.equations(case.diagram)
    made: dict[str, Any] = {"seed": seed, "kind": case.kind, "method": case.method, "locate": case.locate}
    made |= {"step": case.step, "steps": round(case.stop / case.step), "error": None}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        began = time.perf_counter()
        try:
            run = tsm.simulate(case.diagram, **case.run)
        except RunError as error:
            return made | {"outcome": "raised", "text": str(error)[:300]}
    made["seconds"] = time.perf_counter() - began
    said = [str(w.message) for w in caught if issubclass(w.category, StepWarning)]
    made |= {"warned": bool(said), "text": said[0] if said else ""}
    right, source = reference(case, run.t)
    made["reference"] = source
    if right is None:
        return made | {"outcome": "no reference"}
    error = relative(np.column_stack([run[name] for name in eq.x]), right)
    kind = "wrong" if error > WRONG else "right" if error <= RIGHT else "between"
    return made | {"error": error, "outcome": kind}


def table(found: list[dict[str, Any]]) -> str:
    """The two rates, and what was left out."""
    lines = []
    for kind in ("wrong", "between", "right"):
        these = [one for one in found if one["outcome"] == kind]
        lines.append(f"{kind:8} {len(these):4d} runs, warned {sum(one['warned'] for one in these):4d}")
    counted = [one for one in found if one["outcome"] in ("wrong", "between", "right")]
    silent = [one["seed"] for one in counted if one["outcome"] == "wrong" and not one["warned"]]
    needless = [one["seed"] for one in counted if one["outcome"] == "right" and one["warned"]]
    for text, seeds in (("wrong by more than 1 % without a warning", silent), ("warned though right", needless)):
        lines.append(
            f"{text}: {len(seeds)} of {len(counted)} ({100 * len(seeds) / max(len(counted), 1):.1f} %) {seeds}"
        )
    lines.append(f"left out: {dict(Counter(one['outcome'] for one in found if one not in counted))}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the seeds, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:200", metavar="A:B")
    parser.add_argument("--out", type=Path, metavar="FILE", help="a line of JSON for each case; done ones are kept")
    args = parser.parse_args(arguments)
    first, last = map(int, args.seeds.split(":"))
    known = args.out.read_text().splitlines() if args.out and args.out.exists() else []
    found = {one["seed"]: one for one in map(json.loads, known)}
    for seed in range(first, last):
        if seed not in found:
            found[seed] = outcome(seed)
            if args.out:
                with args.out.open("a") as file:
                    file.write(json.dumps(found[seed]) + "\n")
    print(table([found[seed] for seed in range(first, last)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
