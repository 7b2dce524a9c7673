"""What if the data do not identify a parameter?  The fit names it; further information has to settle it.

The symmetric Bouc-Wen model has one parameter too many: its state can be scaled. And an instrument that is only
pulled, never released, has no data on how its two directions differ: that takes a further experiment.
"""

from textwrap import fill

import numpy as np

import tsmblocks as tsm

t = np.linspace(0.0, 10.0, 2001)
swing = 0.97 * np.sin(0.4 * np.pi * t)
pull = 0.97 * (1 - np.cos(0.1 * np.pi * t)) / 2


def measured(model, x_in, seed):
    """The output of a model with 0.3 deg of noise."""
    x_out = tsm.simulate(model, step=5e-3, inputs={"x_in": x_in})["x_out"]
    x_out += np.random.default_rng(seed).normal(0.0, 0.005, len(t))
    return tsm.Record("measured", t, {"x_in": x_in, "x_out": x_out}, {"x_in": "rad", "x_out": "rad"})


def print_estimates(title, fit, *names):
    """One row of values, each with half its interval."""
    values = [f"{name} {fit[name].value:6.3f} ± {(fit[name].high - fit[name].low) / 2:.3f}" for name in names]
    print(f"  {title:20}", *values, sep="  ")


model = tsm.load("tendon_sheath_symmetric")
record = measured(model, swing, seed=1)
fit = tsm.fit(model, record, free=["tsm.*"], starts=1)
print(*(fill(u.words, 79) for u in fit.undetermined), sep="\n")
fixed = tsm.fit(model, record, free=["tsm.alpha_x", "tsm.A", "tsm.beta", "tsm.gamma", "tsm.n"])
print_estimates("alpha_zeta fixed", fixed, "A")
print_estimates("alpha_zeta tied to A", tsm.fit(model, record, free=["tsm.*"], ties={"alpha_zeta": "-A / 2"}), "A")
print_estimates("a constraint", tsm.fit(model, record, free=["tsm.*"], constraints="alpha_zeta == 1"), "A")
print_estimates(
    "a prior", tsm.fit(model, record, free=["tsm.*"], priors={"tsm.alpha_zeta": (0.65, 0.02)}), "A", "alpha_zeta"
)

model = tsm.load("tendon_sheath_asymmetric")
pulled, swung = measured(model, pull, seed=2), measured(model, swing, seed=3)
fit = tsm.fit(model, pulled, free=["tsm.*"], starts=1)
print(*(fill(u.words, 79) for u in fit.undetermined), sep="\n")
fixed = tsm.fit(model.with_parameters({"tsm.delta": 0.0}), pulled, free=["tsm.alpha*", "tsm.A", "tsm.theta"])
print_estimates("delta fixed at zero", fixed, "A")
print_estimates("both directions", tsm.fit(model, [pulled, swung], free=["tsm.*"]), "A", "delta")
