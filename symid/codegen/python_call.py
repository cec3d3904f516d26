"""Functions of a compiled library as built-in functions of CPython: no copies, no ctypes in a call.

Input: a shared library with the extension module in it that `python_call_source` writes. Output: the module.

Two public interfaces carry it: Python's limited API, the same for every version from 3.11, and NumPy's for
arrays. Where their headers are not installed, calls go through ctypes.

Supported: CPython with its global lock, which a call holds; doubles.
Not supported: other interpreters, free-threaded builds, float libraries.
"""

import ctypes
import sys
import sysconfig
from dataclasses import dataclass
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

import numpy as np

from symid.errors import GenerationError, Notice

__all__ = ["CallPath", "find_call_path", "load_calls"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CallPath:
    """How compiled functions are called from this Python.

    Attributes:
        name: the interface that serves; for ctypes also why it does.
        flags: of the compiler, for Python's and NumPy's headers; none where ctypes serves.
        remedy: what would make calls faster, or nothing.
    """

    name: str
    flags: tuple[str, ...] = ()
    remedy: str = ""


def find_call_path() -> CallPath:
    """Return what serves calls from this Python: its limited API, or ctypes."""
    if sys.implementation.name != "cpython":
        return CallPath(name=f"ctypes: this is {sys.implementation.name}, not CPython")
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return CallPath(name="ctypes: a free-threaded Python has no limited API")
    python, numpy = sysconfig.get_path("include"), np.get_include()
    wanted = {
        Path(python, "Python.h"): "python3-dev",
        Path(numpy, "numpy/arrayobject.h"): "python3-numpy-dev",
    }
    for header, package in wanted.items():
        if not header.is_file():
            gain = "calls of single samples are then ten times as fast"
            remedy = f"install {package} (its name on Debian); {gain}"
            return CallPath(name=f"ctypes: {header} is not installed", remedy=remedy)
    # Python.h includes pyconfig.h, which belongs to this machine and may stand apart.
    folders = dict.fromkeys((python, sysconfig.get_path("platinclude"), numpy))
    flags = [flag for folder in folders for flag in ("-isystem", folder)]
    name = f"Python's limited API, arrays of NumPy {np.__version__.partition('.')[0]}"
    return CallPath(name=name, flags=tuple(flags))


def load_calls(binary: Path, prefix: str) -> ModuleType | None:
    """Return the extension module in a library, or None where calls go through ctypes.

    Its `bind(name, ask, kept)` returns a function for one sample. `ask` is the same function in Python, for
    every call that is out of the ordinary; `kept` is the tuple of arrays that every call overwrites and
    returns, or None for new ones at each call.

    Raises:
        GenerationError: the module does not load with this Python and NumPy.
    """
    if not find_call_path().flags or not hasattr(ctypes.CDLL(str(binary)), f"PyInit_{prefix}"):
        return None
    loader = ExtensionFileLoader(prefix, str(binary))
    try:
        module = module_from_spec(ModuleSpec(prefix, loader, origin=str(binary)))
        loader.exec_module(module)
    except ImportError as error:
        text = f"cannot be loaded: {error}; build it again on this machine"
        raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(binary))) from error
    return module
