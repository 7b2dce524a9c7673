"""HTML without scripts or network: notebook cards, charts, formulas, and the report of a diagnosis."""
