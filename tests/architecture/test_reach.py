"""Everything in the package can be reached: from the API, from a verb, or from a call that a page shows."""

import ast
import re
from collections.abc import Iterator

from tests.architecture.source import (
    BY_NAME,
    MODULES,
    PROJECT,
    Module,
    house,
    is_for_type_checkers,
    list_imports,
)

Name = tuple[str, str]
"""Module and top-level name."""


def locate(module: str, name: str) -> Name:
    """Return where a name that is imported from `module` is defined."""
    found = BY_NAME.get(module)
    if found is not None and not any(name in house.list_bound(node) for node in found.tree.body):
        for source, given, local in found.imports:
            if local == name and source == module:
                # A module of the package, offered under its own name.
                return (f"{module}.{name}", "")
            if local == name and source in BY_NAME:
                return locate(source, given)
    return (module, name)


def list_uses(module: Module, nodes: tuple[ast.AST, ...], known: dict[str, Name]) -> Iterator[Name]:
    """Yield what the nodes of one statement of `module` use of the package."""
    inner = {
        local: locate(source, name)
        for source, name, local in list_imports(nodes)
        if source in BY_NAME and name
    }
    yield from inner.values()
    imported = (*module.imports, *list_imports(nodes))
    aliases = {local: f"{source}.{name}".rstrip(".") for source, name, local in imported}
    for node in nodes:
        match node:
            case ast.Name(id=name) if name in known:
                yield known[name]
            case ast.Attribute(value=ast.Name(id=alias), attr=name) if aliases.get(alias) in BY_NAME:
                yield locate(aliases[alias], name)
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id=alias), attr=part), attr=name) if (
                f"{aliases.get(alias)}.{part}" in BY_NAME
            ):
                yield locate(f"{aliases[alias]}.{part}", name)
            case ast.Constant(value=str(text)) if text.isidentifier() and text in known:
                # A name in quotes, as annotations have it.
                yield known[text]


def build_graph() -> dict[Name, set[Name]]:
    """Return what every top-level name of the package uses."""
    graph: dict[Name, set[Name]] = {}
    for module in MODULES:
        known = {local: locate(source, name) for source, name, local in module.imports if source in BY_NAME}
        statements = [node for node in module.tree.body if not is_for_type_checkers(node)]
        known |= {name: (module.name, name) for node in statements for name in house.list_bound(node)}
        for node in statements:
            uses = set(list_uses(module, tuple(ast.walk(node)), known))
            for name in house.list_bound(node):
                graph.setdefault((module.name, name), set()).update(uses)
            if not house.list_bound(node) and not isinstance(node, ast.Import | ast.ImportFrom):
                graph.setdefault((module.name, ""), set()).update(uses)
    return graph


def list_shown_calls() -> Iterator[Name]:
    """Yield what pages and their scripts import."""
    for path in sorted((PROJECT / "docs").rglob("*")):
        if path.suffix in {".md", ".py"}:
            for found in re.finditer(
                r"^[ >.]*from (symid[\w.]*) import (\([^)]*\)|.*)$",
                path.read_text(encoding="utf-8"),
                re.MULTILINE,
            ):
                for name in re.findall(r"(\w+)(?: as \w+)?", found.group(2)):
                    yield locate(found.group(1), name)


def find_unreached() -> list[str]:
    """Return the names that nothing leads to."""
    graph = build_graph()
    waiting = [
        name for name in graph if name[0] in {"symid", "symid.__main__"} or name[0].startswith("symid.cli")
    ]
    waiting += [locate("symid", name) for _, name, _ in BY_NAME["symid"].imports]
    waiting += [locate("symid.api", name) for _, name, _ in BY_NAME["symid.api"].imports]
    # A room that is offered as a whole.
    rooms = [name for name, _ in waiting if name in BY_NAME and BY_NAME[name].is_package and name != "symid"]
    waiting += [locate(room, name) for room in rooms for _, name, _ in BY_NAME[room].imports]
    waiting += list_shown_calls()
    # All that an offered module defines can be called.
    offered = {module for module, name in waiting if not name}
    waiting += [place for place in graph if place[0] in offered and not place[1].startswith("_")]
    reached: set[Name] = set()
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += [*graph.get(name, ()), *([(name[0], "")] if (name[0], "") in graph else [])]
    return sorted(f"{module}.{name}" for module, name in graph.keys() - reached if name and name != "__all__")


def test_every_name_can_be_reached():
    assert find_unreached() == []
