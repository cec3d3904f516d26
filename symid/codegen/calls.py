"""What goes into a function of a library: found by name, checked, and turned into arrays.

Input: a model card, the name of a function, what a caller gave. Output: float64 arrays, row-major.

Supported: anything that NumPy reads as real numbers, one sample or a batch.
Not supported: complex numbers, text, rows of unequal length, arrays of objects.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import cast

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.errors import Notice, UsageError

__all__ = ["Call", "allocate", "check_inputs", "check_outputs", "check_sample", "find_spec", "keep_outputs"]

REAL = "biuf"
_DOUBLE = np.dtype(np.float64)

Call = Callable[..., tuple[FloatArray, ...]]


def find_spec(card: ModelCard, name: str) -> FunctionSpec:
    """Return the function `name` of the card.

    Raises:
        UsageError: the function does not exist.
    """
    for spec in card.functions:
        if spec.name == name:
            return spec
    known = ", ".join(spec.name for spec in card.functions)
    text = f"the library of {card.robot!r} has no function {name!r}; it has {known}"
    raise UsageError(Notice(code="usage.unknown-function", text=text))


def _fail(card: ModelCard, spec: FunctionSpec, text: str) -> UsageError:
    notice = Notice(code="usage.shape", text=f"function {spec.name!r} of {card.robot!r}: {text}")
    return UsageError(notice)


def _convert(card: ModelCard, spec: FunctionSpec, port: Port, value: object) -> FloatArray:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise _fail(card, spec, f"input {port.name!r}: expected an array of numbers, got {error}") from error
    if array.dtype.kind not in REAL:
        text = f"input {port.name!r}: expected real numbers, got an array of {array.dtype}"
        raise _fail(card, spec, text)
    return np.ascontiguousarray(array, dtype=np.float64)


def _convert_all(card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]) -> tuple[FloatArray, ...]:
    if len(inputs) != len(spec.inputs):
        names = ", ".join(port.name for port in spec.inputs)
        raise _fail(card, spec, f"expected the inputs {names}, got {len(inputs)} arrays")
    pairs = zip(spec.inputs, inputs, strict=True)
    return tuple(_convert(card, spec, port, value) for port, value in pairs)


def check_inputs(
    card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]
) -> tuple[int | None, tuple[FloatArray, ...]]:
    """Return the number of samples, None for a single one, and the inputs as arrays.

    Raises:
        UsageError: a shape is wrong, or an input holds no real numbers.
    """
    arrays = _convert_all(card, spec, inputs)
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
            raise _fail(card, spec, text)
    return samples, arrays


def check_sample(card: ModelCard, spec: FunctionSpec, inputs: Sequence[object]) -> tuple[FloatArray, ...]:
    """Return the inputs of one sample as arrays of float64, which may have strides.

    Raises:
        UsageError: a shape is not that of one sample, or an input holds no real numbers.
    """
    # The usual case is told in a few comparisons; anything else is converted or refused.
    if len(inputs) == len(spec.inputs):
        for port, value in zip(spec.inputs, inputs, strict=True):
            if type(value) is not np.ndarray or value.dtype is not _DOUBLE or value.shape != port.shape:
                break
        else:
            return cast("tuple[FloatArray, ...]", tuple(inputs))
    arrays = _convert_all(card, spec, inputs)
    for port, array in zip(spec.inputs, arrays, strict=True):
        if array.shape != port.shape:
            text = f"input {port.name!r}: expected the shape {port.shape} of one sample, got {array.shape}"
            raise _fail(card, spec, text)
    return arrays


def _find_refusal(array: object, shape: tuple[int, ...]) -> str:
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


def check_outputs(
    card: ModelCard, spec: FunctionSpec, samples: int | None, out: object
) -> tuple[FloatArray, ...]:
    """Return the arrays of a caller that outputs are written to, one for each output.

    Raises:
        UsageError: their number is wrong, one cannot take its output, or two share memory.
    """
    names = ", ".join(port.name for port in spec.outputs)
    if not isinstance(out, tuple | list) or len(out) != len(spec.outputs):
        got = f"{len(out)} of them" if isinstance(out, tuple | list) else f"a {type(out).__name__}"
        raise _fail(card, spec, f"out: expected a tuple of arrays for the outputs {names}, got {got}")
    arrays: list[FloatArray] = []
    for port, array in zip(spec.outputs, out, strict=True):
        shape = port.shape if samples is None else (samples, *port.shape)
        if refusal := _find_refusal(array, shape):
            text = f"out, for {port.name!r}: expected an array of float64 of the shape {shape}, {refusal}"
            raise _fail(card, spec, text)
        arrays.append(cast("FloatArray", array))
    pairs = combinations(zip(spec.outputs, arrays, strict=True), 2)
    for (one, first), (other, second) in pairs:
        if np.may_share_memory(first, second):
            text = f"out: the arrays for {one.name!r} and {other.name!r} share memory; give separate ones"
            raise _fail(card, spec, text)
    return tuple(arrays)


def allocate(port: Port, samples: int | None, dtype: type[np.floating]) -> FloatArray:
    """Return an array for an output, its values not set."""
    shape = port.shape if samples is None else (samples, *port.shape)
    array: FloatArray = np.empty(shape, dtype=dtype)
    return array


def keep_outputs(
    card: ModelCard, spec: FunctionSpec, call: Call, kept: tuple[FloatArray, ...] | None
) -> Call:
    """Return `call` of one sample, its outputs written to the arrays `kept` if there are any.

    These are looked at again at each call: UsageError where they cannot take the outputs any more.
    """
    if kept is None:
        return call

    def call_and_keep(*values: FloatArray) -> tuple[FloatArray, ...]:
        outputs = call(*values)
        for target, output in zip(check_outputs(card, spec, None, kept), outputs, strict=True):
            target[...] = output
        return kept

    return call_and_keep
