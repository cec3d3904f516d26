"""Calls of a library's functions: inputs checked and turned into arrays, and the call path without ctypes.

A shared library can hold the extension module of `python_call.c`: functions of CPython without copies. It
uses Python's limited API, the same for every version from 3.11, and NumPy's for arrays; where their headers
are not installed, calls go through ctypes.

Supported: anything that NumPy reads as real numbers, one sample or a batch; extensions for CPython with
its global lock, which a call holds, in double precision.
Not supported: complex numbers, text, rows of unequal length, arrays of objects; extensions for other
interpreters, free-threaded builds and float libraries.
"""

import ctypes
import sys
import sysconfig
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import cast

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.errors import GenerationError, Notice, UsageError

_REAL_KINDS = "biuf"
_DOUBLE = np.dtype(np.float64)

Arrays = tuple[FloatArray, ...]
Call = Callable[..., Arrays]


def get_spec(card: ModelCard, name: str) -> FunctionSpec:
    """Return the function `name` of the card; UsageError where there is none."""
    specs = {spec.name: spec for spec in card.functions}
    if name not in specs:
        text = f"the library of {card.robot!r} has no function {name!r}; it has {', '.join(specs)}"
        raise UsageError(Notice(code="usage.unknown-function", text=text))
    return specs[name]


def _build_error(card: ModelCard, spec: FunctionSpec, text: str) -> UsageError:
    text = f"function {spec.name!r} of {card.robot!r}: {text}"
    return UsageError(Notice(code="usage.shape", text=text))


def _convert_inputs(card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]) -> Arrays:
    if len(inputs) != len(spec.inputs):
        names = ", ".join(port.name for port in spec.inputs)
        raise _build_error(card, spec, f"expected the inputs {names}, got {len(inputs)} arrays")
    arrays = []
    for port, value in zip(spec.inputs, inputs, strict=True):
        try:
            array = np.asarray(value)
        except (TypeError, ValueError, OverflowError) as error:
            text = f"input {port.name!r}: expected an array of numbers, got {error}"
            raise _build_error(card, spec, text) from error
        if array.dtype.kind not in _REAL_KINDS:
            text = f"input {port.name!r}: expected real numbers, got an array of {array.dtype}"
            raise _build_error(card, spec, text)
        arrays.append(np.ascontiguousarray(array, dtype=np.float64))
    return tuple(arrays)


def check_inputs(card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]) -> tuple[int | None, Arrays]:
    """Return the number of samples, None for a single one, and the inputs as arrays.

    Raises:
        UsageError: a shape is wrong, or an input holds no real numbers.
    """
    arrays = _convert_inputs(card, spec, inputs)
    pairs = tuple(zip(spec.inputs, arrays, strict=True))
    leads = [pair for pair in pairs if not pair[0].shared][:1]
    samples = next((array.shape[0] for port, array in leads if array.ndim == len(port.shape) + 1), None)
    for port, array in pairs:
        batch = () if port.shared or samples is None else (samples,)
        if array.shape != (*batch, *port.shape):
            allowed = f"{port.shape}" if port.shared else f"{port.shape} or (N, {str(port.shape)[1:]}"
            text = f"input {port.name!r}: expected the shape {allowed}, the same N for all, got {array.shape}"
            raise _build_error(card, spec, text)
    return samples, arrays


def check_sample(card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]) -> Arrays:
    """Return the inputs of one sample as arrays of float64, which may have strides.

    Raises:
        UsageError: a shape is not that of one sample, or an input holds no real numbers.
    """
    # The usual case takes a few comparisons; anything else is converted or refused.
    if len(inputs) == len(spec.inputs):
        for port, value in zip(spec.inputs, inputs, strict=True):
            if type(value) is not np.ndarray or value.dtype is not _DOUBLE or value.shape != port.shape:
                break
        else:
            return cast("Arrays", tuple(inputs))
    arrays = _convert_inputs(card, spec, inputs)
    for port, array in zip(spec.inputs, arrays, strict=True):
        if array.shape != port.shape:
            text = f"input {port.name!r}: expected the shape {port.shape} of one sample, got {array.shape}"
            raise _build_error(card, spec, text)
    return arrays


