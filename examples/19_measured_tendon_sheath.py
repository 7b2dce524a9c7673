"""Which model fits a real instrument?  All that are shipped, on five bends of a measured tendon sheath.

A tracker measured the tip of a surgical instrument while its motors went through two sine cycles of 60 deg, with the
sheath bent by 0 to 240 deg. Models are compared twice: fitted to all samples, and fitted to the first half and
validated on the second; the last column is another run of the instrument, of three cycles. "Before" are figures of
earlier work, computed with the first of the rows that repeat a time; here their mean is used. Measured data: the
repository nhoyh/hysteresis_compensation_ROS (Nho, Baek and others, IEEE RA-L 2021), in the folder tendon_sheath/ of
the one that TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path
from textwrap import shorten

import tsmblocks as tsm

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit("Set TSMBLOCKS_DATA to a folder that holds tendon_sheath/ (of nhoyh/hysteresis_compensation_ROS).")
folder = Path(os.environ["TSMBLOCKS_DATA"]) / "tendon_sheath"
before = {
    "linear": [12.12, 11.53, 10.32, 8.42, 6.59],
    "play": [1.12, 1.36, 1.25, 0.95, 0.75],
    "symmetric": [0.82, 1.02, 1.01, 0.93, 1.10],
    "asymmetric": [2.41, 2.85, 2.87, 2.95, 2.64],
}
records = {}
for bend in (0, 60, 120, 180, 240):
    records[f"bend {bend}"] = tsm.read(folder / f"calib/{bend}.txt", columns="t, x_in [deg],, x_out [deg],,,,")
tracking = tsm.read(folder / "tracking/conf0_60.txt", columns="t, x_in [deg],,,, x_out [deg],,,,", tail="drop")
records["tracking"] = tracking.resampled(0.02)
for name, record in records.items():
    more = f" (and {len(record.notes) - 1} more)" if len(record.notes) > 1 else ""
    print(shorten(f"{name}: {record.notes[0]}", 79 - len(more), placeholder=" …") + more)

for title, train in {"fitted to all samples": 1.0, "fitted to the first half, validated on the second": 0.5}.items():
    print(f"\nrms error [deg], {title}\n{'':24}", *(f"{name:>8}" for name in records))
    comparisons = [tsm.compare(None, record, train=train) for record in records.values()]
    for model in sorted(
        (row.name for row in comparisons[0]), key=lambda name: max(c[name].figure for c in comparisons)
    ):
        if train == 1.0 and model in before:
            print(f"{model + ', before':24}", *(f"{figure:8.2f}" for figure in before[model]))
        errors = [(c[model].held_out or c[model].train).rms for c in comparisons]
        print(f"{model:24}", *(f"{57.29578 * error:8.2f}" for error in errors))
