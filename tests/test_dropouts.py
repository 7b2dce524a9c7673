"""Spikes and dropouts in recordings are told, and nothing that a mechanism does is taken for one."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.data.repair import dropouts, spikes
from tsmblocks.data.table import Table

T = np.arange(0.0, 20.0, 0.01)
CLEAN = 40 * np.sin(1.1 * T) + 20 * np.sin(2.6 * T)
NOISY = CLEAN + 0.2 * np.random.default_rng(0).standard_normal(len(T))


def notes(x):
    table = Table("run.csv", ("t", "x"), ("s", "deg"), np.column_stack([T, x]), np.arange(len(T)) + 2, (1, 2))
    return (*spikes(table), *dropouts(table))


def with_values(x, **places):
    made = x.copy()
    for place, value in places.items():
        a, _, b = place[1:].partition("_")
        made[int(a) : int(b or int(a) + 1)] = value
    return made


def test_spikes_are_told_with_their_rows():
    (words,) = notes(with_values(NOISY, k700=9999.0, k1500=-9999.0))
    assert words == (
        "x has 2 spikes (row 702: 9999, row 1502: -9999) far off all other samples, which are between "
        f"{NOISY.min():g} and {NOISY.max():g}. A true pulse may be that short. A false one affects all "
        "results: empty its cell, and it is interpolated."
    )


@pytest.mark.parametrize("value", [0.0, NOISY[1000], 70.0])
def test_a_sensor_that_drops_out_is_told(value):
    (words,) = notes(with_values(NOISY, k1000_1300=value))
    assert words == (
        f"x is constant at {value:g} from 10 s to 12.99 s (rows 1002 to 1301), and noisy elsewhere. Either it was "
        "at rest, or its sensor dropped out; then leave this time out: part, or --rows and --window."
    )


@pytest.mark.parametrize(
    "x",
    [
        NOISY,
        CLEAN,
        np.round(NOISY),
        np.clip(NOISY, -30, 30),
        np.where(T < 10, CLEAN, CLEAN[1000]),
        np.sign(CLEAN),
        with_values(np.zeros(len(T)), k500=1.0, k900=1.0),
        np.random.default_rng(1).standard_normal(len(T)) ** 3,
        NOISY + 300 * (np.abs(T - 10) < 2),
        0 * T,
        with_values(NOISY, k0=9999.0),
        np.cumsum(NOISY),
        with_values(NOISY, k100_110=NOISY[100]),
    ],
    ids=[
        "noisy",
        "clean",
        "rounded",
        "clipped",
        "held",
        "relay",
        "pulses",
        "tails",
        "step",
        "still",
        "first",
        "walk",
        "short",
    ],
)
def test_what_a_mechanism_does_is_no_fault(x):
    assert notes(x) == ()


def test_a_file_that_is_read_says_so(tmp_path):
    file = tmp_path / "run.csv"
    rows = "".join(f"{t:.2f},{x:.3f}\n" for t, x in zip(T, with_values(NOISY, k700=9999.0), strict=True))
    file.write_text("t [s],x [deg]\n" + rows, encoding="utf-8", newline="\n")
    (words,) = tsm.read(file).notes
    assert words.startswith("x has 1 spike (row 702: 9999) far off all other samples")
