"""Blocks and diagrams as values. Read ``fields``, ``block``, ``wires``, ``diagram``."""
