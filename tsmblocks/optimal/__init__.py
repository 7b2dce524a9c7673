"""Optimal control: the commands with the smallest error within limits, over the whole run or a receding horizon.

Reading order: ``control`` (the searches), ``setup`` (arguments), ``transcription`` (the nonlinear programme),
``smoothing`` (equations without kinks), ``result``; ``receding_horizon`` uses the same parts sample by sample.
"""
