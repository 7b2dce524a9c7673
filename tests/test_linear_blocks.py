"""Every linear block against python-control's own simulation of its transfer function."""

import control as ct
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import blocks as b

S, T = ct.tf("s"), 0.01
Z = ct.tf([1, 0], [1], dt=T)
CONTINUOUS = {
    "Gain": (b.Gain(gain=-2.5), ct.tf([-2.5], [1])),
    "Integrator": (b.Integrator(gain=3.0), 3 / S),
    "FirstOrderLag": (b.FirstOrderLag(gain=2.0, time_constant=0.3), 2 / (0.3 * S + 1)),
    "SecondOrderLag": (b.SecondOrderLag(gain=2.0, omega=7.0, zeta=0.3), 2 * 49 / (S**2 + 2 * 0.3 * 7 * S + 49)),
    "FilteredDerivative": (b.FilteredDerivative(time_constant=0.05), S / (0.05 * S + 1)),
    "TransferFunction": (b.TransferFunction(num=(1, 2), den=(2, 3, 4)), (S + 2) / (2 * S**2 + 3 * S + 4)),
    "ZeroPoleGain": (
        b.ZeroPoleGain(zeros=[-10], poles=[-20], pole_pairs=[[-3, 4]], gain=50),
        50 * (S + 10) / ((S + 20) * ((S + 3) ** 2 + 16)),
    ),
    "StateSpace": (
        b.StateSpace(A=[[0, 1], [-100, -2]], B=[[0], [100]], C=[[1, 0]]),
        ct.ss([[0, 1], [-100, -2]], [[0], [100]], [[1, 0]], [[0]]),
    ),
    "LeadLag": (b.LeadLag(gain=2.0, lead=0.1, lag=0.02), 2 * (0.1 * S + 1) / (0.02 * S + 1)),
    "PID": (b.PID(kp=1.5, ki=2.0, kd=0.3, tau=0.05), 1.5 + 2 / S + 0.3 * S / (0.05 * S + 1)),
    "MotorTransferFunction": (b.MotorTransferFunction(), 2 / (S * (0.02 * S + 1))),
    "Creep": (b.Creep(share=0.3, time_constant=0.4), 1 + 0.3 / (0.4 * S + 1)),
    "BroadCreep": (
        b.BroadCreep(share=0.4, fastest=0.05, slowest=0.4),
        1 + 0.1 * (1 / (0.05 * S + 1) + 1 / (0.1 * S + 1) + 1 / (0.2 * S + 1) + 1 / (0.4 * S + 1)),
    ),
    "Resonance": (b.Resonance(share=0.6, omega=7.0, zeta=0.3), 0.4 + 0.6 * 49 / (S**2 + 2 * 0.3 * 7 * S + 49)),
    "Resonance fed through": (
        b.Resonance(share=0.6, omega=7.0, zeta=0.3, feed=0.4),
        0.4 + 0.6 * (0.4 * 2 * 0.3 * 7 * S + 49) / (S**2 + 2 * 0.3 * 7 * S + 49),
    ),
    "Derivative": (b.Derivative(), None),
}
SAMPLED = {
    "ZeroOrderHold": (b.ZeroOrderHold(period=T), ct.tf([1], [1], dt=T)),
    "UnitDelay": (b.UnitDelay(period=T), 1 / Z),
    "DiscreteTransferFunction": (
        b.DiscreteTransferFunction(num=(0.2, 0.1), den=(1, -1.5, 0.7), period=T),
        ct.tf([0.2, 0.1], [1, -1.5, 0.7], dt=T),
    ),
    "DiscreteStateSpace": (
        b.DiscreteStateSpace(A=[[0.9]], B=[[0.1]], C=[[1]], period=T),
        ct.ss([[0.9]], [[0.1]], [[1]], [[0]], dt=T),
    ),
    "DiscreteIntegrator": (b.DiscreteIntegrator(gain=2.0, period=T), None),
    "MovingAverage": (b.MovingAverage(length=3, period=T), (1 + 1 / Z + 1 / Z**2) / 3),
}


def response(block, t, u, step):
    port = next(iter(block.inports))
    diagram = tsm.Diagram(title="alone", blocks={"b": block}, inputs={"u": f"b.{port}"}, outputs={"y": "b.y"})
    return tsm.simulate(diagram, inputs={"u": (t, u)}, step=step, hold="linear")["y"]


@pytest.mark.parametrize("name", CONTINUOUS)
def test_continuous(name):
    block, system = CONTINUOUS[name]
    t = np.linspace(0, 3, 3001)
    u = np.sin(3 * t) + 0.5 * np.cos(11 * t)
    ours = response(block, t, u, 1e-3)
    if system is None:  # a pure derivative is no proper system; of samples joined by lines it is their slope
        assert np.abs(ours[:-1] - np.diff(u) / np.diff(t)).max() < 1e-9
        return
    theirs = np.asarray(ct.forced_response(ct.ss(system), t, u).outputs)
    assert np.abs(ours - theirs).max() < 1e-7 * max(1.0, np.abs(theirs).max())


@pytest.mark.parametrize("name", SAMPLED)
def test_sampled(name):
    block, system = SAMPLED[name]
    t = np.arange(200) * T
    u = np.random.default_rng(4).standard_normal(200)
    ours = response(block, t, u, T)
    if system is None:
        system = {"forward": 2 * T / (Z - 1), "backward": 2 * T * Z / (Z - 1), "trapezoidal": T * (Z + 1) / (Z - 1)}[
            block.method
        ]
    theirs = np.asarray(ct.forced_response(ct.ss(system), t, u).outputs)
    assert np.abs(ours - theirs).max() < 1e-10


def test_no_linear_block_is_left_out():
    """Linear means: outputs, rates and updates have second derivatives of zero in states and inputs."""
    from tests.linearity import is_linear

    linear = {n for n in b.__all__ if isinstance(getattr(b, n), type) and is_linear(getattr(b, n)())}
    arithmetic = {
        "Sum",
        "Convert",
        "Bias",
        "GainError",
        "ViscousFriction",
        "SensorNoise",
        "Drift",
        "Jump",
        "SettlingOffset",
        "TemporaryOffset",
        "Disturbance",
    }
    # held against closed forms in test_engine, test_lateness and test_transmission
    elsewhere = {"Delay", "DeadTime", "ParallelResonance"}
    steps = {
        "Sign",
        "Quantiser",
        "Encoder",
        "Comparison",
        "Logic",
        "Enable",
    }  # flat between jumps, so without slopes; not linear
    limited = {"Integrator"}  # linear between its limits, which are infinite here
    assert (
        linear - arithmetic - elsewhere - steps == ({k.partition(" ")[0] for k in CONTINUOUS} | set(SAMPLED)) - limited
    )
