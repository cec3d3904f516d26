"""A robot's functions computed by CasADi: its own C, compiled, or its virtual machine.

Input: the folder of a CasADi target and its model card. Output: `CasadiLibrary`.

Memory goes to CasADi as it is, without its matrices between: a batch passes through `Function.map` of a fixed
number of samples, which works on buffers of its own.

Supported: double precision; libraries that were built again while this process had the old one loaded.
Not supported: shared libraries of another machine; files that a newer CasADi wrote.
"""

import ctypes
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.backends import fail_stale, hand_over, open_shared, read_digest, separate
from symid.codegen.calls import (
    Call,
    allocate,
    check_inputs,
    check_outputs,
    check_sample,
    find_spec,
    keep_outputs,
)
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.errors import GenerationError, Notice

if TYPE_CHECKING:  # users of other libraries do without
    import casadi as ca

__all__ = ["CasadiLibrary", "load_casadi_library"]

# Samples at once. Buffers of a regressor of seven joints are then half a megabyte, and stay in the cache of a
# processor; a call for each piece costs some microseconds.
_CHUNK = 256


def _allocate_columns(port: Port, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return memory in which CasADi has a port's matrices, column by column, and a view of it by samples."""
    memory = np.zeros((samples, *port.shape[1:], *port.shape[:1]))
    return memory, np.moveaxis(memory, -1, 1)


@final
class _Room:
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
        self._spare: dict[tuple[str, int], list[_Room]] = {}

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
        outputs = kept or tuple(allocate(port, samples, np.float64) for port in spec.outputs)
        given = separate(arrays, kept or ())
        if samples is None:
            batch = [a if port.shared else a[None] for port, a in zip(spec.inputs, given, strict=True)]
            self._fill(spec, 1, batch, [output[None] for output in outputs])
        else:
            self._fill(spec, samples, given, outputs)
        return hand_over(outputs, kept)

    def _fill(
        self, spec: FunctionSpec, samples: int, given: Sequence[FloatArray], outputs: Sequence[FloatArray]
    ) -> None:
        """Write the outputs of a batch, piece by piece."""
        # A power of two at least as large: few sizes of rooms, whatever the sizes of batches.
        size = min(_CHUNK, 1 << max(0, samples - 1).bit_length())
        spare = self._spare.setdefault((spec.name, size), [])
        try:
            room = spare.pop()
        except IndexError:
            room = _Room(self._functions[spec.name], spec, size)
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
        card, spec = self.card, find_spec(self.card, name)
        kept = None if out is None else check_outputs(card, spec, None, out)
        room = _Room(self._functions[name], spec, 1)
        targets, results = tuple(view[0] for view in room.inputs), tuple(view[0] for view in room.outputs)

        def call(*values: FloatArray) -> tuple[FloatArray, ...]:
            for target, value in zip(targets, check_sample(card, spec, values), strict=True):
                target[...] = value
            room.run()
            return tuple(result.copy(order="C") for result in results)

        return keep_outputs(card, spec, call, kept)


def _load_files(folder: Path, card: ModelCard) -> "dict[str, ca.Function]":
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
            raise fail_stale(binary)
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
    return CasadiLibrary(card, _load_files(folder, card), notices=(*notices, notice))
