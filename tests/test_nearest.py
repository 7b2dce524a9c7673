"""Of all values that fit alike, a fit and a diagnosis take those nearest to the diagram's own parameters."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import tsmblocks as tsm
from tsmblocks.blocks import Gain, TransferFunction
from tsmblocks.diagnosis.model import ModelSettings, calibrate, nearest
from tsmblocks.fitting.nearest import nearest_of
from tsmblocks.fitting.optimizer import OptimizerResult
from tsmblocks.fitting.setup import pose

T = np.arange(0, 20, 0.02)
NOISE = 0.003
SHEATH = tsm.load("tendon_sheath_asymmetric")
TOLD = SHEATH.with_parameters({"tsm.delta": 0.05, "tsm.theta": 4.0})
TWICE = tsm.load("tendon_sheath_linear").insert("again", Gain(gain=0.7), before="gain.u")


def recorded(diagram, each):
    rng, made = np.random.default_rng(1), {}
    for k, own in enumerate(each):
        x = 0.5 * np.sin(1.1 * T + k) + 0.2 * np.sin(3 * T) + 0.3 * (k - 1)
        run = tsm.simulate(diagram.with_parameters(own), inputs={"x_in": (T, x)}, stop=T[-1], step=0.02, hold="cubic")
        y = run["x_out"] + rng.normal(0, NOISE, T.size)
        made[f"r{k}"] = tsm.Record(f"r{k}", T, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


BENDS = recorded(SHEATH, [{"tsm.delta": 0.09, "tsm.zeta": zeta} for zeta in (-0.1, 0.0, 0.1)])
LINEAR = recorded(TWICE, [{"gain.gain": 2.0, "again.gain": 0.5}])


def nearest_gains(product):
    """Gains of a given product nearest to the diagram's, in shares of these: found by one number alone."""
    g, a = (TWICE.parameters[k] for k in ("gain.gain", "again.gain"))
    found = minimize_scalar(
        lambda one: (one / g - 1) ** 2 + (product / one / a - 1) ** 2,
        bounds=(0.2, 5),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return found.x, product / found.x


@pytest.mark.parametrize(("starts", "seed"), [(1, 0), (4, 0), (4, 3)])
def test_gains_in_series_stay_nearest_to_the_diagram(starts, seed):
    fit = tsm.fit(TWICE, LINEAR, starts=starts, seed=seed)
    gains = fit["gain.gain"].value, fit["again.gain"].value
    assert gains == pytest.approx(nearest_gains(np.prod(gains)), rel=1e-3)
    assert fit.differences.rms == pytest.approx(NOISE, rel=0.05)
    (said,) = (u.words for u in fit.undetermined)
    assert said.endswith("Of values that fit equally well, those closest to the diagram's own are reported.")


def test_values_nearest_to_the_diagram_stay_within_bounds():
    free = tsm.fit(TWICE, LINEAR)
    fit = tsm.fit(TWICE, LINEAR, bounds={"again.gain": (0.1, 0.72)})
    assert free["again.gain"].value > 0.72
    assert fit["again.gain"].value == pytest.approx(0.72)
    assert fit.differences.rms == pytest.approx(free.differences.rms, rel=1e-9)


@pytest.mark.parametrize(("starts", "seed"), [(1, 0), (4, 0), (4, 5)])
def test_offsets_of_the_papers_model_stay_nearest_to_the_diagram(starts, seed):
    fit = tsm.fit(TOLD, BENDS, start_states=True, starts=starts, seed=seed, hold="cubic")
    assert fit.differences.rms == pytest.approx(NOISE, rel=0.05)
    c = (fit["tsm.delta"].value - 0.09) / fit["tsm.theta"].value  # by how much the direction was followed
    assert fit["offset.bias"].value == pytest.approx(-c, abs=2e-3)
    # no step along the direction comes nearer, the offset in shares of what moves the outputs by their own size
    size = np.sqrt(np.mean([np.mean(r["x_out"] ** 2) for r in BENDS.values()]))
    slope = fit["offset.bias"].value / size**2 - fit["tsm.theta"].value * (fit["tsm.delta"].value - 0.05) / 0.05**2
    assert slope == pytest.approx(0.0, abs=0.05)
    assert abs(fit["tsm.delta"].value - 0.05) < 1e-3


def test_a_diagnosis_calibrates_to_the_same_values():
    fit = tsm.fit(TOLD, BENDS, start_states=True, hold="cubic")
    model = calibrate(TOLD, BENDS, ModelSettings(None, {"x_out": NOISE}, ("x_out",)))
    for name, value in model.parameters().items():
        assert value == pytest.approx(fit[name].value, rel=1e-3, abs=1e-4)


def test_what_the_data_determine_stays_as_it_is():
    problem, setup = pose(TOLD, BENDS)  # initial states are fixed, so nothing is left open
    ends = [OptimizerResult(problem.unknowns.start, 1.0, "converged", 0, 0)]
    assert nearest_of(problem, setup, ends) == ends


def test_coefficients_of_a_transfer_function_keep_the_size_of_the_diagrams_own():
    """Of those that are zero in the diagram a smaller common factor is nearer, and it went to 1e-6 of all."""
    arm = tsm.Diagram(
        blocks={"arm": TransferFunction(num=(1.0, 0.0, 0.0), den=(1.0, 2.0, 400.0))},
        inputs={"u": tsm.Inlet("arm", unit="Nm")},
        outputs={"a": "arm"},
    )
    true = arm.with_parameters({"arm.num": (0.2, 0.5, -150.0), "arm.den": (1.0, 1.0, 440.0)})
    u = np.sin(1.1 * T) + np.sin(14 * T + 1) + np.sin(25 * T)
    a = tsm.simulate(true, inputs={"u": (T, u)}, step=0.005, hold="cubic")
    y = np.interp(T, a.t, a["a"]) + np.random.default_rng(0).normal(0, NOISE, T.size)
    record = tsm.Record("arm", T, {"u": u, "a": y}, {"u": "Nm", "a": ""})
    fit = tsm.fit(arm, record, free=["arm.num*", "arm.den*"], starts=1, hold="cubic")
    found = np.array([fit[f"arm.{k}"].value for k in ("num[0]", "num[1]", "num[2]", "den[0]", "den[1]", "den[2]")])
    np.testing.assert_allclose(found / found[-1] * 440, (0.2, 0.5, -150.0, 1.0, 1.0, 440.0), rtol=0.05, atol=0.1)
    assert 200 < found[-1] < 800


def test_a_diagnosis_takes_those_nearest_to_the_diagram_wherever_its_search_began():
    """With an effect in the model it begins at the fitted base, which is not the diagram's own."""
    elsewhere = TWICE.with_parameters({"gain.gain": 3.0, "again.gain": 0.4})
    settings = ModelSettings(("gain.gain", "again.gain"), {"x_out": NOISE}, ("x_out",), False)
    model = calibrate(elsewhere, LINEAR, settings)
    found = nearest(model, TWICE.parameters)
    gains = [found.values[k] for k in ("gain.gain", "again.gain")]
    product = model.values["gain.gain"] * model.values["again.gain"]
    assert gains[0] * gains[1] == pytest.approx(product, rel=1e-6)
    assert gains == pytest.approx(nearest_gains(product), rel=1e-3)
    assert model.values["gain.gain"] != pytest.approx(gains[0], rel=0.05)
