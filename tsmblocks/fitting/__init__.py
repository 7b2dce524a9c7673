"""Fits: free parameters of a diagram estimated from recordings, with confidence intervals.

How a fit works, in reading order: ``fit`` (the steps and the methods), ``setup`` (from a diagram and recordings to a
problem), ``parameters`` (free parameters, with bounds), ``parameter_vector`` (what follows from their values),
``residuals`` (residuals and Jacobian of an experiment), ``gauss_newton`` (the search), ``summary`` (intervals and
cautions).
"""
