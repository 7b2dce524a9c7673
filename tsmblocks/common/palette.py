"""Colours of charts and figures, each with one meaning, on white paper, on dark paper, and on either.

All are about 3:1 or more in contrast with their paper, and those of one chart apart for colour-blind readers. No
meaning rests on a colour alone: there is a label, a width or a dash too.
"""

from __future__ import annotations

ROLES = ("ink", "soft", "rule", "measured", "before", "after", "between", "floor")
"""What a colour means: text and zero lines, small print, grid; a measurement; a model before a change; the model that
was simulated, fitted or tuned; what lies between or is paler; the noise floor."""
TRACKING = ("input", "open", "forward", "feedback")
"""On pages: the motion of the motor; tracking without compensation, with feedforward, and with feedback."""
SERIES = ("c0", "c1", "c2", "c3", "c4", "c5")
"""Colours that only tell the signals of one chart apart."""
NOISE_OPACITY, BAND_OPACITY = 0.2, 0.2
"""Opacity of the band of the noise, in the colour of its floor, and of a band of quantiles in the first of SERIES."""
LIGHT = {
    "ink": "#1b1b1b",
    "soft": "#5b5b5b",
    "rule": "#d5d5d5",
    "measured": "#8a8a8a",
    "before": "#b84a06",
    "after": "#0a5fd0",
    "between": "#7f8ea6",
    "floor": "#0b7a4b",
    "input": "#1b1b1b",
    "open": "#a67c00",
    "forward": "#96123f",
    "feedback": "#4b3fa8",
    "c0": "#0a5fd0",
    "c1": "#b84a06",
    "c2": "#249f66",
    "c3": "#c37eb7",
    "c4": "#d08400",
    "c5": "#111111",
}
"""On white paper."""
DARK = {
    "ink": "#ececec",
    "soft": "#a9a9a9",
    "rule": "#3b3d3f",
    "measured": "#7d7d7d",
    "before": "#ff9a57",
    "after": "#62b5f2",
    "between": "#6c8fae",
    "floor": "#8fe388",
    "input": "#ececec",
    "open": "#d9b44a",
    "forward": "#d9577c",
    "feedback": "#a79bff",
}
"""On dark paper."""
EITHER = {
    "ink": "currentColor",
    "rule": "color-mix(in srgb,currentColor 22%,transparent)",
    "measured": "color-mix(in srgb,currentColor 50%,transparent)",
    "before": "#e87019",
    "after": "#0297ff",
    "between": "#8f9fae",
    "floor": "#72a163",
    "c0": "#0297ff",
    "c1": "#e87019",
    "c2": "#0f7262",
    "c3": "#d060b0",
    "c4": "#7d5c1e",
    "c5": "#7a49b3",
}
"""On the paper of a notebook, light or dark, whose ink is that of the page."""


def css_variables(colours: dict[str, str]) -> str:
    """A palette as declarations of CSS variables, with the bands in their opacity."""
    bands = {"noise": ("floor", NOISE_OPACITY), "band": ("c0", BAND_OPACITY)}
    clear = {k: f"{colours[name]}{round(255 * share):02x}" for k, (name, share) in bands.items() if name in colours}
    return ";".join(f"--{name}:{colour}" for name, colour in {**colours, **clear}.items())
