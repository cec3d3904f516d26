"""A robot's functions, ready to call: compiled C, or the NumPy module.

Input: a folder of generated sources, for C with the shared library in it. Output: `Library`.

Supported: one sample and batches; double precision, and float libraries through conversion.
Not supported: shared libraries of another machine.
"""

import ctypes
import importlib.util
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Protocol, final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import FunctionSpec, ModelCard, Port, read_model_card
from symid.codegen.writer import read_manifest
from symid.errors import GenerationError, Notice, UsageError

__all__ = ["CompiledLibrary", "Library", "PythonLibrary", "load_library"]

Bound = Callable[..., tuple[FloatArray, ...]]


class Library(Protocol):
    """The functions of a model card, however they are computed."""

    @property
    def card(self) -> ModelCard:
        """Return the model behind the functions."""
        ...

    @property
    def backend(self) -> str:
        """Return "c" or "python"."""
        ...

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a user should know, for example that there was no compiler."""
        ...

    def evaluate(self, name: str, *inputs: FloatArray) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`.

        Args:
            name: of a function in the card.
            inputs: (N, *shape) each, or all of one sample's shape; shared vectors (size,).

        Raises:
            UsageError: the function does not exist, or a shape is wrong.
        """
        ...

    def bind(self, name: str) -> Bound:
        """Return function `name` for one sample at a time, with little overhead.

        The arrays that it returns may be overwritten by its next call.

        Raises:
            UsageError: the function does not exist.
        """
        ...


def _find_spec(card: ModelCard, name: str) -> FunctionSpec:
    for spec in card.functions:
        if spec.name == name:
            return spec
    known = ", ".join(spec.name for spec in card.functions)
    text = f"the library of {card.robot!r} has no function {name!r}; it has {known}"
    raise UsageError(Notice(code="usage.unknown-function", text=text))


def _fail_shape(card: ModelCard, spec: FunctionSpec, text: str) -> UsageError:
    notice = Notice(code="usage.shape", text=f"function {spec.name!r} of {card.robot!r}: {text}")
    return UsageError(notice)


def _check_inputs(
    card: ModelCard, spec: FunctionSpec, inputs: tuple[FloatArray, ...]
) -> tuple[int | None, tuple[FloatArray, ...]]:
    """Return the number of samples, None for a single one, and the inputs as float64, row-major."""
    if len(inputs) != len(spec.inputs):
        names = ", ".join(port.name for port in spec.inputs)
        raise _fail_shape(card, spec, f"expected the inputs {names}, got {len(inputs)} arrays")
    arrays = tuple(np.ascontiguousarray(value, dtype=np.float64) for value in inputs)
    pairs = tuple(zip(spec.inputs, arrays, strict=True))
    lead = next(((port, array) for port, array in pairs if not port.shared), None)
    samples = None
    if lead is not None and lead[1].ndim == len(lead[0].shape) + 1:
        samples = lead[1].shape[0]
    for port, array in pairs:
        batch = () if port.shared or samples is None else (samples,)
        if array.shape != (*batch, *port.shape):
            allowed = f"{port.shape}" if port.shared else f"{port.shape} or (N, {str(port.shape)[1:]}"
            text = f"input {port.name!r}: expected the shape {allowed}, N alike for all, got {array.shape}"
            raise _fail_shape(card, spec, text)
    return samples, arrays


def _allocate(port: Port, samples: int | None, dtype: type[np.floating]) -> FloatArray:
    shape = port.shape if samples is None else (samples, *port.shape)
    array: FloatArray = np.empty(shape, dtype=dtype)
    return array


