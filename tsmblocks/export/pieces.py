"""Parts of C text: valid names and comments, and the buffers of delayed signals."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tsmblocks.common.tables import unique_names

SPARE = 8
"""Samples of a delayed signal in its buffer beyond its delay. Chosen: more than the interpolation needs (4)."""
RESERVED = frozenset(
    re.findall(
        r"\w+",
        """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    NAN INFINITY HUGE_VAL NULL EOF least greatest main stdin stdout stderr
    abs acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh div erf erfc exp exp2 expm1 fabs fdim floor
    fma fmax fmin fmod frexp gamma hypot j0 j1 jn ldexp lgamma log log10 log1p log2 logb modf nan pow remainder rint
    round signbit sin sinh sqrt tan tanh tgamma trunc y0 y1 yn
""",
    )
)
"""Keywords of C99, and names of <math.h> and <stdio.h> (ISO/IEC 9899:1999)."""

HEADER = """\
/* {title}: one step of {h:g} s at a time ({method}).
   Written by tsmblocks {version}. */
#ifndef {guard}
#define {guard}

typedef struct {{
{inputs}
}} {n}_inputs;

typedef struct {{
{outputs}
}} {n}_outputs;

typedef struct {{
{parameters}
}} {n}_parameters;

typedef struct {{
    {n}_parameters p;
    double {states}
    double {memory}
{past}{loops}    long long k;  /* steps taken */
}} {n};

/* Parameters may be changed in c->p after init; initial states among them take effect with reset. */
void {n}_init({n} *c);
void {n}_reset({n} *c);
void {n}_step({n} *c, const {n}_inputs *u, {n}_outputs *y);

#endif /* {guard} */
"""
"""The header; a template of ``str.format``."""

PAST = """\
/* Stores the signals to be delayed. */
static void {n}_keep({n} *c, const double *s)
{{
    int i;
    for (i = 0; i < {count}; i++) {{
        c->past[i][c->k & {mask}LL] = s[i];
    }}
}}

/* The stored values around an instant so many steps ahead: oldest first, then the time of the newest, steps per second
   and the number of steps up to it. A delay longer than the buffer is taken as the longest that it can hold. */
static void {n}_recall(const {n} *c, double offset, double *q)
{{
    double tau[{count}];
    int i;
    {n}_delays(&c->p, tau);
    for (i = 0; i < {count}; i++) {{
        const double steps = tau[i] / {h};
        const double longest = (double)({room} - {spare});
        const double excess = (steps > longest) ? steps - longest : 0.0;
        const double place = (double)c->k + offset - (steps - excess);
        const long long m = (long long)floor(place);
        const long long last = (offset == 0.0) ? c->k - 1 : c->k;
        long long newest = (m + 2 < {kept} - 1) ? {kept} - 1 : m + 2;
        int j;
        if (m < 0) {{
            newest = 0;
        }}
        if (newest > last) {{
            newest = last;
        }}
        for (j = 0; j < {kept}; j++) {{
            const long long at = ((newest < 0) ? 0 : newest) - ({kept} - 1 - j);
            q[{per} * i + j] = c->past[i][at & {mask}LL];
        }}
        q[{per} * i + {kept}] = ((double)((newest < 0) ? 0 : newest) - excess) * {h};
        q[{per} * i + {kept} + 1] = 1.0 / {h};
        q[{per} * i + {kept} + 2] = (double)(newest + 1);
    }}
}}
"""
"""C functions that store and recall delayed signals; a template of ``str.format``."""


def used(name: str, text: str) -> bool:
    """Whether an argument (an array, a pointer, or the time) occurs in a text."""
    return re.search(rf"(?<![\w.>]){name}(?:\[|->)" if name != "t" else r"(?<![\w.>])t(?![\w(])", text) is not None


def identifiers(names: Iterable[str]) -> list[str]:
    """Names as distinct identifiers of C."""
    return unique_names(map(_identifier, names))


def _identifier(name: str) -> str:
    plain = re.sub(r"[^a-zA-Z0-9_]+", "_", name).strip("_") or "none"
    return f"v_{plain}" if not plain[0].isalpha() or plain in RESERVED else plain


def comment(text: str) -> str:
    """A text that can be part of a comment."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())
