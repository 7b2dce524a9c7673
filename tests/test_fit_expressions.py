"""Constraints and ties as texts: what they mean, and that nothing else is taken for one."""

import math

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsmblocks.common.errors import ParameterError
from tsmblocks.fitting.constraints import constraint, constraints, ties
from tsmblocks.metrics.expressions import MAX_LENGTH, expression

KNOWN = (
    "tsm.alpha1",
    "tsm.alpha2",
    "tsm.A",
    "tsm.theta",
    "play.half_width",
    "lag.den[0]",
    "lag.den[1]",
    "B",
    "left.k",
    "right.k",
)
VALUES = dict(zip(KNOWN, (0.7, -1.3, 2.0, 0.25, 0.1, 3.0, -4.0, 1.5, 5.0, 6.0), strict=True))
CHOICES = " Known here: B, lag.den[0], lag.den[1], left.k, play.half_width, right.k, tsm.A, tsm.alpha1, … (10 in all)."
FUNCTIONS = " Known here: abs, cos, exp, log, max, min, sin, sqrt, tan, tanh."
NO_ARITHMETIC = (
    "this is no arithmetic. Known here: numbers, + - * / **, abs, exp, log, sqrt, sin, cos, tan, tanh, "
    "min, max, pi, and names of parameters."
)
NO_COMPARISON = "this is not a comparison. Write for example 'theta > 0'."
NEVER, ALWAYS = (f"this is always {which}, for any values of the parameters." for which in ("false", "true"))


def value(read, values=VALUES):
    """A number out of symbols put in, so that forming and evaluating are both tried."""
    symbols = {name: ca.SX.sym(name) for name in values}
    function = ca.Function("f", list(symbols.values()), [read.symbolic(symbols)])
    return float(function(*values.values()))


def refused(read):
    """What is said against a text, None when it reads."""
    try:
        read()
    except ParameterError as error:
        return str(error)
    return None


def marked(why, text, mark):
    return f"{why}\n    {text}\n    {mark}"


# ---- meaning


@pytest.mark.parametrize(
    ("text", "names", "result"),
    [
        ("alpha1", ("tsm.alpha1",), 0.7),
        ("2*B", ("B",), 3.0),
        ("tsm.alpha2 + A - abs(tsm.alpha2)", ("tsm.alpha2", "tsm.A"), -0.6),
        ("den[0] * lag.den[ 1 ]", ("lag.den[0]", "lag.den[1]"), -12.0),
        ("left.k - right.k", ("left.k", "right.k"), -1.0),
        ("-A ** 2 / 4", ("tsm.A",), -1.0),
        ("+(pi)", (), math.pi),
        ("min(A, B, theta) + max(1, 2)", ("tsm.A", "B", "tsm.theta"), 2.25),
        (
            "sqrt(A) + exp(0) + log(B) + sin(A) + cos(A) + tan(A) + tanh(A)",
            ("tsm.A", "B"),
            math.sqrt(2) + 1 + math.log(1.5) + math.sin(2) + math.cos(2) + math.tan(2) + math.tanh(2),
        ),
        ("1e-3 + .5", (), 0.501),
        ("\n A\n + B ", ("tsm.A", "B"), 3.5),
        ("A" + "+A" * 98, ("tsm.A",), 198.0),
    ],
)
def test_what_an_expression_means(text, names, result):
    read = expression(text, KNOWN)
    assert read.names == names
    assert value(read) == pytest.approx(result, rel=1e-14)


def test_an_expression_is_a_value():
    assert expression("2*A", KNOWN) == expression("2*A", KNOWN) != expression("2*B", KNOWN)
    assert hash(expression("2*A", KNOWN)) == hash(expression("2*A", KNOWN))
    assert expression(" 2  * A ", KNOWN).text == "2 * A"


def test_the_whole_name_goes_before_the_end_of_another():
    assert expression("theta", ("theta", "tsm.theta")).names == ("theta",)
    assert expression("tsm.theta", ("robot.tsm.theta", "x.theta")).names == ("robot.tsm.theta",)


