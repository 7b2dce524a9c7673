"""Everything the README shows is run, and prints what it says."""

import contextlib
import io
import math
import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
SHOWN = re.findall(r"```python\n(.*?)```(?:\n\n```\n(.*?)```)?", README.read_text(encoding="utf-8"), re.DOTALL)
TABLES = re.findall(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
SHELL = re.findall(r"^tsmblocks (.*)$", README.read_text(encoding="utf-8"), re.MULTILINE)


def test_code_in_the_readme_prints_what_it_says():
    scope: dict[str, object] = {"__name__": "__main__"}
    assert len(SHOWN) >= 3
    for code, expected in SHOWN:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "README.md", "exec"), scope)
        assert printed.getvalue() == expected


@pytest.mark.parametrize("line", SHELL)
def test_commands_in_the_readme_run(line, tmp_path, monkeypatch, capsys):
    from tsmblocks.blocks import Gain
    from tsmblocks.cli import main
    from tsmblocks.diagram import Diagram
    from tsmblocks.files import save

    monkeypatch.chdir(tmp_path)
    save(
        Diagram(title="mine", blocks={"g": Gain()}, inputs={"u": "g.u"}, outputs={"y": "g"}), tmp_path / "my_loop.toml"
    )
    (tmp_path / "gains.toml").write_text(next(one for one in TABLES if "[plan]" in one))
    rows = [f"{k / 20},{50 * math.sin(k / 20):.3f},{40 * math.sin(k / 20 - 0.5):.3f}" for k in range(260)]
    (tmp_path / "sheath.csv").write_text("\n".join(["t [s], x_in [deg], x_out [deg]", *rows]))
    assert main(line.split()) == 0
    assert capsys.readouterr().out


def test_pictures_in_the_readme_exist():
    for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", README.read_text(encoding="utf-8")):
        assert (README.parent / picture).is_file()


def test_links_in_the_readme_exist():
    for link in re.findall(r"(?<!!)\[[^]]*\]\(([^)#]+)\)", README.read_text(encoding="utf-8")):
        assert link.startswith("http") or (README.parent / link).exists()


def test_the_picture_is_what_the_command_draws():
    import tsmblocks as tsm

    drawn = tsm.to_svg(tsm.load("fig16_feedforward_feedback"))
    assert (README.parent / "examples" / "fig16.svg").read_text(encoding="utf-8").strip() == drawn.strip()


def test_what_a_guard_says_is_what_the_readme_shows(tmp_path):
    from tsmblocks.testing.guards import read_guards
    from tsmblocks.testing.tracking import in_sentences, moved

    text = next(one for one in TABLES if "tolerance" in one)
    path = tmp_path / "loop.tracking.toml"
    path.write_text(text)
    (before,) = read_guards(path).values()
    path.write_text(f'{text}[set]\n"pid.kp" = 1.53\n')
    (now,) = read_guards(path).values()
    runs = before.run(), now.run()
    said = in_sentences(moved(before, *runs), *runs)
    assert f"```\n{said}\n```" in README.read_text(encoding="utf-8")
