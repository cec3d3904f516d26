"""Names of a package that are imported when they are first used.

A package lists what it offers once, as imports below `if TYPE_CHECKING`: type checkers and editors read
them as they stand, and `load_names` reads the same lines, so that importing the package runs none of them.
"""

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

__all__ = ["load_names"]


def load_names(package: str, file: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package, from the imports in its own `file`."""
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    blocks = (node.body for node in tree.body if isinstance(node, ast.If))
    imports = [node for block in blocks for node in block if isinstance(node, ast.ImportFrom)]
    places = {alias.name: node.module or package for node in imports for alias in node.names}
    names = sorted(places)

    def load(name: str) -> object:
        if name not in places:
            message = f"module {package!r} has no attribute {name!r}; it offers {', '.join(names)}"
            raise AttributeError(message)
        # A module of the package itself, offered under its own name.
        if places[name] == package:
            return import_module(f"{package}.{name}")
        return getattr(import_module(places[name]), name)

    return load, lambda: names, names
