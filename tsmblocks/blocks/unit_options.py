"""Descriptions (``about``) of options that give a port its unit, shared by several families of blocks."""

UNIT = "unit of the signal; empty means that of whatever it drives"
UNIT_IN = "unit of the input; empty means that of whatever drives it"
