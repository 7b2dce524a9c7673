"""A page with the names that blocks have in other programs."""

from __future__ import annotations

from tsmblocks.model.aliases import OTHER_NAMES
from tsmblocks.reference import rst

BEYOND = (
    ("Subsystem, Model reference", "a diagram as a block", "/howto/subsystem"),
    ("MATLAB Function, Fcn, S-Function", "a block of your own", "/tutorials/block"),
    ("Scope, To Workspace", "``run.plot``, ``run[name]``", "/howto/plot"),
    ("In, Out, Inport, Outport", "``inputs`` and ``outputs`` of a diagram", "/getting_started"),
    ("connect, interconnect, DiagramBuilder", "``blocks`` and ``wires`` of a diagram", "/getting_started"),
    ("step, impulse, lsim, stepinfo", "``tsm.simulate``, ``tsm.measure``", "/howto/response"),
    ("Solver, Step size, ode4", "``method`` and ``step`` of a run", "/howto/step"),
    ("linmod, Linear Analysis", "``tsm.linearize``, ``tsm.analysis.loop_gain``", "/howto/bode"),
    ("trim, findop", "``tsm.trim``", "/howto/continue"),
    ("parsim, Parameter sweep", "``tsm.study``", "/howto/study"),
    ("Parameter Estimation", "``tsm.fit``", "/howto/fit"),
    ("PID Tuner, Response Optimization", "``tsm.tune``", "/howto/tune"),
    ("Embedded Coder", "``tsm.export.to_c``", "/howto/export_c"),
    ("Mux, Demux, Bus", "none: each signal is a wire of its own", "/concepts/overview"),
)
"""Names of what is no block, what is used here, and the page."""


def pages() -> dict[str, str]:
    """The page by its path."""
    names = sorted((other, block) for block, some in OTHER_NAMES.items() for other in some)
    rows = [(rst.plain(other), rst.link(f"/blocks/{block}", block)) for other, block in names]
    page = rst.page(
        rst.heading("Find a block under its Simulink name"),
        rst.indexed(
            ("Other names", "Names in Simulink", "Migrate from Simulink", "Coming from Simulink", "Mux", "Bus")
        ),
        "Many blocks have the names of the field. Where another program uses another one, this table leads to the "
        "block; so do the search, and the message where a name is unknown.",
        rst.table(("There", "Here"), rows, (60, 40)),
        rst.heading("Beyond blocks", 1),
        rst.table(("There", "Here", "Page"), [(a, b, rst.link(c)) for a, b, c in BEYOND], (36, 36, 28)),
    )
    return {"howto/names": page}
