"""A robot's functions, ready to call: compiled C, the NumPy module, or CasADi.

Folder of generated sources, for C with the shared library in it -> `Library`.

A compiled library holds a digest of what it must have been built from: model card, precision and sources,
not the flags of the compiler. CasADi reads and writes memory as it is, without its matrices between: a
batch passes through `Function.map` of a fixed number of samples, which works on buffers of its own.

Supported: one sample and batches; double precision, and float libraries through conversion; libraries that
were built again while this process had the old one loaded.
Not supported: shared libraries of another machine, or built from other sources than the folder's; files
that a newer CasADi wrote.
"""

import ctypes
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.calls import (
    Call,
    allocate_output,
    check_inputs,
    check_outputs,
    check_sample,
    get_spec,
    load_extension,
    redirect_outputs,
)
from symid.codegen.functions import FunctionSpec, ModelCard, Port, read_model_card, write_model_card
from symid.codegen.source_folder import get_listed_digests, read_manifest
from symid.errors import GenerationError, Notice, UsageError
from symid.serialization import compute_signature

if TYPE_CHECKING:
    import casadi as ca


def compute_build_digest(card: ModelCard, *, prefix: str, precision: str, files: Mapping[str, str]) -> str:
    """Return the digest of all that fixes the interface of a library and its numbers.

    Args:
        card: the model.
        prefix: of the names in the library.
        precision: "double" or "float".
        files: digest by path; headers and functions count. The file that holds this digest does not.
    """
    info = f"{prefix}_info.c"
    compiled = {
        path: digest
        for path, digest in files.items()
        if path == f"{prefix}.h"
        or (path.startswith(f"{prefix}_") and path.endswith((".c", ".h")) and path != info)
    }
    return compute_signature(prefix, precision, write_model_card(card), compiled)


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


def build_stale_error(binary: Path) -> UsageError:
    """Return the error for a library of other sources than those beside it."""
    text = "was built from other sources than those beside it; run `make clean shared` in its folder"
    return UsageError(Notice(code="usage.stale-library", text=text, file=str(binary)))


def _open_built(binary: Path, prefix: str, digest: str) -> tuple[ctypes.CDLL, ModuleType | None]:
    shared = open_shared(binary)
    if read_digest(shared, prefix) == digest:
        return shared, load_extension(binary, prefix)
    # The loader gives back what it already has under a name: look at the file as it is now.
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copied = Path(shutil.copy(binary, scratch))
        shared = open_shared(copied)
        if read_digest(shared, prefix) != digest:
            raise build_stale_error(binary)
        return shared, load_extension(copied, prefix)


_SampleBuffers = tuple[tuple[FloatArray, ...], tuple[FloatArray, ...], tuple[ctypes.c_void_p, ...]]


def _allocate_sample_buffers(spec: FunctionSpec, dtype: type[np.floating]) -> _SampleBuffers:
    """Return arrays for inputs and for outputs of one sample, and where they are."""
    inputs = tuple(allocate_output(port, None, dtype) for port in spec.inputs)
    outputs = tuple(allocate_output(port, None, dtype) for port in spec.outputs)
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
            raise build_stale_error(self._binary) from error
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
        spec = get_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        kept = None if out is None else check_outputs(self.card, spec, samples, out)
        given = [np.asarray(array, dtype=self._dtype) for array in copy_overlapping(arrays, kept or ())]
        if kept is not None and self._dtype is np.float64:
            outputs = kept
        else:
            outputs = tuple(allocate_output(port, samples, self._dtype) for port in spec.outputs)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*given, *outputs)]
        count = ctypes.c_size_t(1 if samples is None else samples)
        status = self._find_symbol(f"{name}_batch")(count, *pointers)
        if status:
            raise _build_call_error(name, status)
        return return_outputs(outputs, kept)

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample; see `Library`.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        spec = get_spec(self.card, name)
        kept = None if out is None else check_outputs(self.card, spec, None, out)
        ask = redirect_outputs(self.card, spec, self._bind_slowly(spec), kept)
        if self._calls is None:
            return ask
        quick: Call = self._calls.bind(name, ask, kept)
        return quick

    def _bind_slowly(self, spec: FunctionSpec) -> Call:
        """Return a function through ctypes, which takes all that can be converted."""
        card = self.card
        call, dtype = self._find_symbol(spec.name), self._dtype
        # Room of calls that are over. A call has its own: ctypes lets other threads run, which may call too.
        spare: list[_SampleBuffers] = []

        def evaluate_one(*values: FloatArray) -> tuple[FloatArray, ...]:
            given = check_sample(card, spec, values)
            try:
                room = spare.pop()
            except IndexError:
                room = _allocate_sample_buffers(spec, dtype)
            inputs, outputs, pointers = room
            for buffer, value in zip(inputs, given, strict=True):
                buffer[...] = value
            status = call(*pointers)
            if status:
                raise _build_call_error(spec.name, status)
            found = tuple(output.astype(np.float64) for output in outputs)
            spare.append(room)
            return found

        return evaluate_one


