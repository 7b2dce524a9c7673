r"""Write a diagram as C99 (one fixed step per call), or as a MAT file.

The C code allocates nothing and needs nothing but math.h; NAME.h declares its
functions. The MAT file has parameters, wiring and, where it exists, the linear
model.

  tsmblocks export eq11_compensator --out compensator.c --step 0.001
  tsmblocks export motor_linear --out motor.mat
"""

from __future__ import annotations

import argparse

from tsmblocks.cli import common, console

HELP = "write a diagram as C source, or as a MAT file"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = parser.add_argument
    common.diagram_argument(parser)
    add("--out", metavar="FILE", required=True, help="a .c file (its header is written beside it) or a .mat file")
    add("--step", type=common.finite_float, metavar="H", default=None, help="step of the C code in s (default 0.001)")
    common.method_argument(parser, default=None, what="method of the C code: ")
    common.settings_argument(parser)
    common.json_argument(parser)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.export import to_c, to_mat
    from tsmblocks.files import load

    out = common.result_path(args.out, (".c", ".mat"))
    assert out is not None
    diagram = load(args.diagram).with_parameters(dict(args.settings))
    if out.suffix.lower() == ".mat":
        if args.step is not None or args.method is not None:
            raise common.UsageError("--step and --method are for C; a MAT file has no step.")
        written = [str(to_mat(diagram, out))]
    else:
        step, method = args.step if args.step is not None else 1e-3, args.method or "rk4"
        written = [str(path) for path in to_c(diagram, step=step, method=method, name=out.stem).save(out.parent)]
    if args.json:
        console.print_json({"diagram": args.diagram, "title": diagram.title, "written": written})
    else:
        print("\n".join(f"wrote {path}" for path in written))
    return 0