def _describe_refusal(array: object, shape: tuple[int, ...]) -> str:
    """Return why `array` cannot take an output, or nothing."""
    if not isinstance(array, np.ndarray):
        return f"got a {type(array).__name__}"
    if array.dtype != np.float64 or not array.dtype.isnative:
        return f"got an array of {array.dtype.str}"
    if array.shape != shape:
        return f"got the shape {array.shape}"
    flags = array.flags
    if not (flags.c_contiguous and flags.aligned and flags.writeable):
        return "got one that cannot be written in place, row after row"
    return ""


def check_outputs(card: ModelCard, spec: FunctionSpec, samples: int | None, out: object) -> Arrays:
    """Return the arrays of a caller that outputs are written to, one for each output.

    Raises:
        UsageError: their number is wrong, one cannot take its output, or two share memory.
    """
    names = ", ".join(port.name for port in spec.outputs)
    if not isinstance(out, tuple | list) or len(out) != len(spec.outputs):
        got = f"{len(out)} of them" if isinstance(out, tuple | list) else f"a {type(out).__name__}"
        raise _build_error(card, spec, f"out: expected a tuple of arrays for the outputs {names}, got {got}")
    pairs = list(zip(spec.outputs, out, strict=True))
    for port, array in pairs:
        shape = port.shape if samples is None else (samples, *port.shape)
        if refusal := _describe_refusal(array, shape):
            text = f"out, for {port.name!r}: expected an array of float64 of the shape {shape}, {refusal}"
            raise _build_error(card, spec, text)
    for (one, first), (other, second) in combinations(pairs, 2):
        if np.may_share_memory(first, second):
            text = f"out: the arrays for {one.name!r} and {other.name!r} share memory; give separate ones"
            raise _build_error(card, spec, text)
    return tuple(out)


def allocate_output(port: Port, samples: int | None, dtype: type[np.floating]) -> FloatArray:
    """Return an array for an output, its values not set."""
    shape = port.shape if samples is None else (samples, *port.shape)
    array: FloatArray = np.empty(shape, dtype=dtype)
    return array


def redirect_outputs(card: ModelCard, spec: FunctionSpec, call: Call, kept: Arrays | None) -> Call:
    """Return `call` of one sample, its outputs written to the arrays `kept` if there are any.

    These are checked again at each call: UsageError where they cannot take the outputs any more.
    """
    if kept is None:
        return call

    def call_and_keep(*values: FloatArray) -> Arrays:
        outputs = call(*values)
        for target, output in zip(check_outputs(card, spec, None, kept), outputs, strict=True):
            target[...] = output
        return kept

    return call_and_keep


@dataclass(frozen=True, slots=True, kw_only=True)
class CallPath:
    """How compiled functions are called from this Python: by its limited API, or by ctypes.

    Attributes:
        name: of the interface; for ctypes also the reason.
        flags: of the compiler, for Python's and NumPy's headers; none for ctypes.
        remedy: what would make calls faster, or nothing.
    """

    name: str
    flags: tuple[str, ...] = ()
    remedy: str = ""


def choose_call_path() -> CallPath:
    """Return how compiled functions are called from this Python."""
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


def build_load_error(path: Path, text: str) -> GenerationError:
    """Return the error that a generated file cannot be loaded."""
    notice = Notice(code="codegen.cannot-load", text=f"cannot be loaded: {text}", file=str(path))
    return GenerationError(notice)


def load_extension(binary: Path, prefix: str) -> ModuleType | None:
    """Return the extension module in a library, or None where calls go through ctypes.

    Its `bind(name, ask, kept)` returns a function for one sample. `ask` is the same function in Python, for
    unusual calls; `kept` is the tuple of arrays that every call overwrites and returns, or None for new ones
    at each call.

    Raises:
        GenerationError: the module does not load with this Python and NumPy.
    """
    if not choose_call_path().flags or not hasattr(ctypes.CDLL(str(binary)), f"PyInit_{prefix}"):
        return None
    loader = ExtensionFileLoader(prefix, str(binary))
    try:
        module = module_from_spec(ModuleSpec(prefix, loader, origin=str(binary)))
        loader.exec_module(module)
    except ImportError as error:
        raise build_load_error(binary, f"{error}; build it again on this machine") from error
    return module
