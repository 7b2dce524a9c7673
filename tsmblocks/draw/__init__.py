"""Block diagrams as pictures: one layout, on paper as SVG, PNG or PDF; Mermaid text. No outside program."""

from tsmblocks.draw.compose import layout
from tsmblocks.draw.mermaid import to_mermaid
from tsmblocks.draw.picture import Arrow, Box, Label, Picture, Wire
from tsmblocks.draw.printed import to_pdf, to_png
from tsmblocks.draw.svg import to_svg

__all__ = ["Arrow", "Box", "Label", "Picture", "Wire", "layout", "to_mermaid", "to_pdf", "to_png", "to_svg"]
