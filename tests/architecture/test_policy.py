"""Numbers that decide stand in one table, each with its meaning, and all numbers together become fewer."""

import ast
from dataclasses import fields

import pytest

from symid.identification.judge import POLICY
from tests.architecture.source import PACKAGE

MOST = 160
"""Numbers of the rooms of identification and of the verdict: every change lowers them, or says why not.

The search of gravity and zeros has five: states and steps of its differences, a grid, a largest step, and how
far gravity differs on Earth. The
test of laws that are much alike has its number of exchanges. What bodies differ from drawings by, and the
least deviation of a spring's torque, replace accusations and promises that were wrong. From which part of
its bend on slow samples show a friction law was one, which was in no table.
"""
POLICY_FILE = PACKAGE / "identification" / "judge" / "policy.py"


def count_numbers(value: ast.expr) -> int:
    """Return how many numbers an expression states; a product or a power is one."""
    if isinstance(value, ast.Constant):
        return int(isinstance(value.value, (int, float)) and not isinstance(value.value, bool))
    if isinstance(value, ast.UnaryOp):
        return count_numbers(value.operand)
    if isinstance(value, ast.BinOp):
        return min(1, sum(count_numbers(part) for part in ast.walk(value) if isinstance(part, ast.Constant)))
    if isinstance(value, (ast.Tuple, ast.List)):
        return sum(map(count_numbers, value.elts))
    if isinstance(value, ast.Call):
        return sum(map(count_numbers, [*value.args, *(entry.value for entry in value.keywords)]))
    return sum(map(count_numbers, value.values)) if isinstance(value, ast.Dict) else 0


def list_stated(tree: ast.Module) -> list[ast.expr]:
    """Return what modules and classes assign, and the defaults of arguments."""
    bodies = [tree.body, *(node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef))]
    assigned = [node for body in bodies for node in body if isinstance(node, (ast.Assign, ast.AnnAssign))]
    found = [node.value for node in assigned if node.value is not None]
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            found += [*node.args.defaults, *filter(None, node.args.kw_defaults)]
    return found


def count_file(text: str) -> int:
    return sum(map(count_numbers, list_stated(ast.parse(text))))


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("A = 3", 1),
        ("A = -3.0", 1),
        ("A: float = 2.0 * 3.0", 1),
        ("A = (1, 2, 'x', True)", 2),
        ("A = {'k': 1.0}\nB = f(1, b=2)", 3),
        ("class A:\n    x: int = 1", 1),
        ("def f(a=1, *, b=2): return 3", 2),
    ],
)
def test_numbers_are_counted(text, count):
    assert count_file(text) == count


def test_numbers_of_identification_become_fewer():
    files = [*(PACKAGE / "identification").rglob("*.py"), PACKAGE / "report" / "verdict.py"]
    assert sum(count_file(path.read_text(encoding="utf-8")) for path in files) <= MOST


def is_entry(value: ast.expr) -> bool:
    """Return whether a number is stated with meaning, source, and what changing it does."""
    return (
        isinstance(value, ast.Call)
        and isinstance(value.func, ast.Name)
        and value.func.id == "_number"
        and len(value.args) == 4
        and all(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in value.args[1:])
    )


def test_no_number_of_the_policy_is_without_its_meaning():
    tree = ast.parse(POLICY_FILE.read_text(encoding="utf-8"))
    bare = [ast.unparse(value) for value in list_stated(tree) if count_numbers(value) and not is_entry(value)]
    assert not bare
    entries = fields(POLICY)
    assert len(entries) == sum(is_entry(value) for value in list_stated(tree)) > 0
    for entry in entries:
        assert set(entry.metadata) == {"meaning", "source", "changed"}
        assert min(map(len, entry.metadata.values())) > 3
