"""Which of the paper's three models fits best, and does the method of identification matter?  (Table 1)

The generalised model replaces the instrument; noise of 0.3 deg and encoders of 3600 counts make its signals
measurements (paper_bench.toml). Each model is fitted to the sine and validated on all three signals. The order of the
errors is that of the paper, as long as no offset is fitted: with one, the symmetric model is better than the proposed
one on the signals that were not fitted. The paper's errors are of a measured sine, and it gives no unit of them (here
times 1e4): only their order can be compared.
"""

from pathlib import Path

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import MultiSine

SIGNALS = {"sine": (56.0, [0.2]), "two sines": (28.0, [0.2, 0.5]), "no period": (28.0, [0.25, 0.25 * 3**0.5])}
PAPER = {"symmetric": 134.0, "proposed": 78.4, "generalised": 18.9}  # mean square errors of section 3.4, times 1e4
bench = tsm.load(Path(__file__).with_name("paper_bench.toml"))


def measured(name, size, tones):
    """Readings of the encoders at both ends; the input, whose rate drives the model, is filtered with zero phase."""
    sizes, phases = [np.deg2rad(size)] * len(tones), [0.0] * len(tones)
    driven = bench.replace("motor", MultiSine(amplitudes=sizes, frequencies=tones, phases=phases, unit="rad"))
    return tsm.simulate(driven, stop=20.0, step=2e-3, locate=True).record(name=name).filtered("x_in", cutoff=10.0)


records = [measured(name, *signal) for name, signal in SIGNALS.items()]
models = {
    "symmetric, Eqs (2)-(3)": tsm.load("tendon_sheath_symmetric"),
    "proposed, Eqs (8)-(9)": tsm.load("tendon_sheath_asymmetric"),
    "generalised, Eqs (4)-(6)": tsm.load("tendon_sheath_generalized"),
}

print(f"{'mean square error [1e-4 rad²]':34}", *(f"{name:>10}" for name in SIGNALS), f"{'paper':>11}")
for suffix, free in {"": ["tsm.*"], " + offset": ["tsm.*", "offset.bias"]}.items():
    for name, model in models.items():
        fit = tsm.fit(model, records[0], free=free)
        errors = [1e4 * one.rms**2 for one in tsm.score(fit.diagram, records)]
        paper = "" if suffix else f"{PAPER[name.split(',')[0]]:11.1f}"
        print(f"{name + suffix:34}", *(f"{error:10.3f}" for error in errors), paper)

print(f"\n{'proposed model by':20}", *(f"{name:>7}" for name in ("alpha1", "alpha2", "A", "theta", "delta")))
for method in ("gauss-newton", "ipopt", "ga"):
    fit = tsm.fit(models["proposed, Eqs (8)-(9)"], records[0], free=["tsm.*"], method=method)
    print(f"{method:20}", *(f"{e.value:7.3f}" for e in fit))
