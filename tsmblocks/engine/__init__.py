"""The fixed-step engine. It receives equations and numbers; it has never heard of blocks.

Reading order: ``methods`` (tables), ``session`` (one run), ``feeds`` (its inputs), ``plan`` and ``program`` (what a
kernel is written from), ``interpret`` (a kernel that can be read as Python), then ``kernel``, ``registers``, ``ir`` and
``jit`` (the same as machine code; ``chunks`` for large diagrams). Apart from these: ``tangents`` (derivatives of a run)
and ``events``, ``crossing``, ``switches`` (switching instants located).
"""
