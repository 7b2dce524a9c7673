"""One value of every class that offers a view of itself, and each of its views rendered.

Run as a program it does so for the package that is installed: ``python tests/views_everywhere.py``.
"""

import tempfile
from importlib import import_module

import numpy as np

import tsmblocks as tsm
from tsmblocks.analysis import frequency_response
from tsmblocks.blocks import PID, Play, Sine
from tsmblocks.common.views import PROVIDERS, view
from tsmblocks.studies import responses

T = np.arange(0.0, 6.0, 0.01)
X = 0.8 * np.sin(2 * T)
LOOP = tsm.load("fig16_feedforward_feedback")
OPTIONS = {
    ("report", "Diagnosis"): lambda: {"folder": tempfile.mkdtemp()},
    ("plot", "Responses"): lambda: {"signal": "x_out"},
}
"""Arguments without which a view cannot be made."""


def record(name="bend", gap=0.03, seed=1, **more):
    """Motion through a backlash gap, measured with noise of 0.002 rad."""
    gap = tsm.Diagram(
        blocks={"gap": Play(half_width=gap)}, inputs={"x_in": tsm.Inlet("gap.u", "rad")}, outputs={"x_out": "gap"}
    )
    run = tsm.simulate(gap, inputs={"x_in": (T, X)}, stop=T[-1], step=0.01)
    y = run["x_out"] + np.random.default_rng(seed).normal(0.0, 0.002, len(T))
    return tsm.Record(name, T, {"x_in": X, "x_out": y}, {"x_in": "rad", "x_out": "rad"}, **more)


def examples(name="bend"):
    """Values by a short key; titles, notes and experiments are called ``name``."""
    linear, measured = tsm.load("tendon_sheath_linear").rewire(title=name), record(name, notes=(name,), origin=name)
    fit = tsm.fit(linear, measured, starts=2)
    return {
        "run": tsm.simulate(LOOP.rewire(title=name), stop=2.0),
        "record": measured,
        "fit": fit,
        "differences": fit.differences,
        "comparison": tsm.compare({name: linear, "play": tsm.load("tendon_sheath_play")}, measured, starts=1),
        "diagnosis": tsm.diagnose(linear, {name: measured}, noise_floor=0.002, effects=["backlash", "drift"]),
        "study": tsm.study(LOOP, {"pid.kp": [0.5, 1.0, 2.0]}, {name: "rms(x_ref - x_out)"}, stop=1.0, title=name),
        "responses": responses(LOOP, {"pid.kp": [0.5, 1.0, 2.0]}, stop=1.0),
        "batch": tsm.simulate_batch(LOOP, {"pid.kp": [0.5, 1.0]}, stop=0.5),
        "reduced": tsm.simulate_batch(
            LOOP, {"pid.kp": np.linspace(0.5, 1.0, 50)}, stop=0.1, reduce=lambda t, y: {"last": y["x_out"][-1]}
        ),
        "tuned": tsm.tune({name: LOOP}, {"pid.kp": (0.5, 2.0)}, "rms(x_ref - x_out)", stop=1.0, starts=1),
        "control": tsm.optimal_control(
            tsm.load("motor_linear").rewire(title=name), {"u": (-24.0, 24.0)}, "0.5 - x", stop=0.2, step=0.02
        ),
        "frequencies": frequency_response(tsm.load("motor_linear").rewire(title=name), [1.0, 2.0], [0.1, 0.2]),
        "block": PID(kp=2.0),
        "source": Sine(unit="rad"),
        "diagram": LOOP,
    }


def registered():
    """(kind, class) of every view that there is, out of the providers."""
    for kind, modules in PROVIDERS.items():
        for module in sorted(set(modules.values())):
            yield from ((kind, cls) for cls in import_module(module).view.registry if cls is not object)


def rendered(values):
    """(kind, class name) -> view, of a value of every class; a class without a value is an AssertionError."""
    found = {}
    for kind, cls in registered():
        value = next((v for v in values if isinstance(v, cls)), None)
        assert value is not None, f"{__name__}.examples() has no {cls.__name__}, which has the view '{kind}'"
        options = OPTIONS.get((kind, cls.__name__), dict)()
        found[kind, cls.__name__] = view(kind, value, **options)
    return found


if __name__ == "__main__":
    made = rendered(list(examples().values()))
    assert all(shown is not None for shown in made.values())
    print(f"{len(made)} views, from {tsm.__file__}")
