"""Stiff diagrams by the implicit methods, against Radau at 1e-10; algebraic loops beside the same without one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from measure import Report, race, three
from scipy.integrate import solve_ivp
from tsmblocks.block import Block, Input, Output, block

import tsmblocks as tsm
from tests.stiff import Contact, Robertson, VanDerPol
from tsmblocks.blocks import DCMotor, FirstOrderLag, Gain, Integrator, Saturation, Sine, Step, Sum

METHODS = ("sdirk2", "sdirk3", "sdirk4")
Exact = Callable[[np.ndarray], np.ndarray]


@block(register=False)
class HalfLimited(Block):
    """The solution of e + limit(e) = u, by hand."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.if_else(ca.fabs(u.u) < 1, u.u / 2, u.u - 0.5 * ca.sign(u.u)))


def radau(rates: Callable[[float, np.ndarray], list[float]], start: list[float], stop: float) -> Exact:
    """The first state by Radau at a tolerance of 1e-10."""
    made = solve_ivp(rates, (0.0, stop), start, "Radau", rtol=1e-10, atol=1e-13, dense_output=True)
    return lambda t: made.sol(t)[0]


def problems() -> list[tuple[str, Any, float, tuple[float, ...], Exact]]:
    """Name, diagram with the output ``y``, end [s], steps [s] and the exact output."""
    w = 2 * np.pi
    circuit = tsm.Diagram(
        blocks=dict(r=Sine(frequency=1.0, amplitude=1.0), y=FirstOrderLag(time_constant=1e-6)),
        wires=["r -> y"],
        outputs={"y": "y"},
    )

    def alone(inner: Block) -> Any:
        return tsm.Diagram(blocks=dict(b=inner), wires=[], outputs={"y": "b.y"})

    def reactions(t: float, x: np.ndarray) -> list[float]:
        slow, back, fast = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
        return [back - slow, slow - back - fast, fast]

    def contact(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -10.0 + 1e7 * max(-x[0], 0.0) * max(1.0 - x[1], 0.0)]

    falling = tsm.Diagram(
        blocks=dict(f=Step(time=0.0, before=-10.0, after=-10.0), b=Contact()), wires=["f -> b"], outputs={"y": "b"}
    )
    return [
        ("lag of 1 us", circuit, 5.0, (1e-2, 1e-3), lambda t: (np.exp(1j * w * t) / (1 + 1j * w * 1e-6)).imag),
        (
            "Van der Pol, mu = 1000, up to its jump",
            alone(VanDerPol()),
            800.0,
            (1.0, 0.1),
            radau(lambda t, x: [x[1], 1000 * (1 - x[0] ** 2) * x[1] - x[0]], [2.0, 0.0], 800.0),
        ),
        ("Robertson", alone(Robertson()), 400.0, (0.5, 0.05), radau(reactions, [1.0, 0.0, 0.0], 400.0)),
        ("winding of 1 uH", *winding()),
        ("contact of 1e7 N/m", falling, 0.5, (1e-4, 1e-5), radau(contact, [0.1, 0.0], 0.5)),
    ]


def winding() -> tuple[Any, float, tuple[float, ...], Exact]:
    """A motor whose current settles in a fraction of a microsecond; its speed by Radau on the same equations."""
    d = tsm.Diagram(
        blocks=dict(u=Step(time=0.0, before=12.0, after=12.0), m=DCMotor(L=1e-6)),
        wires=["u -> m"],
        outputs={"y": "m.v"},
    )
    eq = tsm.equations(d)
    p, place = [d.parameters[k] for k in eq.p], eq.y.index("m.v")

    def value(slot: int, t: float, x: np.ndarray) -> np.ndarray:
        return np.asarray(eq.rhs(t, x, [], [], [], p)[slot], dtype=float).ravel()

    made = solve_ivp(
        lambda t, x: value(0, t, x), (0.0, 0.5), np.zeros(3), "Radau", rtol=1e-10, atol=1e-12, dense_output=True
    )
    exact = lambda t: np.array([value(1, now, made.sol(now))[place] for now in t])  # noqa: E731
    return d, 0.5, (1e-3, 2e-4), exact


def stiff(report: Report) -> None:
    """Error and cost of each method at steps that follow the slow part."""
    rows = []
    for name, d, stop, steps, exact in problems():
        for h in steps:
            cells = []
            runs = {m: (lambda m=m, h=h, d=d, stop=stop: tsm.simulate(d, stop=stop, step=h, method=m)) for m in METHODS}
            best = race(runs, 3)
            for method, run in runs.items():
                made = run()
                later = made.t > 0.02 * stop  # after what starts
                off = np.abs(made["y"] - exact(made.t))[later].max() / np.abs(exact(made.t)).max()
                cells.append(f"{off:.1e}, {three(1e9 * best[method].cpu / len(made.t))}")
                report.note(f"stiff, {name}, {h:g} s, {method}", off)
            rows.append([name, f"{h:g}", *cells])
    report.table(
        "Stiff diagrams: relative error, and ns per step with simulate()", ["diagram", "step [s]", *METHODS], rows
    )


def loops(report: Report) -> None:
    """A plant around a loop, beside the plant around what the loop comes to."""
    rows = []
    for name, inner, by_hand in (
        ("linear", Gain(gain=3.0), Gain(gain=0.25)),
        ("with a limit", Saturation(low=-0.5, high=0.5), HalfLimited()),
    ):
        looped = around(dict(s=Sum(), k=inner), ["e -> s.plus", "s -> k -> s.minus", "s -> lag"])
        plain = around(dict(k=by_hand), ["e -> k -> lag"])
        runs = {
            k: (lambda d=d: tsm.simulate(d, stop=20.0, log="outputs")) for k, d in (("loop", looped), ("hand", plain))
        }
        off = float(np.abs(runs["loop"]()["y"] - runs["hand"]()["y"]).max())
        if report.check(f"loop, {name}", off, 1e-12):
            best = race(runs, 5)
            figures = [best[k].cpu / 20_000 for k in runs]
            rows.append([name, *(three(1e9 * x) for x in figures), three(figures[0] / figures[1])])
    head = ["algebraic loop", "solved [ns per step]", "eliminated by hand [ns per step]", "ratio"]
    report.table("A plant of three states around an algebraic loop, RK4 at 1 ms", head, rows)


def around(inner: dict[str, Any], wires: list[str]) -> Any:
    """A plant of three states around some blocks."""
    blocks = dict(
        ref=Sine(frequency=1.0), e=Sum(), lag=FirstOrderLag(time_constant=0.1, gain=5.0), i=Integrator(),
        last=FirstOrderLag(time_constant=0.05), **inner,
    )  # fmt: skip
    wires = ["ref -> e.plus", "lag -> i -> last -> e.minus", *wires]
    return tsm.Diagram(blocks=blocks, wires=wires, outputs={"y": "last"})
