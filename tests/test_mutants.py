"""The changes of mutation testing: what each makes of a text."""

import pytest

from tests.mutants import mutants


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("x = a < b", ["x = a <= b"]),
        ("x = a + b * c", ["x = a - b * c", "x = a + b / c"]),
        ("x = a and b", ["x = a or b"]),
        ("x = -a", ["x = +a"]),
        ("x = [2, 0.5, 0.0, True, 'two']", [f"x = [{new}, 'two']" for new in (
            "3, 0.5, 0.0, True", "2, 1.0, 0.0, True", "2, 0.5, 1.0, True", "2, 0.5, 0.0, False")]),
        ("if a:\n    b()", ["if not a:\n    b()", "if a:\n    ..."]),
        ("x = [k for k in a if k]", ["x = [k for k in a if True]"]),
        ("x = min(a)", ["x = max(a)"]),
        ("def f(x: int=g) -> A | B:\n    'Adds 2 + 2.'", []),
    ],
)  # fmt: skip
def test_each_mutant_has_one_change(text, made):
    assert [mutant for *_, mutant in mutants(text)] == made


def test_a_mutant_is_named_by_its_line_and_what_a_number_is_a_part_of():
    assert [what for _, what, _ in mutants("x = 1\ny = x[2]")] == ["1: x = 1 -> x = 2", "2: x[2] -> x[3]"]
