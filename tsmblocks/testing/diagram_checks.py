"""Checks of a diagram: title and units, runs, reproducibility, and blocks without effect."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.files import dumps, loads
from tsmblocks.model.block import Samples, is_reference, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate
from tsmblocks.testing.promises import need
from tsmblocks.testing.suites import Suite

DIAGRAM_CHECKS = Suite()
POINTS = 401
"""Samples of an input that is not given. Chosen: smooth over some cycles."""
BACKENDS_APART = 1e-6
"""Share of a signal by which two backends may differ. Chosen: above rounding, where friction amplifies it."""


@attrs.frozen(eq=False)
class Bench:
    """A diagram and how it is run."""

    diagram: Diagram
    stop: float
    step: float
    inputs: Mapping[str, Any]

    def run(
        self, diagram: Diagram | None = None, inputs: Any = None, *, backend: str = "", check_step: bool = False
    ) -> Run:
        """A run, of this diagram with its inputs by default."""
        given, which = self.inputs if inputs is None else inputs, diagram or self.diagram
        options: dict[str, Any] = {"backend": backend, "check_step": check_step}
        return simulate(which, stop=self.stop, step=self.step, inputs=given, **options)

    @cached_property
    def usual(self) -> Run:
        """The run that others are compared with."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self.run()


def check_diagram(
    diagram: Diagram,
    *,
    stop: float = 2.0,
    step: float = 1e-3,
    inputs: Mapping[str, Any] | None = None,
    skip: Collection[str] = (),
) -> None:
    """Check a diagram of your own: names, units, files, runs, and blocks without effect.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    stop, step : float, default 2.0 and 1e-3
        End and step of the runs in s.
    inputs : dict of str to signal, optional
        Inputs as for ``simulate``; by default a smooth signal that begins at rest, between -1 and 1 in its unit.
    skip : list of str, default ()
        Names of checks that do not apply.

    Raises
    ------
    ChecksFailed
        Where checks fail; ``error.broken`` says what was wrong, by check.
    ParameterError
        For anything that is no diagram, and for the name of a check that there is not.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.testing import check_diagram
    >>> check_diagram(tsm.load("motor_linear"))
    """
    if not isinstance(diagram, Diagram):
        raise ParameterError(f"check_diagram takes a diagram, got {in_words(diagram)}.")
    t = np.linspace(0.0, stop, POINTS)
    wave = np.minimum(4.0 * t / stop, 1.0) ** 3 * (0.6 * np.sin(2.6 * t + 0.3) + 0.4 * np.sin(7.0 * t))
    given = {name: Samples(t, wave, "cubic") for name in diagram.inputs} | dict(inputs or {})
    DIAGRAM_CHECKS.run(f"diagram '{diagram.title}'", Bench(diagram, stop, step, given), skip)


@DIAGRAM_CHECKS.add
def says_what_it_is(bench: Bench) -> None:
    """It has a title and an output, and no output has the name of an input."""
    diagram = bench.diagram
    need(diagram.title.strip(), "it has no title.")
    need(diagram.outputs, "it has no outputs: no signal of it can be compared with a recording.")
    both = set(diagram.inputs) & set(diagram.outputs)
    need(
        not both, f"{', '.join(sorted(both))} is both an input and an output; in a recording they would be one signal."
    )


@DIAGRAM_CHECKS.add
def inputs_have_units(bench: Bench) -> None:
    """Every input has a unit, "1" for a pure number, so that recordings are converted to it."""
    bare = [name for name, port in bench.diagram.inports.items() if not port.unit]
    need(not bare, f"{', '.join(bare)} has no unit, so a recording in degrees is taken as it is.")


@DIAGRAM_CHECKS.add
def survives_a_file(bench: Bench) -> None:
    """Written to a file and read back it is the same, and runs the same."""
    again = loads(dumps(bench.diagram))
    need(again == bench.diagram, "it differs when it is read back.")
    need(dumps(again) == dumps(bench.diagram), "written again, its file differs.")
    need(_same(bench.run(again), bench.usual), "read back it gives other signals.")


