"""Linear blocks of any order: transfer function, zero-pole-gain, state space, and systems of python-control."""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import Any

import numpy as np

from tsmblocks.blocks import linear_systems as systems
from tsmblocks.blocks.discrete import DiscreteStateSpace, DiscreteTransferFunction
from tsmblocks.blocks.shared import UNIT, UNIT_IN
from tsmblocks.common.errors import BlockError, ParameterError, in_words
from tsmblocks.common.headings import heading, split_heading
from tsmblocks.common.tables import unique_names
from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter


@block
class TransferFunction(Block):
    r"""Transfer function given by its coefficients, highest power of s first.

    .. math:: \frac{Y(s)}{U(s)} = \frac{b_0 s^m + \dots + b_m}{a_0 s^n + \dots + a_n}

    Controllable canonical form: ``x1`` is the highest derivative kept, each further state its
    integral. With a numerator shorter than the denominator there is no direct feedthrough.
    """

    source = "Åström and Murray, Feedback Systems, section 7.2 (reachable canonical form)"
    symbol = "b(s)/a(s)"
    symbol_with_values = "({num:s})/({den:s})"

    num: tuple[float, ...] = parameter(default=(1.0,), about="numerator")
    den: tuple[float, ...] = parameter(default=(1.0,), about="denominator; its length sets the order")
    x0: tuple[float, ...] = parameter(default=(), about="initial states; an empty list means zeros", initial=True)
    unit: str = option(default="", about=UNIT)
    unit_in: str = option(default="", about=UNIT_IN)

    u = Input("any signal", unit="?u", unit_option="unit_in")
    y = Output("filtered signal", unit="?y", unit_option="unit")

    check = systems.check_fraction
    derivatives = systems.fraction_states
    outputs = systems.fraction_output

    @property
    def states(self) -> dict[str, State]:
        return systems.initial_states(self.x0, len(self.den) - 1, "canonical state")


def _quadratic(pair: Any) -> tuple[Any, ...]:
    """Coefficients of (s - z)(s - z*) for z = re + j im."""
    re, im = pair
    return (1.0, -2 * re, re * re + im * im)


def _linear(*roots: Any) -> tuple[Any, ...]:
    """Coefficients of the product of (s - z) over at most two real roots."""
    return (1.0, -(roots[0] + roots[1]), roots[0] * roots[1]) if len(roots) == 2 else (1.0, *(-z for z in roots))


