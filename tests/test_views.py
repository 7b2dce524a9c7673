"""Views: every class that offers one goes through ``common.views``, and each of them can be made."""

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest

import tsmblocks
import tsmblocks as tsm
from tests.pages import Page
from tests.views_everywhere import examples, registered, rendered
from tsmblocks.common.errors import TsmError
from tsmblocks.common.views import view

METHODS = {"_repr_html_": "html", "_repr_svg_": "svg", "plot": "plot"}
"""Method of a class -> the view that it gives."""


def test_every_result_type_is_rendered_in_every_kind_that_it_offers():
    pytest.importorskip("matplotlib", reason="the extra [plots] brings it")
    made = rendered(list(examples().values()))
    assert {kind for kind, _ in made} == {"details", "html", "plot", "report", "svg", "text"}
    for (kind, name), shown in made.items():
        if kind == "html":
            assert Page(shown).open == [], name
        elif kind == "svg":
            assert ElementTree.fromstring(shown).tag.endswith("svg"), name
        elif kind == "plot":
            shown.canvas.draw()
            assert all(panel.has_data() for panel in shown.axes), name
        elif kind == "report":
            assert {p.name for p in shown.iterdir()} == {"diagnosis.json", "augmented.toml", "report.html"}, name
        else:
            assert shown.strip(), name


def test_every_class_with_a_view_is_registered_and_asks_for_it_by_the_one_function():
    known = set(registered())
    for module in pkgutil.walk_packages(tsmblocks.__path__, "tsmblocks."):
        if module.name.endswith("__main__"):
            continue
        for cls in vars(import_module(module.name)).values():
            if not inspect.isclass(cls) or cls.__module__ != module.name:
                continue
            for method, kind in METHODS.items():
                if method in vars(cls):
                    shown = [cls] if (kind, cls) in known else cls.__subclasses__()  # a base gives views to others
                    assert shown, f"{cls.__name__}.{method}"
                    assert {(kind, one) for one in shown} <= known, f"{cls.__name__}.{method}"
                    assert f'return view("{kind}", self' in inspect.getsource(vars(cls)[method]), cls.__name__


def test_a_view_that_there_is_not_is_refused_with_those_that_there_are():
    run = tsm.simulate(tsm.load("fig16_feedforward_feedback"), stop=0.01)
    for kind, value, said in (
        ("htm", run, "there is no view 'htm'. Did you mean 'html'?"),
        ("report", run, "Run has no view 'report', but html and plot."),
        ("html", 3, "int has no view 'html'."),
    ):
        with pytest.raises(TsmError) as refused:
            view(kind, value)
        assert str(refused.value) == said


def test_the_first_card_of_a_run_loads_no_package_that_it_does_not_show():
    code = (
        "import sys, tsmblocks as tsm; run = tsm.simulate(tsm.load('fig16_feedforward_feedback'), stop=0.1); "
        "run._repr_html_(); "
        "print({m for m in sys.modules if m.startswith('tsmblocks.')} & {'tsmblocks.' + name for name in "
        "('analysis', 'diagnosis', 'fitting', 'optimal', 'plots', 'studies', 'tuning')})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        cwd=Path(__file__).parent.parent,
    )
    assert done.stdout.strip() == "set()"