def test_numbers_may_stand_for_symbols():
    assert float(expression("A + B", KNOWN).symbolic(VALUES)) == 3.5


def test_a_symbol_that_is_missing():
    with pytest.raises(ParameterError) as caught:
        expression("A + B", KNOWN).symbolic({"tsm.A": 1.0, "b": 2.0})
    assert str(caught.value) == "'A + B' needs 'B', which is not given. Did you mean 'b'?"


NUMBERS = st.floats(0.01, 100).map(lambda v: repr(round(v, 3)))
NAMES = st.sampled_from(["tsm.alpha1", "alpha2", "A", "theta", "play.half_width", "den[0]", "lag.den[1]", "B", "pi"])
TEXTS = st.recursive(
    NUMBERS | NAMES,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from(["+", " - ", "*", " / "]), part).map("".join),
        part.map(lambda a: f"-({a})"),
        part.map(lambda a: f"({a})"),
        st.tuples(part, st.integers(0, 3)).map(lambda p: f"({p[0]})**{p[1]}"),
        st.tuples(st.sampled_from(["abs", "sin", "cos", "tanh"]), part).map(lambda p: f"{p[0]}({p[1]})"),
        part.map(lambda a: f"exp(-abs({a}))"),
        part.map(lambda a: f"log(1 + abs({a}))"),
        part.map(lambda a: f"sqrt(abs({a}))"),
        st.tuples(st.sampled_from(["min", "max"]), st.lists(part, min_size=2, max_size=3)).map(
            lambda p: f"{p[0]}({', '.join(p[1])})"
        ),
    ),
    max_leaves=8,
)


class Part:
    """An object whose attributes are the parameters, for Python's own evaluation."""


def in_python(text):
    tsm, play, lag = Part(), Part(), Part()
    tsm.alpha1, play.half_width, lag.den = 0.7, 0.1, [3.0, -4.0]
    functions = {k: getattr(math, k) for k in ("exp", "log", "sqrt", "sin", "cos", "tan", "tanh", "pi")}
    names = dict(tsm=tsm, play=play, lag=lag, alpha2=-1.3, A=2.0, theta=0.25, den=lag.den, B=1.5)
    names |= dict(abs=abs, min=min, max=max, **functions)
    return eval(text, {"__builtins__": {}}, names)


@settings(max_examples=300, deadline=None)
@given(text=TEXTS)
def test_expressions_mean_what_python_means(text):
    try:
        wanted = in_python(text)
    except (ZeroDivisionError, OverflowError):
        wanted = None
    if len(text) > MAX_LENGTH:
        return
    if wanted is not None:
        assert value(expression(text, KNOWN)) == pytest.approx(wanted, rel=1e-6, abs=1e-6)
        return
    said = refused(lambda: expression(text, KNOWN))  # unless it is the parameters that make it so
    assert said is None or "division by zero" in said or "no finite number" in said