@block
class ZeroPoleGain(Block):
    r"""Transfer function given by its zeros, poles and gain.

    .. math::

        \frac{Y(s)}{U(s)} = k\, \frac{\prod (s - z_i) \prod \left((s - a_j)^2 + b_j^2\right)}
        {\prod (s - p_i) \prod \left((s - c_j)^2 + d_j^2\right)}

    A conjugate pair is written as a row (real part, imaginary part). The block is a chain of
    sections of first and second order, so that no polynomial is ever multiplied out. Without zeros and poles it is a
    gain.
    """

    source = "Åström and Murray, Feedback Systems, section 9.2 (zeros and poles)"
    symbol = "zpk"

    zeros: tuple[float, ...] = parameter(default=(), about="real zeros; pairs are zero_pairs", unit="rad/s")
    poles: tuple[float, ...] = parameter(default=(), about="real poles; pairs are pole_pairs", unit="rad/s")
    zero_pairs: systems.Rows = parameter(default=(), about="conjugate zeros, as rows (re, im)", unit="rad/s")
    pole_pairs: systems.Rows = parameter(default=(), about="conjugate poles, likewise", unit="rad/s")
    gain: float = parameter(default=1.0, about="factor in front of the fraction")
    x0: tuple[float, ...] = parameter(default=(), about="initial states; an empty list means zeros", initial=True)
    unit: str = option(default="", about=UNIT)
    unit_in: str = option(default="", about=UNIT_IN)

    u = Input("any signal", unit="?u", unit_option="unit_in")
    y = Output("filtered signal", unit="?y", unit_option="unit")

    def check(self) -> None:
        for name in ("zero_pairs", "pole_pairs"):
            for k, row in enumerate(getattr(self, name)):
                if not isinstance(row, tuple) or len(row) != 2:
                    field = f"ZeroPoleGain.{name}[{k}]"
                    raise ParameterError(f"{field} must be a real and an imaginary part, got {in_words(row)}.")
        zeros, poles = len(self.zeros) + 2 * len(self.zero_pairs), self._order()
        if zeros > poles:
            counts = f"{zeros} zeros and {poles} poles"
            raise ParameterError(f"ZeroPoleGain must be proper: no more zeros than poles, got {counts}.")
        systems.check_initial("ZeroPoleGain", self.x0, poles)

    def _order(self) -> int:
        return len(self.poles) + 2 * len(self.pole_pairs)

    @property
    def states(self) -> dict[str, State]:
        return systems.initial_states(self.x0, self._order(), "state of the chain,")

    def _sections(self) -> list[tuple[Any, Any]]:
        """Numerator and denominator of each section; real poles pair up where a pair of zeros needs it."""
        over, real = [_quadratic(pair) for pair in self.zero_pairs], list(self.zeros)
        under, single = [_quadratic(pair) for pair in self.pole_pairs], list(self.poles)
        while len(under) < len(over):
            under.append(_linear(single.pop(), single.pop()))
        sections = []
        for num, den in zip_longest(over, [*under, *(_linear(p) for p in single)]):
            taken, real = ([], real) if num else (real[: len(den) - 1], real[len(den) - 1 :])
            sections.append((num or _linear(*taken), den))
        return sections

    def _chain(self, x: Any, u: Any) -> tuple[list[Any], Any]:
        """Rates of the states and the output."""
        rates, signal, left = list[Any](), self.gain * u.u, list(x)
        for num, den in self._sections():
            own, left = left[: len(den) - 1], left[len(den) - 1 :]
            moved, signal = systems.section(num, den, own, signal)
            rates += moved
        return rates, signal

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(zip(x._fields, self._chain(x, u)[0], strict=True))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._chain(x, u)[1])


@block
class StateSpace(Block):
    r"""State-space model given by its matrices, with any number of inputs and outputs.

    .. math:: \dot x = A x + B u, \qquad y = C x + D u

    Ports are ``u`` and ``y`` where there is one, ``u1``, ``u2``, … where there are more, unless they have names of
    their own, such as ``"motor [V]"``. Without D there is no direct feedthrough. Without any matrix the signal passes
    unchanged.
    """

    source = "Åström and Murray, Feedback Systems, section 3.2"
    symbol = "A,B,C,D"

    A: systems.Rows = parameter(default=(), about="state matrix, as rows")
    B: systems.Rows = parameter(default=(), about="input matrix, as rows")
    C: systems.Rows = parameter(default=(), about="output matrix, as rows")
    D: systems.Rows = parameter(default=(), about="direct matrix, as rows; an empty list means none")
    x0: tuple[float, ...] = parameter(default=(), about="initial states; an empty list means zeros", initial=True)
    input_names: tuple[str, ...] = systems.names_of("inputs", "u, or u1, u2, …")
    output_names: tuple[str, ...] = systems.names_of("outputs", "y, or y1, y2, …")
    state_names: tuple[str, ...] = systems.names_of("states", "x1, x2, …")

    check = systems.check_matrices
    inports = systems.matrix_inputs
    outports = systems.matrix_outputs
    states = systems.matrix_states
    derivatives = systems.state_equation
    outputs = systems.output_equation


# ---- systems of python-control ----------------------------------------------------------------


