"""What is built for others: the wheel and the source archive, their contents and metadata."""

import email
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from tsmblocks.common.version import __version__

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
INFO = f"tsmblocks-{__version__}.dist-info"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder with a wheel and a source archive of this tree."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder)]
    done = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    with zipfile.ZipFile(built / f"tsmblocks-{__version__}-py3-none-any.whl") as file:
        yield file


def files(*folders):
    """Paths of the files of folders of the tree, without what Python leaves there."""
    found = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file())
    return {p.relative_to(ROOT).as_posix() for p in found if "__pycache__" not in p.parts}


def test_the_wheel_holds_the_package_its_diagrams_and_examples_and_nothing_else(wheel):
    names = set(wheel.namelist())
    about = {f"{INFO}/{name}" for name in ("METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE")}
    carried = {f"tsmblocks/_{path}" for path in files("diagrams", "examples")}
    assert names == files("tsmblocks") | carried | about
    assert {"tsmblocks/py.typed", "tsmblocks/__init__.pyi", "tsmblocks/_diagrams/motor_linear.toml"} <= names


def test_the_metadata_say_what_the_project_declares(wheel):
    said = email.message_from_bytes(wheel.read(f"{INFO}/METADATA"))
    needs = [need.partition(";") for need in said.get_all("Requires-Dist")]
    extras = {extra: set() for extra in said.get_all("Provides-Extra")}
    for need, _, condition in needs:
        if condition:
            extras[condition.split("'")[1]].add(need.strip())
    assert {need for need, _, condition in needs if not condition} == set(PROJECT["dependencies"])
    assert extras == {extra: set(needs) for extra, needs in PROJECT["optional-dependencies"].items()}
    assert (said["Name"], said["Version"]) == ("tsmblocks", __version__)
    assert (said["Requires-Python"], said["License-Expression"]) == (PROJECT["requires-python"], PROJECT["license"])
    assert said["Description-Content-Type"] == "text/markdown"
    assert said.get_payload(decode=True).decode() == (ROOT / "README.md").read_text("utf-8")
    assert wheel.read(f"{INFO}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    entries = wheel.read(f"{INFO}/entry_points.txt").decode()
    assert "[console_scripts]\ntsmblocks = tsmblocks.cli:main" in entries
    assert "[pytest11]\ntsmblocks.testing.plugin = tsmblocks.testing.plugin" in entries


def test_the_source_archive_holds_what_builds_and_tests_it(built):
    with tarfile.open(built / f"tsmblocks-{__version__}.tar.gz") as archive:
        names = {member.name.partition("/")[2] for member in archive if member.isfile()}
        assert all(member.name.startswith(f"tsmblocks-{__version__}/") for member in archive)
    pages = {path.name for path in ROOT.glob("*.md")}
    assert files("tsmblocks", "diagrams", "tests") <= names
    assert {"pyproject.toml", "LICENSE", "PKG-INFO", *pages} <= names
    assert not {path for path in names if path.startswith((".git/", ".ci/")) or path.endswith((".pyc", ".o"))}


def test_the_same_tree_gives_the_same_bytes(built, tmp_path):
    command = [sys.executable, "-m", "hatchling", "build", "--directory", str(tmp_path)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    assert {p.name: p.read_bytes() for p in built.iterdir()} == {p.name: p.read_bytes() for p in tmp_path.iterdir()}
