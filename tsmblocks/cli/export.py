r"""Write a diagram as C99 (one fixed step per call), or as a MAT file.

The C code allocates nothing and needs nothing but math.h; NAME.h declares its
functions. The MAT file has parameters, wiring and, where it exists, the linear
model.

  tsmblocks export eq11_compensator --out compensator.c --step 0.001
  tsmblocks export motor_linear --out motor.mat
"""

from __future__ import annotations

import argparse
from functools import partial

from tsmblocks.cli import common, parameters

HELP = "write a diagram as C source, or as a MAT file"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = partial(common.add, parser)
    add("diagram")
    add("--out", metavar="FILE", required=True, help="a .c file (its header is written beside it) or a .mat file")
    add("--step", help="step of the C code in s (default 0.001)")
    add("--method", default=None, help="method of the C code: as of run (default rk4)")
    add("--set", "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.export import to_c, to_mat
    from tsmblocks.files import load

    out = common.result_path(args.out, (".c", ".mat"))
    assert out is not None
    diagram = parameters.with_settings(load(args.diagram), args.settings)
    if out.suffix.lower() == ".mat":
        if args.step is not None or args.method is not None:
            raise common.UsageError("--step and --method are for C; a MAT file has no step.")
        written = [str(to_mat(diagram, out))]
    else:
        step, method = args.step if args.step is not None else 1e-3, args.method or "rk4"
        written = [str(path) for path in to_c(diagram, step=step, method=method, name=out.stem).save(out.parent)]
    facts = {"diagram": args.diagram, "title": diagram.title, "written": written}
    common.print_result(args, facts, common.wrote(written))
    return 0
