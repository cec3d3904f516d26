"""The rooms, their order, and the shape of every module."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import symid

PROJECT = Path(__file__).resolve().parents[2]
PACKAGE = PROJECT / "symid"
ROOMS = (
    "kernel",
    "robot",
    "formats",
    "algebra",
    "joint",
    "dynamics",
    "parameters",
    "teaching",
    "codegen",
    "data",
    "excitation",
    "simulation",
    "rows",
    "estimators",
    "residuals",
    "logcheck",
    "identification",
    "friction",
    "elastic",
    "tasks",
    "study",
    "report",
    "api",
    "cli",
)
MODULES = tuple(sorted(path for path in PACKAGE.rglob("*.py") if "_data" not in path.parts))
LONGEST_FUNCTION = 55
# Identification runs on a machine without SymPy; these rooms must not need it to be imported.
WITHOUT_SYMBOLS = (
    "robot",
    "formats",
    "data",
    "excitation",
    "simulation",
    "rows",
    "estimators",
    "residuals",
    "logcheck",
    "identification",
    "friction",
    "elastic",
    "study",
    "report",
)
LIGHT_MODULES = frozenset({"symid.codegen.functions", "symid.codegen.library", "symid.codegen.cache"})
SYMBOLIC = frozenset({"sympy", "casadi"})


def name_of(path: Path) -> str:
    """Return the dotted name of a module of the project."""
    parts = path.relative_to(PROJECT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """Return the room that a dotted name under `symid` stands in."""
    parts = module.split(".")
    if parts == ["symid", "__main__"]:
        return "cli"
    return parts[1] if len(parts) > 1 and parts[1] in ROOMS else "kernel"


def imports_of(tree: ast.AST, module: str, *, package: bool) -> Iterator[str]:
    """Yield the dotted names that a module imports, wherever in it the import stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                kept = parts[: len(parts) - node.level + (1 if package else 0)]
                base = ".".join((*kept, base)).rstrip(".")
            yield from (f"{base}.{alias.name}" for alias in node.names)


def statements_at_import(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield every node that runs when a module is imported: not the bodies of functions."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        bodies = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
        waiting.extend(() if isinstance(node, bodies) else ast.iter_child_nodes(node))


def parse(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def exported(tree: ast.Module) -> list[str] | None:
    """Return what `__all__` says, None where there is none."""
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id="__all__")], value=value):
                return list(ast.literal_eval(value))
            case ast.AnnAssign(target=ast.Name(id="__all__"), value=ast.expr() as value):
                return list(ast.literal_eval(value))
    return None


def defined(tree: ast.Module) -> set[str]:
    """Return the names that a module binds at its top level."""
    names: set[str] = set()
    for node in tree.body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.Assign(targets=targets):
                names |= {
                    part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)
                }
            case ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                names |= {(alias.asname or alias.name).split(".")[0] for alias in aliases}
    return names


each_module = pytest.mark.parametrize("path", MODULES, ids=name_of)
plain = tuple(path for path in MODULES if path.name != "__init__.py")
packages = tuple(path for path in MODULES if path.name == "__init__.py")


@each_module
def test_a_room_imports_only_from_rooms_before_it(path):
    module = name_of(path)
    here = ROOMS.index(room_of(module))
    wrong = [
        name
        for name in imports_of(parse(path), module, package=path.name == "__init__.py")
        # The package itself names what the API offers; it is imported when it is used.
        if name.split(".")[0] == "symid" and ROOMS.index(room_of(name)) > here and module != "symid"
    ]
    assert not wrong, f"{module} ({ROOMS[here]}) imports {wrong}"


def test_the_import_reader_sees_relative_and_inner_imports():
    text = "from . import a\nfrom ..data import readers\ndef f():\n    import symid.cli.main\n"
    found = set(imports_of(ast.parse(text), "symid.robot.toml", package=False))
    assert found == {"symid.robot.a", "symid.data.readers", "symid.cli.main"}


