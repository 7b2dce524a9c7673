"""Metrics: expressions of signals, reduced to one number each. Nothing here knows diagrams or files."""
