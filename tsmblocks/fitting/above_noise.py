"""Residuals relative to the noise of the recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError
from tsmblocks.data import Record
from tsmblocks.data.noise_floor import method_text, noise_of_recordings

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

FAR = 1.5
"""Error relative to the noise from which advice is given. Chosen."""
NEGLIGIBLE = 1e-4
"""Residual, as a share of the output's spread, up to which no advice is given: simulated outputs may have no noise.
Chosen."""


def output_noise(name: str, unit: str, records: Mapping[str, Record], inputs: Iterable[str]) -> tuple[float, str]:
    """Noise of an output, rms in ``unit``, and how it was estimated; NaN without an estimate."""
    try:
        return noise_of_recordings(records, name, unit, inputs)
    except DataError:  # too few samples
        return float("nan"), ""


def factor_text(ratio: float) -> str:
    """A ratio in two digits, or more where it is 100 or above."""
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"


def beyond_noise(fit: Fit) -> list[str]:
    """A caution for each output whose residual is far above the noise of the recordings."""
    if fit.status in ("interrupted", "limit"):
        return []
    said = []
    for name in dict.fromkeys(d.output for d in fit.differences):
        own = [d for d in fit.differences if d.output == name]
        rms = float(np.sqrt(np.mean(np.concatenate([d.residual for d in own]) ** 2)))
        spread = float(np.sqrt(np.mean(np.concatenate([d.measured - d.measured.mean() for d in own]) ** 2)))
        if not rms > NEGLIGIBLE * spread:
            continue
        noise, method = output_noise(name, own[0].unit, fit.records, fit.diagram.inports)
        if noise > 0 and rms >= FAR * noise:
            k, unit = units.display_unit(own[0].unit)
            size = f"{k * noise:.3g} {unit}".rstrip()
            held = "a bound or constraint prevents a better fit, or " if fit.active else ""
            said.append(
                f"The residual of {name} is {factor_text(rms / noise)} times the noise ({size} rms, "
                f"{method_text(method)}): {held}"
                "the model lacks an effect, and the intervals do not cover it. A diagnosis (tsm.diagnose, tsmblocks "
                "diagnose) searches for it."
            )
    return said
