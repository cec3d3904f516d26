"""A robot's functions, ready to call: compiled C, the NumPy module, or CasADi.

Folder of generated sources, for C with the shared library in it -> `Library`, which checks what a caller
gives and turns it into arrays, and the `Engine` behind it, which computes. A compiled library holds a digest
of what it must have been built from: model card, precision and sources, not the flags of the compiler.
The extension module in it, of `python_call.c` (Python's limited API from 3.11, NumPy's for arrays), calls it
without copies; where their headers are not installed, calls go through ctypes.

Supported: anything that NumPy reads as real numbers, one sample or a batch; double precision, and float
libraries through conversion; libraries that were built again while this process had the old one loaded;
extensions for CPython with its global lock, which a call holds, in double precision.
Not supported: complex numbers, text, rows of unequal length, arrays of objects; shared libraries of another
machine, or built from other sources than the folder's; files that a newer CasADi wrote; extensions for other
interpreters, free-threaded builds and float libraries.
"""

import contextlib
import ctypes
import shutil
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast, final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import source_folder
from symid.codegen.functions import FunctionSpec, ModelCard, Port, compute_build_digest
from symid.environment import make_scratch_folder
from symid.errors import GenerationError, InputError, Notice, UsageError
from symid.serialization import read_record

if TYPE_CHECKING:
    import casadi as ca

_REAL_KINDS = "biuf"
_DOUBLE = np.dtype(np.float64)
_STALE = "was built from other sources than those beside it; run `make clean shared` in its folder"
_INTERRUPTED = "is incomplete: an update is running or was interrupted. Wait, or generate the folder again"

Arrays = tuple[FloatArray, ...]
Call = Callable[..., Arrays]
_LEAST_PIECE = 256
"""Samples for a thread: to start one takes as long as some hundred."""
# Samples at once: NumPy takes about as long to begin an operation as for a thousand numbers, and a function
# has thousands of operations; but all their results are in memory at once.
_NUMPY_CHUNK = 4096
# Samples at once. Buffers of a regressor of seven joints are then half a megabyte, and stay in the cache of a
# processor; a call for each piece costs some microseconds.
_CASADI_CHUNK = 256


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
    """Return the number of samples, None for one, and the inputs as arrays; UsageError for a wrong one."""
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
    """Return the inputs of one sample as arrays of float64, which may have strides; else a UsageError."""
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


def check_outputs(card: ModelCard, spec: FunctionSpec, samples: int | None, out: object) -> Arrays:
    """Return a caller's arrays that outputs are written to; UsageError where one does not fit its output."""
    names = ", ".join(port.name for port in spec.outputs)
    if not isinstance(out, tuple | list) or len(out) != len(spec.outputs):
        got = f"{len(out)} of them" if isinstance(out, tuple | list) else f"a {type(out).__name__}"
        raise _build_error(card, spec, f"out: expected a tuple of arrays for the outputs {names}, got {got}")
    pairs = list(zip(spec.outputs, out, strict=True))
    for port, array in pairs:
        shape, got = port.shape if samples is None else (samples, *port.shape), ""
        if not isinstance(array, np.ndarray):
            got = f"a {type(array).__name__}"
        elif array.dtype != np.float64 or not array.dtype.isnative:
            got = f"an array of {array.dtype.str}"
        elif array.shape != shape:
            got = f"the shape {array.shape}"
        elif not (array.flags.c_contiguous and array.flags.aligned and array.flags.writeable):
            got = "one that cannot be written in place, row after row"
        if got:
            text = f"out, for {port.name!r}: expected an array of float64 of the shape {shape}, got {got}"
            raise _build_error(card, spec, text)
    for (one, first), (other, second) in combinations(pairs, 2):
        if np.may_share_memory(first, second):
            text = f"out: the arrays for {one.name!r} and {other.name!r} share memory; give separate ones"
            raise _build_error(card, spec, text)
    return tuple(out)


_LINE = 64
"""Bytes of a line of the cache: batches of outputs that begin with one are written in whole lines."""


