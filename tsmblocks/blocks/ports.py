"""What options say of the units of ports: of sources, and of blocks that turn one unit into another."""

UNIT = "unit of the signal; empty means that of whatever it drives"
UNIT_IN = "unit of the input; empty means that of whatever drives it"
