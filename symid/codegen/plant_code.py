"""The compiled plant of elastic robots: built once for all robots, found again, called without copies.

Input: a compiled library of robot functions, `PlantRobot`, `PlantOrder`. Output: `PlantLog`.

The source is one file that knows no robot; it calls the robot's functions through their addresses. Its
shared library stands in the cache folder under a key of its source, the compiler and the machine.

Supported: libraries in double precision; several processes at once.
Not supported: machines without a compiler (`simulation/elastic_numpy` is for those).
"""

import ctypes
import os
import platform
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.backends import CompiledLibrary
from symid.codegen.cache_folder import (
    clear_away,
    find_user_folder,
    find_weakness,
    make_cache_folder,
    make_temporary_folder,
)
from symid.codegen.casadi_library import CasadiLibrary
from symid.codegen.compiler import Compiler, compile_sources, find_compiler
from symid.codegen.library import Library
from symid.codegen.names import find_prefix
from symid.codegen.plant_orders import PlantLog, PlantOrder, PlantRobot
from symid.errors import GenerationError, Notice, OutputError
from symid.provenance import find_signature
from symid.resources import find_resource_folder

__all__ = ["CompiledPlant", "has_addresses", "load_plant_code"]

_SOURCE = "c/plant.c"
_SIZES = ("n", "m", "l")
_TABLES = ("rotor", "stiffness", "cubic", "damping", "radius", "weight", "knee", "slope")
_REFERENCES = ("angle", "speed", "torque", "stiffness", "damping", "limit", "step")
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


class _Robot(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_size_t) for name in _SIZES),
        *((name, ctypes.c_void_p) for name in ("forward", "friction", "beta", "f", *_TABLES)),
    )


class _Order(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_size_t) for name in ("ticks", "substeps", "parts")),
        ("period", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in _REFERENCES),
    )


class _Log(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in _LOGGED)


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledPlant:
    """The loaded code; `notices` say where it is kept if not in the user's cache."""

    shared: ctypes.CDLL
    notices: tuple[Notice, ...] = ()

    def run(self, library: Library, robot: PlantRobot, order: PlantOrder) -> PlantLog:
        """Return what happens to the robot, whose functions `library` has; see `PlantOrder`.

        Raises:
            GenerationError: the library is none of compiled functions in double precision.
        """
        shape = (order.ticks, robot.size)
        arrays = {name: np.zeros(shape) for name in _LOGGED}
        size = ctypes.c_size_t
        sizes = (size(robot.size), size(robot.radius.shape[1]))
        self.shared.symid_plant_scratch.restype = self.shared.symid_plant_run.restype = size
        memory = np.zeros(self.shared.symid_plant_scratch(*sizes))
        start = np.concatenate([order.q, np.zeros(robot.size), order.theta, np.zeros(robot.size)])
        told = _Robot(
            **dict(zip(_SIZES, (*sizes, robot.knee.shape[1]), strict=True)),
            forward=_find_address(library, "forward_dynamics"),
            friction=_find_address(library, "friction") if robot.friction.size else None,
            beta=robot.beta.ctypes.data,
            f=robot.friction.ctypes.data,
            **_find_pointers(robot, _TABLES),
        )
        asked = _Order(
            ticks=order.ticks,
            substeps=order.substeps,
            parts=order.parts,
            period=order.period,
            **_find_pointers(order, _REFERENCES),
        )
        answer = _Log(**{name: array.ctypes.data for name, array in arrays.items()})
        inputs = tuple(ctypes.c_void_p(array.ctypes.data) for array in (start, order.play, memory))
        ticks = self.shared.symid_plant_run(
            ctypes.byref(told), ctypes.byref(asked), *inputs, ctypes.byref(answer)
        )
        return PlantLog(**arrays, ticks=int(ticks))


def has_addresses(library: Library) -> bool:
    """Return whether the library's functions are compiled, in double precision; CasADi's C counts as well."""
    return _find_shared(library) is not None


