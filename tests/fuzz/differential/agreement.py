"""One random diagram, run in every way there is, which all must give what the reference gives."""

from __future__ import annotations

import subprocess
import tempfile
import warnings
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

import tsmblocks as tsm
from tests.fuzz.differential.diagrams import STEPS, Drawn, H, as_diagram, nested
from tests.fuzz.differential.evaluation import NoTest, SampledSignal
from tests.fuzz.differential.methods import IMPLICIT, reference_run, smooth_run
from tsmblocks.common.errors import TsmError
from tsmblocks.export import to_c
from tsmblocks.files import dumps, loads

CLOSE = 3e-8
"""Share of a signal's size by which two ways may differ. Chosen: where anything jumps, the last stage of a step is
read a hair before its end, which makes some 1e-9."""
FILE_CLOSE = 1e-12
"""The same for a diagram that was read back, whose blocks may stand in another order."""
IMPLICIT_CLOSE = 1e-6
"""The same for stages and loops that are solved by iteration."""
SMOOTH_CLOSE = 2e-5
"""The same for rk4 with a short step against an integrator with an error estimate."""
NOISE, AMPLIFIED = 1e-14, 1e4
"""Rounding that is added to see how much of it a diagram amplifies, and how many times of that is allowed."""
HUGE = 1e7
"""Signals from which nothing is compared."""
SMOOTH_REFINED = 8
"""By how much the step of a smooth diagram is refined."""


@attrs.frozen
class Disagreement(Exception):
    """Two ways that differ: which, in what signal and from when on."""

    ways: str
    signal: str
    size: float
    at: float = 0.0

    def __str__(self) -> str:
        return f"{self.ways}: {self.signal} differs by {self.size:.3g} at t = {self.at:g} s"


def options(made: Drawn, backend: str = "", hold: str | None = None) -> dict[str, Any]:
    """Arguments of a run."""
    inputs = {k: tsm.Samples(H * np.arange(STEPS + 1), v, hold or how) for k, (how, v) in made.inputs.items()}
    return {
        "stop": STEPS * H,
        "step": H,
        "method": made.method,
        "inputs": inputs,
        "check_step": False,
        "backend": backend,
    }


def signals_of(run: Any, made: Drawn) -> dict[str, np.ndarray]:
    """All outputs of all blocks of a run of the flat diagram."""
    return {f"{n}.{p}": np.asarray(run[f"{n}.{p}"]) for n, b in made.blocks.items() for p in b.outports}


def differ(
    ways: str, one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], close: float, allowed: Any = None
) -> None:
    """Raise Disagreement where signals differ by more than a share of their size, and more than is ``allowed``."""
    for name, expected in other.items():
        found = np.asarray(one[name], dtype=float)
        size = close * (1.0 + np.abs(expected).max())
        bound = size if allowed is None else np.maximum(size, allowed[name])
        wrong = np.flatnonzero(~(np.abs(found - expected) <= bound))
        if len(wrong):
            k = wrong[0]
            raise Disagreement(ways, name, float(np.abs(found[k] - expected[k])), k * H)


WAYS = ("casadi", "nested", "batch", "stepper")
"""Ways that a diagram is run in beside the machine code of a single run, the file and the reference."""


