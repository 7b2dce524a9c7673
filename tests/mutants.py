"""Mutation testing of the modules that decide the numbers: ``python tests/mutants.py [MODULE …] [--share 0.3]``.

Each mutant has one operator, comparison, boundary, condition, constant or statement changed. The tests nearest to
the module run on a copy of the tree with that mutant: a mutant that no test notices (a survivor) is printed with its
line. Sampled with ``--share`` and ``--seed``; ``--only 120:180`` takes a range of lines. Survivors that change nothing
anybody could see stand in ``EQUIVALENT``, each with the reason, and are not run.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NEAREST = {
    "tsmblocks/compiler/compile.py": ["tests/test_compile.py", "tests/test_loops.py", "-k", "not large and not fit"],
    "tsmblocks/engine/register_kernel.py": [
        "tests/test_kernel_forms.py",
        "tests/test_engine.py",
        "-k",
        "not writers and not by_hand and not hand_written and not machine_code",
    ],
    "tsmblocks/diagnosis/decision.py": [
        "tests/test_decision.py",
        "tests/test_diagnosis_parts.py",
        "-k",
        "not against_many and not one_time_in_twenty",
    ],
}
"""The modules, and the tests that are to notice a change in each: quick ones, which together take seconds."""
COMPILE, DECISION = "tsmblocks/compiler/compile.py", "tsmblocks/diagnosis/decision.py"
COMPUTED = "two computed numbers are not equal"
EQUIVALENT: dict[tuple[str, str], str] = {
    (COMPILE, "ca.SX(0) -> ca.SX(1)"): "the initial state of a held output is replaced by its first sample",
    (COMPILE, "at_samples[1] -> at_samples[2]"): "the exact form of an update has the values of the plain one",
    (DECISION, "removed >= concentrated_size -> removed > concentrated_size"): COMPUTED,
    (
        DECISION,
        "removed >= RARE_SHARE * (before - noise_variance) -> removed > RARE_SHARE * (before - noise_variance)",
    ): COMPUTED,
    (DECISION, "before >= (1 + MIN_EXCESS) * noise_variance -> before > (1 + MIN_EXCESS) * noise_variance"): COMPUTED,
    (DECISION, "value > critical_value -> value >= critical_value"): COMPUTED,
    (DECISION, "worse >= concentrated_size -> worse > concentrated_size"): COMPUTED,
    (DECISION, "worse < tolerance -> worse <= tolerance"): COMPUTED,
    (
        DECISION,
        "INDISTINGUISHABLE_NOISE_SHARE * noise_variance -> INDISTINGUISHABLE_NOISE_SHARE / noise_variance",
    ): "of a candidate that is accepted, 20 % of what it removes are more than 1 % of the noise",
    (
        DECISION,
        "before - one.loss >= SIMPLER_EFFECT_SHARE * removed -> before - one.loss > SIMPLER_EFFECT_SHARE * removed",
    ): COMPUTED,
    (
        DECISION,
        "min((away[side] for side in sides)) <= tolerance -> min((away[side] for side in sides)) < tolerance",
    ): COMPUTED,
    (
        DECISION,
        "before - one.loss >= SIMPLER_EFFECT_SHARE * (before - named.loss) -> before - one.loss > "
        "SIMPLER_EFFECT_SHARE * (before - named.loss)",
    ): COMPUTED,
    (
        DECISION,
        "largest[-1] > CONCENTRATED_RATIO * -min(largest[0], 0.0) -> largest[-1] >= "
        "CONCENTRATED_RATIO * -min(largest[0], 0.0)",
    ): COMPUTED,
    (DECISION, "repr=False -> repr=True"): "how a value is shown decides nothing",
    (DECISION, "np.maximum(spread, 1e-12) -> np.maximum(spread, 2e-12)"): "both are far below any scatter",
}
"""Mutants that cannot be noticed, by module and change, with the reason."""
OPPOSITE: dict[type, type] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Pow: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
OTHER_NAME = {"min": "max", "max": "min", "any": "all", "all": "any"}
SLACK = 20.0
"""Seconds that tests with a mutant may take beyond three times those without. Chosen: code is compiled anew."""


def main(arguments: list[str]) -> int:
    """Run the mutants that are asked for; 1 where one survives that is not known to be equivalent."""
    asked = parsed(arguments)
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".*", "__pycache__", "out", "dist", "build"))
        for module in asked.module or NEAREST:
            survivors += attack(tree, module, asked)
    return 1 if survivors else 0


def parsed(arguments: list[str]) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", nargs="*", choices=[[], *NEAREST], help="only these")
    parser.add_argument("--share", type=float, default=1.0, help="share of the mutants that is run")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--only", default="", metavar="FIRST:LAST", help="lines that are mutated")
    parser.add_argument("--list", action="store_true", help="name the mutants and run none")
    return parser.parse_args(arguments)


def attack(tree: Path, module: str, asked: argparse.Namespace) -> int:
    """Run the mutants of one module in a copy of the tree; how many survive."""
    path, text = tree / module, (ROOT / module).read_text("utf-8")
    found = [(what, made) for line, what, made in mutants(text) if within(line, asked.only)]
    named = {what.split(": ", 1)[1] for _, what, _ in mutants(text)}
    if stale := [change for one, change in EQUIVALENT if one == module and change not in named]:
        sys.exit(f"EQUIVALENT has what is no mutant of {module} any more: {'; '.join(stale)}")
    chosen = sorted(random.Random(asked.seed).sample(range(len(found)), round(asked.share * len(found))))
    if asked.list:
        print("\n".join(found[k][0] for k in chosen))
        return 0
    began = time.monotonic()
    if not passes(tree, module, 3600.0):
        sys.exit(f"the tests of {module} fail without a mutant")
    limit = 3 * (time.monotonic() - began) + SLACK
    killed, known, survivors = 0, 0, []
    for k in chosen:
        what, mutant = found[k]
        if (module, what.split(": ", 1)[1]) in EQUIVALENT:
            known += 1
            continue
        path.write_text(mutant, "utf-8")
        if passes(tree, module, limit):
            survivors.append(what)
            print(f"survives  {module}:{what}", flush=True)
        else:
            killed += 1
    path.write_text(text, "utf-8")
    run = killed + len(survivors)
    print(
        f"{module}: {len(found)} mutants, {run} run, {killed} killed ({killed / max(run, 1):.0%}), {known} equivalent"
    )
    return len(survivors)


def within(line: int, only: str) -> bool:
    """Whether a line is among those asked for."""
    first, _, last = only.partition(":")
    return int(first or 0) <= line <= int(last or 10**9)


def passes(tree: Path, module: str, limit: float) -> bool:
    """Whether the nearest tests pass in the tree within a time [s]."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist"]
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with tempfile.TemporaryFile() as said:
        try:
            done = subprocess.run(
                [*command, *NEAREST[module]],
                check=False,
                cwd=tree,
                env=environment,
                stdout=said,
                stderr=said,
                timeout=limit,
            )
        except subprocess.TimeoutExpired:
            return False
    return done.returncode == 0


