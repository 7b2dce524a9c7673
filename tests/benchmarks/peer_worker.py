"""One tool in a process of its own: import, build, first run, more runs; writes what it measured.

python peer_worker.py MODULE SETTINGS.json RESULT.npz
"""

import time

BEGAN = time.perf_counter()

import json  # noqa: E402 - the clock starts before any import
import sys  # noqa: E402
from importlib import import_module  # noqa: E402


def main(name: str, settings_file: str, result_file: str) -> None:
    """Measure one tool."""
    with open(settings_file, encoding="utf-8") as file:
        settings = json.load(file)
    module = import_module(name)
    imported = time.perf_counter()
    run = module.build(settings["numbers"], settings["stop"], settings["step"])
    built = time.perf_counter()
    runs, spent = [], 0.0
    while True:
        wall, cpu = time.perf_counter(), time.process_time()
        error = run()
        runs.append((time.perf_counter() - wall, time.process_time() - cpu))
        # the first run of a tool that compiles says nothing of how long the next one takes
        spent += 0.0 if len(runs) == 1 and getattr(module, "COMPILES", False) else runs[-1][0]
        if spent > settings["seconds"] or len(runs) >= settings["most"]:
            break
    import numpy as np

    np.savez(
        result_file,
        error=np.asarray(error, dtype=float).ravel(),
        runs=np.array(runs),
        times=np.array([imported - BEGAN, built - imported, runs[0][0]]),
        tolerance=module.TOLERANCE,
        method=module.METHOD,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
