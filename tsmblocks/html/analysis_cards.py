"""Cards of analyses: the frequency response of a diagram."""

from __future__ import annotations

import functools

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.common.views import no_view
from tsmblocks.html.card import card, rows, table_number

view = functools.singledispatch(no_view)


@view.register
def frequency_card(response: FrequencyResponse) -> str:
    """A frequency response: gain, phase and distortion at each frequency, for each amplitude."""
    columns = (response.gain, response.phase, 100 * response.distortion)
    cells = [
        [table_number(value) for value in (a, f, *(column[i, k] for column in columns))]
        for i, a in enumerate(response.amplitudes)
        for k, f in enumerate(response.frequencies)
    ]
    head = (f"amplitude of {response.driven}", "frequency [Hz]", "gain", "phase [deg]", "distortion [%]")
    return card(
        f"{response.title}: {response.output} / {response.driven}",
        "",
        rows(head, cells, "Response at each amplitude and frequency", most=40),
    )