def check(made: Drawn, ways: Collection[str] = WAYS) -> str:
    """Compare ways; what was not compared, or "". Raises Disagreement, or any error that is no refusal.

    A further way is ``"C"``, which needs gcc.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diagram = as_diagram(made)
        try:
            run = tsm.simulate(diagram, **options(made))
        except TsmError as error:
            return f"refused: {type(error).__name__}: {str(error)[:200]}" if _refused(made, error) else ""
        found = signals_of(run, made)
        if max(np.abs(v).max() for v in found.values()) > HUGE:
            return "huge"
        left = _against_reference(made, found)
        _against_others(made, diagram, found, ways)
        return left


def _refused(made: Drawn, error: TsmError) -> bool:
    """Whether a refusal is right as far as the reference can say. Raises Disagreement where it runs to the end."""
    if not isinstance(error, tsm.errors.NotFinite):
        return True
    try:
        expected = _expected(made)
    except (NoTest, OverflowError, ZeroDivisionError, ValueError, np.linalg.LinAlgError):
        return True
    if all(np.abs(v).max() < HUGE for v in expected.values()):  # of none is it NaN
        raise Disagreement("reference against a run that is not finite", str(error)[:200], np.inf)
    return True


def _expected(made: Drawn, noise: float = 0.0, seed: int = 0) -> dict[str, np.ndarray]:
    inputs = {k: SampledSignal.of(v, how, H) for k, (how, v) in made.inputs.items()}
    made_ = reference_run(made.flat(), H, STEPS, inputs, made.method, noise, seed)
    return {".".join(key): v for key, v in made_.items()}


def _against_reference(made: Drawn, found: dict[str, np.ndarray]) -> str:
    try:
        expected = _expected(made)
        close = IMPLICIT_CLOSE if made.method in IMPLICIT else CLOSE
        try:
            differ("run against reference", found, expected, close)
        except Disagreement:
            differ("run against reference", found, expected, close, _spread(made, expected))
            return "sensitive"
        if made.smooth and not made.inputs and made.method == "rk4":
            _against_scipy(made)
    except NoTest as reason:
        return f"no reference: {reason}"
    except (OverflowError, ZeroDivisionError):
        return "no reference: not finite"
    return ""


def _spread(made: Drawn, expected: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By how much rounding moves each signal up to each instant, with a margin."""
    spread = {name: np.zeros(len(v)) for name, v in expected.items()}
    for seed in range(4):
        for name, moved in _expected(made, NOISE, seed).items():
            spread[name] = np.maximum(spread[name], np.abs(moved - expected[name]))
    return {name: AMPLIFIED * np.maximum.accumulate(v) for name, v in spread.items()}


def _against_scipy(made: Drawn) -> None:
    inputs = {k: SampledSignal.of(v, how, H) for k, (how, v) in made.inputs.items()}
    expected = {".".join(key): v for key, v in smooth_run(made.flat(), H, STEPS, inputs).items()}
    fine = options(made) | {"step": H / SMOOTH_REFINED, "every": SMOOTH_REFINED}
    differ("rk4 against SciPy", signals_of(tsm.simulate(as_diagram(made), **fine), made), expected, SMOOTH_CLOSE)


# ---- the ways there are, against each other


def _against_others(made: Drawn, diagram: Any, found: dict[str, np.ndarray], ways: Collection[str]) -> None:
    close = IMPLICIT_CLOSE if made.method in IMPLICIT else CLOSE

    def compare(
        ways: str,
        other: Callable[[], Mapping[str, np.ndarray]],
        expected: Mapping[str, np.ndarray] = found,
        close: float = close,
    ) -> None:
        """Compare with another way, unless rounding is amplified."""
        given = other()
        try:
            differ(ways, given, expected, close)
        except Disagreement:
            if not _is_sensitive(made, diagram, given, expected, close):
                raise

    if "casadi" in ways:
        compare("casadi against llvm", lambda: signals_of(tsm.simulate(diagram, **options(made, "casadi")), made))
    again = loads(dumps(diagram))
    if again != diagram or dumps(again) != dumps(diagram):
        raise Disagreement("file", "the diagram", np.inf)
    compare("file against diagram", lambda: signals_of(tsm.simulate(again, **options(made)), made), close=FILE_CLOSE)
    if "nested" in ways:
        shown = {f"{n}.{p}": np.asarray(v) for (n, p), v in _nested_signals(made, nested(made)).items()}
        compare("nested against flat", lambda: shown, {k: found[k] for k in shown})
    if "batch" in ways:
        _batch(made, diagram, compare)
    if "stepper" in ways or "C" in ways:
        _by_step(made, diagram, compare, "C" in ways)


def _is_sensitive(made: Drawn, diagram: Any, given: Any, expected: Any, close: float) -> bool:
    """Whether the difference is no more than what rounding makes, in the reference."""
    try:
        allowed = _spread(made, _expected(made))
        named = {k: v for k, v in allowed.items() if k in expected}
        outputs = {name: allowed[diagram_signal(diagram, name)] for name in expected if name not in allowed}
        differ("", given, expected, close, named | outputs)
    except (NoTest, OverflowError, ZeroDivisionError):
        return False
    except Disagreement:
        return False
    return True


def diagram_signal(diagram: Any, output: str) -> str:
    """The signal that an output of a diagram is."""
    return ".".join(diagram.shown[output])


def _nested_signals(made: Drawn, inside: Any) -> dict[tuple[str, str], np.ndarray]:
    """Signals of the nested diagram by the names that they have in the flat one."""
    run = tsm.simulate(inside, **options(made))
    by_end = {name.split(".")[-2]: name.rsplit(".", 1)[0] for name in run.names if "." in name}
    return {(n, p): run[f"{by_end[n]}.{p}"] for n, b in made.blocks.items() for p in b.outports}


