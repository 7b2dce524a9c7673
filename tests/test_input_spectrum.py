"""Noise of measured inputs of any spectrum is told from effects by the likelihood of the residual."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, lsim
from scipy.stats import multivariate_normal

import tsmblocks as tsm
from tsmblocks.diagnosis.input_noise import NoiseOfInput, errors_of_inputs
from tsmblocks.diagnosis.input_spectrum import likelihood
from tsmblocks.diagnosis.model import ModelSettings, calibrate

STEP, MASS, DAMPING, STIFFNESS, SENSOR = 0.004, 2.5, 18.0, 400.0, 1e-4
T = np.arange(0.0, 8.0, STEP)


def slow_noise(rms, corner, seed=0):
    """Noise that falls above a corner frequency [Hz]."""
    a, white = np.exp(-2 * np.pi * corner * STEP), np.random.default_rng(seed).standard_normal(len(T) + 2000)
    return rms * lfilter([np.sqrt(1 - a * a)], [1, -a], white)[2000:]


def force(seed=0):
    random = np.random.default_rng(seed)
    waves = zip(np.geomspace(0.2, 4, 7), random.uniform(0, 2 * np.pi, 7), strict=True)
    return 8 * sum(np.sin(2 * np.pi * f * T + phase) for f, phase in waves)


def recorded(noise, seed=0, friction=0.0):
    """A mass on a spring, its force measured with noise; Coulomb friction by a fine Euler simulation."""
    F, fine = force(seed), 10
    if friction:
        x, v, places = 0.0, 0.0, []
        for now in np.arange(0.0, len(T), 1 / fine):
            F_now = np.interp(now, np.arange(len(T)), F)
            if now == int(now):
                places.append(x)
            v += STEP / fine * (F_now - DAMPING * v - STIFFNESS * x - friction * np.tanh(v / 1e-3)) / MASS
            x += STEP / fine * v
        place = np.array(places)
    else:
        system = [[0, 1], [-STIFFNESS / MASS, -DAMPING / MASS]], [[0], [1 / MASS]], [[1, 0]], [[0]]
        place = lsim(system, F, T)[1]
    place = place + SENSOR * np.random.default_rng(seed + 1).standard_normal(len(T))
    return tsm.Record("run", T, {"F": F + noise, "x": place}, {"F": "N", "x": "m"})


def slide():
    blocks = {
        "net": tsm.blocks.Sum(signs="+--"),
        "acceleration": tsm.blocks.Gain(gain=0.33, unit="m/s^2"),
        "speed": tsm.blocks.Integrator(),
        "place": tsm.blocks.Integrator(),
        "friction": tsm.blocks.ViscousFriction(coefficient=20.0),
        "spring": tsm.blocks.Gain(gain=350.0, unit="N"),
    }
    wires = [
        "net -> acceleration -> speed -> place",
        "speed -> friction -> net.minus1",
        "place -> spring -> net.minus2",
    ]
    return tsm.Diagram(
        blocks=blocks, wires=wires, inputs={"F": tsm.Inlet(["net.plus"], unit="N")}, outputs={"x": "place"}
    )


def base(record):
    return calibrate(slide(), {"run": record}, ModelSettings(None, {"x": SENSOR}, ("x",)))


def test_the_noise_of_an_input_is_found_in_the_residual():
    rms = 0.6
    model = base(recorded(slow_noise(rms, 3.0)))
    errors = {0: errors_of_inputs(model, 0, {"F": NoiseOfInput(0.06, 40.0)}, 500)}
    found = likelihood(model, errors)
    assert np.mean(model.differences**2) > 20
    assert found.square == pytest.approx(1.0, abs=0.1)
    assert found.noise["F"] * np.std(force()) == pytest.approx(rms, rel=0.3)


def test_the_likelihood_is_that_of_a_normal_distribution():
    """With little noise in the input its most likely spectrum is the least one, which is known."""
    model = base(recorded(0.0))
    noise = NoiseOfInput(0.01, 20.0)
    errors = {0: errors_of_inputs(model, 0, {"F": noise}, 200)}
    found, causes = likelihood(model, errors), errors[0]["F"].causes
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
    found = tsm.diagnose(slide(), recorded(slow_noise(0.6, 3.0), friction=2.0), effects=EFFECTS)
    assert [one.name for one in found.effects] == ["coulomb_friction"]
