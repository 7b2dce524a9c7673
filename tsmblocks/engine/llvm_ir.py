"""LLVM IR for scalar operations, on one number or on one number per SIMD lane.

Elementary functions of lanes are polynomials (``elementary``), so that they need no library; those of single numbers
call libm, except tanh, sine and cosine: every call of libm makes a kernel store its registers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from tsmblocks.common.errors import TsmError
from tsmblocks.engine.elementary import BODIES, Maths

_TRIGONOMETRIC = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh")
_OTHERS = ("exp", "log", "erf", "log1p", "expm1", "pow", "fmod", "remainder", "atan2", "hypot")
LIBM = {name.upper(): name for name in (*_TRIGONOMETRIC, *_OTHERS)} | {"CONSTPOW": "pow"}
"""CasADi's operations and the functions of libm that compute them."""
_INTRINSIC = {"SQRT": "sqrt", "FABS": "fabs", "FLOOR": "floor", "CEIL": "ceil", "COPYSIGN": "copysign"}
MOST_INLINED = 12
"""Places at which sine and cosine are inlined, at most. Chosen: 12 take 30 ms to compile, 180 take 2 s."""
_COMPARE = {"LT": "olt", "LE": "ole", "EQ": "oeq", "NE": "une"}


def llvm_double(x: float) -> str:
    """A double as LLVM writes it, exactly."""
    return "0x" + struct.pack(">d", x).hex().upper()


