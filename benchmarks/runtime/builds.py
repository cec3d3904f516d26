"""The programs under test, compiled once for each compiler and kept.

Input: cases, compilers. Output: paths of programs. A program is made anew only where its command or one of
its sources has changed: Pinocchio takes minutes.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from tools import Compiler, NotInstalledError

from robots import LARGE, Case, find_prefix, write_model, write_states
from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.source_folder import write_sources
from symid.options import GenerateOptions

__all__ = ["FUNCTIONS", "Workshop", "find_folder", "hold_folder"]

_HERE = Path(__file__).resolve().parent
_TIMEOUT = 3600.0
# What Pinocchio's CMake files ask of those who include its headers.
_PINOCCHIO = (
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
FUNCTIONS = (
    "inverse_dynamics",
    "gravity",
    "mass_matrix",
    "coriolis_matrix",
    "forward_dynamics",
    "kinetic_energy_regressor",
    "potential_energy_regressor",
    "torque_regressor",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
)
_OURS = (*FUNCTIONS[:5], "energy_regressor", *FUNCTIONS[7:])


def _list_flags(machine: str) -> list[str]:
    return ["-O3", f"-march={machine}", "-DNDEBUG"]


def _find_casadi() -> Path:
    import casadi

    return Path(casadi.__file__).resolve().parent


def _find_eigen() -> Path:
    """Return the folder with Eigen's headers: Pinocchio's wheels need them and do not bring them.

    Raises:
        NotInstalledError: no package has them.
    """
    for folder in (
        find_prefix() / "include/eigen3",
        _find_casadi() / "include/eigen3",
        Path("/usr/include/eigen3"),
    ):
        if (folder / "Eigen/Core").is_file():
            return folder
    text = "no headers of Eigen: pip install casadi, or apt-get install libeigen3-dev"
    raise NotInstalledError(text)


@dataclass(frozen=True, slots=True, kw_only=True)
class Workshop:
    """A folder of compiled programs."""

    folder: Path

    def _make(
        self, target: Path, command: Sequence[str], inputs: Sequence[Path], *, slow: bool = False
    ) -> Path:
        """Run `command` unless `target` is what it made of the same inputs before.

        Raises:
            NotInstalledError: the command fails, as older compilers may.
        """
        digest = hashlib.sha256("\0".join(command).encode())
        for path in inputs:
            digest.update(path.read_bytes())
        stamp = target.with_name(f"{target.name}.stamp")
        if target.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == digest.hexdigest():
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        if slow:
            print(f"compiling {target.name}, which takes minutes, once", file=sys.stderr, flush=True)
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIMEOUT)
        if done.returncode:
            errors = [
                line for line in done.stderr.splitlines() if "error" in line
            ] or done.stderr.splitlines()
            text = f"{target.name}: {Path(command[0]).name} fails: {' '.join(errors)[:500]}"
            raise NotInstalledError(text)
        stamp.write_text(digest.hexdigest(), encoding="utf-8")
        return target

    def _compile_cxx(
        self,
        target: Path,
        compiler: Compiler,
        source: str,
        options: Sequence[str],
        inputs: Sequence[Path] = (),
        *,
        slow: bool = False,
    ) -> Path:
        headers = [_HERE / "contender.hpp"] if source != "pinocchio_sx.cpp" else []
        command = [compiler.cxx, "-std=c++17", *options, "-c", str(_HERE / source), "-o", str(target)]
        return self._make(target, command, [_HERE / source, *headers, *inputs], slow=slow)

    def _link(
        self, target: Path, compiler: Compiler, parts: Sequence[Path], options: Sequence[str] = ()
    ) -> Path:
        command = [compiler.cxx, *map(str, parts), "-o", str(target), *options, "-lm"]
        return self._make(target, command, parts)

    def _build_main(self, compiler: Compiler, machine: str) -> Path:
        target = self.folder / f"main_{compiler.name}_{machine}.o"
        return self._compile_cxx(target, compiler, "main.cpp", _list_flags(machine))

    def _list_pinocchio(self) -> list[str]:
        includes = (find_prefix() / "include", _find_eigen(), _find_casadi() / "include")
        # Their headers are not ours to keep free of warnings.
        options = [part for folder in includes for part in ("-isystem", str(folder))]
        return ["-w", *_PINOCCHIO, f"-DBENCH_PINOCCHIO={version('libpinocchio')}", *options]

    def build_pinocchio(self, compiler: Compiler, machine: str) -> Path:
        """Return the program with Pinocchio's algorithms on doubles.

        Only its headers are used: the libraries of the wheels are compiled for any x86-64 processor, and
        mixing both would change how Eigen aligns memory.
        """
        stem = f"pinocchio_{compiler.name}_{machine}"
        options = [*_list_flags(machine), *self._list_pinocchio()]
        part = self._compile_cxx(
            self.folder / f"{stem}.o", compiler, "pinocchio.cpp", options, [_HERE / "model.hpp"], slow=True
        )
        return self._link(self.folder / stem, compiler, [part, self._build_main(compiler, machine)])

    def write_traced(self, compiler: Compiler, case: Case) -> Path:
        """Return the folder with sx.c: Pinocchio over CasADi's SX, printed by CasADi, for this robot."""
        libraries = _find_casadi()
        part = self._compile_cxx(
            self.folder / f"pinocchio_sx_{compiler.name}.o",
            compiler,
            "pinocchio_sx.cpp",
            ["-O0", "-DNDEBUG", *self._list_pinocchio()],
            [_HERE / "model.hpp"],
            slow=True,
        )
        options = [f"-L{libraries}", "-l:libcasadi.so", f"-Wl,-rpath,{libraries}"]
        program = self._link(self.folder / f"pinocchio_sx_{compiler.name}", compiler, [part], options)
        folder = self.write_case(case)
        command = [str(program), "model.txt", "columns.txt", "sx.c"]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=_TIMEOUT
        )
        if done.returncode:
            text = f"{program.name} fails: {done.stderr[:500]}"
            raise NotInstalledError(text)
        return folder

    def build_traced(self, compiler: Compiler, machine: str, folder: Path) -> Path:
        """Return the program with the functions of sx.c in `folder`."""
        stem = f"sx_{compiler.name}_{machine}"
        flags = _list_flags(machine)
        code = folder / f"{stem}_code.o"
        command = [compiler.c, "-std=c99", *flags, "-c", str(folder / "sx.c"), "-o", str(code)]
        self._make(code, command, [folder / "sx.c"])
        options = [*flags, "-include", str(folder / "sx.h")]
        part = self._compile_cxx(folder / f"{stem}.o", compiler, "sx.cpp", options, [folder / "sx.h"])
        return self._link(folder / stem, compiler, [part, code, self._build_main(compiler, machine)])

    def write_case(self, case: Case) -> Path:
        """Return the folder of a robot, with its model, its states and the base columns in it."""
        folder = self.folder / case.robot.name
        folder.mkdir(parents=True, exist_ok=True)
        write_model(case, folder / "model.txt")
        write_states(case, folder / "states_ours.bin")
        write_states(case, folder / "states_pinocchio.bin", theirs=True)
        (folder / "columns.txt").write_text("\n".join(map(str, case.columns)), encoding="utf-8")
        return folder

    def write_ours(self, case: Case, trigonometry: str) -> Path:
        """Return the folder with the C that symid generates for the robot."""
        folder = self.write_case(case) / f"c_{trigonometry}"
        names = _OURS[:-1] if case.robot.size >= LARGE else _OURS
        functions = build_functions(case.robot, names=names)
        sources = generate_c_library(functions, GenerateOptions(trigonometry=trigonometry))
        write_sources(sources, folder, force=True)
        return folder

    def build_ours(self, compiler: Compiler, machine: str, code: Path, *, scalar: bool = False) -> Path:
        """Return the program with the functions of the generated folder `code`; `scalar`: as plain C99."""
        prefix = json.loads((code / "manifest.json").read_text(encoding="utf-8"))["prefix"]
        headers, flags = sorted(code.glob("*.h")), _list_flags(machine)
        stem = f"{'scalar' if scalar else 'ours'}_{code.name}_{compiler.name}_{machine}"
        lanes = [f"-D{prefix.upper()}_LANES=1"] if scalar else []
        parts = []
        for source in sorted(code.glob(f"{prefix}_*.c")):
            target = code.parent / f"{stem}_{source.stem}.o"
            command = [compiler.c, "-std=c99", *flags, *lanes, "-c", str(source), "-o", str(target)]
            parts.append(self._make(target, command, [source, *headers]))
        header = code / f"{prefix}.h"
        large = [] if (code / f"{prefix}_{_OURS[-1]}.c").exists() else ["-DLARGE"]
        options = [*flags, f"-DPREFIX={prefix}", *large, "-include", str(header)]
        part = self._compile_cxx(code.parent / f"{stem}.o", compiler, "ours.cpp", options, [header])
        return self._link(code.parent / stem, compiler, [part, *parts, self._build_main(compiler, machine)])


@contextlib.contextmanager
def hold_folder(folder: Path) -> Iterator[None]:
    """Keep others out of `folder` meanwhile: two runs would write each other's files."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"waiting for another run in {folder}", file=sys.stderr, flush=True)
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def find_folder() -> Path:
    """Return where programs are kept: build/runtime beside the sources of symid."""
    return Path(os.environ.get("SYMID_BENCHMARK_FOLDER", _HERE.parent.parent / "build" / "runtime"))
