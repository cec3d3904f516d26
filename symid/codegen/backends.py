"""The two ways to compute a robot's functions: a shared library, and the NumPy module.

Input: a model card, and the file that computes. Output: objects with what `Library` asks for.

Supported: double precision, and float libraries through conversion; libraries that were built again
while this process had the old one loaded.
Not supported: shared libraries of another machine.
"""

import ctypes
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.calls import (
    Call,
    allocate,
    check_inputs,
    check_outputs,
    check_sample,
    find_spec,
    keep_outputs,
)
from symid.codegen.functions import FunctionSpec, ModelCard
from symid.codegen.python_call import load_calls
from symid.errors import GenerationError, Notice, UsageError

__all__ = [
    "CompiledLibrary",
    "PythonLibrary",
    "fail_stale",
    "hand_over",
    "import_module",
    "open_shared",
    "read_digest",
    "separate",
]


def open_shared(binary: Path) -> ctypes.CDLL:
    """Return the shared library.

    Raises:
        GenerationError: it does not load on this machine.
    """
    try:
        return ctypes.CDLL(str(binary))
    except OSError as error:
        text = f"cannot be loaded: {error}; build it again on this machine"
        raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(binary))) from error


def read_digest(shared: ctypes.CDLL, prefix: str) -> str:
    """Return what a library says it was built from, nothing if it says nothing."""
    try:
        call = getattr(shared, f"{prefix}_digest")
    except AttributeError:
        return ""
    call.restype = ctypes.c_char_p
    return str((call() or b"").decode("ascii", "replace"))


def fail_stale(binary: Path) -> UsageError:
    """Return the error for a library of other sources than those beside it."""
    text = "was built from other sources than those beside it; run `make clean shared` in its folder"
    return UsageError(Notice(code="usage.stale-library", text=text, file=str(binary)))


def _open_built(binary: Path, prefix: str, digest: str) -> tuple[ctypes.CDLL, ModuleType | None]:
    shared = open_shared(binary)
    if read_digest(shared, prefix) == digest:
        return shared, load_calls(binary, prefix)
    # The loader gives back what it already has under a name: look at the file as it is now.
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copied = Path(shutil.copy(binary, scratch))
        shared = open_shared(copied)
        if read_digest(shared, prefix) != digest:
            raise fail_stale(binary)
        return shared, load_calls(copied, prefix)


_Room = tuple[tuple[FloatArray, ...], tuple[FloatArray, ...], tuple[ctypes.c_void_p, ...]]


def _make_room(spec: FunctionSpec, dtype: type[np.floating]) -> _Room:
    """Return arrays for inputs and for outputs of one sample, and where they are."""
    inputs = tuple(allocate(port, None, dtype) for port in spec.inputs)
    outputs = tuple(allocate(port, None, dtype) for port in spec.outputs)
    return inputs, outputs, tuple(ctypes.c_void_p(array.ctypes.data) for array in (*inputs, *outputs))


