"""Runs of a diagram: arguments, one run, batches, sensitivities, stepping sample by sample, saved states.

Reading order: ``simulate`` (one run) with ``arguments``, ``compiled`` (equations of a diagram) and ``run`` (its
result); ``batch`` and ``sensitivities`` (many runs in ``lanes``); ``stepper``. Apart from these: ``stability`` (the
warning of a step too long for the poles) and ``step_check`` (of one too long for the run, with ``repeated_steps`` and
``step_advice``), ``divergence`` (the error of a run that diverges), ``saved_state``.
"""
