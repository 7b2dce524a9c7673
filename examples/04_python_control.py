"""How does backlash change the Bode plot of a loop designed with python-control?

A motor as ``control.tf`` and a lead compensator as ``control.ss`` go into a diagram unchanged, together with the
saturation of the drive and the backlash of the gear. Without backlash the response to sines is that of
python-control; with it, the response depends on their amplitude. A folder given as an argument receives the Bode
plot.
"""

import sys
from pathlib import Path

import control
import numpy as np

import tsmblocks as tsm
from tsmblocks.analysis import frequency_response
from tsmblocks.blocks import Play, Saturation, Sum

motor = control.tf([2.0], [0.02, 1.0, 0.0], inputs="u [V]", outputs="x [rad]")
lead = control.ss(control.tf([0.3, 6.0], [0.005, 1.0]), inputs="e [rad]", outputs="u [V]")
loop = tsm.Diagram(
    title="lead compensator, drive, motor and gear",
    blocks={
        "error": Sum(),
        "lead": tsm.from_control(lead),
        "drive": Saturation(low=-24.0, high=24.0),
        "motor": tsm.from_control(motor),
        "gear": Play(half_width=np.deg2rad(1.0)),
    },
    wires=["error -> lead -> drive -> motor -> gear -> error.minus"],
    inputs={"x_ref": tsm.Inlet("error.plus", unit="rad")},
    outputs={"x_out": "gear"},
)

f = np.array([0.5, 1.0, 2.0, 4.0, 8.0])  # Hz
degrees = [20.0, 10.0, 5.0]
closed = control.frequency_response(control.feedback(motor * lead), 2 * np.pi * f)
free = frequency_response(loop.with_parameters({"gear.half_width": 0.0}), f, np.deg2rad(5.0))
found = frequency_response(loop, f, np.deg2rad(degrees))

print(f"{'f [Hz]':8} python-control   no backlash", *(f"{a:9.0f} deg" for a in degrees))
print(f"{'':8}" + 5 * "  gain   phase")
columns = [
    (closed.magnitude, np.rad2deg(closed.phase)),
    (free.gain[0], free.phase[0]),
    *zip(found.gain, found.phase, strict=True),
]
for k, hertz in enumerate(f):
    print(f"{hertz:8.1f}", *(f"{gain[k]:6.3f} {phase[k]:6.1f}" for gain, phase in columns))

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    figure = found.plot()
    for panel, line in zip(figure.axes, (20 * np.log10(closed.magnitude), columns[0][1]), strict=False):
        panel.plot(f, line, "k--")
    figure.suptitle("x_out / x_ref; dashed: python-control, without backlash", x=0.01, ha="left")
    figure.savefig(folder / "bode.png")
