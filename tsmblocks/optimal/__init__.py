"""What the best controller could do: commands found by optimal control, all at once or sample by sample."""