# ---- what is refused


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("alpa1 + 1", marked("there is no parameter 'alpa1'. Did you mean 'tsm.alpha1'?", "alpa1 + 1", "^^^^^")),
        ("1 + thet", marked("there is no parameter 'thet'. Did you mean 'tsm.theta'?", "1 + thet", "    ^^^^")),
        ("2*k", marked("'k' may mean left.k or right.k. Give the full name.", "2*k", "  ^")),
        ("B + é*A", marked("there is no parameter 'é'." + CHOICES, "B + é*A", "    ^")),
        ("exp", marked("there is no parameter 'exp'." + CHOICES, "exp", "^^^")),
        ("A.imag", marked("there is no parameter 'A.imag'." + CHOICES, "A.imag", "^^^^^^")),
        ("2*(A", marked("this cannot be read from here on.", "2*(A", "  ^")),
        ("A = 2", marked("this cannot be read from here on. Write == for equal.", "A = 2", "  ^")),
        ("1 2", marked("this cannot be read from here on.", "1 2", "  ^")),
        ("A < 2", marked("this is a comparison, but an expression is expected here.", "A < 2", "^^^^^")),
        ("A^2 + 1", marked("there is no operation '^'. Write ** for a power.", "A^2 + 1", "^^^^^^^")),
        ("1 + A/0", marked("this is a division by zero.", "1 + A/0", "    ^^^")),
        ("A/(pi - pi)", marked("this is a division by zero.", "A/(pi - pi)", "^^^^^^^^^^^")),
        ("A + 9**9**9", marked("this is no finite number.", "A + 9**9**9", "    ^^^^^^^")),
        ("log(-1)", marked("this is no finite number.", "log(-1)", "^^^^^^^")),
        ("1e999", marked("inf is no finite number.", "1e999", "^^^^^")),
        ("True", marked("True is no finite number.", "True", "^^^^")),
        ("1j", marked("1j is no finite number.", "1j", "^^")),
        ("A * 'b'", marked("'b' is no finite number.", "A * 'b'", "    ^^^")),
        ("foo(A)", marked("there is no function 'foo'." + FUNCTIONS, "foo(A)", "^^^")),
        ("sqr(A)", marked("there is no function 'sqr'. Did you mean 'sqrt'?", "sqr(A)", "^^^")),
        ("(1)(A)", marked("there is no function." + FUNCTIONS, "(1)(A)", " ^")),
        ("sin(A, 2)", marked("sin takes one argument, got 2.", "sin(A, 2)", "^^^^^^^^^")),
        ("2 + min(A)", marked("min takes two arguments or more, got 1.", "2 + min(A)", "    ^^^^^^")),
        ("A, B", marked("these are several expressions. Give each as a separate text.", "A, B", "^^^^")),
        ("max(*A)", marked("max takes plain arguments.", "max(*A)", "^^^^^^^")),
        ("exp(x=A)", marked("exp takes plain arguments.", "exp(x=A)", "^^^^^^^^")),
        ("x" * 100_000, f"'{'x' * 28}… has 100000 characters; {MAX_LENGTH} are the most."),
        ("", "a text such as '2 * theta' is expected, got ''."),
        ("A\x00", "a text such as '2 * theta' is expected, got 'A\\x00'."),
        (3, "a text such as '2 * theta' is expected, got 3."),
        ("-" * 200 + "A", marked("this is nested more than 100 deep.", "-" * 80 + "…", "^" * 80)),
        ("A+" * 200 + "A", marked("this is nested more than 100 deep.", "A+" * 40 + "…", "^" * 80)),
        (
            "B + " * 30 + "alfa1",
            marked(
                "there is no parameter 'alfa1'. Did you mean 'alpha1'?",
                "…" + ("B + " * 30)[-75:] + "alfa1",
                76 * " " + "^^^^^",
            ),
        ),
    ],
)
def test_what_is_no_expression(text, message):
    with pytest.raises(ParameterError) as caught:
        expression(text, KNOWN)
    assert str(caught.value) == f"expression: {message}"


@pytest.mark.parametrize(
    "text",
    [
        "[A]",
        "{A}",
        "{A: B}",
        "lambda: A",
        "A if A else B",
        "f'{A}'",
        "A @ B",
        "A % 2",
        "A // 2",
        "A << 1",
        "~A",
        "not A",
        "A[0:1]",
        "den[A]",
        "lag.den[-1]",
        "await A",
        "[A for A in B]",
        "1if A else 2",
    ],
)
def test_python_beyond_arithmetic_is_refused(text):
    with pytest.raises(ParameterError) as caught:
        expression(text, KNOWN)
    assert str(caught.value) == "expression: " + marked(NO_ARITHMETIC, text, "^" * len(text))


@pytest.mark.parametrize(
    ("text", "mark"),
    [
        ("__import__('os')", "^^^^^^^^^^"),
        ("__import__('os').system('true')", "^" * 23),
        ("exp.__globals__['x']()", "^" * 20),
        ("().__class__.__bases__[0]()", "^" * 25),
        ("eval('1')", "^^^^"),
    ],
)
def test_no_code_is_reached(text, mark):
    named = text[: len(mark)] if "'" not in mark and text[: len(mark)] in ("__import__", "eval") else ""
    shown = f" '{named}'" if named else ""
    with pytest.raises(ParameterError) as caught:
        expression(text, KNOWN)
    assert str(caught.value) == "expression: " + marked(f"there is no function{shown}.{FUNCTIONS}", text, mark)


