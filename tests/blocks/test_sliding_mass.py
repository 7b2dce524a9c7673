"""A mass with dry friction that sticks, against closed forms and against SciPy with events."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound
from tsmblocks.blocks import Gain, Integrator, Ramp, SlidingMass, Sum

STOP = 8.0
H = (0.02, 0.005, 0.00125)


def driven(t):
    return 3 * np.sin(2 * t) + 0.4 * np.sin(7.3 * t)


def run(force, stop=STOP, step=0.01, **given):
    diagram = tsm.Diagram(
        blocks={"mass": SlidingMass(**given), "x": Integrator()},
        wires=["mass -> x"],
        inputs={"f": "mass.u"},
        outputs={"v": "mass", "x": "x"},
    )
    t = np.arange(0, stop + 1e-9, 1e-4)
    return tsm.simulate(diagram, inputs={"f": (t, force(t))}, stop=stop, step=step, check_step=False)


def with_events(force, friction, stop):
    """Speed and position of a unit mass: each span of sticking or sliding is integrated to its end."""
    t, v, x, way = 0.0, 0.0, 0.0, 0.0
    while t < stop:
        if way == 0.0:
            fine = np.linspace(t, stop, 200_001)
            beyond = np.flatnonzero(np.abs(force(fine)) > friction * (1 + 1e-12))
            if not len(beyond):
                return v, x
            k = beyond[0]
            t = brentq(lambda s: abs(force(s)) - friction, fine[k - 1], fine[k]) if k else t
            way = np.sign(force(t))

        def rates(s, y, way=way):
            return [force(s) - way * friction, y[0]]

        first = solve_ivp(rates, [t, t + 1e-4], [v, x], rtol=1e-12, atol=1e-14)  # away from the zero it begins at

        def stops(s, y):
            return y[0]

        stops.terminal = True
        rest = solve_ivp(rates, [t + 1e-4, stop], first.y[:, -1], rtol=1e-12, atol=1e-13, max_step=0.01, events=stops)
        t, (v, x) = rest.t[-1], rest.y[:, -1]
        if rest.status == 1:
            v, way = 0.0, 0.0 if abs(force(t)) <= friction else np.sign(force(t))
    return v, x


def test_sound():
    assert_sound(SlidingMass())


def test_it_slides_to_rest_as_a_parabola_and_stays_there():
    found = run(lambda t: 0 * t, stop=3.0, coulomb=2.0, mass=4.0, v=1.0)
    t = found.t
    assert found["v"] == pytest.approx(np.maximum(1 - t / 2, 0), abs=1e-12)
    assert set(found["v"][t > 2.01]) == {0.0}
    assert found["x"][-1] == pytest.approx(1.0, abs=1e-4)  # the stop lies between two samples


@pytest.mark.parametrize("force", [0.49, -0.49])
def test_a_force_below_the_friction_moves_nothing_however_long(force):
    found = run(lambda t: 0 * t + force, stop=100.0, coulomb=0.3, breakaway=0.2)
    assert not found["v"].any()
    assert not found["x"].any()


@pytest.mark.parametrize("force", [0.51, -0.51])
def test_a_force_above_the_friction_at_rest_starts_it(force):
    found = run(lambda t: 0 * t + force, stop=60.0, coulomb=0.3, breakaway=0.2, viscous=0.5)
    assert found["v"][-1] == pytest.approx(np.sign(force) * 0.21 / 0.5, rel=1e-4)  # Coulomb and viscous friction


def test_it_tends_to_the_solution_with_events_with_the_square_of_the_step():
    v, x = with_events(driven, 1.0, STOP)
    wrong = [
        np.abs([found["v"][-1] - v, found["x"][-1] - x]) for found in (run(driven, step=h, coulomb=1.0) for h in H)
    ]
    assert np.max(wrong[0]) < 5e-4
    assert np.max(wrong[2]) < 1e-5
    assert np.max(wrong[2]) < np.max(wrong[0]) / 25  # a sixteenth at first order


def pulled(step, method="rk4"):
    """A mass behind a spring whose end moves steadily: it sticks and slips."""
    law = SlidingMass(coulomb=1.0, breakaway=0.5, stribeck=0.05, viscous=0.4, unit="m/s")
    diagram = tsm.Diagram(
        blocks=dict(
            end=Ramp(slope=0.1, unit="m"), stretch=Sum(signs="+-"), spring=Gain(gain=2.0), mass=law, x=Integrator()
        ),
        wires=["end -> stretch.plus", "stretch -> spring -> mass -> x -> stretch.minus"],
        outputs={"x": "x", "v": "mass"},
    )
    return tsm.simulate(diagram, stop=30.0, step=step, method=method, check_step=False)


def slipped():
    """The same with SciPy: the position after each slip."""

    def rates(s, y):
        level = 1.0 + 0.5 * np.exp(-((y[0] / 0.05) ** 2))
        return [2 * (0.1 * s - y[1]) - level - 0.4 * y[0], y[0]]

    def stops(s, y):
        return y[0]

    stops.terminal = True
    stops.direction = -1
    x, places = 0.0, [0.0]
    while (begins := (x + 0.75) / 0.1) < 30.0:
        # just beyond the force at rest: without a push the mass would never begin
        slip = solve_ivp(rates, [begins + 1e-7, 30.0], [1e-12, x], rtol=1e-11, atol=1e-15, max_step=1e-3, events=stops)
        if slip.status != 1:  # it slips as the run ends
            break
        x = slip.y[1, -1]
        places.append(x)
    return places


@pytest.mark.parametrize("method", ["heun", "rk4", "sdirk2"])
def test_stick_slip_is_that_of_an_integration_with_events(method):
    expected = slipped()
    assert len(expected) == 4
    found = pulled(1e-3, method)
    rests = found["x"][1:][(found["v"][1:] == 0) & (found["v"][:-1] != 0)]
    assert rests == pytest.approx(expected[1:], rel=2e-3)
    assert (found["v"] == 0).mean() > 0.5


def test_a_fit_finds_friction_and_mass():
    truth = {"mass.coulomb": 0.8, "mass.mass": 1.5}
    diagram = tsm.Diagram(
        blocks={"mass": SlidingMass(coulomb=0.5, mass=1.0), "x": Integrator()},
        wires=["mass -> x"],
        inputs={"f": "mass.u"},
        outputs={"x": "x"},
    )
    t = np.arange(0, STOP, 0.01)
    made = tsm.simulate(diagram.with_parameters(truth), inputs={"f": (t, driven(t))}, stop=STOP - 0.01, step=0.01)
    noisy = made["x"] + 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    found = tsm.fit(
        diagram, tsm.Record("r", t, {"f": driven(t), "x": noisy}, {}), free=[*truth], starts=1, hold="linear"
    )
    for name, value in truth.items():
        (one,) = [e for e in found if e.name == name]
        assert one.value == pytest.approx(value, rel=2e-3)
        assert one.low < value < one.high
