"""A diagram as C99: ``init``, ``reset`` and ``step``, no allocation, nothing but math.h.

The source has the instructions that the engine compiles, so blocks declare nothing for it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from pathlib import Path

import attrs
import numpy as np

from tsmblocks.common.arguments import as_positive
from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.displayed_units import times
from tsmblocks.common.errors import ParameterError, RunError, in_words
from tsmblocks.common.version import __version__
from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES, Equations
from tsmblocks.engine.implicit import step_of
from tsmblocks.engine.kernel_frame import JUMP_OFFSETS, time_jumps
from tsmblocks.engine.loops import solved_loops
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.program import Program
from tsmblocks.engine.session import check_delays, steps_per_period
from tsmblocks.export.loops import solver_functions
from tsmblocks.export.operations import LIMITS, c_double, statements
from tsmblocks.export.pieces import HEADER, PAST, RESERVED, SPARE, comment, identifiers, used
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import SOLVE, equations, parameter_vector, with_held
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


def to_c(diagram: Diagram, *, step: float, method: str = "rk4", name: str = "controller", loops: str = SOLVE) -> Code:
    """Write a diagram as C99 that takes one fixed step at each call.

    ``NAME_init(&c)`` sets the initial state and the parameters, which are then in ``c.p`` and may be changed;
    ``NAME_reset(&c)`` goes back to the start with the initial states that are in ``c.p``.
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
        Integration method: "euler", "heun", "rk4", or for stiff diagrams "sdirk2", "sdirk3", "sdirk4".
    name : str, default "controller"
        Prefix of the functions and name of the files: letters, digits and underscores.
    loops : {"solve", "refuse"}
        Solve algebraic loops, or raise AlgebraicLoop for one. An output of a loop without a solution is NaN.

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
    eq = equations(diagram, loops=loops)
    for feed in eq.u:
        if feed.block:
            raise RunError(
                f"diagram '{eq.title}' cannot be written in C: {feed.block} generates its signal for a whole run at "
                "once. Give this signal as an input instead."
            )
    eq = with_held(eq, diagram, diagram.inports)
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
        step = step_of(eq, method) if method.implicit and eq.x else None
        self.advance = Program(step.plain) if step is not None else None
        self.loops = [*solved_loops(eq.loops), *(step.loops if step is not None else ())]
        places = itertools.accumulate((loop.size for loop in self.loops), initial=0)
        self.solvers = {k: (f"{name}_loop_{k}", first) for k, first in enumerate(places)}
        self.rhs = Program(eq.plain[0])
        self.jumps = time_jumps(self.rhs)
        inputs = [f.name.removeprefix("d/dt " * f.order) + "_dot" * f.order for f in eq.u]
        self.u, self.p = identifiers(inputs), identifiers(eq.p)
        self.y = identifiers(eq.aliases)
        self.given = (
            f"const {name}_parameters *p, double t, const double *x, const double *d, const {name}_inputs *u, "
            f"const double *q{', double *loops' if self.loops else ''}"
        )

    def code(self) -> Code:
        """Header and source."""
        return Code(self.name, self._header(), "\n".join([*self._source(), ""]))

    def _header(self) -> str:
        eq = self.eq
        return HEADER.format(
            title=comment(eq.title),
            h=self.h,
            method=self.method.name,
            version=__version__,
            guard=f"{self.name.upper()}_H",
            n=self.name,
            inputs=_fields(self.u, [times(f.unit, "s", -1) if f.order else f.unit for f in eq.u]),
            outputs=_fields(self.y, [eq.units.get(signal, "") for signal in eq.aliases.values()]),
            parameters=_fields(self.p, [""] * len(self.p)),
            states=f"x[{max(len(eq.x), 1)}];  /* states: {comment(', '.join(eq.x)) or 'none'} */",
            memory=f"d[{max(len(eq.d), 1)}];  /* memory: {comment(', '.join(eq.d)) or 'none'} */",
            loops=f"    double loops[{sum(one.size for one in self.loops)}];  /* solutions of algebraic loops */\n"
            if self.loops
            else "",
            past=f"    double past[{len(eq.q)}][{self.room}];  /* of delayed signals */\n" if eq.q else "",
        )

    # ---- source

    def _source(self) -> Iterator[str]:
        parts = (self._init, self._update, self._past, self._signals, self._rates, self._step)
        body = [line for part in parts for line in part()]
        body = [*self._solvers("\n".join(body)), *body]
        yield from [f'#include "{self.name}.h"', "", "#include <math.h>", ""]
        text = "\n".join(body)
        limits = [limit for name, limit in LIMITS.items() if f"{name}(" in text]
        if limits:
            yield from ["/* Limits that keep NaN. */", "\n".join(limits)]
        yield from body

    def _solvers(self, text: str) -> Iterator[str]:
        """Functions of the loops that the text solves: what is shown may depend on none of a loop's signals."""
        yield from solver_functions(self.name, self.loops, text)

    def _place(self, program: Program) -> Callable[[int, int], str]:
        """The expression in C of each input of a program."""

        def place(slot: int, index: int) -> str:
            kind = program.inputs[slot]
            if program is self.advance and kind in ("t", "h", "u"):  # several instants, of the same inputs
                return (
                    f"t[{index}]"
                    if kind == "t"
                    else c_double(self.h)
                    if kind == "h"
                    else f"u->{self.u[index % len(self.u)]}"
                )
            named = {"p": self.p, "u": self.u}.get(kind)
            return f"{kind}->{named[index]}" if named else "t" if kind == "t" else f"{kind}[{index}]"

        return place

    def _function(self, head: str, program: Program, stored: Mapping[str, tuple[int, int]]) -> Iterator[str]:
        """A function that stores outputs of a program: target of the assignment -> (slot, index)."""
        goals = {target: program.outputs[place] for target, place in stored.items() if place in program.outputs}
        lines = statements(program, goals, self._place(program), self.solvers)
        lines += [f"    {target} = 0.0;" for target in stored if target not in goals]
        arguments, text = re.findall(r"(\w+)[,)]", head), "\n".join(lines)
        yield from [f"static void {head}", "{"]
        yield from (f"    (void){name};" for name in arguments if not used(name, text))
        yield from [*lines, "}", ""]

    def _init(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        starts = bool(eq.x or eq.d or eq.q)
        if starts:
            stored = {**_array("x", 0, eq.x), **_array("d", 1, eq.d), **_array("s", 2, eq.q)}
            head = f"{n}_start(const {n}_parameters *p, double *x, double *d, double *s)"
            yield from self._function(head, Program(eq.start), stored)
        yield from ["/* Back to the start, with the initial states that are in c->p. */"]
        yield from [f"void {n}_reset({n} *c)", "{"]
        if eq.q:
            yield from [f"    double s[{len(eq.q)}];", "    int i;", "    int j;"]
        for kind, elements in (("x", eq.x), ("d", eq.d)):
            if not elements:
                yield f"    c->{kind}[0] = 0.0;"
        if starts:
            yield f"    {n}_start(&c->p, c->x, c->d, {'s' if eq.q else '0'});"
        if eq.q:
            yield from _loop("i", len(eq.q), _loop("j", self.room, ["    c->past[i][j] = s[i];"]))
        yield from (f"    c->loops[{k}] = 0.0;" for k in range(sum(loop.size for loop in self.loops)))
        yield from ["    c->k = 0;", "}", "", f"void {n}_init({n} *c)", "{"]
        for name, value in zip(self.p, self.values, strict=True):
            yield f"    c->p.{name} = {c_double(float(value))};"
        if not self.p:
            yield "    c->p.none = 0;"
        yield from [f"    {n}_reset(c);", "}", ""]

    def _update(self) -> Iterator[str]:
        if self.eq.update is not None:
            stored = {**_array("dn", 0, self.eq.d), **_array("xn", 1, self.eq.x)}
            head = f"{self.name}_update({self.given}, const double *hit, double *dn, double *xn)"
            yield "/* Samples and memory after an instant. */"
            yield from self._function(head, Program(self.eq.plain[1]), stored)

    def _signals(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        shown = zip(self.y, eq.aliases.values(), strict=True)
        stored = {f"y->{name}": (1, eq.y.index(signal)) for name, signal in shown} | _array("s", 2, eq.q)
        yield "/* Outputs and signals to be delayed at an instant. */"
        yield from self._function(f"{n}_signals({self.given}, {n}_outputs *y, double *s)", self.rhs, stored)

    def _rates(self) -> Iterator[str]:
        if self.advance is not None:
            yield "/* States after a step. */"
            head = f"{self.name}_advance({self.given.replace('double t,', 'const double *t,')}, double *xn)"
            yield from self._function(head, self.advance, _array("xn", 0, self.eq.x))
        elif self.eq.x:
            yield "/* Derivatives of the states. */"
            head = f"{self.name}_rates({self.given}, double *dx)"
            yield from self._function(head, self.rhs, _array("dx", 0, self.eq.x))

    def _past(self) -> Iterator[str]:
        n, count = self.name, len(self.eq.q)
        if not count:
            return
        yield "/* Delays in s. */"
        head = f"{n}_delays(const {n}_parameters *p, double *tau)"
        yield from self._function(head, Program(self.eq.lag), _array("tau", 0, self.eq.q))
        h, room = c_double(self.h), self.room
        sizes = dict(kept=DELAY_SAMPLES, per=DELAY_NUMBERS, spare=SPARE)
        yield PAST.format(n=n, count=count, mask=room - 1, room=room, h=h, **sizes)

    def _step(self) -> Iterator[str]:
        n, eq = self.name, self.eq
        yield from [f"void {n}_step({n} *c, const {n}_inputs *u, {n}_outputs *y)", "{"]
        yield f"    const {n}_parameters *p = &c->p;"
        yield f"    const double t = (double)c->k * {c_double(self.h)};"
        if eq.x and self.advance is None:
            yield f"    double slope[{len(self.method.rows)}][{len(eq.x)}];"
        if eq.x:
            yield from [f"    double ahead[{len(eq.x)}];", "    int i;"]
        if eq.q:
            instants = len(self.method.instants) if self.advance is not None else 1
            yield from [f"    double q[{DELAY_NUMBERS * len(eq.q) * instants}];", f"    double s[{len(eq.q)}];"]
        past, stored = ("q", "s") if eq.q else ("0", "0")
        past += ", c->loops" if self.loops else ""
        yield from self._updated(past)
        if eq.q:
            yield f"    {n}_recall(c, 0.0, q);"
        yield f"    {n}_signals(p, t, c->x, c->d, u, {past}, y, {stored});"
        if eq.q:
            yield f"    {n}_keep(c, s);"
        yield from self._stages(past) if self.advance is None else self._implicit_step(past)
        yield from ["    c->k += 1;", "}"]

    def _updated(self, past: str) -> Iterator[str]:
        """Samples and memory are updated before any signal of an instant."""
        n, eq = self.name, self.eq
        if eq.update is None:
            return
        each = ", ".join(f"(double)(c->k % {steps} == 0)" for steps in self.hits) or "0.0"
        yield f"    const double hit[{max(len(self.hits), 1)}] = {{{each}}};"
        always = eq.every_step or not self.hits
        yield f"    if ({'1' if always else ' || '.join(f'hit[{k}] != 0.0' for k in range(len(self.hits)))}) {{"
        yield f"        double dn[{max(len(eq.d), 1)}];"
        yield from [f"        double xn[{max(len(eq.x), 1)}];", "        int j;"]
        if eq.q:
            yield f"        {n}_recall(c, 0.0, q);"
        yield f"        {n}_update(p, t, c->x, c->d, u, {past}, hit, dn, xn);"
        for kind, count in (("d", len(eq.d)), ("x", len(eq.x))):
            if count:
                yield from _indented(_loop("j", count, [f"    c->{kind}[j] = {kind}n[j];"]))
        if not eq.d and not eq.x:
            yield "        (void)j;"
        yield "    }"

    def _stages(self, past: str) -> Iterator[str]:
        """The step of the method, with the inputs held."""
        n, eq, method = self.name, self.eq, self.method
        if not eq.x:
            return
        for k, (row, offset) in enumerate(zip(method.rows, method.offsets, strict=True)):
            yield from _loop("i", len(eq.x), [f"    ahead[i] = {' + '.join(['c->x[i]', *self._slopes(row)])};"])
            if eq.q and k:
                yield f"    {n}_recall(c, {c_double(offset)}, q);"
            yield f"    {n}_rates(p, {self._time(offset)}, ahead, c->d, u, {past}, slope[{k}]);"
        yield from _loop("i", len(eq.x), [f"    c->x[i] += {' + '.join(self._slopes(method.weights))};"])

    def _implicit_step(self, past: str) -> Iterator[str]:
        """One step whose stages are solved, with the inputs held."""
        n, eq, instants = self.name, self.eq, self.method.instants
        yield f"    const double at[{len(instants)}] = {{{', '.join(map(self._time, instants))}}};"
        for k, offset in enumerate(instants):
            if eq.q:
                yield f"    {n}_recall(c, {c_double(offset)}, q + {DELAY_NUMBERS * len(eq.q) * k});"
        yield f"    {n}_advance(p, at, c->x, c->d, u, {past}, ahead);"
        yield from _loop("i", len(eq.x), ["    c->x[i] = ahead[i];"])

    def _slopes(self, weights: Iterable[float]) -> list[str]:
        """Terms of a weighted sum of the slopes of a step."""
        return [f"{c_double(self.h)} * {c_double(w)} * slope[{j}][i]" for j, w in enumerate(weights) if w]

    def _time(self, offset: float) -> str:
        if offset == 0:
            return "t"
        if offset == 1:
            end = f"(double)(c->k + 1) * {c_double(self.h)}"
            hair = f"{c_double(JUMP_OFFSETS[0] * self.h)} + {c_double(JUMP_OFFSETS[1])} * fabs({end})"
            return f"{end} - fmin({hair}, {c_double(JUMP_OFFSETS[2] * self.h)})" if self.jumps else end
        return f"t + {c_double(offset)} * {c_double(self.h)}"


def _fields(names: list[str], units: list[str]) -> str:
    """The members of a structure."""
    if not names:
        return "    char none;  /* C has no empty structure */"
    rows = zip(names, units, strict=True)
    return "\n".join(f"    double {name};{f'  /* [{comment(unit)}] */' if unit else ''}" for name, unit in rows)


def _indented(lines: Iterable[str]) -> Iterator[str]:
    return (f"    {line}" for line in lines)


def _loop(index: str, count: int, body: Iterable[str]) -> Iterator[str]:
    """A loop of C around indented lines."""
    yield f"    for ({index} = 0; {index} < {count}; {index}++) {{"
    yield from _indented(body)
    yield "    }"


def _array(name: str, slot: int, elements: Sized) -> dict[str, tuple[int, int]]:
    """Every element of an output as an element of an array."""
    return {f"{name}[{k}]": (slot, k) for k in range(len(elements))}
