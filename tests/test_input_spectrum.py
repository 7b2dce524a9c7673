"""Noise of measured inputs of any spectrum is distinguished from effects by the likelihood of the residual."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import tsmblocks as tsm
from tests.slides import SENSOR, force, recorded, slide, slow_noise
from tsmblocks.diagnosis.input_noise import NoiseOfInput, errors_of_inputs
from tsmblocks.diagnosis.input_spectrum import ErrorsOfInputs
from tsmblocks.diagnosis.model import ModelSettings, calibrate


def base(record):
    return calibrate(slide(), {"run": record}, ModelSettings(None, {"x": SENSOR}, ("x",)))


def test_the_noise_of_an_input_is_found_in_the_residual():
    rms = 0.6
    model = base(recorded(slow_noise(rms, 3.0)))
    errors = {0: errors_of_inputs(model, 0, {"F": NoiseOfInput(0.06, 40.0)}, 500)}
    found = ErrorsOfInputs(errors).likelihood(model)
    assert np.mean(model.differences**2) > 20
    assert found.square == pytest.approx(1.0, abs=0.1)
    assert found.noise["F"] * np.std(force()) == pytest.approx(rms, rel=0.3)


def test_the_likelihood_is_that_of_a_normal_distribution():
    """With little noise in the input its most likely spectrum is the least one, which is known."""
    model = base(recorded())
    noise = NoiseOfInput(0.01, 20.0)
    errors = {0: errors_of_inputs(model, 0, {"F": noise}, 200)}
    found, causes = ErrorsOfInputs(errors).likelihood(model), errors[0]["F"].causes
    covariance = np.eye(len(causes)) + 0.25 * causes @ causes.T
    J = model.J.dense()
    weighted = np.linalg.solve(covariance, np.column_stack([model.r, J]))
    r = model.r - J @ np.linalg.solve(J.T @ weighted[:, 1:], J.T @ weighted[:, 0])
    normal = multivariate_normal(np.zeros(len(r)), covariance)
    independent = -2 * normal.logpdf(r) - len(r) * np.log(2 * np.pi)
    assert found.deviance == pytest.approx(independent, abs=2.0)


EFFECTS = ["coulomb_friction", "resonance", "position_ripple", "parameter_change", "periodic_disturbance"]


@pytest.mark.parametrize("seed", [0, 3])
def test_nothing_is_named_for_slow_noise_of_an_input(seed):
    """Effects were named for it, or it was called an unmodelled effect that the recorded signals predict."""
    found = tsm.diagnose(slide(), recorded(slow_noise(0.6, 3.0, seed), seed), effects=EFFECTS)
    assert found.verdict == "none"
    (segment,) = found.segments
    (noise,) = segment.noise_of_inputs
    assert (noise.input, noise.unit) == ("F", "N")
    assert noise.rms == pytest.approx(0.6, rel=0.4)
    assert "rms in F (" in segment.sentence
    assert "Measure the noise of F" in " ".join(str(found).split())


def test_an_effect_beside_slow_noise_of_an_input_is_named_alone():
    found = tsm.diagnose(
        slide(), recorded(slow_noise(0.6, 3.0), resistance=lambda t, v: 2.0 * np.tanh(v / 1e-3)), effects=EFFECTS
    )
    assert [one.name for one in found.effects] == ["coulomb_friction"]