@DIAGRAM_CHECKS.add
def runs_the_same_again(bench: Bench) -> None:
    """Two runs give the same signals, bit for bit."""
    need(_same(bench.run(), bench.usual), "two runs differ: a block holds a memory outside of its states.")


@DIAGRAM_CHECKS.add
def the_step_is_short_enough(bench: Bench) -> None:
    """No warning of the step: shorter steps give the same signals."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        bench.run(check_step=True)
    need(not heard, "; ".join(str(w.message) for w in heard))


@DIAGRAM_CHECKS.add
def backends_agree(bench: Bench) -> None:
    """Machine code and CasADi's evaluator give the same outputs."""
    other = bench.run(backend="casadi")
    for name in bench.diagram.outputs:
        size, away = np.abs(bench.usual[name]).max(), np.abs(other[name] - bench.usual[name]).max()
        need(away <= BACKENDS_APART * (size + 1e-12), f"{name} differs by {away:.3g} between backends, of {size:.3g}.")


@DIAGRAM_CHECKS.add
def every_input_matters(bench: Bench) -> None:
    """Each input changes an output."""
    for name in bench.diagram.inputs:
        moved = dict(bench.inputs)
        moved[name] = _larger(moved[name])
        changed = bench.run(inputs=moved)
        same = all(np.array_equal(changed[k], bench.usual[k]) for k in bench.diagram.outputs)
        need(not same, f"no output depends on the input '{name}'.")


@DIAGRAM_CHECKS.add
def outputs_move(bench: Bench) -> None:
    """No output is constant through the run."""
    for name in bench.diagram.outputs:
        need(np.ptp(bench.usual[name]) > 0, f"output '{name}' is {bench.usual[name][0]:g} at all times.")


@DIAGRAM_CHECKS.add
def nothing_is_idle(bench: Bench) -> None:
    """Every block reaches an output, and every number of ``values`` is used, in diagrams inside as well."""
    idle = list(_idle(bench.diagram, ""))
    need(not idle, f"{', '.join(idle)}: no output depends on it.")


def _idle(diagram: Diagram, prefix: str) -> Any:
    """Blocks that reach no output, and numbers that no block refers to."""
    driven: dict[str, set[str]] = {name: set() for name in diagram.blocks}
    for link in diagram.links:
        if link.source[0]:
            driven[link.target[0]].add(link.source[0])
    reached: set[str] = set()
    left = [end[0] for end in diagram.shown.values() if end[0]]
    left += [name for name, block in diagram.blocks.items() if not block.outports or _switches(block)]
    while left:
        name = left.pop()
        if name not in reached:
            reached.add(name)
            left += driven[name]
    yield from (f"{prefix}{name}" for name in diagram.blocks if name not in reached)
    used = {
        value[1:]
        for block in diagram.blocks.values()
        if not isinstance(block, Diagram)
        for given in block.parameters.values()
        for _, value in leaves(given)
        if is_reference(value)
    }
    yield from (f"{prefix}{name} of values" for name in diagram.values if name not in used)
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            yield from _idle(block, f"{prefix}{name}.")


def _switches(block: Any) -> bool:
    """Whether a block acts on the diagram that contains it."""
    return type(block).__name__ in ("Enable", "Trigger")


def _same(one: Run, other: Run) -> bool:
    return set(one.names) == set(other.names) and all(np.array_equal(one[k], other[k]) for k in one.names)


def _larger(given: Any) -> Any:
    """An input, changed everywhere."""
    if isinstance(given, Samples):
        return attrs.evolve(given, y=1.1 * np.asarray(given.y) + 0.01)
    if callable(given):
        return lambda t: 1.1 * np.asarray(given(t)) + 0.01
    if isinstance(given, tuple) and len(given) == 2:
        return given[0], 1.1 * np.asarray(given[1]) + 0.01
    return 1.1 * np.asarray(given) + 0.01
