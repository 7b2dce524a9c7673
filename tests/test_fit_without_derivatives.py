"""A search that ends where the outputs have no finite derivatives does not cost what the others found."""

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import Gain
from tsmblocks.fitting.residuals import Problem


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