class Writer:
    """Appends instructions to ``lines`` and hands out value names; ``lanes`` is the SIMD width."""

    def __init__(self, lanes: int = 1, fused: bool = True) -> None:
        self.lanes = lanes
        self.lines: list[str] = []
        self.declared: dict[str, str] = {}
        self.functions: dict[str, str] = {}
        self.fused = fused
        self.products: dict[str, tuple[str, str]] = {}
        self.vector = f"<{lanes} x double>"
        self._count = 0
        self._splats: dict[str, str] = {}
        self._entry_splats: dict[str, str] = {}
        self._pairs: dict[str, tuple[str, ...]] = {}

    # ---- plain writing

    def emit(self, text: str) -> str:
        """One instruction with a result; returns its name."""
        self._count += 1
        name = f"%v{self._count}"
        self.lines.append(f"  {name} = {text}")
        return name

    def do(self, text: str) -> None:
        """One instruction without a result."""
        self.lines.append(f"  {text}")

    def label(self, name: str) -> None:
        """Begin a basic block; numbers widened in other blocks may not be defined in it, so they are dropped."""
        self.lines.append(f"{name}:")
        self._splats, self._pairs = dict(self._entry_splats), {}

    def end_of_entry(self) -> None:
        """Keep the numbers widened so far: they are defined in every later block."""
        self._entry_splats = dict(self._splats)

    def type(self, wide: bool) -> str:
        """The type of a number, or of one number per lane."""
        return self.vector if wide else "double"

    def constant(self, x: float, wide: bool) -> str:
        """A number written out, in every lane where it is wide."""
        if not wide:
            return llvm_double(x)
        return "<" + ", ".join([f"double {llvm_double(x)}"] * self.lanes) + ">"

    def widen(self, value: str) -> str:
        """A single number in every lane."""
        if value.startswith("0x"):
            return self.constant(struct.unpack(">d", bytes.fromhex(value[2:]))[0], True)
        if value not in self._splats:
            one = self.emit(f"insertelement {self.vector} poison, double {value}, i32 0")
            zeros = f"<{self.lanes} x i32> zeroinitializer"
            self._splats[value] = self.emit(f"shufflevector {self.vector} {one}, {self.vector} poison, {zeros}")
        return self._splats[value]

    def load(self, pointer: str, wide: bool) -> str:
        """Read the value at a pointer."""
        return self.emit(f"load {self.type(wide)}, ptr {pointer}, align 8")

    def store(self, value: str, pointer: str, wide: bool) -> None:
        """Write a value to where a pointer points."""
        self.do(f"store {self.type(wide)} {value}, ptr {pointer}, align 8")

    def at(self, base: str, index: int | str) -> str:
        """Pointer to the index-th double after base."""
        return base if index == 0 else self.emit(f"getelementptr double, ptr {base}, i64 {index}")

    # ---- arithmetic

    def add(self, a: str, b: str, wide: bool = False) -> str:
        """The sum of two values; a product among them is not rounded first.

        Which one is settled here, by their order. LLVM would decide it by how often each product is used, and the same
        equations would round differently in a diagram with one more block.
        """
        if b in self.products:
            return self.intrinsic("fmuladd", [*self.products[b], a], wide)
        if a in self.products:
            return self.intrinsic("fmuladd", [*self.products[a], b], wide)
        return self.emit(f"fadd {self.type(wide)} {a}, {b}")

    def sub(self, a: str, b: str, wide: bool = False) -> str:
        """The difference of two values, rounded as ``add``."""
        t = self.type(wide)
        if b in self.products:
            x, y = self.products[b]
            return self.intrinsic("fmuladd", [self.emit(f"fneg {t} {x}"), y, a], wide)
        if a in self.products:
            return self.intrinsic("fmuladd", [*self.products[a], self.emit(f"fneg {t} {b}")], wide)
        return self.emit(f"fsub {t} {a}, {b}")

    def mul(self, a: str, b: str, wide: bool = False) -> str:
        """The product of two values."""
        made = self.emit(f"fmul {self.type(wide)} {a}, {b}")
        if self.fused:
            self.products[made] = (a, b)
        return made

    def intrinsic(self, name: str, args: list[str], wide: bool) -> str:
        """The value of an LLVM intrinsic, which is declared when first used."""
        t = self.type(wide)
        full = f"llvm.{name}." + (f"v{self.lanes}f64" if wide else "f64")
        self.declared[full] = f"declare {t} @{full}({', '.join([t] * len(args))})"
        return self.emit(f"call {t} @{full}({', '.join(f'{t} {a}' for a in args)})")

    def operation(self, name: str, a: list[str], wide: bool) -> str:
        """One CasADi operation on values that are all wide or all single."""
        t = self.type(wide)
        if name in ("ADD", "SUB", "MUL"):
            return getattr(self, name.lower())(*a, wide)
        if name == "DIV":
            return self.emit(f"fdiv {t} {a[0]}, {a[1]}")
        if name == "NEG":
            return self.emit(f"fneg {t} {a[0]}")
        if name == "SQ":
            return self.mul(a[0], a[0], wide)
        if name == "TWICE":
            return self.add(a[0], a[0], wide)
        if name == "INV":
            return self.emit(f"fdiv {t} {self.constant(1.0, wide)}, {a[0]}")
        if name == "ASSIGN":
            return a[0]
        if name in _INTRINSIC:
            return self.intrinsic(_INTRINSIC[name], a, wide)
        if name in LIBM:
            return self._elementary(name, a, wide)
        return self._logic(name, a, wide)

    def _logic(self, name: str, a: list[str], wide: bool) -> str:
        t, bit = self.type(wide), f"<{self.lanes} x i1>" if wide else "i1"
        zero = self.constant(0.0, wide)

        def as_number(flag: str) -> str:
            return self.emit(f"uitofp {bit} {flag} to {t}")

        def is_set(value: str) -> str:
            return self.emit(f"fcmp une {t} {value}, {zero}")

        if name in _COMPARE:
            return as_number(self.emit(f"fcmp {_COMPARE[name]} {t} {a[0]}, {a[1]}"))
        if name in ("FMIN", "FMAX"):
            # min and max must keep a NaN: in this order the compare keeps one in the first operand (and is
            # one instruction), the second selection one in the second
            flag = self.emit(f"fcmp {'olt' if name == 'FMIN' else 'ogt'} {t} {a[1]}, {a[0]}")
            chosen = self.emit(f"select {bit} {flag}, {t} {a[1]}, {t} {a[0]}")
            lost = self.emit(f"fcmp uno {t} {a[1]}, {a[1]}")
            return self.emit(f"select {bit} {lost}, {t} {a[1]}, {t} {chosen}")
        if name == "NOT":
            return as_number(self.emit(f"fcmp oeq {t} {a[0]}, {zero}"))
        if name in ("AND", "OR"):
            return as_number(self.emit(f"{name.lower()} {bit} {is_set(a[0])}, {is_set(a[1])}"))
        if name == "IF_ELSE_ZERO":
            return self.emit(f"select {bit} {is_set(a[0])}, {t} {a[1]}, {t} {zero}")
        if name == "SIGN":
            up, down = (as_number(self.emit(f"fcmp {c} {t} {a[0]}, {zero}")) for c in ("ogt", "olt"))
            return self.emit(f"fsub {t} {up}, {down}")
        raise TsmError(f"the engine does not know CasADi's operation {name}.")

    def _elementary(self, name: str, a: list[str], wide: bool) -> str:
        if name == "TANH" or (wide and name in ("EXP", "EXPM1", "SIN", "COS")):
            return self._own(name.lower(), a[0], wide)
        if name in ("SIN", "COS"):
            return self._of_pair(a[0], ("SIN", "COS").index(name))
        function = LIBM[name]
        doubles = ", ".join(["double"] * len(a))
        self.declared[function] = f"declare double @{function}({doubles}) #1"
        if not wide:
            return self.emit(f"call double @{function}({', '.join(f'double {v}' for v in a)})")
        result = "poison"
        for lane in range(self.lanes):
            single = [self.emit(f"extractelement {self.vector} {v}, i32 {lane}") for v in a]
            value = self.emit(f"call double @{function}({', '.join(f'double {v}' for v in single)})")
            result = self.emit(f"insertelement {self.vector} {result}, double {value}, i32 {lane}")
        return result

    def _call_instead(self, written: Iterable[str]) -> None:
        """Call the function for sine and cosine where it is needed often: inlined, it makes compilation slow."""
        name = "tsm_both1"
        used = sum(line.count(f"@{name}(") for line in (*written, *self.lines))
        if used > MOST_INLINED:
            self.functions[name] = self.functions[name].replace("alwaysinline", "noinline", 1)

    def _of_pair(self, x: str, which: int) -> str:
        """Sine or cosine of a single number, both of which are formed at once."""
        if x not in self._pairs:
            pair = self._own("both", x, False)
            self._pairs[x] = tuple(self.emit(f"extractvalue {{double, double}} {pair}, {k}") for k in range(2))
        return self._pairs[x][which]

    def _own(self, name: str, x: str, wide: bool) -> str:
        """Call one of this module's own functions, adding its text on first use."""
        t = self.type(wide)
        made = "{double, double}" if name == "both" else t
        full = f"tsm_{name}{self.lanes if wide else 1}"
        if full not in self.functions:
            self.functions[full] = ""  # reserves the name while the body is written
            body = Writer(self.lanes if wide else 1, fused=True)
            body.vector = t
            result = BODIES[name](Maths(body, wide), "%x")
            head = f"define internal {made} @{full}({t} %x) alwaysinline {{"
            self.functions[full] = "\n".join([head, *body.lines, f"  ret {made} {result}", "}"])
            self.declared.update(body.declared)
        return self.emit(f"call {made} @{full}({t} {x})")

    def module(self, written: Iterable[str] = ()) -> str:
        """Functions and declarations that the text needs, some of which has been written before."""
        self._call_instead(written)
        parts = [
            *self.functions.values(),
            *self.declared.values(),
            "attributes #1 = { nounwind willreturn memory(none) }",
        ]
        return "\n".join(parts) + "\n"