@final
class CompiledLibrary:
    """Functions of a shared library; calls pass arrays without a copy and release the interpreter's lock."""

    backend = "c"

    def __init__(
        self, card: ModelCard, binary: Path, *, prefix: str, precision: str, notices: tuple[Notice, ...] = ()
    ) -> None:
        self.card = card
        self.notices = notices
        self._prefix = prefix
        self._dtype = np.float32 if precision == "float" else np.float64
        try:
            self._shared = ctypes.CDLL(str(binary))
        except OSError as error:
            text = f"cannot be loaded: {error}; build it again on this machine"
            raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(binary))) from error

    def _find_symbol(self, name: str) -> Callable[..., int]:
        symbol = getattr(self._shared, f"{self._prefix}_{name}")
        symbol.restype = ctypes.c_int
        found: Callable[..., int] = symbol
        return found

    def evaluate(self, name: str, *inputs: FloatArray) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`; see `Library`.

        Raises:
            UsageError: the function does not exist, or a shape is wrong.
        """
        spec = _find_spec(self.card, name)
        samples, arrays = _check_inputs(self.card, spec, inputs)
        given = [np.asarray(array, dtype=self._dtype) for array in arrays]
        outputs = tuple(_allocate(port, samples, self._dtype) for port in spec.outputs)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*given, *outputs)]
        count = ctypes.c_size_t(1 if samples is None else samples)
        status = self._find_symbol(f"{name}_batch")(count, *pointers)
        if status:
            text = f"function {name!r} returned the error code {status}"
            raise GenerationError(Notice(code="codegen.call-failed", text=text))
        return tuple(np.asarray(output, dtype=np.float64) for output in outputs)

    def bind(self, name: str) -> Bound:
        """Return function `name` for one sample; its outputs are overwritten by the next call.

        Raises:
            UsageError: the function does not exist.
        """
        spec = _find_spec(self.card, name)
        inputs = tuple(np.zeros(port.shape, dtype=self._dtype) for port in spec.inputs)
        outputs = tuple(_allocate(port, None, self._dtype) for port in spec.outputs)
        call = self._find_symbol(name)
        pointers = tuple(ctypes.c_void_p(array.ctypes.data) for array in (*inputs, *outputs))

        def evaluate_one(*values: FloatArray) -> tuple[FloatArray, ...]:
            for buffer, value in zip(inputs, values, strict=True):
                buffer[...] = value
            call(*pointers)
            return outputs

        return evaluate_one


_CHUNK = 512


@final
class PythonLibrary:
    """Functions of a generated NumPy module; batches go through in pieces that fit the cache."""

    backend = "python"

    def __init__(self, card: ModelCard, module: ModuleType, notices: tuple[Notice, ...] = ()) -> None:
        self.card = card
        self.notices = notices
        self._module = module

    def _call(self, name: str, inputs: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        result = getattr(self._module, name)(*inputs)
        return result if isinstance(result, tuple) else (result,)

    def evaluate(self, name: str, *inputs: FloatArray) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`; see `Library`.

        Raises:
            UsageError: the function does not exist, or a shape is wrong.
        """
        spec = _find_spec(self.card, name)
        samples, arrays = _check_inputs(self.card, spec, inputs)
        if samples is None:
            return self._call(name, arrays)
        outputs = tuple(_allocate(port, samples, np.float64) for port in spec.outputs)
        for start in range(0, samples, _CHUNK):
            piece = slice(start, start + _CHUNK)
            given = tuple(a if p.shared else a[piece] for p, a in zip(spec.inputs, arrays, strict=True))
            for output, values in zip(outputs, self._call(name, given), strict=True):
                output[piece] = values
        return outputs

    def bind(self, name: str) -> Bound:
        """Return function `name` for one sample.

        Raises:
            UsageError: the function does not exist.
        """
        _find_spec(self.card, name)
        return lambda *values: self._call(name, values)


def _import_module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise GenerationError(
            Notice(code="codegen.cannot-load", text="is not a Python module", file=str(path))
        )
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (OSError, SyntaxError, ImportError) as error:
        text = f"cannot be imported: {error}; generate it again"
        raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(path))) from error
    return module


def _find_text(manifest: Mapping[str, object], key: str, folder: Path) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        text = f"the manifest has no {key!r}; generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder)))
    return value


def load_library(folder: Path, *, notices: tuple[Notice, ...] = ()) -> Library:
    """Return the library in a folder that symid generated; C needs `make shared` first.

    Raises:
        UsageError: the folder holds no generated library, or its C was not compiled.
        GenerationError: the library does not load on this machine.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        text = "holds no library of symid: there is no manifest.json that it wrote"
        raise UsageError(Notice(code="usage.no-library", text=text, file=str(folder)))
    try:
        card = read_model_card(json.dumps(manifest["card"]))
    except (KeyError, TypeError, ValueError) as error:
        text = f"the manifest holds no model card ({error}); generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder))) from error
    prefix = _find_text(manifest, "prefix", folder)
    if manifest.get("target") == "python":
        return PythonLibrary(card, _import_module(folder / f"{prefix}.py"), notices)
    binary = folder / f"lib{prefix}.so"
    if not binary.is_file():
        text = f"has no {binary.name}; run `make shared` in it"
        raise UsageError(Notice(code="usage.not-compiled", text=text, file=str(folder)))
    precision = _find_text(manifest, "precision", folder)
    return CompiledLibrary(card, binary, prefix=prefix, precision=precision, notices=notices)