def from_control(system: Any) -> Block:
    """Return a linear system of python-control as a block.

    A system with a sample time (``dt`` > 0) becomes a sampled block with that period. Names of inputs, outputs and
    states are kept, and units where they are given in brackets: ``control.ss(A, B, C, D, inputs="u [V]",
    outputs=["angle [rad]", "speed [rad/s]"])``. A transfer function keeps its ports ``u`` and ``y`` and takes the
    units. Characters other than letters and digits become underscores, and a second ``x`` becomes ``x_2``.

    Parameters
    ----------
    system : control.TransferFunction or control.StateSpace
        The system; a zpk model of python-control is a transfer function.

    Returns
    -------
    Block
        ``TransferFunction``, ``StateSpace``, ``DiscreteTransferFunction`` or ``DiscreteStateSpace``.

    Raises
    ------
    BlockError
        For anything else, for ``dt=True``, and for a transfer function that is not proper.
    ParameterError
        For an unknown unit.

    Examples
    --------
    >>> import control
    >>> import tsmblocks as tsm
    >>> tsm.from_control(control.tf([1.0], [0.1, 1.0]))
    TransferFunction(num=(1.0,), den=(0.1, 1.0), x0=(), unit='', unit_in='')
    """
    import control

    if not isinstance(system, (control.TransferFunction, control.StateSpace)):
        got = type(system).__name__
        raise BlockError(f"from_control takes a TransferFunction or StateSpace of python-control, got {got}.")
    if system.dt is True:
        raise BlockError(
            "from_control needs the sample time, but this system has dt=True (sampled, period unknown). "
            "Build it with its period in s, such as control.tf(num, den, 0.01)."
        )
    fraction = isinstance(system, control.TransferFunction)
    fields = _fields_of_fraction(system) if fraction else _fields_of_matrices(system)
    if system.dt:
        return (DiscreteTransferFunction if fraction else DiscreteStateSpace)(period=float(system.dt), **fields)
    return (TransferFunction if fraction else StateSpace)(**fields)


def _fields_of_fraction(system: Any) -> dict[str, Any]:
    if (system.ninputs, system.noutputs) != (1, 1):
        raise BlockError(
            f"from_control takes a transfer function with one input and one output, got {system.ninputs} "
            f"and {system.noutputs}. Give it as a state space, such as control.ss(system)."
        )
    # Leading zeros would count as a direct path.
    num, den = (tuple(np.trim_zeros(part[0][0], "f").tolist()) or (0.0,) for part in (system.num, system.den))
    if len(num) > len(den):
        raise BlockError(
            f"from_control needs a proper transfer function, got a numerator of degree {len(num) - 1} over a "
            f"denominator of degree {len(den) - 1}. Add a fast pole."
        )
    unit_in, unit = (_heading(labels[0])[1] for labels in (system.input_labels, system.output_labels))
    return dict(num=num, den=den, unit=unit, unit_in=unit_in)


def _fields_of_matrices(system: Any) -> dict[str, Any]:
    matrices = {name: tuple(map(tuple, getattr(system, name).tolist())) for name in "ABCD"}
    if not system.D.any() and matrices["A"]:
        matrices["D"] = ()
    return matrices | _names(system)


def _heading(label: str) -> tuple[str, str]:
    """Name and unit of a label of python-control; no name where python-control generated the label."""
    if re.fullmatch(r"[uyx]\[\d+\]", label):
        return "", ""
    text, unit = split_heading(label)
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    return name if name and not name[0].isdigit() else f"s_{name}", unit


def _names(system: Any) -> dict[str, Any]:
    """Names of inputs, outputs and states from the labels of python-control, where it did not generate them.

    python-control allows a state and an output of the same name; here these would be one signal, so the state gets a
    number.
    """
    kinds = ("input", "output", "state")
    found = {f"{kind}_names": [_heading(label) for label in getattr(system, f"{kind}_labels")] for kind in kinds}
    found = {field: own for field, own in found.items() if all(name for name, _ in own)}
    names = iter(unique_names(name for own in found.values() for name, _ in own))
    return {field: tuple(heading(next(names), unit) for _, unit in own) for field, own in found.items()}
