"""Every message of a fit stands in the table of mistakes, and odd arguments never end in a traceback from inside."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tests.mistakes import fitting
from tests.mistakes.all import TABLE
from tests.test_fit_methods import FAR_OFF, LINEAR, LONG, TRUTH, balanced, pendulum
from tests.test_fit_problem import T, U, record
from tsmblocks.common.errors import RunError, TsmError
from tsmblocks.fitting import multiple_shooting as shooting
from tsmblocks.fitting.text import flipped_gains

FOLDER = Path(shooting.__file__).parent
TESTED_ALONE = {"constraints", "multistart", "noise", "statistics"}
"""Modules whose messages are tested where the module is."""
MODULES = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem not in TESTED_ALONE)
SHARED = "../common/arguments"
"""The checks that all rooms share; any room's mistakes may show them."""
TEXTS = [row.text for row in TABLE if row.make.__module__ == fitting.__name__]
ELSEWHERE = {
    "no step meets all constraints at once.": "caught by the search; see test_fit_problem",
    ": its outputs are not finite.": "a guard, should the second simulation differ from the first",
    "multiple shooting could not join its ": "below",
    **dict.fromkeys(
        ("none of ", "the start of Nelder", "the population ", "the cost must ", "the constraints must give "),
        "test_fit_genetic",
    ),
}
"""Beginnings of messages that no row of the table shows, and why."""


def messages(module):
    """What a module raises, as patterns: the fixed words of each message, anything in between."""
    for node in ast.walk(ast.parse((FOLDER / f"{module}.py").read_text(encoding="utf-8"))):
        call = getattr(node, "exc", None) if isinstance(node, ast.Raise) else None
        if not isinstance(call, ast.Call) or not call.args:
            continue
        text = call.args[0]
        parts = text.values if isinstance(text, ast.JoinedStr) else [text]
        yield [p.value if isinstance(p, ast.Constant) else None for p in parts]


@pytest.mark.parametrize("module", [SHARED, *MODULES])
def test_every_message_is_shown_by_a_mistake(module):
    texts = [row.text for row in TABLE] if module == SHARED else TEXTS
    for parts in messages(module):
        fixed = [p for p in parts if p]
        if any(p.startswith(beginning) for p in fixed[:1] for beginning in ELSEWHERE):
            continue
        pattern = "".join(".*" if p is None else re.escape(p) for p in parts)
        assert any(re.fullmatch(pattern, text, re.DOTALL) for text in texts), "".join(p or "…" for p in parts)


def test_messages_are_found_where_they_are():
    assert sum(1 for module in MODULES for _ in messages(module)) > 50


def test_pieces_that_do_not_join_are_told(monkeypatch):
    solve = shooting.solve

    def gives_up(*args, **options):
        ended = solve(*args, **{**options, "iterations": 2})
        object.__setattr__(ended, "word", "Restoration_Failed")
        return ended

    monkeypatch.setattr(shooting, "solve", gives_up)
    with pytest.raises(RunError) as caught:
        tsm.fit(pendulum(), balanced(LONG, 0.0), free=list(TRUTH), start=FAR_OFF, method="ipopt", segments=5)
    jumps = r"a state still jumps by [\d.e+-]+ of its size|the states diverged"
    said = re.sub(jumps, "a state still jumps by 0.5 of its size", str(caught.value))
    assert said == (
        "multiple shooting could not join its 5 pieces (Restoration_Failed): a state still jumps by 0.5 of its size. "
        "Try more segments, another start, tighter bounds, or fewer free parameters: of two with the same effect, one "
        "must be fixed."
    )


# ---- odd arguments

NAN, INF = float("nan"), float("inf")
ODD = [
    None,
    0,
    -1,
    1.5,
    True,
    NAN,
    INF,
    -INF,
    1e308,
    10**400,
    "",
    "x",
    "gain.gain",
    b"x",
    [],
    (),
    {},
    set(),
    [None],
    [NAN],
    [[]],
    {"": 1},
    {None: 1},
    {"gain.gain": None},
    {"gain.gain": NAN},
    {"gain.gain": "x"},
    {"gain.gain": ()},
    {"gain.gain": (NAN, NAN)},
    {"gain.gain": (1, 2, 3)},
    {"gain.gain": (INF, -INF)},
    {"gain.gain": [[1, 2]]},
    {"gain.gain": (0, 10**400)},
    {"gain.gain": {}},
    {1: 2},
    {"x_out": 0},
    (0, 1),
    (NAN, NAN),
    (None, None),
    (1, 0),
    np.zeros(3),
    np.zeros((2, 2)),
    np.array(["x"]),
    object(),
    int,
    lambda: 0,
    1j,
    range(3),
    "a > b",
    "gain > nan",
    ["gain > 0", 0],
    iter(["gain.gain"]),
]
ARGUMENTS = (
    "free",
    "bounds",
    "start",
    "local",
    "start_states",
    "constraints",
    "ties",
    "priors",
    "outputs",
    "sigma",
    "window",
    "method",
    "starts",
    "seed",
    "segments",
    "iterations",
    "step",
    "integrator",
    "hold",
    "progress",
    "backend",
)


