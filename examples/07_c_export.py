"""Does a controller as C code act like the controller in the simulation?  It drives the simulated motor.

They exchange signals once a millisecond: the C code of controller and drive, compiled here, and the motor with its
encoder, stepped by Python. The same loop simulated as one diagram must give the same. Needs a C compiler.
"""

import ctypes
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import tsmblocks as tsm
from tsmblocks.export import to_c

STEP = 1e-3  # s
GLUE = """
#include "controller.h"
static controller c;
void start(void) { controller_init(&c); }
double act(double x_ref, double x)
{
    controller_inputs u = {x_ref, x};
    controller_outputs y;
    controller_step(&c, &u, &y);
    return y.u;
}
"""
compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
if compiler is None:
    sys.exit("This example compiles C, and found none of cc, gcc and clang. Install one of them.")

loop = tsm.load("sampled_position_loop")
board = tsm.Diagram(
    title="controller on the board",
    blocks={name: loop.blocks[name] for name in ("error", "controller", "drive")},
    wires=["error -> controller -> drive"],
    inputs={"x_ref": "error.plus", "x": "error.minus"},
    outputs={"u": "drive"},
)
bench = tsm.Diagram(
    title="motor and encoder on the bench",
    blocks={name: loop.blocks[name] for name in ("motor", "encoder")},
    wires=["motor.y -> encoder"],
    inputs={"u": "motor.u"},
    outputs={"x": "encoder", "angle": "motor.y"},
)

code = to_c(board, step=STEP, name="controller")
with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
    code.save(folder)
    (Path(folder) / "glue.c").write_text(GLUE)
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "controller.c", "glue.c", "-lm", "-o", "board.so"], cwd=folder, check=True)
    c = ctypes.CDLL(str(Path(folder) / "board.so"))
c.act.argtypes, c.act.restype = [ctypes.c_double, ctypes.c_double], ctypes.c_double

whole = tsm.simulate(loop, stop=10.0, step=STEP, check_step=False)  # the same steps as the board's
c.start()
motor, x, u, angle = tsm.Stepper(bench, step=STEP), 0.0, [], [0.0]
for x_ref in whole["x_ref"][:-1]:
    u.append(c.act(x_ref, x))
    now = motor.step({"u": u[-1]})
    x = now["x"]
    angle.append(now["angle"])

settled = whole.t >= 5.0
error = {"simulated": whole["x_ref"] - whole["x_out"], "C on the board": whole["x_ref"] - angle}
print(f"{len(code.source.splitlines())} lines of C, {len(u)} calls")
for name, e in error.items():
    print(f"{name:15} {np.rad2deg(tsm.peak_to_peak(e[settled])):.6f} deg peak to peak")
print(f"largest difference: {np.abs(whole['u'][:-1] - u).max():.1e} V, {np.abs(whole['x_out'] - angle).max():.1e} rad")
