"""Colours as people see them: contrast by the accessibility guidelines, and distance where a cone is missing."""

import re

import numpy as np

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""Linear sRGB to CIE XYZ (IEC 61966-2-1)."""
VISION = {
    "usual": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""What is seen of linear sRGB (Machado, Oliveira and Fernandes 2009, severity 1)."""


def themes(css):
    """The colours of a style sheet by name, for light and for dark screens."""
    found = [
        dict(re.findall(r"--([\w-]+):(#[0-9a-f]{3,6})(?![0-9a-f])", one)) for one in re.findall(r":root\{(.*?)\}", css)
    ]
    light, dark = (one for one in found if one)
    return {"light": light, "dark": {**light, **dark}}


def linear(colour):
    digits = colour.lstrip("#")
    digits = "".join(2 * c for c in digits) if len(digits) == 3 else digits
    parts = np.array([int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)])
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def contrast(one, two):
    """Contrast ratio of WCAG 2.1."""
    low, high = sorted(float(TO_XYZ[1] @ linear(colour)) for colour in (one, two))
    return (high + 0.05) / (low + 0.05)


def distance(one, two, vision="usual"):
    """Distance of two colours in CIELAB (CIE 1976), about 2.3 of which are just noticeable."""
    return float(np.linalg.norm(lab(one, vision) - lab(two, vision)))


def lab(colour, vision="usual"):
    """Lightness, red over green, yellow over blue in CIELAB, for white of D65."""
    seen = np.clip(VISION[vision] @ linear(colour), 0, 1)
    x, y, z = (v / 0.008856 * (16 / 116 - 4 / 29) + 4 / 29 if v <= 0.008856 else v ** (1 / 3) for v in _relative(seen))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def _relative(seen):
    return TO_XYZ @ seen / (TO_XYZ @ np.ones(3))
