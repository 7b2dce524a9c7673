"""A search that ends where the outputs have no finite derivatives does not cost what the others found."""

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import CoulombFriction, Gain, Integrator, SlidingMass, Sum
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import pose


def test_the_best_search_that_has_derivatives_is_the_result_with_a_note(monkeypatch):
    """All of it was lost, with an error. Here the derivatives of all ends but the second are made infinite."""
    diagram = tsm.Diagram(blocks={"k": Gain()}, inputs={"u": "k"}, outputs={"y": "k"})
    t = np.arange(0, 2, 0.01)
    record = tsm.Record("run", t, {"u": np.sin(5 * t), "y": 2 * np.sin(5 * t) + 0.1}, {"u": "", "y": ""})
    right, ends, whole = tsm.fit(diagram, record, starts=3), [], Problem.jacobian

    def jacobian(self, theta, steps=None):
        residuals, found = whole(self, theta, steps)
        ends.append(theta)
        if len(ends) == 1:
            found.common[:] = np.inf
        return residuals, found

    monkeypatch.setattr(Problem, "jacobian", jacobian)
    found = tsm.fit(diagram, record, starts=3)
    assert len(ends) > 1
    assert abs(found["k.gain"].value - right["k.gain"].value) < 1e-6
    (note,) = (text for text in found.notes if "no finite derivatives" in text)
    assert note.startswith(
        "1 of 3 searches ended at a lower residual, but where the outputs have no finite derivatives"
    )


def test_where_derivatives_diverge_and_the_outputs_do_not_differences_take_their_place():
    """Dry friction with a narrow smoothing: its slope is unstable at the step, and its level is still determined."""
    t = 0.005 * np.arange(1500)
    push = 2.0 * np.sin(2 * np.pi * 0.4 * t) * (np.sin(2 * np.pi * 0.13 * t) > 0)  # rests in between
    mass = tsm.Diagram(
        blocks={"net": Sum(signs="+-"), "speed": Integrator(), "friction": CoulombFriction(level=0.8, smoothing=7e-4)},
        wires=["net -> speed -> friction -> net.minus"],
        inputs={"u": "net.plus"},
        outputs={"v": "speed"},
    )
    true = tsm.Diagram(blocks={"m": SlidingMass(coulomb=0.8)}, inputs={"u": "m"}, outputs={"v": "m"})
    run = tsm.simulate(true, inputs={"u": (t, push)}, stop=t[-1], step=0.0005)
    v = run["v"][::10] + np.random.default_rng(0).normal(0.0, 1e-3, t.size)
    record = tsm.Record("run", t, {"u": push, "v": v}, {})
    problem, _ = pose(mass, record, free=["friction.level"], step=0.005)
    theta = problem.unknowns.start
    exact = problem._derivatives(theta, None)[1].norms
    r, J = problem.jacobian(theta)
    assert not exact < 1e20
    rise = problem.residuals(1.01 * theta) - problem.residuals(0.99 * theta)
    np.testing.assert_allclose(J.common[:, 0], rise / (0.02 * theta[0]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(r, problem.residuals(theta))
    found = tsm.fit(mass.with_parameters({"friction.level": 0.5}), record, free=["friction.level"], step=0.005)
    assert abs(found["friction.level"].value - 0.8) < 0.05
    assert found["friction.level"].high - found["friction.level"].low < 0.1
