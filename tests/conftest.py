"""What all tests share: where things are, which tools are there, a cache of their own.

A test that wants something a machine may not have asks for it through a fixture, and the
fixture skips with the reason.
"""

import gc
import os
import shlex
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

PROJECT = Path(__file__).resolve().parent.parent

# A file a line, or the beginning of a test's name, and its seconds: `make test` leaves these out.
_TABLE = (PROJECT / "tests" / "long.txt").read_text(encoding="utf-8")
LONG = {name: int(seconds) for name, seconds in map(str.split, _TABLE.splitlines())}

# The same examples in every run: a failure here is a failure everywhere.
settings.register_profile("symid", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("symid")


OPTIMISING = "SYMID_TEST_OPTIMISING_COMPILER"
# What a run has compiled before is copied. Without optimisation, functions compute the same in half to a
# fifth of the compiler's time; small ones are optimised where warnings count, some of which need it. Loops
# over many samples are optimised as users have them: they run longer than the compiler.
QUICK_COMPILER = """#!/bin/sh
source= target= options= before=
for argument; do
    case "$before" in -o) target=$argument argument= ;; esac
    case "$argument" in *.c) source=$argument argument=${{argument##*/}} ;; esac
    options="$options $argument" before=$argument
done
test -f "$source" || exec {compiler} "$@"
case "$options " in *" -c "*) ;; *) exec {compiler} "$@" ;; esac
case "$options " in
    *" elastic_plant.c "* | *" rigid_plant.c "* | *" branch.c "*) ;;
    *" -Werror "*) test "$(wc -c < "$source")" -gt 20000 && set -- "$@" -O0 ;;
    *) set -- "$@" -O0 ;;
esac
folder=.
case "$source" in */*) folder=${{source%/*}} ;; esac
kept={folder}/$({{ echo "$options"; cat "$source" "$folder"/*.h 2>/dev/null; }} | sha256sum | cut -c1-64)
test -f "$kept" && exec cp "$kept" "$target"
{compiler} "$@" 2>"$kept.$$.said"
code=$?
cat "$kept.$$.said" >&2
test $code -eq 0 && test ! -s "$kept.$$.said" && cp "$target" "$kept.$$" && mv "$kept.$$" "$kept"
rm -f "$kept.$$.said"
exit $code
"""


def pytest_configure(config: pytest.Config) -> None:
    """Give the run an empty cache, so that no old library is found, and a quick compiler, for all workers."""
    if not hasattr(config, "workerinput"):
        folder = tempfile.mkdtemp(prefix="symid-test-cache-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
        os.environ["XDG_CACHE_HOME"] = folder
        compiler = shutil.which("cc")
        if compiler is not None:
            quick = Path(tempfile.mkdtemp(prefix="symid-test-compiler-"))
            config.add_cleanup(lambda: shutil.rmtree(quick, ignore_errors=True))
            text = QUICK_COMPILER.format(compiler=shlex.quote(compiler), folder=shlex.quote(str(quick)))
            (quick / "cc").write_text(text, encoding="utf-8")
            (quick / "cc").chmod(0o755)
            os.environ[OPTIMISING] = compiler
            os.environ["PATH"] = f"{quick}{os.pathsep}{os.environ['PATH']}"


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files out that take long, where those tests are not wanted, without importing them."""
    if "not long" not in config.option.markexpr or collection_path.suffix != ".py":
        return None
    return True if collection_path.relative_to(PROJECT).as_posix() in LONG else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that take long, and begin with their files: none is left for one worker at the end."""
    sizes = Counter(item.nodeid.split("::")[0] for item in items)
    seconds = {file: sum(n for name, n in LONG.items() if name.split("::")[0] == file) for file in sizes}
    for item in items:
        if item.nodeid.startswith(tuple(LONG)):
            item.add_marker(pytest.mark.long)
    items.sort(key=lambda item: [-table[item.nodeid.split("::")[0]] for table in (seconds, sizes)])


def pytest_collection_finish() -> None:
    """Leave out of garbage collection what stays for the whole run, and collect less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


@pytest.fixture(scope="session", autouse=True)
def shared_fits() -> Iterator[None]:
    """Let all tests share the fits by which causes are found."""
    from tests.sharing import ALWAYS, share_work

    with share_work(ALWAYS):
        yield


@pytest.fixture(scope="session")
def project() -> Path:
    """Return the root of the source tree."""
    return PROJECT


@pytest.fixture(scope="session")
def robots_folder(project: Path) -> Path:
    """Return the folder of the robot files."""
    return project / "robots"


@pytest.fixture(scope="session")
def shared_data(project: Path) -> Path:
    """Return the folder of the real recordings, or skip: they are not part of the project."""
    folder = project.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("wants the recordings in ../shared/data")
    return folder


@pytest.fixture(scope="session")
def c_compiler() -> str:
    """Return the path of a C compiler, or skip."""
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("wants a C compiler (cc, gcc or clang)")


@pytest.fixture(scope="session")
def optimising_compiler() -> str:
    """Return the path of the C compiler that optimises large functions too, as users have it, or skip."""
    if OPTIMISING not in os.environ:
        pytest.skip("wants a C compiler called cc")
    return os.environ[OPTIMISING]
