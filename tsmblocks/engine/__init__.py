"""The fixed-step engine. It receives equations and parameters, and imports neither blocks nor diagrams.

Reading order:

1. ``equations``: x' = f(t, x, d, u, q, p) and its outputs, as the compiler makes them; ``methods``: Runge-Kutta tables.
2. ``session``: one run, piece by piece; ``inputs``: sampled signals as rows; ``kernel``: the code that takes the steps.
3. ``plan`` and ``program``: the specification of a kernel; ``casadi_kernel``: one that can be read as Python.
4. The same as machine code: ``kernel_frame`` (loop, time, delays), ``register_kernel``, ``large_kernel``, ``llvm_ir``
   (scalar operations), ``jit`` (compilation and cache); ``backends`` chooses.

Apart from these: ``sensitivities`` (exact derivatives of a run); ``events``, ``zero_crossing`` and ``switches``
(switching instants located within a step).
"""