def _find_shared(library: Library) -> ctypes.CDLL | None:
    if isinstance(library, CasadiLibrary):
        return library.shared
    if isinstance(library, CompiledLibrary) and library._dtype is np.float64:  # noqa: SLF001  same room
        return library._shared  # noqa: SLF001  same room
    return None


def _find_address(library: Library, name: str) -> int:
    shared = _find_shared(library)
    if shared is None:
        text = f"the library of {library.card.robot!r} has no compiled functions in double precision"
        raise GenerationError(Notice(code="codegen.no-address", text=text))
    symbol = getattr(shared, f"{find_prefix(library.card.robot)}_{name}")
    return int(ctypes.cast(symbol, ctypes.c_void_p).value or 0)


def _find_pointers(record: PlantRobot | PlantOrder, names: tuple[str, ...]) -> dict[str, int]:
    arrays: dict[str, FloatArray] = {name: getattr(record, name) for name in names}
    return {name: int(array.ctypes.data) for name, array in arrays.items()}


def _open(path: Path, key: str) -> ctypes.CDLL | None:
    """Return the library at `path`, None if there is none, or none of this key."""
    try:
        shared = ctypes.CDLL(str(path))
        shared.symid_plant_key.restype = ctypes.c_char_p
        return shared if shared.symid_plant_key() == key.encode() else None
    except (OSError, AttributeError):
        return None


def _open_copy(path: Path, key: str) -> ctypes.CDLL | None:
    """Return the library at `path` as it is now: the loader gives back what it already has under a name."""
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        return _open(Path(shutil.copy(path, scratch)), key)


def _build(compiler: Compiler, source: Path, path: Path, key: str) -> None:
    """Compile the plant to `path`, which appears by one rename."""
    marked = replace(compiler, flags=(*compiler.flags, f'-DSYMID_PLANT_KEY="{key}"'))
    make_cache_folder(path.parent)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".plant-") as scratch:
        made = compile_sources(marked, [source], Path(scratch) / path.name)
        shutil.move(made, path)


def _obtain(compiler: Compiler, source: Path, folder: Path, key: str) -> ctypes.CDLL:
    path = folder / f"plant-{key[:24]}.so"
    # What somebody else may have written is not loaded.
    trusted = not (os.path.lexists(path) and find_weakness(path))
    shared = _open(path, key) if trusted else None
    if shared is None:
        try:
            if not trusted:
                clear_away(path)
            _build(compiler, source, path, key)
        except OSError as error:
            text = f"the cache folder cannot be written: {error.strerror or error}"
            raise OutputError(Notice(code="output.cache", text=text, file=str(folder))) from error
        shared = _open(path, key) or _open_copy(path, key)
    if shared is None:
        text = "the compiled plant cannot be loaded; remove it, and check the compiler with `symid doctor`"
        raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(path)))
    return shared


def load_plant_code(*, compiler: str | None = None, cache: Path | None = None) -> CompiledPlant | None:
    """Return the compiled plant, from the cache or made now; None on a machine without a C compiler.

    Args:
        compiler: command of the C compiler; None for the first of cc, gcc, clang.
        cache: folder to keep it in; None for the user's, and if that cannot be written, a temporary one,
            of which a notice tells.

    Raises:
        GenerationError: the compiler fails, or what it made cannot be loaded.
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    found = find_compiler(compiler)
    if found is None:
        return None
    source = find_resource_folder("templates") / _SOURCE
    machine = (platform.system(), platform.machine())
    key = find_signature("plant", source.read_bytes(), found, machine)
    folder = cache or find_user_folder()
    if folder is not None:
        try:
            return CompiledPlant(shared=_obtain(found, source, folder, key))
        except OutputError:
            if cache is not None:
                raise
    temporary = make_temporary_folder()
    text = "the compiled plant is kept in this temporary folder; set XDG_CACHE_HOME to a folder of yours"
    notice = Notice(code="codegen.cache-temporary", text=text, file=str(temporary))
    return CompiledPlant(shared=_obtain(found, source, temporary, key), notices=(notice,))
