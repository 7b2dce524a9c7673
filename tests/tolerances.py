"""Tolerance classes, with their reasons. Loosening one needs a sentence in the commit."""

EXACT = 1e-12
"""The same arithmetic in another order."""

BACKENDS = 1e-9
"""Two back ends on the same equations: rounding, carried along by a stable loop."""

INTEGRATION = 1e-6
"""A fixed step of 1 ms against an integrator at tight tolerance, in rad, away from kinks."""

PAPER_DEGREES = 0.006
"""Figures quoted with two decimals of a degree."""
