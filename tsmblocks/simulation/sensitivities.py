"""Exact derivatives of a run with respect to parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.engine.sensitivities import Sensitivities, tangent_memory
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions, as_diagram, kept_columns, run_to_their_end
from tsmblocks.simulation.batch_parameters import parameter_index
from tsmblocks.simulation.compiled import SOLVE, equations, for_run, parameter_vector
from tsmblocks.simulation.lanes import directions, lane_columns, tangent_kernel, whole_run


def sensitivities(
    diagram: Diagram,
    names: Sequence[str],
    *,
    outputs: Sequence[str] | None = None,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: Hold = AUTO,
    every: int = 1,
    backend: str = "",
    loops: str = SOLVE,
) -> Sensitivities:
    """Signals of a run and their exact derivatives with respect to parameters and initial states.

    At a kink (a sign, an absolute value, a limit) the derivative is one-sided.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    names : list of str
        Parameters, initial states among them.
    outputs : list of str, optional
        Signals. By default the outputs of the diagram.
    stop, step, start, method, inputs, hold : optional
        As for ``simulate``.
    every, backend, loops : optional
        As for ``simulate``.

    Returns
    -------
    Sensitivities
        Instants ``t`` (N,), signals ``y`` (N, signals) and ``jacobian`` (N, signals, parameters), in the units of the
        signals per unit of the parameters.

    Raises
    ------
    ParameterError
        For an unknown parameter, or none.
    RunError, DataError
        As for ``simulate``.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> motor = tsm.load("motor_linear")
    >>> made = tsm.sensitivities(motor, ["motor.K", "motor.angle"], stop=1.0, inputs={"u": 12.0})
    >>> made.jacobian[-1].round(3).tolist()
    [[11.76, 1.0]]
    """
    options = RunOptions(stop, step, start, method, inputs, hold, every, backend, loops)
    return sensitivities_of(diagram, as_list(names), options, outputs)


def sensitivities_of(
    diagram: Diagram, names: Sequence[str], options: RunOptions, outputs: Sequence[str] | None = None
) -> Sensitivities:
    """As ``sensitivities``, with the options of the run as one value."""
    if not names:
        raise ParameterError(f"sensitivities of '{as_diagram(diagram).title}' need the name of a parameter at least.")
    diagram = as_diagram(diagram).untied(names)
    run_to_their_end(diagram, "a run with sensitivities")
    times, eq = options.times, equations(diagram, loops=options.loops)
    eq, signals = for_run(eq, diagram, options)
    base, known = parameter_vector(eq, diagram), [parameter_index(eq, name, diagram) for name in names]
    (shown, chosen, columns), lanes = kept_columns(eq, outputs), directions(len(known))
    kernel = tangent_kernel(eq, options.rule, chosen, lanes, options.backend)
    whole = whole_run(eq, kernel, signals, times)
    size = 8.0 * times.kept * len(shown) * len(known)
    refuse_too_large(size, f"the sensitivities at {times.kept:,} instants", "Keep fewer: every, outputs.", RunError)
    jacobian = np.empty((times.kept, len(shown), len(known)))
    for first in range(0, len(known), lanes):
        part = known[first : first + lanes]
        seeds = np.zeros((len(eq.p), lanes))
        seeds[part, range(len(part))] = 1.0
        y = whole(tangent_memory(eq, kernel, base, seeds, times.h))
        for i, column in enumerate(columns):
            wide = lane_columns(y, kernel, len(chosen) + column, lanes)
            jacobian[:, i, first : first + len(part)] = wide[:, : len(part)]
    values = np.column_stack([y[:, kernel.layout_y.offset[c]] for c in columns])
    return Sensitivities(times.kept_instants, values, jacobian, tuple(shown), tuple(names))
