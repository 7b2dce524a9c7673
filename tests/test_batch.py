"""Many runs in lanes against single runs; exact derivatives against central differences."""

import numpy as np
import pytest

import tsmblocks as tsm
from tests.derivatives import JUMPS, SMOOTH
from tests.test_engine import everything, inputs_for
from tests.tolerances import BACKENDS


def central(diagram, name, outputs, size, **options):
    """Central differences with one Richardson step, so that their own error is of fourth order."""
    value = diagram.parameters[name]
    step = size * max(abs(value), 0.1)

    def slope(e):
        up, down = (tsm.simulate(diagram, parameters={name: value + s * e}, **options) for s in (1, -1))
        return np.column_stack([(up[k] - down[k]) / (2 * e) for k in outputs])

    return (4 * slope(step / 2) - slope(step)) / 3


@pytest.mark.parametrize("name", sorted(SMOOTH))
def test_gradients_equal_central_differences(name):
    diagram = tsm.load(name)
    # an amplitude whose velocity is never exactly zero on a step: at a kink every method picks a side
    t = np.arange(0, 4.0005, 1e-3)
    inputs = {k: tsm.Samples(t, 0.9 * np.sin(1.3 * t + 0.2), "cubic") for k in diagram.inputs}
    if "ref" in diagram.blocks:
        diagram = diagram.with_parameters({"ref.frequency": 0.213, "ref.phase": 0.2})
    diagram = diagram.untied(SMOOTH[name])
    options = {"stop": 4.0, "inputs": inputs}
    found = tsm.sensitivities(diagram, SMOOTH[name], **options)
    for j, parameter in enumerate(SMOOTH[name]):
        best = []
        for size in (1e-3, 1e-4, 1e-5, 1e-7):  # a difference has an error of its own, least at a size that varies
            expected = central(diagram, parameter, found.signals, size, **options)
            scale = max(1.0, np.abs(expected).max())
            share = np.abs(found.jacobian[:, :, j] - expected).max(axis=1) / scale
            # a difference across a kink that moves with the parameter is itself of first order: a few instants
            best.append((np.quantile(share, 0.99), share.max()))
        assert min(best)[0] < 1e-6, parameter
        assert min(best)[1] < 1e-3 or name in JUMPS, parameter


def test_sensitivities_carry_the_run_itself():
    diagram = tsm.load("fig09b_feedforward")
    found = tsm.sensitivities(diagram, ["theta"], stop=5.0)
    run = tsm.simulate(diagram, stop=5.0)
    for k, name in enumerate(found.signals):
        assert np.abs(found.y[:, k] - run[name]).max() < BACKENDS


def test_more_parameters_than_lanes():
    diagram = tsm.load("fig16_feedforward_feedback")
    names = [k for k in tsm.equations(diagram).p if not k.startswith("ref.")]
    many = tsm.sensitivities(diagram, names * 2, outputs=["x_out"], stop=0.5)
    few = tsm.sensitivities(diagram, names[:3], outputs=["x_out"], stop=0.5)
    assert many.jacobian.shape == (501, 1, 2 * len(names))
    assert np.abs(many.jacobian[:, :, :3] - few.jacobian).max() < BACKENDS
    assert np.array_equal(many.jacobian[:, :, : len(names)], many.jacobian[:, :, len(names) :])


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("sets", [1, 2, 7, 33])
def test_a_batch_equals_single_runs(backend, sets):
    diagram = everything()
    rng = np.random.default_rng(1)
    values = {
        "lag.time_constant": rng.uniform(0.1, 0.3, sets),
        "delay.time": rng.uniform(0.002, 0.4, sets),
        "tsm.theta": rng.uniform(2, 8, sets),
        "play.half_width": rng.uniform(0.05, 0.2, sets),
        "pid.kp": rng.uniform(0.5, 1.5, sets),
    }
    batch = tsm.simulate_batch(diagram, values, stop=0.6, backend=backend)
    assert batch["y"].shape == (sets, 601)
    for k in {0, sets // 2, sets - 1}:
        run = tsm.simulate(diagram, stop=0.6, parameters={name: v[k] for name, v in values.items()})
        for name in run.aliases:
            assert np.abs(batch[name][k] - run[name]).max() < BACKENDS, name


def test_a_reduction_sees_every_set_once_and_threads_do_not_matter():
    diagram = tsm.load("tendon_sheath_asymmetric")
    theta = np.linspace(3, 7, 100)

    def reduce(t, y):
        return {"ptp": np.ptp(y["x_out"], axis=0), "last": y["x_out"][-1]}

    one, four = (
        tsm.simulate_batch(diagram, {"tsm.theta": theta}, inputs=inputs_for(diagram, 5.0), reduce=reduce, threads=n)
        for n in (1, 4)
    )
    assert one["ptp"].shape == (100,)
    assert np.array_equal(one["ptp"], four["ptp"])
    run = tsm.simulate(diagram, inputs=inputs_for(diagram, 5.0), parameters={"tsm.theta": theta[41]})
    assert one["ptp"][41] == pytest.approx(np.ptp(run["x_out"]), abs=1e-10)
    assert not one.failed.any()


def test_an_unstable_set_is_marked_and_harms_no_other():
    diagram = tsm.load("fig09a_without_feedforward")
    batch = tsm.simulate_batch(diagram, {"controller.kp": [60.0, 1e300, 30.0]}, stop=2.0)
    good = tsm.simulate(diagram, stop=2.0, parameters={"controller.kp": 30.0})
    assert np.abs(batch["x_out"][2] - good["x_out"]).max() < BACKENDS
    assert list(batch.failed) == [False, bool(~np.isfinite(batch["x_out"][1]).all()), False]


def test_a_frame_of_results():
    pytest.importorskip("pandas", reason="pip install 'tsmblocks[data]'")
    batch = tsm.simulate_batch(
        tsm.load("fig09a_without_feedforward"),
        {"controller.kp": [40.0, 60.0]},
        stop=1.0,
        reduce=lambda t, y: {"error": np.ptp(y["x_ref"] - y["x_out"], axis=0)},
    )
    frame = batch.to_pandas()
    assert list(frame.columns) == ["controller.kp", "error"]
    assert len(frame) == 2
