"""The diagnosis on data in which the effect is hidden: how often it is found, named, placed, and nothing is made up.

    python tests/benchmarks/hidden.py [--seeds N] [--first SEED] [--groups null,single] [--workers 2]
                                      [--out FILE.jsonl] [--table FILE.jsonl] [--every N] [--baselines]

Each case is written to FILE.jsonl when it is done; the command run again does those that are missing. ``--table`` only
reads such a file. See README.md beside this file.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import queue
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin on problems of this size

import hidden_cases  # noqa: E402 - after the threads are set
from hidden_tables import tables  # noqa: E402

from tests.hidden import GROUPS  # noqa: E402

_tell: Any = None


def main(arguments: list[str] | None = None) -> int:
    """Run what is not in the file yet, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="plants and noises of each kind (10)")
    parser.add_argument("--first", type=int, default=8000, metavar="SEED", help="the first of them (8000)")
    parser.add_argument("--groups", default=",".join(GROUPS), help="groups, with commas between them")
    parser.add_argument("--workers", type=int, default=2, help="processes side by side (2)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one case in N of each group: a quick look")
    parser.add_argument("--out", type=Path, default=Path("hidden.jsonl"), metavar="FILE", help="results, one a line")
    parser.add_argument("--table", type=Path, metavar="FILE", help="only print the tables of these results")
    parser.add_argument("--baselines", action="store_true", help="sparse regression of the residual beside it")
    args = parser.parse_args(arguments)
    if args.table is None:
        run(args)
    tables(rows(args.table or args.out))
    return 0


def run(args: argparse.Namespace) -> None:
    """Work through what is missing, the groups in turn, so that an early stop leaves something of each."""
    groups = [g.strip() for g in args.groups.split(",")]
    strange = [g for g in groups if g not in GROUPS]
    if strange:
        raise SystemExit(f"no group {', '.join(strange)}; there are {', '.join(GROUPS)}")
    done = {row["key"] for row in rows(args.out)} if args.out.exists() else set()
    by_group = hidden_cases.listed(args.seeds, args.first)
    todo = []
    for group in groups:
        wanted = [one for one in by_group[group][:: args.every] if hidden_cases.key_of(*one) not in done]
        parts = hidden_cases.batches(wanted)
        todo += [((k + 0.5) / len(parts), part) for k, part in enumerate(parts)]
    order = [part for _, part in sorted(todo, key=lambda one: one[0])]
    count = sum(len(part) for part in order)
    print(f"{count} cases to do, {len(done)} in {args.out} already", flush=True)
    if order:
        _work(order, count, args)


def _work(order: list[Any], count: int, args: argparse.Namespace) -> None:
    context = multiprocessing.get_context("spawn")
    channel, began, seen = context.Queue(), time.monotonic(), 0
    with (
        context.Pool(args.workers, _begin, (channel,), maxtasksperchild=8) as pool,
        args.out.open("a", encoding="utf-8") as file,
    ):
        waiting = [pool.apply_async(_one, (part, args.baselines)) for part in order]
        while seen < count:
            try:
                row = channel.get(timeout=5.0)
            except queue.Empty:
                for one in waiting:
                    if one.ready():
                        one.get()  # a batch that could not be made says so here
                continue
            file.write(json.dumps(row) + "\n")
            file.flush()
            seen += 1
            print(f"{seen}/{count} {time.monotonic() - began:.0f} s  {line(row)}", flush=True)


def _begin(channel: Any) -> None:
    global _tell
    _tell = channel.put


def _one(part: Any, baselines: bool) -> None:
    hidden_cases.worked(part, _tell, baselines)


def line(row: dict[str, Any]) -> str:
    """A case in one line."""
    spec = row["spec"]
    what = f"{spec['group']} {spec['effect'] or '-'} {spec['size']:g} seed {spec['seed']} {row['protocol']}"
    if "error" in row:
        return f"{what}: {row['error']}"
    names = ", ".join(e["name"] + "".join(f"/{k}" for k in e["also"]) for e in row["effects"])
    return f"{what} excess {row['excess']:.2f}: {row['verdict']} {names} ({row['seconds']:.0f} s)"


def rows(path: Path) -> list[dict[str, Any]]:
    """The results in a file; a line cut off by a stop is left out."""
    made = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            made.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return made


if __name__ == "__main__":
    raise SystemExit(main())
