"""Cards of commands found by optimal control."""

from __future__ import annotations

import functools

import attrs

from tsmblocks.common.views import no_view
from tsmblocks.html.card import card, listed, over_time
from tsmblocks.optimal.result import OptimalControl

view = functools.singledispatch(no_view)


@view.register
def control_card(control: OptimalControl) -> str:
    """Commands found: the error with them, and the run."""
    run = control.run
    names = list(dict.fromkeys([*run.aliases, *(name for name in control.commands if name in run)]))
    signals = {name: (run[name], run.unit(name)) for name in names}
    notes = [] if control.found else [f"The search did not converge to a local optimum: {control.word}."]
    return card(
        str(attrs.evolve(control, found=True)),
        f"{len(control.t)} samples of {', '.join(control.commands)}",
        over_time(run.t, signals, "over time, with the commands found"),
        listed(notes),
    )
