"""Coordinates of the motion that predict a residual."""

import numpy as np

from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.residual_location import residual_coordinates

COUNT, FOLDS = 2000, 10
BLOCK = np.arange(COUNT) * 40 // COUNT


def found(r, **known):
    blocks = TimeBlocks(BLOCK, BLOCK % FOLDS, np.zeros(COUNT, dtype=int), np.bincount(BLOCK).astype(float))
    return {one.coordinate: one.share for one in residual_coordinates(r, known, blocks, float(np.mean(r**2)))}


def test_a_single_experiment_does_not_differ_from_others():
    """The mean of its residual is an offset, and no difference from experiment to experiment."""
    x = np.sin(0.05 * np.arange(COUNT))
    r = 1.0 + x + 0.1 * np.random.default_rng(1).standard_normal(COUNT)
    assert [*found(r, position=x, experiment=np.zeros(COUNT))] == ["position"]


def test_two_experiments_do():
    experiment = np.arange(COUNT) % 2.0
    r = experiment - 0.5 + 0.1 * np.random.default_rng(1).standard_normal(COUNT)
    assert found(r, experiment=experiment)["experiment"] > 0.9
