"""Block diagrams as pictures: one layout, on paper as SVG, PNG or PDF; Mermaid text. No outside program."""

import functools

from tsmblocks.common.views import no_view
from tsmblocks.draw.annotations import nested
from tsmblocks.draw.compose import layout
from tsmblocks.draw.mermaid import to_mermaid
from tsmblocks.draw.printed import to_pdf, to_png
from tsmblocks.draw.svg import to_svg
from tsmblocks.model.diagram import Diagram

view = functools.singledispatch(no_view)
view.register(Diagram, to_svg)

__all__ = ["layout", "nested", "to_mermaid", "to_pdf", "to_png", "to_svg"]
