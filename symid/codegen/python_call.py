"""Functions of a compiled library as built-in functions of CPython: no copies, no ctypes in a call.

Input: a shared library with what `python_call_source` writes in it. Output: built-in functions, or None.

The C declares by hand what it needs of CPython and of NumPy's arrays. None of that is taken on trust:
before the first use the sizes are compared and arrays of many kinds are read through the same
declarations, and every function is tried against its call through ctypes. Where anything differs the
answer is None, and the caller stays with ctypes.

Supported: CPython with its global lock, which a call holds; doubles.
Not supported: other interpreters, free-threaded and tracing builds of CPython, float libraries.
"""

import ctypes
import sys
from collections.abc import Iterable
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.calls import Call
from symid.codegen.functions import FunctionSpec, Port

__all__ = ["find_python_call"]

_MOST_PORTS = 16
_MOST_AXES = 3
_FASTCALL = 0x0080
# In the order of the fields of `struct bound`.
_SERVICES = ("PyObject_CallObject", "PyTuple_New", "PyTuple_SetItem", "Py_IncRef", "Py_DecRef")


class _Object(ctypes.Structure):
    _fields_: ClassVar = [("references", ctypes.c_ssize_t), ("type", ctypes.c_void_p)]


class _Array(ctypes.Structure):
    _fields_: ClassVar = [
        ("head", _Object),
        ("data", ctypes.c_void_p),
        ("axes", ctypes.c_int),
        ("shape", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
        ("flags", ctypes.c_int),
    ]


class _Port(ctypes.Structure):
    _fields_: ClassVar = [
        ("axes", ctypes.c_int),
        ("shape", ctypes.c_ssize_t * _MOST_AXES),
        ("size", ctypes.c_size_t),
        ("arguments", ctypes.py_object),
        ("kept", ctypes.c_void_p),
    ]


class _Bound(ctypes.Structure):
    _fields_: ClassVar = [
        ("inputs", ctypes.c_ssize_t),
        ("outputs", ctypes.c_ssize_t),
        ("function", ctypes.c_void_p),
        ("array_type", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
        ("ask", ctypes.py_object),
        ("empty", ctypes.py_object),
        ("kept", ctypes.py_object),
        *((service, ctypes.c_void_p) for service in _SERVICES),
        ("ports", _Port * _MOST_PORTS),
    ]


class _Method(ctypes.Structure):
    _fields_: ClassVar = [
        ("name", ctypes.c_char_p),
        ("call", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("text", ctypes.c_char_p),
    ]


def _read_integers(address: int | None, count: int) -> tuple[int, ...]:
    return tuple((ctypes.c_ssize_t * count).from_address(address or 0)) if count else ()


def _is_read_rightly(array: NDArray[Any]) -> bool:
    """Return whether the declarations find in `array` what NumPy says of it."""
    found = _Array.from_address(id(array))
    fixed = (found.head.type, found.data, found.axes, found.dtype, found.flags)
    told = (id(type(array)), array.ctypes.data, array.ndim, id(array.dtype), array.flags.num)
    base = None if array.base is None else id(array.base)
    # The shape is behind a pointer, which is followed only where all beside it is in its place.
    if fixed != told or found.base != base:
        return False
    shape, strides = (_read_integers(place, array.ndim) for place in (found.shape, found.strides))
    return shape == array.shape and strides == array.strides


def _make_probes() -> Iterable[NDArray[Any]]:
    block = np.arange(24.0)
    frozen = np.arange(3.0)
    frozen.setflags(write=False)
    yield from (block, block[::2], block.reshape(2, 3, 4), np.asfortranarray(block.reshape(4, 6)), frozen)
    yield from (np.empty(0), np.array(1.0), np.empty((7, 43)), np.zeros(5, dtype=">f8"))
    yield from (np.zeros(5, dtype=dtype) for dtype in (np.float32, np.int64, np.complex128))
    yield np.frombuffer(bytearray(41), dtype=np.float64, offset=1)


@cache
def _find_services() -> tuple[int, ...]:
    """Return the addresses of what the C calls; none where the interpreter is not as the C declares it."""
    if sys.implementation.name != "cpython" or object.__basicsize__ != ctypes.sizeof(_Object):
        return ()
    if np.ndarray.__basicsize__ < ctypes.sizeof(_Array) or not all(map(_is_read_rightly, _make_probes())):
        return ()
    try:
        found = [ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value for name in _SERVICES]
    except AttributeError:
        return ()
    return tuple(address or 0 for address in found) if all(found) else ()


def _find_addresses(shared: ctypes.CDLL, prefix: str, name: str) -> tuple[int, int] | None:
    """Return the addresses of the common call and of function `name`, None where the library has none."""
    try:
        size = getattr(shared, f"{prefix}_python_size")
        symbols = (getattr(shared, f"{prefix}_python_call"), getattr(shared, f"{prefix}_{name}_pointers"))
    except AttributeError:
        return None
    size.restype = ctypes.c_size_t
    if size() != ctypes.sizeof(_Bound):
        return None
    call, function = (ctypes.cast(symbol, ctypes.c_void_p).value or 0 for symbol in symbols)
    return call, function


def _describe(port: Port, output: FloatArray | None) -> _Port:
    shape = (ctypes.c_ssize_t * _MOST_AXES)(*port.shape)
    double = np.dtype(np.float64)
    # With its type said: NumPy 2.4 counts one reference too many to the one that it takes by itself.
    arguments = (port.shape, double)
    size = port.size * double.itemsize
    # The array itself: where its numbers are, and how many, is read at each call.
    kept = None if output is None else id(output)
    return _Port(axes=len(port.shape), shape=shape, size=size, arguments=arguments, kept=kept)


def _make(
    spec: FunctionSpec, addresses: tuple[int, int], ask: Call, kept: tuple[FloatArray, ...] | None
) -> Call:
    """Return a built-in function; what its C reads lives as long as it does."""
    outputs = kept or (None,) * len(spec.outputs)
    ports = [_describe(port, None) for port in spec.inputs]
    ports += [_describe(port, output) for port, output in zip(spec.outputs, outputs, strict=True)]
    bound = _Bound(
        inputs=len(spec.inputs),
        outputs=len(spec.outputs),
        function=addresses[1],
        array_type=id(np.ndarray),
        dtype=id(np.dtype(np.float64)),
        ask=ask,
        empty=np.empty,
        ports=(_Port * _MOST_PORTS)(*ports),
        **dict(zip(_SERVICES, _find_services(), strict=True)),
    )
    if kept is not None:
        bound.kept = kept
    method = _Method(name=spec.name.encode(), call=addresses[0], flags=_FASTCALL, text=spec.meaning.encode())
    # The built-in function owns the array, the array the structure, the structure all else.
    bound.owned = (method, ports, kept)
    itself = np.frombuffer(bound, dtype=np.uint8)  # type: ignore[call-overload]  # has a buffer
    itself.setflags(write=False)
    new = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.py_object)
    made: Call = new(("PyCFunction_NewEx", ctypes.pythonapi))(ctypes.addressof(method), itself, __name__)
    return made


def _draw(port: Port) -> FloatArray:
    return np.linspace(0.1, 1.2, port.size).reshape(port.shape)


def _agrees(tried: Call, ask: Call, spec: FunctionSpec) -> bool:
    """Return whether a call, and one that has to ask, give the bytes that `ask` gives."""
    inputs = tuple(map(_draw, spec.inputs))
    unusual = tuple(values.astype(np.float32).astype(">f8") for values in inputs)
    for given in (inputs, unusual):
        found, wanted = tried(*given), ask(*given)
        if len(found) != len(wanted):
            return False
        for value, want in zip(found, wanted, strict=True):
            if value.shape != want.shape or value.tobytes() != want.tobytes():
                return False
    return True


def find_python_call(
    shared: ctypes.CDLL,
    prefix: str,
    spec: FunctionSpec,
    ask: Call,
    *,
    kept: tuple[FloatArray, ...] | None = None,
    ask_kept: Call | None = None,
) -> Call | None:
    """Return function `spec` for one sample as a built-in function, or None where that cannot be.

    Args:
        shared: the library, in double precision.
        prefix: of the names in it.
        spec: what the function takes and gives.
        ask: the same function through ctypes, for every call that is out of the ordinary; gives new arrays.
        kept: arrays that every call overwrites and returns; None for new ones at each call.
        ask_kept: `ask`, but with the outputs in `kept`.
    """
    ports = (*spec.inputs, *spec.outputs)
    if len(ports) > _MOST_PORTS or any(len(port.shape) > _MOST_AXES for port in ports):
        return None
    addresses = _find_addresses(shared, prefix, spec.name)
    if addresses is None or not _find_services():
        return None
    if not _agrees(_make(spec, addresses, ask, None), ask, spec):
        return None
    return _make(spec, addresses, ask_kept or ask, kept)
