"""Runs of a diagram: arguments, one run, batches, stepping sample by sample, saved states, stability of the step."""