def short(name="a"):
    return record(name, T[:40], {"x_in": "rad", "x_out": "rad"}, x_in=U[:40], x_out=0.8 * U[:40] + 0.1)


def told(make):
    """Whether something works or is refused in words; anything else comes up."""
    try:
        make()
    except TsmError as error:
        text = str(error)
    else:
        return ""
    assert len(text) > 20
    return text


@pytest.mark.parametrize("name", ARGUMENTS)
def test_odd_arguments_of_a_fit_are_told(name):
    odd_ones = [odd for odd in ODD if name != "progress" or not callable(odd)]  # what a function does is its affair
    said = [told(lambda odd=odd: tsm.fit(LINEAR, short(), **{"starts": 1, name: odd})) for odd in odd_ones]
    assert sum(text != "" for text in said) > len(ODD) / 3


@pytest.mark.parametrize("name", ["models", "train", "held_out", "free", "outputs", "starts", "progress"])
def test_odd_arguments_of_a_comparison_are_told(name):
    for odd in (odd for odd in ODD if name != "progress" or not callable(odd)):
        given = {"models": ["tendon_sheath_linear"], "starts": 1, name: odd}
        if name != "models" or odd is not None:
            told(lambda given=given: tsm.compare(given.pop("models"), short(), **given))


@pytest.mark.parametrize("name", ["outputs", "window", "step", "parameters"])
def test_odd_arguments_of_a_score_are_told(name):
    for odd in ODD:
        told(lambda odd=odd: tsm.score(LINEAR, short(), **{name: odd}))


@pytest.mark.parametrize("call", [tsm.fit, tsm.score])
def test_odd_data_are_told(call):
    rows = dict(x_in=U[:5], x_out=U[:5])
    for odd in [*ODD, *(dict(a=odd) for odd in ODD), *([odd] for odd in ODD)]:
        assert told(lambda odd=odd: call(LINEAR, odd)) != ""
    for t in ([0] * 5, [4, 3, 2, 1, 0], [NAN] * 5, [0, 1, 2, 3, INF], [-INF, 1, 2, 3, 4], [0, 1, NAN, 3, 4]):
        data = record(t=np.array(t, dtype=float), **rows)
        assert "times must be finite and increase" in told(lambda data=data: call(LINEAR, data))


@pytest.mark.parametrize("size", [1e-320, 1e-150, 1e-30, 1e-12, 1e12, 1e30, 1e150, 1e300])
def test_odd_sizes_are_fitted_or_refused(size):
    data = record(
        t=T[:40], units={"x_in": "rad", "x_out": "rad"}, x_in=size * U[:40], x_out=size * (0.8 * U[:40] + 0.1)
    )
    said = told(lambda: tsm.fit(LINEAR, data))
    if 1e-100 < size < 1e100:
        found = tsm.fit(LINEAR, data, starts=1)
        assert found.values["gain.gain"] == pytest.approx(0.8, rel=1e-6)
        assert found.undetermined == ()
    else:
        assert "and its square is out of range" in said


def test_names_that_mean_something_elsewhere():
    for name in ("", "a@b", "a.b", "x_out", "#1", "gain.gain", "\x1b[31m"):
        found = tsm.fit(LINEAR, {name: short(), "other": short()}, local=["offset.bias"])
        assert found.names == ("gain.gain", f"offset.bias@{name or 'experiment'}", "offset.bias@other")
        assert str(found)


def test_gains_that_changed_their_signs_together_are_said_to_have():
    before, after = {"a.gain": 2.0, "b.gain": 3.0, "c.bias": 1.0}, {"a.gain": -1.0, "b.gain": -6.0, "c.bias": -1.0}
    (said,) = flipped_gains(before, after)
    assert said.startswith("a.gain and b.gain have changed their signs")
    assert flipped_gains(before, {**after, "b.gain": 6.0}) == []
    assert flipped_gains({}, after) == []
