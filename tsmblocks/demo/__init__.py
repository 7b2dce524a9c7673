"""The demonstration: the paper's experiments, then a mechanism in which an effect is hidden, from data to control."""
