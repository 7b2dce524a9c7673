"""Blocks and diagrams as values.

Reading order: ``fields`` (what a block declares), ``block`` (its equations), ``wires`` (the notation of connections),
``diagram`` (blocks and wires as one value). ``values`` and ``block_class`` serve a block: numbers as they are kept and
checked, and what its class may declare. The others serve a diagram: ``arguments`` (what it is given, and what that
means), ``validation``, ``unit_inference``, ``parameters`` (by name), ``edits`` (of blocks and wires).
"""
