"""Whether an oscillation comes back where the motion does: of several pairs of repeats, all are taken together."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.diagnosis.oscillation import comes_back_with_motion

T = 0.01 * np.arange(400)
LOCAL = ("disturbance.cosine", "disturbance.sine")
CANDIDATE = SimpleNamespace(local=LOCAL)


def model(*phases):
    """Pairs of experiments of one motion each, the second of which is opposite where its number is negative."""
    items, theta, experiments = [], [], []
    for k, pair in enumerate(phases):
        for one, (amplitude, phase) in zip("ab", pair, strict=True):
            name, sign = f"run{k}{one}", -1.0 if one == "b" and amplitude < 0 else 1.0
            motion = sign * np.sin(2 * np.pi * (0.5 + k) * T)
            experiments.append(SimpleNamespace(name=name, record=tsm.Record(name, T, {"u": motion}, {"u": "rad"})))
            items += [SimpleNamespace(experiment=name, parameter=p) for p in LOCAL]
            theta += [amplitude * np.cos(phase), amplitude * np.sin(phase)]
    return SimpleNamespace(
        problem=SimpleNamespace(unknowns=SimpleNamespace(items=items)),
        theta=np.array(theta),
        diagram=SimpleNamespace(inputs={"u": None}),
        setup=SimpleNamespace(experiments=experiments),
    )


@pytest.mark.parametrize(
    ("phases", "back"),
    [
        ([((1.0, 0.3), (1.0, 0.32))], True),
        ([((1.0, 0.3), (-1.0, 0.32))], True),
        ([((1.0, 0.3), (1.0, 2.3))], False),
        ([((1.0, 0.3), (1.0, 0.32)), ((1.0, 0.3), (1.0, 2.0)), ((1.0, 1.3), (1.0, 5.0))], False),
        ([((1.0, 0.3), (1.0, 0.32)), ((1.0, 0.9), (1.0, 0.88)), ((0.05, 1.3), (0.05, 5.0))], True),
    ],
    ids=["repeated", "opposite", "another phase", "one of three by chance", "a small one in noise"],
)
def test_it_comes_back_where_all_pairs_together_agree(phases, back):
    assert comes_back_with_motion(model(*phases), CANDIDATE) is back
