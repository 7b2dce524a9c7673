"""Elementary functions as polynomials in LLVM IR, for one number or one number per SIMD lane."""

from __future__ import annotations

import math
from typing import Any

_TO_WHOLE = 1.5 * 2.0**52
"""Adding this rounds a number to an integer, which is then in its low bits."""
_LN2 = (0.6931471805599453, 2.3190468138462996e-17)
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17)
_QUARTER_LN2 = (0.17328679513998632, 5.797617034615749e-18)
"""A constant as a double, and the difference that this leaves (reduction of Cody and Waite)."""
_ROOT_REST = -6.835808657661922e-17
"""What sqrt(2) as a double lacks, as a share."""
_EXP_SQUARE = [
    1.9999999999999685,
    1.3333333333333277,
    0.6666666667226561,
    0.2666666666768458,
    0.08888886204053738,
    0.025396820515643865,
    0.006353974375889379,
    0.0014118016126990918,
]
"""(exp(2s) - 1 - 2s) / s**2 for |s| <= ln(2)/8 as a polynomial in s. Derived: interpolation at the zeros of Chebyshev's
polynomial of degree 9 other than 0, which keeps the error of exp(2s) - 1 below 2e-16 of it."""
FARTHEST = 1e9
"""Size of an argument up to which its reduction by pi/2 in two parts is accurate."""


class Maths:
    """Shorthand for the polynomials below."""

    def __init__(self, w: Any, wide: bool) -> None:
        self.w, self.wide = w, wide
        self.t = w.type(wide)
        self.i = f"<{w.lanes} x i64>" if wide else "i64"
        self.b = f"<{w.lanes} x i1>" if wide else "i1"

    def c(self, x: float) -> str:
        """A number written out."""
        return self.w.constant(x, self.wide)

    def n(self, x: int) -> str:
        """An integer written out."""
        return str(x) if not self.wide else "<" + ", ".join([f"i64 {x}"] * self.w.lanes) + ">"

    def op(self, instruction: str, *args: str) -> str:
        """An instruction on floating-point numbers."""
        return self.w.emit(f"{instruction} {self.t} {', '.join(args)}")

    def whole(self, instruction: str, *args: str) -> str:
        """An instruction on integers."""
        return self.w.emit(f"{instruction} {self.i} {', '.join(args)}")

    def function(self, name: str, *args: str) -> str:
        """An intrinsic of LLVM."""
        return self.w.intrinsic(name, list(args), self.wide)

    def fma(self, a: str, b: str, c: str) -> str:
        """a b + c with one rounding."""
        return self.function("fma", a, b, c)

    def pick(self, flag: str, a: str, b: str) -> str:
        """a where the flag is set, else b."""
        return self.w.emit(f"select {self.b} {flag}, {self.t} {a}, {self.t} {b}")

    def poly(self, r: str, coefficients: list[float]) -> str:
        """Estrin's scheme: pairs, then pairs of pairs, so that the chain of additions stays short."""
        terms = [self.c(q) for q in coefficients]
        power = r
        while len(terms) > 1:
            terms = [
                self.fma(terms[k + 1], power, terms[k]) if k + 1 < len(terms) else terms[k]
                for k in range(0, len(terms), 2)
            ]
            power = self.op("fmul", power, power) if len(terms) > 1 else power
        return terms[0]

    def power(self, whole: str) -> str:
        """2**n for the low bits of an integer."""
        shifted = self.whole("shl", self.whole("add", whole, self.n(1023)), self.n(52))
        return self.w.emit(f"bitcast {self.i} {shifted} to {self.t}")

    def remainder(self, x: str, n: str, of: tuple[float, float]) -> str:
        """x - n c for a constant c in two parts."""
        minus = self.op("fneg", n)
        return self.fma(minus, self.c(of[1]), self.fma(minus, self.c(of[0]), x))


def _exponential(m: Maths, x: str, less: bool) -> str:
    """exp(x), or exp(x) - 1: 2**n exp(r) with x = n ln 2 + r and |r| <= ln(2)/2. NaN stays NaN."""
    low, high = m.c(-708.0), m.c(709.0)
    inside = m.pick(m.op("fcmp ogt", x, high), high, x)
    inside = m.pick(m.op("fcmp olt", inside, low), low, inside)
    n = m.function("rint", m.op("fmul", inside, m.c(1 / math.log(2))))
    r = m.remainder(inside, n, _LN2)
    q = m.poly(r, [1 / math.factorial(k) for k in range(2, 14)])
    s = m.power(m.w.emit(f"fptosi {m.t} {n} to {m.i}"))
    e = m.fma(m.op("fmul", r, r), q, r)
    y = m.fma(s, e, m.op("fsub", s, m.c(1.0)) if less else s)
    y = m.pick(m.op("fcmp ogt", x, high), m.c(math.inf), y)
    return y if less else m.pick(m.op("fcmp olt", x, low), m.c(0.0), y)


