"""Blocks and diagrams as values.

Reading order: ``fields`` (what a block declares), ``block`` (its equations), ``wires`` (the notation of connections),
``diagram`` (blocks and wires as one value); then what a diagram uses: ``validation``, ``unit_inference``, ``edits``.
"""
