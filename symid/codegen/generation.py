"""A folder of generated code: tested and written where something has changed, else left as it is.

Robot -> Functions -> SourceSet -> self-test -> record -> files. The self-test runs in a folder of its own:
code that fails it is never written. The sources and most of the manifest are the same on every machine. The
entry "build" is not: which compiler passed the self-test, and how large every function became. It holds a
digest of the other entries that shows edits of these.

Supported: C, Python, JavaScript and CasADi; one run of a user at a time writes a folder, another waits.
Not supported: files of others in the folder (they take no part in the test); waiting for other users or
machines.
"""

import contextlib
import functools
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

from symid.codegen import source_folder
from symid.codegen.cache import compute_library_key, lock_folder
from symid.codegen.compiler import STACK_FLAG, CodeSize, Compiler, locate_compiler, measure_code_sizes
from symid.codegen.functions import Standard
from symid.environment import make_scratch_folder
from symid.errors import GenerationError, Notice
from symid.options import GenerateOptions
from symid.robot import Robot
from symid.serialization import compute_signature

_ENTRY = "build"
_SELFTEST_TIMEOUT = 1800.0
_SELFTEST_FLAGS = "-O1"  # Sizes are those of -O2 to 1 %, in two thirds of its time.
# An outer `make` may have been told to build nothing, or to ignore all errors.
_MAKE_VARIABLES = frozenset({"MAKEFLAGS", "MFLAGS", "GNUMAKEFLAGS", "MAKELEVEL", "MAKEFILES"})
_PASSED = re.compile(r"0 of [1-9][0-9]* functions failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildRecord:
    """How the self-test of a folder went, and the sizes of the functions, where they are known.

    `inputs`: signature of all that the folder was made from and of what ran the test; `selftest` "passed" or
    "not run"; `runner` the compiler (with its flags), or Python and NumPy; empty if it was not run.
    """

    inputs: str
    selftest: str
    runner: str = ""
    flags: str = ""
    sizes: Mapping[str, CodeSize] = field(default_factory=dict)


def read_operations(manifest: Mapping[str, object]) -> dict[str, dict[str, int]]:
    """Return the operations of every function of a manifest that symid wrote, in the order of its card."""
    card, operations = manifest.get("card"), manifest.get("operations")
    if not isinstance(card, dict) or not isinstance(operations, dict):
        return {}
    return {entry["name"]: operations[entry["name"]] for entry in card["functions"]}


def _compute_seal(manifest: Mapping[str, object]) -> str:
    return compute_signature({key: value for key, value in manifest.items() if key != _ENTRY})


def _read_unchanged(folder: Path, inputs: str) -> tuple[Mapping[str, object], BuildRecord] | None:
    """Return the manifest and the record of a folder that was made from `inputs` and is as it was then."""
    manifest = source_folder.read_manifest(folder)
    found = None if manifest is None else manifest.get(_ENTRY)
    if manifest is None or not isinstance(found, dict):
        return None
    entry = dict(found)
    try:
        seal = entry.pop("seal")
        sizes = {name: CodeSize(**size) for name, size in entry.pop("sizes").items()}
        record = BuildRecord(**entry, sizes=sizes)
    except (AttributeError, KeyError, TypeError):
        # It was edited.
        return None
    if record.inputs != inputs or seal != _compute_seal(manifest):
        return None
    return (manifest, record) if source_folder.is_unchanged(folder, manifest) else None


@functools.cache
def _find_node() -> str:
    """Return the version of Node, empty where there is none."""
    path = shutil.which("node")
    if path is None:
        return ""
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run([path, "--version"], capture_output=True, text=True, check=False, timeout=60.0)
        return f"Node {done.stdout.strip()}" if not done.returncode else ""
    return ""


def choose_runner(target: str) -> tuple[Compiler | None, str]:
    """Return the compiler, and the version of what runs the self-test, empty where nothing can."""
    if target == "python":
        return None, f"Python {platform.python_version()}, NumPy {version('numpy')}"
    if target == "js":
        return None, _find_node()
    compiler = locate_compiler()
    built_by = compiler.version if compiler is not None and shutil.which("make") else ""
    if target == "casadi":
        # Without a compiler the .casadi files are tested all the same.
        runners = (f"CasADi {version('casadi')}", built_by)
        return compiler if built_by else None, ", ".join(filter(None, runners))
    return compiler, built_by


def run_selftest(
    sources: source_folder.SourceSet, folder: Path, target: str, inputs: str, progress: Callable[[str], None]
) -> BuildRecord:
    """Run the test of `sources`, which `folder` is to hold, in a folder of its own and return how it went.

    The test counts as passed where the program itself ran, ended with zero and said so in its last line; what
    `make` says proves nothing, as variables of the environment can keep it from doing anything.

    Raises:
        GenerationError: the test failed, or did not run to its end.
    """
    compiler, runner = choose_runner(target)
    if not runner:
        return BuildRecord(inputs=inputs, selftest="not run")
    progress("running the self-test")
    manifest = json.loads(sources.manifest)
    prefix, names = str(manifest.get("prefix")), tuple(read_operations(manifest))

    def fail(why: str) -> GenerationError:
        text = f"nothing was written: the self-test failed: {why}"
        return GenerationError(Notice(code="generate.selftest-failed", text=text, file=str(folder)))

    with make_scratch_folder() as scratch:
        copy = scratch / "code"
        source_folder.write_sources(sources, copy)
        environment = {name: value for name, value in os.environ.items() if name not in _MAKE_VARIABLES}

        def run(command: list[str]) -> subprocess.CompletedProcess[str]:
            try:
                return subprocess.run(
                    command,
                    cwd=copy,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                    errors="replace",
                    check=False,
                    timeout=_SELFTEST_TIMEOUT,
                )
            except subprocess.TimeoutExpired:
                text = f"`{' '.join(command)}` did not end within {_SELFTEST_TIMEOUT:g} s"
            except OSError as error:
                text = f"`{' '.join(command)}` cannot be run: {error.strerror or error}"
            raise fail(text)

        done = None
        if compiler is not None:
            goal = "shared" if target == "casadi" else "selftest"
            make = ["make", f"-j{os.cpu_count() or 1}", goal, f"CC={compiler.path}"]
            done = run([*make, f"CFLAGS={_SELFTEST_FLAGS} {STACK_FLAG}"])
            # A compiler that does not know the flag fails, and so does wrong code: then once more.
            done = run(make) if done.returncode else done
        failed = done is not None and done.returncode
        if done is None or not failed:
            module = {"python": f"{prefix}.py", "casadi": f"{prefix}_casadi.py"}.get(target)
            command = [sys.executable, module] if module else [str(copy / "selftest")]
            done = run(["node", "selftest.mjs"] if target == "js" else command)
            failed = done.returncode or not _PASSED.fullmatch(done.stdout.rstrip("\n").rpartition("\n")[2])
        if failed:
            how = f"`{' '.join(done.args)}` ended with {done.returncode}\n{done.stdout}{done.stderr}"
            raise fail(how.rstrip())
        sizes = measure_code_sizes(copy, prefix, names) if target == "c" else {}
    flags = _SELFTEST_FLAGS if compiler else ""
    return BuildRecord(inputs=inputs, selftest="passed", runner=runner, flags=flags, sizes=sizes)


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneratedFolder:
    """The files of a folder, its manifest and the record of its self-test.

    `unchanged`: it was up to date, so that nothing was written. `notices`: as that the test was not run.
    `springs`: folders in this one, of springs that no function of the robot has.
    """

    folder: Path
    manifest: Mapping[str, object]
    record: BuildRecord
    unchanged: bool
    notices: tuple[Notice, ...]
    springs: tuple["GeneratedFolder", ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """Return all files that symid wrote there."""
        paths = (*source_folder.get_listed_digests(self.manifest), source_folder.MANIFEST)
        return tuple(self.folder / path for path in paths)

    @property
    def operations(self) -> dict[str, dict[str, int]]:
        """Return products, sums and sines by function."""
        return read_operations(self.manifest)


def generate_folder(
    robot: Robot,
    order: GenerateOptions,
    folder: Path,
    *,
    progress: Callable[[str], None],
    force: bool = False,
) -> GeneratedFolder:
    """Write the code of `robot` to `folder` and test it; nothing is done where nothing has changed.

    The folder is new, or one that symid wrote; files of others in it stay as they are. Code that fails its
    self-test is not written. `progress` is called with what begins; `force`: write in any case, over files of
    symid that were edited too.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: the robot has no such function, or its file lacks a value that shall be constant.
        OutputError: the folder cannot be written, or holds what symid did not write.
        GenerationError: the code fails its self-test.
    """
    compiler, runner = choose_runner(order.target)
    key = compute_library_key(robot, order.functions, compiler)
    inputs = compute_signature(key, replace(robot, path="", notices=()), order, runner)

    def build() -> source_folder.SourceSet:
        # Imported here: where nothing has changed, neither CasADi nor SymPy is needed.
        from symid.codegen import python_targets as targets
        from symid.codegen.c_library import generate_c_library
        from symid.codegen.casadi_functions import build_functions

        source_folder.check_folder(folder)
        progress(f"deriving the functions of {robot.name}")
        kinds: dict[str, Standard] = {"base": False, "standard": True, "internal": "internal"}
        standard = kinds[order.parameters]
        functions = build_functions(robot, names=order.functions, standard=standard, constant=order.constant)
        progress(f"writing {order.target} code")
        generate = {
            "python": targets.generate_python_module,
            "casadi": targets.generate_casadi_target,
            "js": targets.generate_javascript_module,
        }
        return generate.get(order.target, generate_c_library)(functions, order)

    return write_folder(build, folder, order.target, inputs, progress, force=force)


def write_folder(
    build: Callable[[], source_folder.SourceSet],
    folder: Path,
    target: str,
    inputs: str,
    progress: Callable[[str], None],
    *,
    force: bool,
) -> GeneratedFolder:
    """Test what `build` makes of `inputs` and write it, unless the folder holds it already.

    Raises:
        OutputError: the folder cannot be written, or holds what symid did not write.
        GenerationError: the code fails its self-test; nothing was written.
    """
    with lock_folder(folder, lambda: progress(f"{folder}: waiting for another run that writes it")):
        found = None if force else _read_unchanged(folder, inputs)
        unchanged = found is not None
        if found is None:
            sources = build()
            source_folder.check_folder(folder, sources, force=force)
            record = run_selftest(sources, folder, target, inputs, progress)
            made = json.loads(sources.manifest)
            made[_ENTRY] = {**asdict(record), "seal": _compute_seal(made)}
            text = json.dumps(made, indent=1, sort_keys=True) + "\n"
            source_folder.write_sources(replace(sources, manifest=text), folder, force=force)
            found = json.loads(text), record
        manifest, record = found
    notices = []
    if record.selftest != "passed":
        text = "its self-test was not run: no C compiler or no make; install them, then `make check` there"
        if (folder / "selftest.mjs").exists():
            text = "its self-test was not run: no Node; install it, then `node selftest.mjs` there"
        notices.append(Notice(code="generate.selftest-not-run", text=text, file=str(folder)))
    return GeneratedFolder(
        folder=folder, manifest=manifest, record=record, unchanged=unchanged, notices=tuple(notices)
    )
