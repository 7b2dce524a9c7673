"""Runs tests with the oldest allowed and with the newest dependencies: ``python tests/versions.py [tests …]``.

    python tests/versions.py --python 3.12 --versions oldest -- -x tests/test_files.py

For each Python at hand that ``pyproject.toml`` allows, and for each end of the ranges that it gives, an environment is
made (with ``--keep FOLDER``, one of an earlier run is brought up to date) and pytest runs in it; what stands after
``--`` goes to pytest. Oldest are the lower bounds themselves, where they have a wheel for this Python, else the first
release above that has one; what they depend on in turn is as new as they allow. The tests turn warnings into errors:
not so with the oldest releases, which do not know of the newer ones beside them. ``--strict`` makes errors of the
warnings of every process, from its first import on. The command ``uv`` resolves and installs: ``pip install uv``.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESOLUTIONS = {"oldest": "lowest-direct", "newest": "highest"}
EXTRAS = ("plots", "data", "test")
"""What the command for the tests in the README installs, too."""


def main(arguments: list[str]) -> int:
    """Test every environment asked for; 1 where one fails."""
    asked = parsed(arguments)
    if shutil.which("uv") is None:
        sys.exit("uv is needed to resolve the oldest versions: pip install uv")
    found = {version: path for version, path in pythons().items() if not asked.python or version in asked.python}
    if missing := [version for version in asked.python if version not in found]:
        sys.exit(f"no Python {', '.join(missing)} at hand, only {', '.join(pythons())}")
    verdicts = []
    with tempfile.TemporaryDirectory() as made:
        for version, python in found.items():
            for end in asked.versions or RESOLUTIONS:
                place = (asked.keep or Path(made)).resolve() / f"{version}-{end}"
                print(f"\n== Python {version}, {end} versions", flush=True)
                good = install(place, python, end) and tested(place, end, asked.strict, asked.pytest)
                verdicts.append((version, end, good))
    print(
        "\n"
        + "\n".join(f"Python {version}, {end}: {'passed' if good else 'FAILED'}" for version, end, good in verdicts)
    )
    return 0 if all(good for *_, good in verdicts) else 1


def parsed(arguments: list[str]) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--python", action="append", default=[], metavar="3.N", help="only this Python; may be repeated"
    )
    parser.add_argument("--versions", action="append", choices=RESOLUTIONS, help="only this end of the ranges")
    parser.add_argument("--strict", action="store_true", help="every warning of every process is an error")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the environments here, for another run")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest, after --")
    return parser.parse_args(arguments)


def pythons() -> dict[str, str]:
    """Interpreters at hand that are new enough, by version: on the path, and those of pyenv."""
    found = {}
    for minor in range(least_minor(), least_minor() + 20):
        version = f"3.{minor}"
        managed = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
        for path in (sys.executable, shutil.which(f"python{version}"), *map(str, managed)):
            if path and answers(path, version):
                found[version] = path
                break
    return found


def least_minor() -> int:
    """The minor number of the oldest Python that is allowed."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["requires-python"]
    return int(declared.removeprefix(">=3."))


def answers(python: str, version: str) -> bool:
    """Whether this is an interpreter of the version that runs: a stand-in of pyenv on the path may not."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    done = subprocess.run([python, "-c", code], check=False, capture_output=True, text=True)
    return done.stdout.strip() == version


def install(place: Path, python: str, end: str) -> bool:
    """An environment with the package of this tree, editable, and its dependencies of this end of the ranges."""
    wanted = place.with_name(f"{place.name}.txt")  # versions have dots
    place.parent.mkdir(parents=True, exist_ok=True)
    extras = [word for extra in EXTRAS for word in ("--extra", extra)]
    resolve = ["--resolution", RESOLUTIONS[end], "--only-binary", ":all:", "--python", python, *extras]
    into = ["uv", "pip", "install", "--quiet", "--python", str(place)]
    return all(
        subprocess.run(command, check=False, cwd=ROOT).returncode == 0
        for command in (
            ["uv", "venv", "--quiet", "--allow-existing", "--python", python, str(place)],
            ["uv", "pip", "compile", "--quiet", *resolve, "--output-file", str(wanted), "pyproject.toml"],
            [*into, "--only-binary", ":all:", "--requirements", str(wanted)],
            [*into, "--no-deps", "--editable", "."],
        )
    )


def tested(place: Path, end: str, strict: bool, arguments: list[str]) -> bool:
    """Whether the tests pass there."""
    scripts = place / ("Scripts" if os.name == "nt" else "bin")
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    if strict:
        environment["PYTHONWARNINGS"] = "error"
    lenient = ["-W", "default"] if end == "oldest" and not strict else []
    command = [str(scripts / "python"), "-m", "pytest", "-q", *lenient, *arguments]
    return subprocess.run(command, check=False, cwd=ROOT, env=environment).returncode == 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
