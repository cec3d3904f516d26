"""Figures of the house, counted from the source: `python .ci/house.py [TREE ...]`, one column a tree.

With --ways, from the environment of one tree: functions, files and depth of three everyday calls.

Lines of code are neither blank nor comment nor docstring. A private helper is used once if its name stands
once in its file besides its definition. A circle is a group of files that import each other, late imports
and those for type checkers included; imports of what a package offers lead to the file that defines it.
"""

import argparse
import ast
import importlib
import io
import itertools
import re
import sys
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
WIDEST = 10


def read_modules(tree: Path, folder: str = "symid") -> dict[str, tuple[str, ast.Module]]:
    """Return text and syntax tree of every file of a package by its dotted name."""
    found = {}
    for path in sorted((tree / folder).rglob("*.py")):
        parts = path.relative_to(tree).with_suffix("").parts
        if "_data" not in parts:
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            text = path.read_text(encoding="utf-8")
            found[name] = (text, ast.parse(text))
    return found


def count_code(text: str, tree: ast.Module) -> int:
    """Return the number of lines with code: neither blank nor comment nor docstring."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in {*skipped, tokenize.ENCODING, tokenize.ENDMARKER}:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                lines.difference_update(range(node.lineno, node.end_lineno + 1))
    return len(lines)


def list_imports(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield module and name of every import, wherever it stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)


def find_circles(modules: dict[str, tuple[str, ast.Module]]) -> list[list[str]]:
    """Return the groups of files that import each other."""
    offered: dict[tuple[str, str], str] = {}
    packages = {name for name in modules if any(other.startswith(f"{name}.") for other in modules)}
    for name in packages:
        for source, what in list_imports(modules[name][1]):
            offered[name, what] = source if source != name else f"{name}.{what}"
    arrows: dict[str, set[str]] = defaultdict(set)
    for name, (_, tree) in modules.items():
        if name in packages:
            continue
        for source, what in list_imports(tree):
            target = offered.get((source, what), source)
            target = f"{target}.{what}" if f"{target}.{what}" in modules else target
            while target in packages and (target, what) in offered:
                target = offered[target, what]
            if target in modules and target not in packages and target != name:
                arrows[name].add(target)
    return [sorted(group) for group in list_components(sorted(modules), arrows) if len(group) > 1]


def list_components(names: list[str], arrows: dict[str, set[str]]) -> Iterator[set[str]]:
    """Yield the strongly connected groups: those that reach each other."""

    def reach(start: str, along: dict[str, set[str]]) -> set[str]:
        seen, waiting = {start}, [start]
        while waiting:
            new = along.get(waiting.pop(), set()) - seen
            seen |= new
            waiting += new
        return seen

    back: dict[str, set[str]] = defaultdict(set)
    for name, targets in arrows.items():
        for target in targets:
            back[target].add(name)
    left = set(names)
    for name in names:
        if name in left:
            group = reach(name, arrows) & reach(name, back)
            left -= group
            yield group


def count_helpers(modules: dict[str, tuple[str, ast.Module]]) -> tuple[int, int, int]:
    """Return how many private functions there are, those used once, and the short ones of these."""
    private, once, short = 0, 0, 0
    for text, tree in modules.values():
        words = Counter(re.findall(r"\w+", text))
        for node in ast.walk(tree):
            if isinstance(node, FUNCTIONS) and re.match(r"_(?!_)", node.name):
                private += 1
                if words[node.name] == 2:
                    once += 1
                    body = node.body[1:] if ast.get_docstring(node) else node.body
                    short += sum(isinstance(part, ast.stmt) for entry in body for part in ast.walk(entry)) < 4
    return private, once, short


def list_widest(modules: dict[str, tuple[str, ast.Module]]) -> list[tuple[int, str]]:
    """Return the calls of the API with the most keywords: methods of its classes, and its functions."""
    found = {}
    for name, (_, tree) in modules.items():
        if not name.startswith(("symid.api", "symid.fleet")):
            continue
        for node in ast.walk(tree):
            if isinstance(node, FUNCTIONS) and not node.name.startswith("_"):
                defaults = len(node.args.defaults)
                found[f"{name.rpartition('.')[2]}.{node.name}"] = len(node.args.kwonlyargs) + defaults
    return sorted(((count, name) for name, count in found.items()), key=lambda pair: (-pair[0], pair[1]))[
        :WIDEST
    ]


def measure(tree: Path) -> dict[str, object]:
    """Return the figures of a tree."""
    modules = read_modules(tree)
    nodes = {name: list(ast.walk(parsed)) for name, (_, parsed) in modules.items()}
    everything = [node for group in nodes.values() for node in group]
    private, once, short = count_helpers(modules)
    late = {
        id(node)
        for function in everything
        if isinstance(function, FUNCTIONS)
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    public = {
        target
        for _, parsed in modules.values()
        for node in parsed.body
        for target in list_bound(node)
        if not target.startswith("_")
    }
    circles = find_circles(modules)
    languages = sum(
        isinstance(node, ast.Call)
        and ast.unparse(node.func).split(".")[-1] in {"select_fields", "tabulate"}
        and any(isinstance(part, ast.Constant | ast.JoinedStr) for part in node.args[1:2])
        for node in everything
    )
    tests = read_modules(tree, "tests")
    widest = list_widest(modules)
    return {
        "files of symid/": len(modules),
        "lines": sum(text.count("\n") for text, _ in modules.values()),
        "lines of code": sum(count_code(*entry) for entry in modules.values()),
        "classes": sum(isinstance(node, ast.ClassDef) for node in everything),
        "functions": sum(isinstance(node, FUNCTIONS) for node in everything),
        "private helpers": private,
        "... used once": once,
        "... of these, three statements or less": short,
        "public names at the top of files": len(public),
        "functions called describe_*": sum(
            isinstance(node, FUNCTIONS) and node.name.lstrip("_").startswith("describe_")
            for node in everything
        ),
        "imports inside functions": len(late),
        "names imported for type checkers only": count_for_type_checkers(everything),
        "circles of files": ", ".join(str(len(group)) for group in circles) or 0,
        "strings read as a language": languages,
        "keywords of the ten widest calls": ", ".join(str(count) for count, _ in widest),
        "lines of tests": sum(text.count("\n") for text, _ in tests.values()),
        "kB of DESIGN.md": round((tree / "DESIGN.md").stat().st_size / 1000),
        "kB of README.md": round((tree / "README.md").stat().st_size / 1000),
        "kB of CHANGELOG.md": round((tree / "CHANGELOG.md").stat().st_size / 1000),
        "kB of generated/": round(
            sum(path.stat().st_size for path in (tree / "generated").rglob("*") if path.is_file()) / 1000
        ),
    }


def list_bound(node: ast.stmt) -> list[str]:
    """Return the names that a statement at the top of a file binds."""
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
    return []


def count_for_type_checkers(nodes: list[ast.AST]) -> int:
    """Return how many names are imported under TYPE_CHECKING."""
    blocks = (
        node for node in nodes if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    return sum(len(node.names) for block in blocks for node in block.body if isinstance(node, ast.ImportFrom))


def trace(call: Callable[[], object], root: str) -> tuple[int, int, int]:
    """Return functions, files and depth of a call within the folder `root`, once its modules are loaded."""
    call()
    seen: set[tuple[str, str]] = set()
    depth, deepest = 0, 0

    def watch(frame: object, event: str, _: object) -> None:
        nonlocal depth, deepest
        code = frame.f_code  # type: ignore[attr-defined]
        if code.co_filename.startswith(root) and code.co_name != "<module>":
            if event == "call":
                depth += 1
                deepest = max(deepest, depth)
                seen.add((code.co_filename, f"{code.co_qualname}:{code.co_firstlineno}"))
            elif event == "return":
                depth -= 1

    sys.setprofile(watch)
    try:
        call()
    finally:
        sys.setprofile(None)
    return len(seen), len({file for file, _ in seen}), deepest


def print_ways() -> None:
    """Print functions, files and depth of three everyday calls."""
    symid = importlib.import_module("symid")
    root = str(Path(symid.__file__).parent)
    rigid, elastic = symid.load("two_link"), symid.load("two_link_elastic")
    log, elastic_log = (robot.simulate(duration=5.0, seed=1).log for robot in (rigid, elastic))
    numbers = itertools.count()
    with tempfile.TemporaryDirectory() as folder:
        ways = {
            "identify two_link, everything stated": lambda: rigid.identify(
                log, rows="torque", estimator="wls", cutoff=20.0, decimate=5
            ),
            "identify two_link_elastic": lambda: elastic.identify(elastic_log),
            "write C of two_link": lambda: symid.load("two_link").write("c", f"{folder}/{next(numbers)}"),
        }
        print(f"{'functions, files, depth of a call':40}")
        for name, call in ways.items():
            print(f"{name:40} {' / '.join(map(str, trace(call, root)))}")


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("trees", nargs="*", type=Path, default=[PROJECT], metavar="TREE")
    parser.add_argument("--ways", action="store_true", help="trace three calls of the installed package")
    given = parser.parse_args()
    if given.ways:
        print_ways()
        return
    columns = [measure(tree) for tree in given.trees]
    for name in columns[0]:
        print(f"{name:40}", *(f"{column[name]!s:>12}" for column in columns), sep="  ")
    for tree in given.trees:
        modules = read_modules(tree)
        for group in find_circles(modules):
            print(f"circle in {tree.name}: {', '.join(group)}")
        print(f"widest in {tree.name}:", ", ".join(f"{name} {count}" for count, name in list_widest(modules)))


if __name__ == "__main__":
    main()
