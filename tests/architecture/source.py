"""The package as its rules see it: modules, rooms, imports, names."""

import ast
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
PACKAGE = PROJECT / "symid"
_SPEC = importlib.util.spec_from_file_location("house", PROJECT / ".ci" / "house.py")
house = importlib.util.module_from_spec(_SPEC)
"""What counts the figures of the house."""
_SPEC.loader.exec_module(house)
ROOMS = (
    "kernel",
    "joint_models",
    "robot",
    "dynamics",
    "codegen",
    "lessons",
    "logs",
    "excitation",
    "simulation",
    "identification.judge",
    "identification.regression",
    "identification.estimators",
    "identification.diagnostics",
    "identification.rigid",
    "identification.hysteresis",
    "identification.friction",
    "identification.elastic",
    "identification",
    "study",
    "report",
    "api",
    "fleet",
    "cli",
)
"""Each imports only from those before it."""


def room_of(name: str) -> str:
    """Return the room of a dotted name under `symid`, of a module or of something in one."""
    parts = name.split(".")[1:]
    if parts == ["__main__"]:
        return "cli"
    for count in (2, 1):
        if ".".join(parts[:count]) in ROOMS:
            return ".".join(parts[:count])
    return "kernel"


@dataclass(frozen=True)
class Module:
    """One file of the package."""

    path: Path

    @cached_property
    def tree(self) -> ast.Module:
        """Return its syntax tree."""
        return ast.parse(self.path.read_text(encoding="utf-8"), str(self.path))

    @cached_property
    def name(self) -> str:
        """Return its dotted name."""
        parts = self.path.relative_to(PROJECT).with_suffix("").parts
        return ".".join(parts[:-1] if self.is_package else parts)

    @property
    def is_package(self) -> bool:
        """Return whether it is the `__init__.py` of a folder."""
        return self.path.name == "__init__.py"

    @property
    def room(self) -> str:
        """Return the room that it stands in."""
        return room_of(self.name)

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """Return all nodes of the tree."""
        return tuple(ast.walk(self.tree))

    @cached_property
    def imports(self) -> tuple[tuple[str, str, str], ...]:
        """Return (module, name, local name) of every import, wherever it stands."""
        return tuple(list_imports(self.nodes))

    def list_import_time_nodes(self) -> Iterator[ast.AST]:
        """Yield every node that runs when the module is imported: not the bodies of functions."""
        waiting: list[ast.AST] = [node for node in self.tree.body if not is_for_type_checkers(node)]
        while waiting:
            node = waiting.pop()
            yield node
            bodies = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
            waiting.extend(() if isinstance(node, bodies) else ast.iter_child_nodes(node))


def is_for_type_checkers(node: ast.AST) -> bool:
    """Return whether a statement is an `if TYPE_CHECKING`."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def list_imports(nodes: Iterator[ast.AST] | tuple[ast.AST, ...]) -> Iterator[tuple[str, str, str]]:
    """Yield (module, name, local name) of every import among `nodes`."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((alias.name, "", alias.asname or alias.name.split(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"a relative import: {ast.unparse(node)}"
            yield from ((node.module or "", alias.name, alias.asname or alias.name) for alias in node.names)


MODULES = tuple(Module(path) for path in sorted(PACKAGE.rglob("*.py")) if "_data" not in path.parts)
BY_NAME = {module.name: module for module in MODULES}
