"""Cards of analyses: answers to sines, and commands found by optimal control."""

from __future__ import annotations

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.html.card import card, listed, number, over_time, rows
from tsmblocks.optimal.result import OptimalControl


def frequency_card(found: FrequencyResponse) -> str:
    """Answers to sines: gain, phase and distortion at each frequency, for each amplitude."""
    cells = [
        (
            number(a),
            number(f),
            number(found.gain[i, k]),
            number(found.phase[i, k]),
            number(100 * found.distortion[i, k]),
        )
        for i, a in enumerate(found.amplitudes)
        for k, f in enumerate(found.frequencies)
    ]
    head = (f"size of {found.driven}", "frequency [Hz]", "gain", "phase [deg]", "distortion [%]")
    return card(f"{found.title}: {found.output} over {found.driven}", "", rows(head, cells, most=40))


def control_card(found: OptimalControl) -> str:
    """Commands found: what they leave of the error, and the run with them."""
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