def _allocate_output(port: Port, samples: int | None) -> FloatArray:
    """Return an array for an output, its values not set."""
    if samples is None:
        return np.empty(port.shape)
    count = samples * port.size
    room = np.empty(count + _LINE // 8)
    first = -room.ctypes.data % _LINE // 8
    return room[first : first + count].reshape(samples, *port.shape)


def redirect_outputs(card: ModelCard, spec: FunctionSpec, call: Call, kept: Arrays | None) -> Call:
    """Return `call` of one sample, its outputs written to the arrays `kept`, if any, checked each time."""
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
    """How compiled functions are called from this Python: by its limited API or, for a reason, by ctypes.

    `flags` of the compiler find Python's and NumPy's headers; `remedy`: what would make calls faster, if any.
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
    headers = (Path(python, "Python.h"), Path(numpy, "numpy/arrayobject.h"))
    for header, package in zip(headers, ("python3-dev", "python3-numpy-dev"), strict=True):
        if not header.is_file():
            remedy = f"install {package} (its name on Debian); single samples are then ten times as fast"
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
    at each call. GenerationError where it does not load with this Python and NumPy.
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


def open_shared(binary: Path) -> ctypes.CDLL:
    """Return the shared library; GenerationError where it does not load on this machine."""
    try:
        return ctypes.CDLL(str(binary))
    except OSError as error:
        raise build_load_error(binary, f"{error}; build it again on this machine") from error


def _read_digest(shared: ctypes.CDLL, prefix: str) -> str:
    """Return the digest of what a library was built from, nothing if it holds none."""
    call = getattr(shared, f"{prefix}_digest", None)
    if call is None:
        return ""
    call.restype = ctypes.c_char_p
    return str((call() or b"").decode("ascii", "replace"))


def _refuse_place(place: Path, code: str, text: str) -> UsageError:
    return UsageError(Notice(code=code, text=text, file=str(place)))


@contextlib.contextmanager
def _open_copy(binary: Path, prefix: str, digest: str) -> Iterator[tuple[ctypes.CDLL, Path]]:
    """Open a copy of a library: of a name that it knows, the loader gives back the file as it was."""
    with make_scratch_folder() as scratch:
        copy = Path(shutil.copy(binary, scratch))
        shared = open_shared(copy)
        if _read_digest(shared, prefix) != digest:
            raise _refuse_place(binary, "usage.stale-library", _STALE)
        yield shared, copy


@final
@dataclass(eq=False)
class Library:
    """The functions of a model card, computed by `engine`; `notices` say for example: no compiler.

    `tangents` returns torques (N, n, k) at q, dq and ddq per change of the last k that are searched.
    """

    card: ModelCard
    engine: "Engine"
    notices: tuple[Notice, ...] = ()
    tangents: Callable[[FloatArray, FloatArray, FloatArray], FloatArray] | None = None

    @property
    def backend(self) -> str:
        """Return "c", "python" or "casadi"."""
        return self.engine.backend

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None, threads: int = 1
    ) -> Arrays:
        """Return the outputs of function `name`.

        Contiguous arrays of float64 are not copied. In a loop over batches of many megabytes, give the
        arrays of one pass as `out` to the next: new memory can cost as much as the computation.

        Args:
            name: of a function in the card.
            inputs: (N, *shape) each, or all of one sample's shape; shared vectors (size,).
            out: a tuple of arrays to write the outputs to and return, contiguous, float64, of the outputs'
                shapes, without memory in common; None for new ones. An input that shares memory with
                them is copied first.
            threads: that share a batch; the outputs are the same bytes with any number. Compiled C alone
                has more than one.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs, or there is no thread.
        """
        if threads < 1:
            text = f"threads: expected 1 or more, got {threads}"
            raise UsageError(Notice(code="usage.threads", text=text))
        spec = get_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        if out is None:
            outputs = tuple(_allocate_output(port, samples) for port in spec.outputs)
        else:
            outputs = check_outputs(self.card, spec, samples, out)
            shared = [any(np.may_share_memory(array, output) for output in outputs) for array in arrays]
            arrays = tuple(a.copy() if is_shared else a for a, is_shared in zip(arrays, shared, strict=True))
        self.engine.run(spec, samples, arrays, outputs, threads)
        return outputs

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample at a time, with little overhead.

        A call raises UsageError for anything but one sample of real numbers. One bound function belongs to
        one thread; bind another for another thread.

        Args:
            name: of a function in the card.
            out: as for `evaluate`, of one sample's shapes: every call overwrites and returns these arrays.
                None for new ones in each call.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        spec = get_spec(self.card, name)
        kept = None if out is None else check_outputs(self.card, spec, None, out)
        return self.engine.bind(self.card, spec, kept)


def _check_status(name: str, status: int) -> None:
    """Raise GenerationError for a status other than 0."""
    if status:
        text = f"function {name!r} returned the error code {status}"
        raise GenerationError(Notice(code="codegen.call-failed", text=text))


@final
class _CompiledEngine:
    """Functions of a shared library; `digest` is what it must have been built from.

    A batch goes through ctypes, which passes arrays without a copy and releases the interpreter's lock.
    `bind` gives a built-in function where it can (see `load_extension`), which holds the lock; elsewhere it
    goes through ctypes and copies its few numbers.
    """

    backend = "c"

    def __init__(self, binary: Path, *, prefix: str, precision: str, digest: str) -> None:
        self.binary = binary
        self._prefix = prefix
        self._dtype = np.float32 if precision == "float" else np.float64
        self._shared = open_shared(binary)
        if _read_digest(self._shared, prefix) == digest:
            self.calls = load_extension(binary, prefix)
        else:
            with _open_copy(binary, prefix, digest) as (self._shared, copy):
                self.calls = load_extension(copy, prefix)
        self.addresses = self._shared if self._dtype is np.float64 else None

    def _get_symbol(self, name: str) -> Callable[..., int]:
        symbol: Callable[..., int] | None = getattr(self._shared, f"{self._prefix}_{name}", None)
        if symbol is None:
            raise _refuse_place(self.binary, "usage.stale-library", _STALE)
        return symbol

    def run(
        self, spec: FunctionSpec, samples: int | None, given: Arrays, outputs: Arrays, threads: int
    ) -> None:
        arrays = [np.asarray(array, dtype=self._dtype) for array in given]
        rounded = self._dtype is np.float32
        computed = tuple(np.empty_like(one, dtype=self._dtype) for one in outputs) if rounded else outputs
        # Where each array begins, and how far its next sample is.
        places = [
            (array.ctypes.data, 0 if port.shared else port.size * array.itemsize)
            for port, array in zip((*spec.inputs, *spec.outputs), (*arrays, *computed), strict=True)
        ]
        call, count = self._get_symbol(f"{spec.name}_batch"), 1 if samples is None else samples

        def run_piece(start: int, stop: int) -> int:
            pointers = (ctypes.c_void_p(first + start * step) for first, step in places)
            return call(ctypes.c_size_t(stop - start), *pointers)

        # A piece has whole vectors of samples, and enough of them to be worth a thread.
        piece = _LEAST_PIECE * max(1, -(-count // (_LEAST_PIECE * threads)))
        starts = range(0, count, piece) if threads > 1 and count >= 2 * _LEAST_PIECE else ()
        if len(starts) > 1:
            # The last piece takes a short rest along.
            stops = [*starts[1:], count]
            if count - starts[-1] < _LEAST_PIECE:
                starts, stops = starts[:-1], [*stops[:-2], count]
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(len(starts)) as pool:
                statuses = list(pool.map(run_piece, starts, stops))
        else:
            statuses = [run_piece(0, count)]
        _check_status(spec.name, max(statuses))
        for output, values in zip(outputs, computed, strict=True) if rounded else ():
            output[...] = values

    def bind(self, card: ModelCard, spec: FunctionSpec, kept: Arrays | None) -> Call:
        slow = redirect_outputs(card, spec, self.bind_slowly(card, spec), kept)
        quick: Call = slow if self.calls is None else self.calls.bind(spec.name, slow, kept)
        return quick

    def bind_slowly(self, card: ModelCard, spec: FunctionSpec) -> Call:
        """Return a function through ctypes, which takes all that can be converted."""
        call = self._get_symbol(spec.name)
        # Room of calls that are over. A call has its own: ctypes lets other threads run, which may call too.
        spare: list[tuple[Arrays, Arrays, tuple[ctypes.c_void_p, ...]]] = []
        ports = (spec.inputs, spec.outputs)

        def evaluate_one(*values: FloatArray) -> Arrays:
            given = check_sample(card, spec, values)
            try:
                inputs, outputs, pointers = spare.pop()
            except IndexError:
                kind = self._dtype
                inputs, outputs = (tuple(np.empty(p.shape, kind) for p in side) for side in ports)
                pointers = tuple(ctypes.c_void_p(array.ctypes.data) for array in (*inputs, *outputs))
            for buffer, value in zip(inputs, given, strict=True):
                buffer[...] = value
            _check_status(spec.name, call(*pointers))
            found = tuple(output.astype(np.float64) for output in outputs)
            spare.append((inputs, outputs, pointers))
            return found

        return evaluate_one


@final
@dataclass(frozen=True, slots=True, eq=False)
class _PythonEngine:
    """Functions of a generated NumPy module; large batches go through in pieces, to save memory."""

    module: ModuleType
    backend = "python"
    addresses = None

    def _call(self, name: str, inputs: Arrays) -> Arrays:
        result = getattr(self.module, name)(*inputs)
        return result if isinstance(result, tuple) else (result,)

    def run(
        self, spec: FunctionSpec, samples: int | None, given: Arrays, outputs: Arrays, _threads: int
    ) -> None:
        for start in range(0, 1 if samples is None else samples, _NUMPY_CHUNK):
            piece = ... if samples is None else slice(start, start + _NUMPY_CHUNK)
            inputs = tuple(a if p.shared else a[piece] for p, a in zip(spec.inputs, given, strict=True))
            for output, values in zip(outputs, self._call(spec.name, inputs), strict=True):
                output[piece] = values

    def bind(self, card: ModelCard, spec: FunctionSpec, kept: Arrays | None) -> Call:
        return redirect_outputs(
            card, spec, lambda *values: self._call(spec.name, check_sample(card, spec, values)), kept
        )


def import_generated_module(path: Path) -> ModuleType:
    """Return the module at `path`, from its source, not from byte code; GenerationError where it is none."""
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)  # noqa: S102  what symid wrote
    except (OSError, SyntaxError, ImportError, ValueError) as error:
        raise build_load_error(path, f"{error}; generate it again") from error
    return module


@final
class _MappedFunction:
    """A function for a number of samples, with memory for inputs and outputs; for one caller at a time."""

    def __init__(self, function: "ca.Function", spec: FunctionSpec, samples: int) -> None:
        mapped = function if samples == 1 else function.map(samples)
        self._name = spec.name
        # Any: the types that CasADi states are those of C++, with sizes that Python does not give.
        self._buffer: Any
        self._buffer, self._run = mapped.buffer()

        def allocate(place: int, port: Port, give: Callable[[int, memoryview], None]) -> FloatArray:
            # CasADi has matrices column by column; callers a view of them by samples, which keeps the memory.
            memory = np.zeros((samples, *port.shape[1:], *port.shape[:1]))
            give(place, memory.data)
            return np.moveaxis(memory, -1, 1)

        ports = (enumerate(spec.inputs), enumerate(spec.outputs))
        self.inputs = tuple(allocate(k, port, self._buffer.set_arg) for k, port in ports[0])
        self.outputs = tuple(allocate(k, port, self._buffer.set_res) for k, port in ports[1])

    def run(self) -> None:
        """Compute the outputs from the inputs."""
        self._run()
        _check_status(self._name, self._buffer.ret())


@final
@dataclass(frozen=True, slots=True, eq=False)
class _CasadiEngine:
    """Functions of CasADi by name: of the compiled library `addresses`, or of its virtual machine.

    `spare` is memory of finished calls, by function and samples. A call has its own: other threads may call.
    """

    functions: "Mapping[str, ca.Function]"
    addresses: ctypes.CDLL | None = None
    spare: dict[tuple[str, int], list[_MappedFunction]] = field(default_factory=dict)
    backend = "casadi"

    def run(
        self, spec: FunctionSpec, samples: int | None, given: Arrays, outputs: Arrays, _threads: int
    ) -> None:
        if samples is None:
            given = tuple(a if port.shared else a[None] for port, a in zip(spec.inputs, given, strict=True))
            outputs, samples = tuple(output[None] for output in outputs), 1
        # A power of two at least as large: few sizes of rooms, whatever the sizes of batches.
        size = min(_CASADI_CHUNK, 1 << max(0, samples - 1).bit_length())
        spare = self.spare.setdefault((spec.name, size), [])
        try:
            room = spare.pop()
        except IndexError:
            room = _MappedFunction(self.functions[spec.name], spec, size)
        ports = list(zip(spec.inputs, room.inputs, given, strict=True))
        for port, target, array in ports:
            if port.shared:
                target[...] = array
        for start in range(0, samples, size):
            piece = slice(start, min(start + size, samples))
            count = piece.stop - start
            for port, target, array in ports:
                if not port.shared:
                    target[:count] = array[piece]
            # After a shorter last piece, samples of before are left, whose outputs are not read.
            room.run()
            for output, values in zip(outputs, room.outputs, strict=True):
                output[piece] = values[:count]
        spare.append(room)

    def bind(self, card: ModelCard, spec: FunctionSpec, kept: Arrays | None) -> Call:
        room = _MappedFunction(self.functions[spec.name], spec, 1)
        targets, results = tuple(view[0] for view in room.inputs), tuple(view[0] for view in room.outputs)

        def call(*values: FloatArray) -> Arrays:
            for target, value in zip(targets, check_sample(card, spec, values), strict=True):
                target[...] = value
            room.run()
            return tuple(result.copy(order="C") for result in results)

        return redirect_outputs(card, spec, call, kept)


Engine = _CompiledEngine | _PythonEngine | _CasadiEngine
"""What computes functions; inputs were checked before, and share no memory with outputs.

`backend` is "c", "python" or "casadi"; `addresses` the shared library in which the functions stand in double
precision, if there is one. `run` computes a batch, or one sample where `samples` is None, into `outputs`;
`bind` returns a function of one sample, see `Library.bind`.
"""


_UPDATE_PATIENCE = 1.0
_UPDATE_LOOK = 0.05


def load_library(folder: Path) -> Library:
    """Return the library in a folder that symid generated; C needs `make shared` first.

    A folder for CasADi works as it is; after `make shared` its compiled C is used, which is faster.

    Raises:
        UsageError: the folder holds no generated library, or its C was not compiled since it was written,
            or its files do not belong together.
        GenerationError: the library does not load on this machine.
    """
    # An update takes less than a second; a folder of one that was interrupted stays.
    end = time.monotonic() + _UPDATE_PATIENCE
    while source_folder.list_interrupted_updates(folder) and time.monotonic() < end:
        time.sleep(_UPDATE_LOOK)
    manifest = source_folder.read_manifest(folder)
    if manifest is None:
        text = "holds no library of symid: there is no manifest.json that it wrote"
        raise _refuse_place(folder, "usage.no-library", text)
    try:
        card = read_record(ModelCard, manifest.get("card"))
    except InputError as error:
        text = f"the manifest holds no model card ({error}); generate the folder again"
        raise _refuse_place(folder, "usage.broken-manifest", text) from error
    if source_folder.list_interrupted_updates(folder):
        raise _refuse_place(folder, "usage.interrupted-update", _INTERRUPTED)
    prefix, precision, target = (manifest.get(key) for key in ("prefix", "precision", "target"))
    if not isinstance(prefix, str) or not isinstance(precision, str):
        text = "the manifest has no prefix or precision; generate the folder again"
        raise _refuse_place(folder, "usage.broken-manifest", text)
    binary = folder / (f"lib{prefix}_casadi.so" if target == "casadi" else f"lib{prefix}.so")
    if target != "python" and binary.is_file():
        files = source_folder.get_listed_digests(manifest)
        digest = compute_build_digest(card, prefix=prefix, precision=precision, files=files)
        if target != "casadi":
            return Library(card, _CompiledEngine(binary, prefix=prefix, precision=precision, digest=digest))
        import casadi as ca

        with _open_copy(binary, prefix, digest) as (shared, copy):
            try:
                functions = {spec.name: ca.external(spec.name, str(copy)) for spec in card.functions}
            except RuntimeError as error:
                raise build_load_error(binary, f"CasADi: {error}; build it again on this machine") from error
        return Library(card, _CasadiEngine(functions, shared))
    if target == "python":
        library = Library(card, _PythonEngine(import_generated_module(folder / f"{prefix}.py")))
    elif target == "casadi":
        text = f"no {binary.name}: CasADi's virtual machine is used, which is slower; run `make shared` there"
        notice = Notice(code="codegen.casadi-machine", text=text, file=str(folder))
        import casadi as ca

        functions = {}
        for spec in card.functions:
            path = folder / f"{spec.name}.casadi"
            try:
                functions[spec.name] = ca.Function.load(str(path))
            except RuntimeError as error:
                reader = f"CasADi {ca.CasadiMeta.version()}"
                text = f"{reader} cannot read it; generate it again with this version\n{error}"
                raise build_load_error(path, text) from error
        library = Library(card, _CasadiEngine(functions), (notice,))
    else:
        text = f"has no {binary.name}; run `make shared` in it"
        raise _refuse_place(folder, "usage.not-compiled", text)
    # The files were read one by one: they must belong together.
    if not source_folder.is_unchanged(folder, manifest):
        raise _refuse_place(folder, "usage.interrupted-update", _INTERRUPTED)
    return library