@settings(max_examples=300, deadline=None)
@given(text=st.text("Atsm.lph12 ()[]<>=+-*/^,'\"{}:\\\n\x00é_5e", max_size=60) | st.text(max_size=40))
def test_whatever_is_written_either_reads_or_is_refused(text):
    for read in (expression, lambda given, known: constraint("", given, known)):
        said = refused(lambda read=read: read(text, KNOWN))
        assert said is None or said.startswith(("expression: ", "constraint: "))


# ---- constraints


def test_a_comparison_becomes_a_difference():
    for text, wanted, equality, strict in [
        ("A > B", 0.5, False, True),
        ("A >= B", 0.5, False, False),
        ("A < B", -0.5, False, True),
        ("A <= B", -0.5, False, False),
        ("A == B", 0.5, True, False),
    ]:
        (one,) = constraint("", text, KNOWN)
        assert (one.name, one.text, one.equality, one.strict) == (text, text, equality, strict)
        assert value(one.expression) == wanted
        assert set(one.expression.names) == {"tsm.A", "B"}


def test_a_monotone_map():
    (one,) = constraint("monotone", "alpha2 + A - abs(B) > 0", KNOWN)
    assert one.name == "monotone"
    assert one.expression.names == ("tsm.alpha2", "tsm.A", "B")
    assert value(one.expression) == pytest.approx(-0.8)


def test_each_part_of_a_chain_is_a_constraint():
    made = constraint("", "0 < alpha1 <= theta < (2 + 1)", KNOWN)
    assert [(c.text, c.strict) for c in made] == [
        ("0 < alpha1", True),
        ("alpha1 <= theta", False),
        ("theta < 2 + 1", True),
    ]
    assert [value(c.expression) for c in made] == pytest.approx([0.7, -0.45, 2.75])
    assert {c.name for c in constraint("order", "0 < A < B", KNOWN)} == {"order"}


def test_constraints_come_alone_in_a_list_or_by_name():
    assert constraints("A > 0", KNOWN) == constraints(["A > 0"], KNOWN) == constraints(("A > 0",), KNOWN)
    assert [c.name for c in constraints({"one": "A > 0", "two": "1 < B < 2"}, KNOWN)] == ["one", "two", "two"]
    assert constraints([], KNOWN) == ()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["A > 0", "A + 1"], "constraint: " + marked(NO_COMPARISON, "A + 1", "^^^^^")),
        ({"c": "A"}, "constraint 'c': " + marked(NO_COMPARISON, "A", "^")),
        (
            "A > 0 and B > 0",
            "constraint: "
            + marked("one comparison is expected. Write several as a list.", "A > 0 and B > 0", "^" * 15),
        ),
        ("A != B", "constraint: " + marked("comparisons are <, <=, >, >=, ==.", "A != B", "^^^^^^")),
        ("A in B", "constraint: " + marked("comparisons are <, <=, >, >=, ==.", "A in B", "^^^^^^")),
        ("1 < 2", "constraint: " + marked(ALWAYS, "1 < 2", "^^^^^")),
        ("A > 2 > 3", "constraint: " + marked(NEVER, "A > 2 > 3", "    ^^^^^")),
        ("A < A", "constraint: " + marked(NEVER, "A < A", "^^^^^")),
        ("A == A", "constraint: " + marked(ALWAYS, "A == A", "^^^^^^")),
        ("A <= A", "constraint: " + marked(ALWAYS, "A <= A", "^^^^^^")),
        ("A > B > 1/0", "constraint: " + marked("this is a division by zero.", "A > B > 1/0", "        ^^^")),
        (
            {"m": "alpha3 > 0"},
            "constraint 'm': "
            + marked("there is no parameter 'alpha3'. Did you mean 'tsm.alpha2'?", "alpha3 > 0", "^^^^^^"),
        ),
        ([None], "constraint: a text such as '2 * theta' is expected, got None."),
        (5, "constraints must be texts such as 'theta > 0', a list or a mapping of them, got 5."),
    ],
)
def test_what_is_no_constraint(given, message):
    with pytest.raises(ParameterError) as caught:
        constraints(given, KNOWN)
    assert str(caught.value) == message