def _tanh(m: Maths, x: str) -> str:
    """(E - 1) / (E + 1) with E = exp(2x) = 2**(n/2) exp(2s) and |s| <= ln(2)/8, a few units in the last place.

    Written for a short chain of operations, since every plant with hysteresis evaluates it at each stage: all that does
    not wait for the polynomial in s is formed beside it. Arguments beyond the range of the reduction are replaced at
    the end, in parallel to the chain.
    """
    rounded = m.fma(x, m.c(4 / math.log(2)), m.c(_TO_WHOLE))
    n = m.op("fsub", rounded, m.c(_TO_WHOLE))
    s = m.fma(m.op("fneg", n), m.c(_QUARTER_LN2[0]), x)
    bits = m.w.emit(f"bitcast {m.t} {rounded} to {m.i}")
    odd = m.whole("icmp ne", m.whole("and", bits, m.n(1)), m.n(0))
    root = m.pick(odd, m.c(math.sqrt(2)), m.c(1.0))
    whole = m.whole("shl", m.whole("lshr", bits, m.n(1)), m.n(52))
    scaled = m.whole("add", m.w.emit(f"bitcast {m.t} {root} to {m.i}"), whole)
    power = m.w.emit(f"bitcast {m.i} {scaled} to {m.t}")  # 2**(n/2), to within ``_ROOT_REST``
    rest = m.fma(m.op("fneg", n), m.c(2 * _QUARTER_LN2[1]), m.pick(odd, m.c(_ROOT_REST), m.c(0.0)))
    linear = m.fma(s, m.c(2.0), rest)
    square = m.op("fmul", power, m.op("fmul", s, s))
    q = m.poly(s, _EXP_SQUARE)
    over = m.fma(square, q, m.fma(power, linear, m.op("fsub", power, m.c(1.0))))
    under = m.fma(square, q, m.fma(power, linear, m.op("fadd", power, m.c(1.0))))
    y = m.op("fdiv", over, under)
    far = m.op("fcmp ogt", m.function("fabs", x), m.c(20.0))
    one = m.function("copysign", m.c(1.0), x)
    m.w.declared["!0"] = "!0 = !{}"  # without this mark LLVM makes it a branch around the division
    return m.w.emit(f"select {m.b} {far}, {m.t} {one}, {m.t} {y}, !unpredictable !0")


def _sincos(m: Maths, x: str, cosine: bool) -> str:
    """Accurate up to |x| of about 1e9: reduction by pi/2 in two parts (Cody and Waite), then Taylor polynomials."""
    y = _quadrant(m, *_reduced(m, x), cosine=cosine)
    # beyond the range of the reduction the result would be wrong, so it is NaN
    return m.pick(m.op("fcmp ogt", m.function("fabs", x), m.c(FARTHEST)), m.c(math.nan), y)


def _reduced(m: Maths, x: str) -> tuple[str, str, str]:
    """Number of the quadrant, and sine and cosine of x less a multiple of pi/2, at most pi/4 in size."""
    rounded = m.fma(x, m.c(2 / math.pi), m.c(_TO_WHOLE))
    r = m.remainder(x, m.op("fsub", rounded, m.c(_TO_WHOLE)), _HALF_PI)
    z = m.op("fmul", r, r)
    s = m.poly(z, [(-1) ** k / math.factorial(2 * k + 1) for k in range(1, 9)])
    sine = m.fma(m.op("fmul", r, z), s, r)
    c = m.poly(z, [(-1) ** k / math.factorial(2 * k) for k in range(2, 9)])
    cos = m.fma(m.op("fmul", z, z), c, m.fma(z, m.c(-0.5), m.c(1.0)))
    return m.w.emit(f"bitcast {m.t} {rounded} to {m.i}"), sine, cos


def _quadrant(m: Maths, k: str, sine: str, cos: str, *, cosine: bool) -> str:
    """The sine of x, or its cosine, from its quadrant."""
    if cosine:
        k = m.whole("add", k, m.n(1))
    odd = m.whole("icmp ne", m.whole("and", k, m.n(1)), m.n(0))
    chosen = m.pick(odd, cos, sine)
    sign = m.whole("shl", m.whole("and", k, m.n(2)), m.n(62))
    bits = m.whole("xor", m.w.emit(f"bitcast {m.t} {chosen} to {m.i}"), sign)
    return m.w.emit(f"bitcast {m.i} {bits} to {m.t}")


def _both(m: Maths, x: str) -> str:
    """Sine and cosine of one number, which share their reduction; far from zero those of libm."""
    w = m.w
    far = m.op("fcmp ugt", m.function("fabs", x), m.c(FARTHEST))
    w.do(f"br i1 {far}, label %far, label %near, !prof !1")
    w.label("near")
    parts = _reduced(m, x)
    near = [_quadrant(m, *parts, cosine=flag) for flag in (False, True)]
    w.do("br label %end")
    w.label("far")
    other = [w.emit(f"call double @{name}(double {x})") for name in ("sin", "cos")]
    w.do("br label %end")
    w.label("end")
    made = [w.emit(f"phi double [ {a}, %near ], [ {b}, %far ]") for a, b in zip(near, other, strict=True)]
    w.declared |= {name: f"declare double @{name}(double) #1" for name in ("sin", "cos")}
    w.declared["!1"] = '!1 = !{!"branch_weights", i32 1, i32 1000000}'
    pair = w.emit(f"insertvalue {{double, double}} poison, double {made[0]}, 0")
    return w.emit(f"insertvalue {{double, double}} {pair}, double {made[1]}, 1")


BODIES = {
    "exp": lambda m, x: _exponential(m, x, False),
    "expm1": lambda m, x: _exponential(m, x, True),
    "tanh": _tanh,
    "sin": lambda m, x: _sincos(m, x, False),
    "cos": lambda m, x: _sincos(m, x, True),
    "both": _both,
}