@final
class CompiledLibrary:
    """Functions of a shared library.

    `evaluate` passes arrays without a copy and releases the interpreter's lock. So does nothing else: `bind`
    gives a built-in function where it can (see `python_call`), which holds the lock and copies nothing
    either; elsewhere it goes through ctypes and copies its few numbers.

    `digest` is what the library must say it was built from; see `find_build_digest`.
    """

    backend = "c"

    def __init__(
        self,
        card: ModelCard,
        binary: Path,
        *,
        prefix: str,
        precision: str,
        digest: str,
        notices: tuple[Notice, ...] = (),
    ) -> None:
        self.card = card
        self.notices = notices
        self._binary = binary
        self._prefix = prefix
        self._dtype = np.float32 if precision == "float" else np.float64
        self._shared, self._calls = _open_built(binary, prefix, digest)

    def _find_symbol(self, name: str) -> Callable[..., int]:
        try:
            symbol = getattr(self._shared, f"{self._prefix}_{name}")
        except AttributeError as error:
            raise fail_stale(self._binary) from error
        symbol.restype = ctypes.c_int
        found: Callable[..., int] = symbol
        return found

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`; see `Library`.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs.
        """
        spec = find_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        kept = None if out is None else check_outputs(self.card, spec, samples, out)
        given = [np.asarray(array, dtype=self._dtype) for array in separate(arrays, kept or ())]
        if kept is not None and self._dtype is np.float64:
            outputs = kept
        else:
            outputs = tuple(allocate(port, samples, self._dtype) for port in spec.outputs)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*given, *outputs)]
        count = ctypes.c_size_t(1 if samples is None else samples)
        status = self._find_symbol(f"{name}_batch")(count, *pointers)
        if status:
            raise _fail_call(name, status)
        return hand_over(outputs, kept)

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample; see `Library`.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        spec = find_spec(self.card, name)
        kept = None if out is None else check_outputs(self.card, spec, None, out)
        ask = keep_outputs(self.card, spec, self._bind_slowly(spec), kept)
        if self._calls is None:
            return ask
        quick: Call = self._calls.bind(name, ask, kept)
        return quick

    def _bind_slowly(self, spec: FunctionSpec) -> Call:
        """Return a function through ctypes, which takes all that can be converted."""
        card = self.card
        call, dtype = self._find_symbol(spec.name), self._dtype
        # Room of calls that are over. A call has its own: ctypes lets other threads run, which may call too.
        spare: list[_Room] = []

        def evaluate_one(*values: FloatArray) -> tuple[FloatArray, ...]:
            given = check_sample(card, spec, values)
            try:
                room = spare.pop()
            except IndexError:
                room = _make_room(spec, dtype)
            inputs, outputs, pointers = room
            for buffer, value in zip(inputs, given, strict=True):
                buffer[...] = value
            status = call(*pointers)
            if status:
                raise _fail_call(spec.name, status)
            found = tuple(output.astype(np.float64) for output in outputs)
            spare.append(room)
            return found

        return evaluate_one


def separate(arrays: tuple[FloatArray, ...], kept: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Return `arrays`, copied where they share memory with what is about to be written."""
    return tuple(
        array.copy() if any(np.may_share_memory(array, output) for output in kept) else array
        for array in arrays
    )


def hand_over(outputs: tuple[FloatArray, ...], kept: tuple[FloatArray, ...] | None) -> tuple[FloatArray, ...]:
    """Return `outputs` as doubles, written to the arrays `kept` of a caller if there are any."""
    if kept is None:
        return tuple(np.asarray(output, dtype=np.float64) for output in outputs)
    for target, output in zip(kept, outputs, strict=True):
        if target is not output:
            target[...] = output
    return kept


def _fail_call(name: str, status: int) -> GenerationError:
    text = f"function {name!r} returned the error code {status}"
    return GenerationError(Notice(code="codegen.call-failed", text=text))


# A piece: NumPy takes about as long to begin an operation as for a thousand numbers, and a function has
# thousands of them; but all their results are in memory at once.
_CHUNK = 4096


@final
class PythonLibrary:
    """Functions of a generated NumPy module; large batches go through in pieces, to save memory."""

    backend = "python"

    def __init__(self, card: ModelCard, module: ModuleType, notices: tuple[Notice, ...] = ()) -> None:
        self.card = card
        self.notices = notices
        self._module = module

    def _call(self, name: str, inputs: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        result = getattr(self._module, name)(*inputs)
        return result if isinstance(result, tuple) else (result,)

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`; see `Library`.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs.
        """
        spec = find_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        kept = None if out is None else check_outputs(self.card, spec, samples, out)
        arrays = separate(arrays, kept or ())
        if samples is None or samples <= _CHUNK:
            return hand_over(self._call(name, arrays), kept)
        outputs = kept or tuple(allocate(port, samples, np.float64) for port in spec.outputs)
        for start in range(0, samples, _CHUNK):
            piece = slice(start, start + _CHUNK)
            given = tuple(a if p.shared else a[piece] for p, a in zip(spec.inputs, arrays, strict=True))
            for output, values in zip(outputs, self._call(name, given), strict=True):
                output[piece] = values
        return outputs

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample; see `Library`.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        card, spec = self.card, find_spec(self.card, name)
        kept = None if out is None else check_outputs(card, spec, None, out)

        def call(*values: FloatArray) -> tuple[FloatArray, ...]:
            return self._call(name, check_sample(card, spec, values))

        return keep_outputs(card, spec, call, kept)


def import_module(path: Path) -> ModuleType:
    """Return the generated module at `path`, from its source: byte code beside it is not looked at.

    Raises:
        GenerationError: it cannot be read or is no Python.
    """
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)  # noqa: S102  what symid wrote
    except (OSError, SyntaxError, ImportError, ValueError) as error:
        text = f"cannot be imported: {error}; generate it again"
        raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(path))) from error
    return module