def copy_overlapping(arrays: tuple[FloatArray, ...], kept: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Return `arrays`, copied where they share memory with what is about to be written."""
    return tuple(
        array.copy() if any(np.may_share_memory(array, output) for output in kept) else array
        for array in arrays
    )


def return_outputs(
    outputs: tuple[FloatArray, ...], kept: tuple[FloatArray, ...] | None
) -> tuple[FloatArray, ...]:
    """Return `outputs` as doubles, written to the arrays `kept` of a caller if there are any."""
    if kept is None:
        return tuple(np.asarray(output, dtype=np.float64) for output in outputs)
    for target, output in zip(kept, outputs, strict=True):
        if target is not output:
            target[...] = output
    return kept


def _build_call_error(name: str, status: int) -> GenerationError:
    text = f"function {name!r} returned the error code {status}"
    return GenerationError(Notice(code="codegen.call-failed", text=text))


# A piece: NumPy takes about as long to begin an operation as for a thousand numbers, and a function has
# thousands of them; but all their results are in memory at once.
_NUMPY_CHUNK = 4096


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
        spec = get_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        kept = None if out is None else check_outputs(self.card, spec, samples, out)
        arrays = copy_overlapping(arrays, kept or ())
        if samples is None or samples <= _NUMPY_CHUNK:
            return return_outputs(self._call(name, arrays), kept)
        outputs = kept or tuple(allocate_output(port, samples, np.float64) for port in spec.outputs)
        for start in range(0, samples, _NUMPY_CHUNK):
            piece = slice(start, start + _NUMPY_CHUNK)
            given = tuple(a if p.shared else a[piece] for p, a in zip(spec.inputs, arrays, strict=True))
            for output, values in zip(outputs, self._call(name, given), strict=True):
                output[piece] = values
        return outputs

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample; see `Library`.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        card, spec = self.card, get_spec(self.card, name)
        kept = None if out is None else check_outputs(card, spec, None, out)

        def call(*values: FloatArray) -> tuple[FloatArray, ...]:
            return self._call(name, check_sample(card, spec, values))

        return redirect_outputs(card, spec, call, kept)


def import_generated_module(path: Path) -> ModuleType:
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


# Samples at once. Buffers of a regressor of seven joints are then half a megabyte, and stay in the cache of a
# processor; a call for each piece costs some microseconds.
_CASADI_CHUNK = 256


def _allocate_columns(port: Port, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return memory in which CasADi has a port's matrices, column by column, and a view of it by samples."""
    memory = np.zeros((samples, *port.shape[1:], *port.shape[:1]))
    return memory, np.moveaxis(memory, -1, 1)


@final
class _MappedFunction:
    """A function for so many samples, with memory for what goes in and out; for one caller at a time."""

    def __init__(self, function: "ca.Function", spec: FunctionSpec, samples: int) -> None:
        mapped = function if samples == 1 else function.map(samples)
        self._name = spec.name
        # Any: the types that CasADi states are those of C++, with sizes that Python does not give.
        self._buffer: Any
        self._buffer, self._run = mapped.buffer()
        inputs = [_allocate_columns(port, samples) for port in spec.inputs]
        outputs = [_allocate_columns(port, samples) for port in spec.outputs]
        # CasADi looks at this memory at each run: it must live as long.
        self._memory = (*(memory for memory, _ in inputs), *(memory for memory, _ in outputs))
        self.inputs = tuple(view for _, view in inputs)
        self.outputs = tuple(view for _, view in outputs)
        for place, (memory, _) in enumerate(inputs):
            self._buffer.set_arg(place, memory.data)
        for place, (memory, _) in enumerate(outputs):
            self._buffer.set_res(place, memory.data)

    def run(self) -> None:
        """Compute the outputs from the inputs.

        Raises:
            GenerationError: CasADi returns an error.
        """
        self._run()
        if status := self._buffer.ret():
            text = f"function {self._name!r} returned the error code {status}"
            raise GenerationError(Notice(code="codegen.call-failed", text=text))


@final
class CasadiLibrary:
    """Functions of CasADi, by name: those of a compiled library or those that its virtual machine runs.

    `shared` is that library, None for the virtual machine.
    """

    backend = "casadi"

    def __init__(
        self,
        card: ModelCard,
        functions: "Mapping[str, ca.Function]",
        *,
        shared: ctypes.CDLL | None = None,
        notices: tuple[Notice, ...] = (),
    ) -> None:
        self.card = card
        self.notices = notices
        self.shared = shared
        self._functions = functions
        # Rooms of calls that are over, by function and samples. A call has its own: other threads may call.
        self._spare: dict[tuple[str, int], list[_MappedFunction]] = {}

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`; see `Library`.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs.
        """
        spec = get_spec(self.card, name)
        samples, arrays = check_inputs(self.card, spec, inputs)
        kept = None if out is None else check_outputs(self.card, spec, samples, out)
        outputs = kept or tuple(allocate_output(port, samples, np.float64) for port in spec.outputs)
        given = copy_overlapping(arrays, kept or ())
        if samples is None:
            batch = [a if port.shared else a[None] for port, a in zip(spec.inputs, given, strict=True)]
            self._fill(spec, 1, batch, [output[None] for output in outputs])
        else:
            self._fill(spec, samples, given, outputs)
        return return_outputs(outputs, kept)

    def _fill(
        self, spec: FunctionSpec, samples: int, given: Sequence[FloatArray], outputs: Sequence[FloatArray]
    ) -> None:
        """Write the outputs of a batch, piece by piece."""
        # A power of two at least as large: few sizes of rooms, whatever the sizes of batches.
        size = min(_CASADI_CHUNK, 1 << max(0, samples - 1).bit_length())
        spare = self._spare.setdefault((spec.name, size), [])
        try:
            room = spare.pop()
        except IndexError:
            room = _MappedFunction(self._functions[spec.name], spec, size)
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
            # What a last piece leaves over holds samples of before, whose outputs nobody reads.
            room.run()
            for output, values in zip(outputs, room.outputs, strict=True):
                output[piece] = values[:count]
        spare.append(room)

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample; see `Library`.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        card, spec = self.card, get_spec(self.card, name)
        kept = None if out is None else check_outputs(card, spec, None, out)
        room = _MappedFunction(self._functions[name], spec, 1)
        targets, results = tuple(view[0] for view in room.inputs), tuple(view[0] for view in room.outputs)

        def call(*values: FloatArray) -> tuple[FloatArray, ...]:
            for target, value in zip(targets, check_sample(card, spec, values), strict=True):
                target[...] = value
            room.run()
            return tuple(result.copy(order="C") for result in results)

        return redirect_outputs(card, spec, call, kept)


def _load_serialized(folder: Path, card: ModelCard) -> "dict[str, ca.Function]":
    import casadi as ca

    functions = {}
    for spec in card.functions:
        path = folder / f"{spec.name}.casadi"
        try:
            functions[spec.name] = ca.Function.load(str(path))
        except RuntimeError as error:
            reader = f"CasADi {ca.CasadiMeta.version()}"
            text = f"{reader} cannot read it; generate it again with this version\n{error}"
            raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(path))) from error
    return functions


def _load_compiled(
    binary: Path, card: ModelCard, *, prefix: str, digest: str, notices: tuple[Notice, ...]
) -> CasadiLibrary:
    import casadi as ca

    # The loader gives back what it already has under a name: a copy is the file as it is now.
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copy = Path(shutil.copy(binary, scratch))
        shared = open_shared(copy)
        if read_digest(shared, prefix) != digest:
            raise build_stale_error(binary)
        try:
            functions = {spec.name: ca.external(spec.name, str(copy)) for spec in card.functions}
        except RuntimeError as error:
            text = f"CasADi cannot load it: {error}; build it again on this machine"
            raise GenerationError(Notice(code="codegen.cannot-load", text=text, file=str(binary))) from error
    return CasadiLibrary(card, functions, shared=shared, notices=notices)


def load_casadi_library(
    folder: Path, card: ModelCard, *, prefix: str, digest: str, notices: tuple[Notice, ...] = ()
) -> CasadiLibrary:
    """Return the functions in the folder of a CasADi target: compiled where that was done, else as they are.

    Args:
        folder: as `generate_casadi` wrote it.
        card: of its manifest.
        prefix: of its files.
        digest: what a compiled library must say it was built from.
        notices: what a user should know; one more is added where nothing was compiled.

    Raises:
        UsageError: the library was not compiled since its sources were written.
        GenerationError: CasADi cannot load what is there.
    """
    binary = folder / f"lib{prefix}_casadi.so"
    if binary.is_file():
        return _load_compiled(binary, card, prefix=prefix, digest=digest, notices=notices)
    text = f"no {binary.name}: CasADi's virtual machine is used, which is slower; run `make shared` there"
    notice = Notice(code="codegen.casadi-machine", text=text, file=str(folder))
    return CasadiLibrary(card, _load_serialized(folder, card), notices=(*notices, notice))


Loaded = CompiledLibrary | PythonLibrary | CasadiLibrary


class Library(Protocol):
    """The functions of a model card, however they are computed."""

    @property
    def card(self) -> ModelCard:
        """Return the model behind the functions."""
        ...

    @property
    def backend(self) -> str:
        """Return "c", "python" or "casadi"."""
        ...

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a user should know, for example that there was no compiler."""
        ...

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`.

        Contiguous arrays of float64 are read where they are. The system hands out new arrays of many
        megabytes page by page, which can cost as much as the computation: in a loop over such batches,
        give the arrays of one pass as `out` to the next.

        Args:
            name: of a function in the card.
            inputs: (N, *shape) each, or all of one sample's shape; shared vectors (size,).
            out: a tuple of arrays to write the outputs to and return, contiguous, float64, of the outputs'
                shapes, without memory in common; None for new ones. An input that shares memory with
                them is copied first.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs.
        """
        ...

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample at a time, with little overhead.

        A call refuses with UsageError what is not one sample of real numbers. One bound function
        belongs to one thread; bind another for another thread.

        Args:
            name: of a function in the card.
            out: as for `evaluate`, of one sample's shapes: every call overwrites and returns these arrays.
                None for new ones in each call.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        ...


def _read_manifest_text(manifest: Mapping[str, object], key: str, folder: Path) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        text = f"the manifest has no {key!r}; generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder)))
    return value


def load_library(folder: Path, *, notices: tuple[Notice, ...] = ()) -> Loaded:
    """Return the library in a folder that symid generated; C needs `make shared` first.

    A folder for CasADi works as it is; after `make shared` its compiled C is used, which is faster.

    Raises:
        UsageError: the folder holds no generated library, or its C was not compiled since it was written.
        GenerationError: the library does not load on this machine.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        text = "holds no library of symid: there is no manifest.json that it wrote"
        raise UsageError(Notice(code="usage.no-library", text=text, file=str(folder)))
    try:
        card = read_model_card(json.dumps(manifest["card"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        text = f"the manifest holds no model card ({error}); generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder))) from error
    prefix = _read_manifest_text(manifest, "prefix", folder)
    if manifest.get("target") == "python":
        return PythonLibrary(card, import_generated_module(folder / f"{prefix}.py"), notices)
    precision = _read_manifest_text(manifest, "precision", folder)
    digest = compute_build_digest(
        card, prefix=prefix, precision=precision, files=get_listed_digests(manifest)
    )
    if manifest.get("target") == "casadi":
        return load_casadi_library(folder, card, prefix=prefix, digest=digest, notices=notices)
    binary = folder / f"lib{prefix}.so"
    if not binary.is_file():
        text = f"has no {binary.name}; run `make shared` in it"
        raise UsageError(Notice(code="usage.not-compiled", text=text, file=str(folder)))
    return CompiledLibrary(card, binary, prefix=prefix, precision=precision, digest=digest, notices=notices)