# ---- what is changed --------------------------------------------------------------------------


def mutants(text: str) -> Iterator[tuple[int, str, str]]:
    """Line, change in words, and the whole text of each mutant of a module."""
    tree = ast.parse(text)
    numbers = {id(node): k for k, node in enumerate(ast.walk(tree))}
    above = {numbers[id(inner)]: k for k, node in enumerate(ast.walk(tree)) for inner in ast.iter_child_nodes(node)}
    said = {id(inner) for part in unrun(tree) for inner in ast.walk(part)}
    for number, node in enumerate(ast.walk(tree)):
        for change in range(0 if id(node) in said else len(changes(node))):
            other = ast.parse(text)  # quicker than a copy
            nodes = list(ast.walk(other))
            site = nodes[number]
            # A number says nothing without what it is a part of.
            shown = nodes[above[number]] if isinstance(site, ast.Constant) else site
            before = ast.unparse(shown)
            changes(site)[change]()
            after = ast.unparse(shown)
            line = getattr(node, "lineno", None) or node.target.lineno  # a comprehension has none
            yield line, f"{line}: {clipped(before)} -> {clipped(after)}", ast.unparse(other)


def unrun(tree: ast.Module) -> Iterator[ast.AST]:
    """Annotations, which are never evaluated, and decorators, which say how values compare."""
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            if getattr(node, name, None) is not None:
                yield getattr(node, name)
        yield from getattr(node, "decorator_list", ())


def clipped(text: str) -> str:
    """One line of a text."""
    line = " ".join(text.split())
    return line if len(line) < 90 else f"{line[:87]}..."


def changes(node: ast.AST) -> list:
    """What can be changed at a node: functions that change it."""
    return [change for kind, made in CHANGES.items() if isinstance(node, kind) for change in made(node)]


def of_comparison(node: ast.Compare) -> list:
    def flip(k):
        node.ops[k] = OPPOSITE[type(node.ops[k])]()

    return [lambda k=k: flip(k) for k in range(len(node.ops))]


def of_operator(node: ast.BinOp | ast.BoolOp) -> list:
    return [lambda: setattr(node, "op", OPPOSITE[type(node.op)]())] if type(node.op) in OPPOSITE else []


def of_sign(node: ast.UnaryOp) -> list:
    return [lambda: setattr(node, "op", ast.UAdd())] if isinstance(node.op, ast.USub) else []


def of_condition(node: ast.If | ast.IfExp) -> list:
    return [lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))]


def of_filter(node: ast.comprehension) -> list:
    return [lambda k=k: node.ifs.__setitem__(k, ast.Constant(True)) for k in range(len(node.ifs))]


def of_constant(node: ast.Constant) -> list:
    value = node.value
    if isinstance(value, bool):
        return [lambda: setattr(node, "value", not value)]
    if isinstance(value, int):
        return [lambda: setattr(node, "value", value + 1)]
    if isinstance(value, float):
        return [lambda: setattr(node, "value", 2 * value or 1.0)]
    return []


def of_call(node: ast.Call) -> list:
    if isinstance(node.func, ast.Name) and node.func.id in OTHER_NAME:
        return [lambda: setattr(node.func, "id", OTHER_NAME[node.func.id])]
    return []


def of_statement(node: ast.Expr) -> list:
    """A call whose result is not used is left out; a docstring is none."""
    return [lambda: setattr(node, "value", ast.Constant(...))] if isinstance(node.value, ast.Call) else []


CHANGES = {
    ast.Compare: of_comparison,
    (ast.BinOp, ast.BoolOp): of_operator,
    ast.UnaryOp: of_sign,
    (ast.If, ast.IfExp): of_condition,
    ast.comprehension: of_filter,
    ast.Constant: of_constant,
    ast.Call: of_call,
    ast.Expr: of_statement,
}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
