"""Fits: free parameters of a diagram found from recordings, with how well the recordings determine them.

How a fit works, in reading order: ``fit`` (the steps and the methods), ``setup`` (from a diagram and recordings to a
problem), ``parameters`` (what is free, with bounds), ``residuals`` (residuals and Jacobian of an experiment),
``gauss_newton`` (the search), ``summary`` (intervals and cautions).
"""
