"""Metrics: expressions of signals, reduced to one number each. Nothing here knows diagrams or files.

Reading order: ``expressions`` (texts of arithmetic), ``reductions`` (signal to number), ``metrics`` (both together);
``tracking`` has the errors of the paper.
"""