# ---- ties


def test_ties_come_in_the_order_they_can_be_worked_out():
    made = ties(
        {"theta": "2*alpha2", "half_width": "alpha1/B", "tsm.alpha2": "alpha1 + half_width", "den[1]": 2}, KNOWN, []
    )
    place = {name: i for i, (name, _) in enumerate(made)}
    assert set(place) == {"tsm.theta", "play.half_width", "tsm.alpha2", "lag.den[1]"}
    assert place["play.half_width"] < place["tsm.alpha2"] < place["tsm.theta"]
    values = dict(VALUES)
    for name, read in made:
        values[name] = value(read, values)
    assert values["lag.den[1]"] == 2.0
    assert values["tsm.theta"] == pytest.approx(2 * (0.7 + 0.7 / 1.5))


def test_no_ties():
    assert ties({}, KNOWN, ["B"]) == ()


@settings(deadline=None)
@given(st.permutations(range(8)), st.randoms())
def test_ties_without_a_circle_can_always_be_ordered(order, random):
    names = [f"b.p{i}" for i in range(8)]
    given_ = {}
    for i in range(1, 8):
        followed = random.sample(order[:i], random.randint(1, i))
        given_[names[order[i]]] = " + ".join(f"b.p{j}" for j in followed)
    keys = list(given_)
    random.shuffle(keys)
    done = {names[order[0]]}
    for name, read in ties({k: given_[k] for k in keys}, names, []):
        assert set(read.names) <= done
        done.add(name)
    assert done == set(names)


@pytest.mark.parametrize(
    ("given", "free", "message"),
    [
        ({"A": "A + 1"}, [], "ties: 'tsm.A' depends on itself."),
        (
            {"alpha1": "A", "A": "2*B", "B": "theta", "theta": "A"},
            [],
            "ties: parameters depend on each other in a cycle, tsm.A -> B -> tsm.theta -> tsm.A.",
        ),
        ({"alpha1": "B", "tsm.alpha1": "A"}, [], "ties: 'tsm.alpha1' is tied twice."),
        ({"theta": "2*A"}, ["tsm.theta"], "ties: 'tsm.theta' is free in this fit, so it cannot be tied to '2*A'."),
        ({"thet": "A"}, [], "ties: there is no parameter 'thet'. Did you mean 'tsm.theta'?"),
        ({"k": "A"}, [], "ties: 'k' may mean left.k or right.k. Give the full name."),
        ({"A": "C"}, [], "tie of 'tsm.A': " + marked("there is no parameter 'C'." + CHOICES, "C", "^")),
        (
            {"A": "B > 1"},
            [],
            "tie of 'tsm.A': " + marked("this is a comparison, but an expression is expected here.", "B > 1", "^^^^^"),
        ),
        ({"A": math.nan}, [], "tie of 'tsm.A': a text such as '2 * theta' is expected, got nan."),
        ({"A": True}, [], "tie of 'tsm.A': a text such as '2 * theta' is expected, got True."),
        (["A"], [], "ties must map parameters to expressions, such as {'alpha2': 'alpha1'}, got ['A']."),
    ],
)
def test_what_is_no_tie(given, free, message):
    with pytest.raises(ParameterError) as caught:
        ties(given, KNOWN, free)
    assert str(caught.value) == message


def test_a_name_with_many_meanings_lists_some():
    with pytest.raises(ParameterError) as caught:
        expression("k", [f"b{i}.k" for i in range(9)])
    assert str(caught.value) == "expression: " + marked(
        "'k' may mean b0.k or b1.k or b2.k or 6 more. Give the full name.", "k", "^"
    )
