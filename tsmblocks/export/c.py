"""A diagram as C99: ``init`` and ``step``, no allocation, nothing but math.h.

The source has the instructions that the engine compiles, so blocks declare nothing for it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sized
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_positive
from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import ParameterError, RunError, in_words
from tsmblocks.common.units import times
from tsmblocks.common.version import __version__
from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES, Equations
from tsmblocks.engine.kernel_frame import JUMP_OFFSETS, time_jumps
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.program import Program
from tsmblocks.engine.session import check_delays, steps_per_period
from tsmblocks.export.operations import GREATEST, LEAST, c_double, statements
from tsmblocks.export.pieces import PAST, RESERVED, SPARE, comment, identifiers, used
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.stability import RunStart, warn_of_fast_poles


@attrs.frozen
class Code:
    """A diagram in C: the texts of a header and of a source file.

    Parameters
    ----------
    name : str
        Name of the files without ending, and prefix of the functions.
    header : str
        Text of ``NAME.h``.
    source : str
        Text of ``NAME.c``.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> code = tsm.export.to_c(tsm.load("eq11_compensator"), step=1e-3, name="compensator")
    >>> code.header.splitlines()[2]
    '#ifndef COMPENSATOR_H'
    """

    name: str
    header: str = attrs.field(repr=False)
    source: str = attrs.field(repr=False)

    def save(self, folder: str | Path = ".") -> tuple[Path, Path]:
        """Write both files into a folder.

        Parameters
        ----------
        folder : str or pathlib.Path, default "."
            An existing folder.

        Returns
        -------
        tuple of pathlib.Path
            Paths of header and source.

        Raises
        ------
        OSError
            The files cannot be written.
        """
        paths = tuple(Path(folder) / f"{self.name}.{ending}" for ending in ("h", "c"))
        for path, text in zip(paths, (self.header, self.source), strict=True):
            replace_file(path, text)
        return paths[0], paths[1]


def to_c(diagram: Diagram, *, step: float, method: str = "rk4", name: str = "controller") -> Code:
    """Write a diagram as C99 that takes one fixed step at each call.

    ``NAME_init(&c)`` sets the initial state and the parameters, which are then in ``c.p`` and may be changed.
    ``NAME_step(&c, &u, &y)`` computes the outputs ``y`` for the inputs ``u`` of this instant, and takes one step with
    the inputs held: the same as ``simulate`` with ``hold="zero"``. Where the derivative of an input enters (an exact
    Derivative), it is another input, ``NAME_dot``. Nothing is allocated; only math.h is needed.

    Parameters
    ----------
    diagram : Diagram
        The diagram, with inputs and outputs.
    step : float
        Time step in s, positive.
    method : str, default "rk4"
        Integration method: "euler", "heun" or "rk4".
    name : str, default "controller"
        Prefix of the functions and name of the files: letters, digits and underscores.

    Returns
    -------
    Code
        Texts of header and source.

    Raises
    ------
    RunError
        The diagram has signals that are computed for a whole run (noise, recordings).
    ParameterError
        ``step`` or ``method`` is invalid, or ``name`` is no identifier of C.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.export.to_c(tsm.load("eq11_compensator"), step=1e-3, name="compensator")
    Code(name='compensator')
    """
    diagram, h = as_diagram(diagram), as_positive("step", step)
    if not isinstance(name, str) or not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", name) or name in RESERVED:
        raise ParameterError(
            f"a name in C has letters, digits and underscores, and is none of C's own; got {in_words(name)}."
        )
    eq = equations(diagram)
    for feed in eq.u:
        if feed.block:
            raise RunError(
                f"diagram '{eq.title}' cannot be written in C: {feed.block} is made for a whole run at "
                "once. Give its signal as an input instead."
            )
    rule, p = method_named(method), parameter_vector(eq, diagram)
    made = _Text(eq, p, h, rule, name).code()
    warn_of_fast_poles([RunStart(eq, p)], rule, h)
    return made


class _Text:
    """Header and source of one diagram."""

    def __init__(self, eq: Equations, p: np.ndarray, h: float, method: Method, name: str) -> None:
        self.eq, self.values, self.h, self.method, self.name = eq, p, h, method, name
        self.hits = steps_per_period(eq, h)
        tau = check_delays(eq, p, h)
        self.room = 1 << int(max(tau, default=0) + SPARE).bit_length()
        self.rhs = Program(eq.rhs)
        self.update = Program(eq.update) if eq.update is not None else None
        self.start = Program(eq.start)
        self.lag = Program(eq.lag) if eq.q else None
        self.jumps = time_jumps(self.rhs)
        inputs = [f.name.removeprefix("d/dt " * f.order) + "_dot" * f.order for f in eq.u]
        self.u, self.p = identifiers(inputs), identifiers(eq.p)
        self.y = identifiers(eq.aliases)

    def code(self) -> Code:
        """Header and source."""
        return Code(self.name, "\n".join([*self._header(), ""]), "\n".join([*self._source(), ""]))

    # ---- header

    def _header(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        guard = f"{n.upper()}_H"
        yield f"/* {comment(eq.title)}: one step of {self.h:g} s at a time ({self.method.name})."
        yield f"   Written by tsmblocks {__version__}. */"
        yield f"#ifndef {guard}"
        yield f"#define {guard}"
        yield ""
        yield "typedef struct {"
        yield from self._fields(self.u, [times(f.unit, "s", -1) if f.order else f.unit for f in eq.u])
        yield f"}} {n}_inputs;"
        yield ""
        yield "typedef struct {"
        yield from self._fields(self.y, [eq.units.get(signal, "") for signal in eq.aliases.values()])
        yield f"}} {n}_outputs;"
        yield ""
        yield "typedef struct {"
        yield from self._fields(self.p, [""] * len(self.p))
        yield f"}} {n}_parameters;"
        yield ""
        yield "typedef struct {"
        yield f"    {n}_parameters p;"
        yield f"    double x[{max(len(eq.x), 1)}];  /* states: {comment(', '.join(eq.x)) or 'none'} */"
        yield f"    double d[{max(len(eq.d), 1)}];  /* memory: {comment(', '.join(eq.d)) or 'none'} */"
        if eq.q:
            yield f"    double past[{len(eq.q)}][{self.room}];  /* of delayed signals */"
        yield "    long long k;  /* steps taken */"
        yield f"}} {n};"
        yield ""
        yield f"void {n}_init({n} *c);"
        yield f"void {n}_step({n} *c, const {n}_inputs *u, {n}_outputs *y);"
        yield ""
        yield f"#endif /* {guard} */"

    def _fields(self, names: list[str], units: list[str]) -> Iterator[str]:
        for name, unit in zip(names, units, strict=True):
            yield f"    double {name};{f'  /* [{comment(unit)}] */' if unit else ''}"
        if not names:
            yield "    char none;  /* C has no empty structure */"

    # ---- source

    def _source(self) -> Iterator[str]:
        n = self.name
        yield f'#include "{n}.h"'
        yield ""
        yield "#include <math.h>"
        yield ""
        body = [
            *self._init(),
            "",
            *self._update(),
            *self._past(),
            *self._signals(),
            "",
            *self._rates(),
            "",
            *self._step(),
        ]
        text = "\n".join(body)
        limits = [LEAST] * ("least(" in text) + [GREATEST] * ("greatest(" in text)
        if limits:
            yield "/* Limits that keep NaN. */"
            yield "\n".join(limits)
        yield from body

    def _place(self, program: Program) -> Any:
        """The expression in C of each input of a program."""
        plain = {"t": "t", "x": "x[{}]", "d": "d[{}]", "q": "q[{}]", "hit": "hit[{}]"}

        def place(slot: int, index: int) -> str:
            kind = program.inputs[slot]
            if kind == "p":
                return f"p->{self.p[index]}"
            if kind == "u":
                return f"u->{self.u[index]}"
            return plain[kind].format(index)

        return place

    def _function(
        self, head: str, program: Program, stored: Mapping[str, tuple[int, int]], unused: list[str]
    ) -> Iterator[str]:
        """A function that stores outputs of a program: target of the assignment -> (slot, index)."""
        goals = {target: program.outputs[place] for target, place in stored.items() if place in program.outputs}
        zero = [f"    {target} = 0.0;" for target in stored if target not in goals]
        lines = statements(program, goals, self._place(program))
        text = "\n".join(lines + zero)
        yield f"static void {head}"
        yield "{"
        yield from (f"    (void){name};" for name in unused if not used(name, text))
        yield from lines
        yield from zero
        yield "}"

    def _init(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        starts = bool(eq.x or eq.d or eq.q)
        if starts:
            stored = {**_array("x", 0, eq.x), **_array("d", 1, eq.d), **_array("s", 2, eq.q)}
            head = f"{n}_start(const {n}_parameters *p, double *x, double *d, double *s)"
            yield from self._function(head, self.start, stored, ["p", "x", "d", "s"])
            yield ""
        yield f"void {n}_init({n} *c)"
        yield "{"
        if eq.q:
            yield f"    double s[{len(eq.q)}];"
            yield "    int i;"
            yield "    int j;"
        for name, value in zip(self.p, self.values, strict=True):
            yield f"    c->p.{name} = {c_double(float(value))};"
        if not self.p:
            yield "    c->p.none = 0;"
        for k in range(not eq.x):
            yield f"    c->x[{k}] = 0.0;"
        for k in range(not eq.d):
            yield f"    c->d[{k}] = 0.0;"
        if starts:
            yield f"    {n}_start(&c->p, c->x, c->d, {'s' if eq.q else '0'});"
        if eq.q:
            yield f"    for (i = 0; i < {len(eq.q)}; i++) {{"
            yield f"        for (j = 0; j < {self.room}; j++) {{"
            yield "            c->past[i][j] = s[i];"
            yield "        }"
            yield "    }"
        yield "    c->k = 0;"
        yield "}"

    @property
    def _given(self) -> str:
        n = self.name
        return (
            f"const {n}_parameters *p, double t, const double *x, const double *d, const {n}_inputs *u, const double *q"
        )

    def _update(self) -> Iterator[str]:
        if self.update is None:
            return
        n, eq = self.name, self.eq
        stored = {**_array("dn", 0, eq.d), **_array("xn", 1, eq.x)}
        head = f"{n}_update({self._given}, const double *hit, double *dn, double *xn)"
        yield "/* Samples and memory after an instant. */"
        yield from self._function(head, self.update, stored, ["p", "t", "x", "d", "u", "q", "hit", "dn", "xn"])
        yield ""

    def _signals(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        shown = zip(self.y, eq.aliases.values(), strict=True)
        stored = {f"y->{name}": (1, eq.y.index(signal)) for name, signal in shown} | _array("s", 2, eq.q)
        head = f"{n}_signals({self._given}, {n}_outputs *y, double *s)"
        yield "/* Outputs and signals to be delayed at an instant. */"
        yield from self._function(head, self.rhs, stored, ["p", "t", "x", "d", "u", "q", "y", "s"])

    def _rates(self) -> Iterator[str]:
        if not self.eq.x:
            return
        head = f"{self.name}_rates({self._given}, double *dx)"
        yield "/* Derivatives of the states. */"
        yield from self._function(head, self.rhs, _array("dx", 0, self.eq.x), ["p", "t", "x", "d", "u", "q", "dx"])

    def _past(self) -> Iterator[str]:
        if self.lag is None:
            return
        n = self.name
        stored = _array("tau", 0, self.eq.q)
        yield "/* Delays in s. */"
        yield from self._function(f"{n}_delays(const {n}_parameters *p, double *tau)", self.lag, stored, ["p"])
        yield ""
        yield from PAST.format(
            n=n,
            kept=DELAY_SAMPLES,
            per=DELAY_NUMBERS,
            count=len(self.eq.q),
            mask=self.room - 1,
            room=self.room,
            h=c_double(self.h),
            spare=SPARE,
        ).split("\n")

    def _step(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        stages = len(self.method.rows)
        yield f"void {n}_step({n} *c, const {n}_inputs *u, {n}_outputs *y)"
        yield "{"
        yield f"    const {n}_parameters *p = &c->p;"
        yield f"    const double t = (double)c->k * {c_double(self.h)};"
        if eq.x:
            yield f"    double slope[{stages}][{len(eq.x)}];"
            yield f"    double ahead[{len(eq.x)}];"
            yield "    int i;"
        if eq.q:
            yield f"    double q[{DELAY_NUMBERS * len(eq.q)}];"
            yield f"    double s[{len(eq.q)}];"
        past = "q" if eq.q else "0"
        yield from self._act(past)
        if eq.q:
            yield f"    {n}_recall(c, 0.0, q);"
        yield f"    {n}_signals(p, t, c->x, c->d, u, {past}, y, {'s' if eq.q else '0'});"
        if eq.q:
            yield f"    {n}_keep(c, s);"
        yield from self._stages(past)
        yield "    c->k += 1;"
        yield "}"

    def _act(self, past: str) -> Iterator[str]:
        """Samples and memory are updated before any signal of an instant."""
        n, eq = self.name, self.eq
        if self.update is None:
            return
        each = ", ".join(f"(double)(c->k % {steps} == 0)" for steps in self.hits) or "0.0"
        yield f"    const double hit[{max(len(self.hits), 1)}] = {{{each}}};"
        always = eq.every_step or not self.hits
        when = "1" if always else " || ".join(f"hit[{k}] != 0.0" for k in range(len(self.hits)))
        yield f"    if ({when}) {{"
        yield f"        double dn[{max(len(eq.d), 1)}];"
        yield f"        double xn[{max(len(eq.x), 1)}];"
        yield "        int j;"
        if eq.q:
            yield f"        {n}_recall(c, 0.0, q);"
        yield f"        {n}_update(p, t, c->x, c->d, u, {past}, hit, dn, xn);"
        for kind, count in (("d", len(eq.d)), ("x", len(eq.x))):
            if count:
                yield f"        for (j = 0; j < {count}; j++) {{"
                yield f"            c->{kind}[j] = {kind}n[j];"
                yield "        }"
        if not eq.d and not eq.x:
            yield "        (void)j;"
        yield "    }"

    def _stages(self, past: str) -> Iterator[str]:
        """The step of the method, with the inputs held."""
        n, eq, method = self.name, self.eq, self.method
        if not eq.x:
            return
        for k, (row, offset) in enumerate(zip(method.rows, method.offsets, strict=True)):
            terms = [f"{c_double(self.h)} * {c_double(a)} * slope[{j}][i]" for j, a in enumerate(row) if a]
            yield f"    for (i = 0; i < {len(eq.x)}; i++) {{"
            yield f"        ahead[i] = {' + '.join(['c->x[i]', *terms])};"
            yield "    }"
            if eq.q and k:
                yield f"    {n}_recall(c, {c_double(offset)}, q);"
            yield f"    {n}_rates(p, {self._time(offset)}, ahead, c->d, u, {past}, slope[{k}]);"
        terms = [f"{c_double(self.h)} * {c_double(b)} * slope[{j}][i]" for j, b in enumerate(method.weights)]
        yield f"    for (i = 0; i < {len(eq.x)}; i++) {{"
        yield f"        c->x[i] += {' + '.join(terms)};"
        yield "    }"

    def _time(self, offset: float) -> str:
        if offset == 0:
            return "t"
        if offset == 1:
            end = f"(double)(c->k + 1) * {c_double(self.h)}"
            hair = f"{c_double(JUMP_OFFSETS[0] * self.h)} + {c_double(JUMP_OFFSETS[1])} * fabs({end})"
            return f"{end} - fmin({hair}, {c_double(JUMP_OFFSETS[2] * self.h)})" if self.jumps else end
        return f"t + {c_double(offset)} * {c_double(self.h)}"


def _array(name: str, slot: int, elements: Sized) -> dict[str, tuple[int, int]]:
    """Every element of an output as an element of an array."""
    return {f"{name}[{k}]": (slot, k) for k in range(len(elements))}