def test_every_folder_is_a_known_room():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name[0] != "_"}
    assert folders <= set(ROOMS)


@each_module
def test_rooms_that_run_without_sympy_do_not_import_it(path):
    module = name_of(path)
    heads: set[str] = set()
    for node in statements_at_import(parse(path)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = imports_of(node, module, package=path.name == "__init__.py")
            heads |= {name.split(".")[0] for name in names}
    light = room_of(module) in WITHOUT_SYMBOLS or module in LIGHT_MODULES
    assert not (light and heads & SYMBOLIC)


def length_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function without those of its arguments and its docstring."""
    first = function.body[1:] if ast.get_docstring(function) else function.body
    return function.end_lineno - first[0].lineno + 1 if first else 0


@each_module
def test_no_function_is_long(path):
    functions = [n for n in ast.walk(parse(path)) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    lengths = {n.name: length_of(n) for n in functions}
    long = {name: length for name, length in lengths.items() if length > LONGEST_FUNCTION}
    assert not long


@pytest.mark.parametrize("path", plain, ids=name_of)
def test_every_module_says_what_it_offers(path):
    tree = parse(path)
    names = exported(tree)
    assert names is not None, "no __all__"
    assert set(names) <= defined(tree)
    assert len(set(names)) == len(names)
    public = {n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name[0] != "_"}
    assert public <= set(names), "public by name, but not in __all__"


@pytest.mark.parametrize("path", packages, ids=name_of)
def test_packages_hold_a_docstring_only(path):
    tree = parse(path)
    assert ast.get_docstring(tree)
    # The package itself names what the API offers.
    assert path.parent == PACKAGE or len(tree.body) == 1


@each_module
def test_every_module_begins_with_a_docstring(path):
    assert ast.get_docstring(parse(path))


@each_module
def test_no_module_changes_its_own_globals(path):
    assert not [node for node in ast.walk(parse(path)) if isinstance(node, ast.Global)]


@each_module
def test_nothing_is_called_for_its_effect_at_import(path):
    calls = [n for n in parse(path).body if isinstance(n, ast.Expr) and isinstance(n.value, ast.Call)]
    assert not [ast.unparse(call) for call in calls]


@each_module
def test_modules_keep_no_growing_state(path):
    # An empty list or dictionary at the top of a module is there to be filled later.
    values = [n.value for n in parse(path).body if isinstance(n, ast.Assign | ast.AnnAssign)]
    assert not {ast.unparse(value) for value in values if value is not None} & {
        "[]",
        "{}",
        "set()",
        "dict()",
        "list()",
    }


@each_module
def test_sets_of_symbols_are_never_walked(path):
    # Their order differs from run to run.
    names = [node.attr for node in ast.walk(parse(path)) if isinstance(node, ast.Attribute)]
    assert "free_symbols" not in names


@each_module
def test_only_the_command_line_prints_or_exits(path):
    if room_of(name_of(path)) == "cli":
        return
    calls = [n.func for n in ast.walk(parse(path)) if isinstance(n, ast.Call)]
    names = {ast.unparse(func) for func in calls}
    assert not names & {"print", "exit", "quit", "sys.exit", "os._exit", "click.echo"}


VERBS = sorted(path for path in (PACKAGE / "cli").glob("*.py") if path.name != "__init__.py")
# What is not a verb: how verbs are called, and what they share.
HELPERS = frozenset({"call", "main", "inputs", "options", "output"})


@pytest.mark.parametrize("path", [path for path in VERBS if path.stem not in HELPERS], ids=name_of)
def test_a_verb_is_a_client_of_the_api(path):
    allowed = ("symid.api", "symid.cli", "symid.errors", "click")
    offered = {"symid", *(f"symid.{name}" for name in symid.__all__)}
    wrong = [
        name
        for name in imports_of(parse(path), name_of(path), package=False)
        if name not in offered
        and not name.startswith(tuple(f"{head}." for head in allowed))
        and name not in allowed
        and name.split(".")[0] not in sys.stdlib_module_names
    ]
    assert not wrong