def _batch(made: Drawn, diagram: Any, compare: Callable[..., None]) -> None:
    """Sets side by side: the first is the run itself, another is a run with that parameter."""
    names = [f"{n}.gain" for n, b in made.blocks.items() if type(b).__name__ == "Gain"][:2]
    if not names:
        return
    values = {name: diagram.parameters[name] * np.array([1.0, 0.9, 1.05]) for name in names}
    given = {k: v for k, v in options(made).items() if k != "check_step"}
    for k in (0, 2):
        changed = {name: float(v[k]) for name, v in values.items()}
        try:
            batch = tsm.simulate_batch(diagram, values, **given)
            run = tsm.simulate(diagram, parameters=changed, **options(made))
        except tsm.errors.NotFinite:
            return  # of another set than that of the run
        expected = {name: np.asarray(run[name]) for name in diagram.outputs}
        if max(np.abs(v).max() for v in expected.values()) > HUGE:
            return
        compare(
            "batch against run", lambda k=k, batch=batch: {name: batch[name][k] for name in diagram.outputs}, expected
        )


def _by_step(made: Drawn, diagram: Any, compare: Callable[..., None], c_code: bool) -> None:
    """Stepper, and C code: inputs are held over each step."""
    twice = np.arange(STEPS + 1) // 2 * 2  # so that inputs are the same at both ends of every other step
    made = attrs.evolve(made, inputs={k: (how, v[twice]) for k, (how, v) in made.inputs.items()})
    try:
        run = tsm.simulate(diagram, **options(made, hold="zero"))
        stepper = tsm.Stepper(diagram, step=H, method=made.method)
    except TsmError:
        return  # the rate of an input, or a recorded signal, is needed
    expected = {name: np.asarray(run[name]) for name in diagram.outputs}
    if max(np.abs(v).max() for v in expected.values()) > HUGE:
        return
    rows = [{name: float(v[k]) for name, (_, v) in made.inputs.items()} for k in range(STEPS + 1)]
    stepped = [stepper.step(row) for row in rows][:STEPS:2]
    ends = {name: v[1 : STEPS + 1 : 2] for name, v in expected.items()}
    compare("stepper against run", lambda: {name: np.array([one[name] for one in stepped]) for name in ends}, ends)
    if c_code:
        compare("C against run", lambda: _c_signals(made, diagram, rows), expected)


MAIN = """
#include <stdio.h>
#include "controller.h"
int main(void)
{
    controller c; controller_inputs u; controller_outputs y; long k; int i;
    controller_init(&c);
    for (k = 0; k < STEPS; k++) {
        for (i = 0; i < INPUTS; i++) { if (scanf("%lf", (double *)&u + i) != 1) { return 1; } }
        controller_step(&c, &u, &y);
        for (i = 0; i < OUTPUTS; i++) { printf("%.17g ", *((double *)&y + i)); }
        printf("\\n");
    }
    return 0;
}
"""


def _c_signals(made: Drawn, diagram: Any, rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Outputs of the C code."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        to_c(diagram, step=H, method=made.method).save(folder)
        counts = {"STEPS": len(rows), "INPUTS": len(made.inputs), "OUTPUTS": len(diagram.outputs)}
        text = MAIN
        for key, count in counts.items():
            text = text.replace(key, str(count))
        (folder / "main.c").write_text(text)
        command = [
            "gcc",
            "-std=c99",
            "-O0",
            "-ffp-contract=off",
            "-Wall",
            "-Werror",
            "controller.c",
            "main.c",
            "-lm",
            "-o",
            "run",
        ]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        given = "\n".join(" ".join(f"{v:.17g}" for v in row.values()) for row in rows)
        out = subprocess.run([str(folder / "run")], input=given, capture_output=True, text=True, check=True).stdout
    values = np.array([line.split() for line in out.splitlines()], dtype=float)
    return {name: values[:, k] for k, name in enumerate(diagram.outputs)}


# ---- what is reported


def shrunk(made: Drawn, fails: Callable[[Drawn], bool]) -> Drawn:
    """The diagram without every block that it does not need to fail."""
    again = True
    while again:
        again = False
        for name in list(made.blocks):
            less = made.without(name)
            if less is not None and fails(less):
                made, again = less, True
    return made
