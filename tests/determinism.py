"""Results of the package as digests: ``python tests/determinism.py quick|demo|reference WORKERS`` prints a JSON object.

What is printed must not depend on the order of sets (``PYTHONHASHSEED``), the threads of linear algebra
(``OPENBLAS_NUM_THREADS``), the number of worker processes, or machine code kept from before.
"""

import contextlib
import hashlib
import io
import json
import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.cli import main as command

T = np.arange(0.0, 8.0, 0.02)


def recording() -> tsm.Record:
    """Motion through a backlash gap, with noise of 0.002 rad on the output."""
    x = 0.8 * np.sin(1.3 * T) + 0.3 * np.sin(0.41 * T)
    gap = tsm.Diagram(
        blocks={"gap": Play(half_width=0.03)}, inputs={"x_in": tsm.Inlet("gap.u", "rad")}, outputs={"x_out": "gap"}
    )
    y = tsm.simulate(gap, inputs={"x_in": (T, x)}, stop=T[-1], step=0.02)["x_out"]
    y += np.random.default_rng(1).normal(0.0, 0.002, len(T))
    return tsm.Record("bend", T, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})


def printed(*arguments: str) -> str:
    """What a command prints."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert command(list(arguments)) == 0, arguments
    return said.getvalue()


def digests(folder: Path) -> dict[str, str]:
    """A digest of each file below a folder."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): digest(path.read_bytes()) for path in paths}


def digest(content: bytes | str) -> str:
    """A short digest of a text or of bytes."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:16]


def quick(folder: Path, workers: int) -> dict[str, str]:
    """Fit, diagnosis with report, study, run, C, pictures and pages, from Python and from commands."""
    linear, measured = tsm.load("tendon_sheath_linear"), recording()
    data = folder / "bend.csv"
    measured.save(data)
    fit = tsm.fit(linear, measured, starts=3, seed=5)
    genetic = tsm.fit(linear, measured, method="ga", iterations=20, seed=5)
    diagnosis = tsm.diagnose(
        linear, {"bend": measured}, noise_floor=0.002, effects=["backlash", "drift", "stribeck_friction"], seed=5
    )
    diagnosis.save(folder / "report")
    plan = tsm.studies.latin_hypercube({"pid.kp": (0.5, 2.0), "theta": (4.0, 5.0)}, runs=60, seed=3)
    loop = tsm.load("fig16_feedforward_feedback")
    with contextlib.ExitStack() as opened:
        pool = None
        if workers > 1:
            pool = opened.enter_context(ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")))
        study = tsm.study(
            loop, plan, {"error": "rms(x_ref - x_out)"}, stop=0.5, executor=pool, out=folder / "study.csv"
        )
    run = tsm.simulate(loop, stop=2.0)
    run.save(folder / "run.csv")
    (folder / "code").mkdir()
    said = {
        "run": printed("run", "fig16_feedforward_feedback", "--stop", "2", "--json"),
        "export": printed("export", "fig16_feedforward_feedback", "--out", str(folder / "code" / "loop.c")),
        "picture": printed("draw", "fig16_feedforward_feedback", "--out", str(folder / "loop.svg")),
        "fit": json.dumps(fit.to_dict()) + str(fit) + fit._repr_html_(),
        "genetic": json.dumps(genetic.to_dict()) + str(genetic),
        "diagnosis": json.dumps(diagnosis.to_dict()) + str(diagnosis) + diagnosis._repr_html_(),
        "study": json.dumps(study.to_dict()) + str(study) + study._repr_html_(),
        "pages": run._repr_html_() + measured._repr_html_() + loop._repr_svg_(),
    }
    return {key: digest(text.replace(str(folder), "")) for key, text in said.items()} | digests(folder)


def demo(folder: Path, _: int) -> dict[str, str]:
    """The demonstration, with all that it writes."""
    said = printed("demo", "--out", str(folder / "demo"))
    return {"said": digest(said.replace(str(folder), ""))} | digests(folder)


def reference(folder: Path, _: int) -> dict[str, str]:
    """The reference, with all of its pages."""
    printed("reference", "--out", str(folder / "reference"))
    return digests(folder)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        made_by = {"quick": quick, "demo": demo, "reference": reference}[sys.argv[1]]
        print(json.dumps(made_by(Path(made), int(sys.argv[2]))))
