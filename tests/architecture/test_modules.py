"""The rooms, their order, and the shape of every module: one test a rule."""

import ast
import contextlib
import sys
from collections import defaultdict

import pytest

import symid
from tests.architecture.source import BY_NAME, MODULES, PACKAGE, ROOMS, list_imports, room_of

LONGEST_FUNCTION = 100
# Identification runs on a machine without SymPy; these rooms must not need it to be imported.
WITHOUT_SYMBOLS = ("robot", "logs", "excitation", "simulation", "study", "report")
LIGHT_MODULES = frozenset({"symid.codegen.functions", "symid.codegen.library", "symid.codegen.cache"})
# What reads base parameters of a robot, so as to compare or to write them.
SYMBOLIC_MODULES = frozenset(
    {f"symid.identification.{name}" for name in ("compare", "export", "identified", "payload")}
)
# Problems of CasADi, which are loaded when one is posed.
SYMBOLIC_MODULES |= {"symid.identification.elastic.nlp"}
SYMBOLIC = frozenset({"sympy", "casadi"})


def test_a_room_imports_only_from_rooms_before_it():
    wrong = [
        f"{module.name} ({module.room}) imports {source}.{name}"
        for module in MODULES
        # The package itself names what the API offers; it is imported when it is used.
        if module.name != "symid"
        for source, name, _ in module.imports
        if source.split(".")[0] == "symid"
        and source != "symid"
        and ROOMS.index(room_of(f"{source}.{name}")) > ROOMS.index(module.room)
    ]
    assert not wrong


def test_other_rooms_are_imported_by_what_they_offer():
    # Not from their files: what a room does not name in its `__init__` is its own.
    wrong = [
        f"{module.name}: from {source} import {name}"
        for module in MODULES
        if not module.is_package
        for source, name, _ in module.imports
        if source.split(".")[0] == "symid" and room_of(source) not in {"kernel", module.room}
        if source in BY_NAME and not BY_NAME[source].is_package
    ]
    # The entry loads what answers when it is called.
    assert not wrong


def list_code(module):
    """Yield the nodes of a module, those of annotations in quotes too; comments and prose are none."""
    for node in module.nodes:
        yield node
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            with contextlib.suppress(SyntaxError, ValueError):
                yield from ast.walk(ast.parse(node.value, mode="eval"))


def test_what_a_room_offers_is_used_by_another():
    files = [module for module in MODULES if not module.is_package]
    used = {(source, name) for module in files for source, name, _ in module.imports}
    # A room that is imported as a whole: `report.write_html`.
    for module in files:
        rooms = {local: f"{source}.{name}" for source, name, local in module.imports}
        used |= {
            (rooms.get(node.value.id, ""), node.attr)
            for node in list_code(module)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        }
    texts = "".join(
        path.read_text(encoding="utf-8")
        for folder in ("docs", "tests", "benchmarks")
        for path in (PACKAGE.parent / folder).rglob("*")
        if path.suffix in {".py", ".md"}
    )
    unused = [
        f"{module.name}: {name}"
        for module in MODULES
        if module.is_package and module.name not in {"symid", "symid.api"}
        for _, name, _ in module.imports
        if name not in {"TYPE_CHECKING", "load_names"}
        and (module.name, name) not in used
        and name not in texts
    ]
    assert not unused


def test_every_folder_is_a_known_room():
    folders = {
        path.parent.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if "_data" not in path.parts
    }
    assert {".".join(folder.parts) or "kernel" for folder in folders} == set(ROOMS)


def test_rooms_that_run_without_sympy_do_not_import_it():
    wrong = []
    for module in MODULES:
        light = module.room.split(".")[0] == "identification" and module.name not in SYMBOLIC_MODULES
        light = light or module.room in WITHOUT_SYMBOLS or module.name in LIGHT_MODULES
        heads = {source.split(".")[0] for source, _, _ in list_imports(module.list_import_time_nodes())}
        if light and heads & SYMBOLIC:
            wrong.append(module.name)
    assert not wrong


def test_no_function_is_long():
    # Without its arguments and its docstring.
    long = []
    for module in MODULES:
        for node in module.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                first = node.body[1:] if ast.get_docstring(node) else node.body
                length = node.end_lineno - first[0].lineno + 1 if first else 0
                if length > LONGEST_FUNCTION:
                    long.append(f"{module.name}.{node.name}: {length} lines")
    assert not long


def test_no_class_has_the_name_of_another():
    places = defaultdict(list)
    for module in MODULES:
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module.name)
    assert not {name: where for name, where in places.items() if len(where) > 1}


def test_every_module_begins_with_a_docstring():
    assert not [module.name for module in MODULES if not ast.get_docstring(module.tree)]


def test_packages_only_name_what_they_offer():
    allowed = (ast.Expr, ast.ImportFrom, ast.If)
    wrong = [
        f"{module.name}: {ast.unparse(node)}"
        for module in MODULES
        if module.is_package
        for node in module.tree.body
        if not isinstance(node, allowed) and ast.unparse(node) != f"__version__ = '{symid.__version__}'"
    ]
    assert not wrong


def test_a_verb_is_a_client_of_the_api():
    # What is not a verb: how verbs are called, and what they share.
    shared = {"symid.cli.call", "symid.cli.main"}
    allowed = {"symid", "symid.api", "symid.errors", "symid.environment", "symid.options", "click"}
    offered = {f"symid.{name}" for name in symid.__all__}
    wrong = [
        f"{module.name}: {source}.{name}"
        for module in MODULES
        if module.room == "cli" and module.name not in shared
        for source, name, _ in module.imports
        if source not in allowed
        and f"{source}.{name}" not in offered
        and not source.startswith("symid.cli")
        and source.split(".")[0] not in sys.stdlib_module_names
    ]
    assert not wrong


PRINTS = {"print", "exit", "quit", "sys.exit", "os._exit", "click.echo"}
EMPTY = {"[]", "{}", "set()", "dict()", "list()"}
TOP = {
    "calls at import": lambda node: isinstance(node, ast.Expr) and isinstance(node.value, ast.Call),
    # An empty list or dictionary at the top of a module is there to be filled later.
    "growing state": lambda node: (
        isinstance(node, ast.Assign | ast.AnnAssign) and node.value and ast.unparse(node.value) in EMPTY
    ),
}
ANYWHERE = {
    "changes of globals": lambda node: isinstance(node, ast.Global),
    # The order of such a set differs from run to run.
    "walks over sets of symbols": lambda node: (
        isinstance(node, ast.Attribute) and node.attr == "free_symbols"
    ),
}
OUTSIDE_CLI = {
    "prints or exits": lambda node: isinstance(node, ast.Call) and ast.unparse(node.func) in PRINTS
}


@pytest.mark.parametrize("what", [*TOP, *ANYWHERE, *OUTSIDE_CLI])
def test_no_module_has_any_of_these(what):
    rule = (TOP | ANYWHERE | OUTSIDE_CLI)[what]
    assert not [
        f"{module.name}: {ast.unparse(node)}"
        for module in MODULES
        if what not in OUTSIDE_CLI or module.room != "cli"
        for node in (module.tree.body if what in TOP else module.nodes)
        if rule(node)
    ]
