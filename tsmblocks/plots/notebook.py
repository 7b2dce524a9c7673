"""The figure that a notebook shows where a cell ends with it. Imported when a figure is made: it needs matplotlib."""

import io

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure with a picture of itself, which a notebook shows before any backend of pyplot is set up."""

    def _repr_png_(self) -> bytes:
        """The figure as a PNG file."""
        made = io.BytesIO()
        self.savefig(made, format="png")
        return made.getvalue()
