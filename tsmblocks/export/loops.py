"""The solution of algebraic loops in C99: the method of ``engine.loops``, one pair of functions for each loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tsmblocks.engine.loops import (
    DECREASE,
    FINITE,
    FLOOR,
    LEAST_SHARE,
    MOST_ITERATIONS,
    STALLED,
    STARTS,
    TOLERANCE,
    Loop,
    start_value,
)
from tsmblocks.engine.program import Program
from tsmblocks.export.operations import c_double, statements
from tsmblocks.export.pieces import comment, used

SOLVER = """\
/* Solves the algebraic loop {path}
   by a damped Newton method, from the last solution and, where that fails, from other starts; NaN where all fail. */
static void {n}_loop_{number}(const double *w, double *root)
{{
    static const double starts[{starts}][{size}] = {{{values}}};
    double guess[{size}];
    double c[{size}];
    double z[{size}];
    double dz[{size}];
    double step[{size}];
    double merit = HUGE_VAL;
    double share = 1.0;
    int tries = 0;
    int start = 0;
    int i;
    for (i = 0; i < {size}; i++) {{
        guess[i] = (fabs(root[i]) < HUGE_VAL) ? root[i] : 0.0;
        c[i] = guess[i];
        z[i] = guess[i];
        dz[i] = 0.0;
    }}
    for (;;) {{
        int small;
        const double sum = {n}_correction_{number}(c, w, step, &small);
        const double least = {least_step};
        for (i = 0; i < {size}; i++) {{
            small = small && fabs(step[i]) <= {tolerance} * (fabs(c[i]) + fabs(guess[i])) + least;
        }}
        if (small) {{
            for (i = 0; i < {size}; i++) {{
                root[i] = c[i] + step[i];
            }}
            return;
        }}
        if (sum <= (1.0 - {decrease} * share) * merit && sum < {finite}) {{
            for (i = 0; i < {size}; i++) {{
                z[i] = c[i];
                dz[i] = step[i];
            }}
            merit = sum;
            share = (4.0 * share < 1.0) ? 4.0 * share : 1.0;
        }} else {{
            share = 0.5 * share;
        }}
        tries += 1;
        if (share < {least} || tries >= {most}) {{
            if (start == {starts}) {{
                for (i = 0; i < {size}; i++) {{
                    root[i] = 0.0 * HUGE_VAL;
                }}
                return;
            }}
            for (i = 0; i < {size}; i++) {{
                z[i] = starts[start][i];
                dz[i] = 0.0;
            }}
            start += 1;
            merit = HUGE_VAL;
            share = 1.0;
            tries = 0;
        }}
        for (i = 0; i < {size}; i++) {{
            c[i] = z[i] + share * dz[i];
        }}
    }}
}}
"""
"""The C function that solves a loop; a template of ``str.format``."""


def solver_functions(name: str, loops: Sequence[Loop], text: str) -> Iterator[str]:
    """Functions of the loops that a text solves: ``NAME_loop_K(w, root)`` replaces the last solution by the new one."""
    for number, loop in enumerate(loops):
        if f"{name}_loop_{number}(" not in text:
            continue
        yield from _correction(f"{name}_correction_{number}", loop)
        rows = [", ".join(c_double(start_value(s, k)) for k in range(loop.size)) for s in range(1, STARTS + 1)]
        yield SOLVER.format(
            n=name,
            number=number,
            path=comment(str(loop)),
            size=loop.size,
            starts=STARTS,
            values=", ".join(f"{{{row}}}" for row in rows),
            tolerance=c_double(TOLERANCE),
            least_step=_least_step(loop),
            decrease=c_double(DECREASE),
            finite=c_double(FINITE),
            least=c_double(LEAST_SHARE),
            most=MOST_ITERATIONS,
        )


def _least_step(loop: Loop) -> str:
    """The size of a correction that ends the method whatever z."""
    floor = c_double(FLOOR)
    return floor if loop.of_step else f"(sum > {c_double(STALLED)} * merit) ? {floor} : 0.0"


def _correction(name: str, loop: Loop) -> Iterator[str]:
    """The Newton correction of a loop, which returns the sum of squares of F, and whether that is near zero."""
    program = Program(loop.correction)
    goals = {f"dz[{k}]": program.outputs[0, k] for k in range(loop.size) if (0, k) in program.outputs}
    goals["sum"], goals["zero"] = program.outputs[1, 0], program.outputs[2, 0]
    lines = statements(program, goals, lambda slot, index: f"{'zw'[slot]}[{index}]")
    lines += [f"    dz[{k}] = 0.0;" for k in range(loop.size) if (0, k) not in program.outputs]
    text = "\n".join(lines)
    yield from [f"static double {name}(const double *z, const double *w, double *dz, int *near)", "{"]
    yield from ["    double sum;", "    double zero;"]
    yield from (f"    (void){argument};" for argument in "zw" if not used(argument, text))
    yield from [*lines, "    *near = zero != 0.0;", "    return sum;", "}", ""]
