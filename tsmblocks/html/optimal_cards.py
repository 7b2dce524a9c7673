"""Cards of commands found by optimal control."""

from __future__ import annotations

import functools

from tsmblocks.common.views import no_view
from tsmblocks.html.card import card, listed, over_time
from tsmblocks.optimal.result import OptimalControl

view = functools.singledispatch(no_view)


@view.register
def control_card(found: OptimalControl) -> str:
    """Commands found: the error with them, and the run."""
    run = found.run
    names = list(dict.fromkeys([*run.aliases, *(name for name in found.commands if name in run)]))
    signals = {name: (run[name], run.unit(name)) for name in names}
    said = [] if found.found else [f"The search did not end where nothing nearby is better: {found.word}."]
    return card(
        str(found).partition(" (not the end")[0],
        f"{len(found.t)} samples of {', '.join(found.commands)}",
        over_time(run.t, signals, "over time, with the commands found"),
        listed(said),
    )
