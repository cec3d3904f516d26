"""The tree as a whole: no paths of one machine, no side effects, no silent errors, no unseen notices."""

import ast
import os
import re
import sys
from pathlib import Path

import symid.errors
from symid.errors import NOTES
from tests.architecture.source import MODULES, PROJECT
from tests.builds import run

HEAVY = ("numpy", "scipy", "sympy", "casadi", "jinja2")
# Without slashes here, so that this file is not found by its own search.
MACHINE_FOLDERS = ("root", "home", "work", "Users", "mnt", "opt")
TEXT = {".py", ".toml", ".md", ".jinja", ".c", ".h", ".txt", ".json", ".yml", ".cfg", ".csv", ".html", ""}
IGNORED = {".git", ".venv", ".mypy_cache", ".ruff_cache", ".pytest_cache", ".hypothesis", "__pycache__"}
IGNORED |= {"_build", "build", "dist", "demo"}


def tree_files() -> list[Path]:
    """Return the text files that belong to the project: those git knows, or would add."""
    try:
        files = run(PROJECT, "git", "ls-files", "--cached", "--others", "--exclude-standard").stdout
        paths = [PROJECT / line for line in files.splitlines()]
    except (OSError, AssertionError):
        # An unpacked archive has no history: take everything that is not a by-product.
        paths = [path for path in PROJECT.rglob("*") if not IGNORED & set(path.relative_to(PROJECT).parts)]
    return [path for path in paths if path.is_file() and path.suffix in TEXT]


def test_no_machine_path_in_the_tree():
    # `../shared/` and URLs with such a part are no absolute paths.
    folders = re.compile(rf"/(?<![\w./>-].)(?:{'|'.join(MACHINE_FOLDERS)})/")
    found = [
        f"{path.relative_to(PROJECT)}: {match.group()}"
        for path in tree_files()
        for match in folders.finditer(path.read_text(encoding="utf-8"))
    ]
    assert not found


def test_importing_every_module_prints_and_writes_nothing(tmp_path):
    names = [module.name for module in MODULES if module.name != "symid.__main__"]
    script = (
        "import importlib, os, random, sys, threading, warnings\n"
        "warnings.simplefilter('error')\n"
        "state, folder, path = random.getstate(), os.getcwd(), list(sys.path)\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "assert random.getstate() == state and os.getcwd() == folder and sys.path == path\n"
        "assert threading.active_count() == 1\n"
    )
    places = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "TMPDIR"), str(tmp_path))
    done = run(
        PROJECT, sys.executable, "-c", script, env={**os.environ, "PYTHONPATH": str(PROJECT), **places}
    )
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_help_loads_no_heavy_package():
    done = run(PROJECT, sys.executable, "-X", "importtime", "-m", "symid", "--help", check=False)
    assert "identify" in done.stdout
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in done.stderr.splitlines()}
    assert "click" in loaded, "the list of imports was not read"
    assert not loaded & set(HEAVY)


LIGHT = (
    "robot.toml_reader",
    "robot.urdf_reader",
    "codegen.library",
    "codegen.cache",
    "simulation.experiment",
    "identification.rigid.fit",
    "report.identification_page",
)


def test_what_identification_needs_loads_no_sympy():
    script = (
        "import importlib, sys\n"
        f"for name in {LIGHT!r}:\n"
        "    importlib.import_module(f'symid.{name}')\n"
        "    heavy = {'sympy', 'casadi'} & set(sys.modules)\n"
        "    if heavy: sys.exit(f'{name} loads {sorted(heavy)}')\n"
    )
    run(PROJECT, sys.executable, "-c", script)


def error_classes() -> list[str]:
    """Return the names of the errors that are raised, not only inherited from."""
    return sorted(name for name in vars(symid.errors) if name.endswith("Error"))


def test_every_error_is_expected_in_some_test():
    expected: set[str] = set()
    for path in (PROJECT / "tests").rglob("*.py"):
        for errors in re.findall(r"raises\(\s*(\([^)]*\)|[\w.]+)", path.read_text(encoding="utf-8")):
            expected |= set(re.findall(r"\w+", errors))
    assert set(error_classes()) - expected == set()


def test_every_error_raised_is_of_the_tree():
    allowed = {*error_classes(), "TypeError", "ValueError", "KeyError", "ImportError", "AttributeError"}
    # What the system would raise; the caller makes an `OutputError`, or exit code 5, of it.
    allowed |= {"OSError", "PermissionError", "MemoryError"}
    raised = {
        (module.name, ast.unparse(node.exc.func).split(".")[-1])
        for module in MODULES
        for node in module.nodes
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    }
    endings = ("Error", "Exception", "Exit")
    assert not [pair for pair in raised if pair[1].endswith(endings) and pair[1] not in allowed]


def notice_codes() -> list[str]:
    """Return every notice code that stands in the package."""
    calls = (
        node
        for module in MODULES
        for node in module.nodes
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Notice"
    )
    codes = {
        part.value
        for call in calls
        for keyword in call.keywords
        if keyword.arg == "code"
        for part in ast.walk(keyword.value)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    }
    return sorted({*codes, *NOTES})


def test_notices_are_found():
    assert "symid" + ".missing-resource" in notice_codes()


def test_every_notice_appears_in_some_test():
    texts = "".join(path.read_text(encoding="utf-8") for path in (PROJECT / "tests").rglob("*.py"))
    assert [code for code in notice_codes() if code not in texts] == []
