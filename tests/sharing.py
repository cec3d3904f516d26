"""Work that several tests repeat with equal inputs is done once a process: filters, rows, fits of logs.

`share_work` puts memories in front of functions that compute nothing but their result. Keys are the inputs
themselves, arrays by a hash of their bytes. Arrays are given out as copies; all other results are frozen.
"""

import sys
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import wraps
from importlib import import_module
from typing import Any

import numpy as np

from symid.codegen.library import Library

SHARED = (
    ("symid.logs.signals", "decimate"),
    ("symid.identification.regression.equations", "build_rows"),
    ("symid.identification.diagnostics.residual_structure", "_tabulate"),
)
ALWAYS = (("symid.identification.diagnostics.causes", "fit_motion"),)
"""In all tests: every fit of a log tries the same mistakes, whatever estimates its parameters."""
LARGEST = 200_000_000
"""Bytes of arrays that are remembered."""


class NotSharedError(Exception):
    """Inputs that are no plain values."""


def build_key(value: Any) -> Hashable:
    """Return what is equal for equal inputs."""
    match value:
        case np.ndarray():
            return value.shape, value.dtype.str, hash(value.tobytes())
        case Library():
            return type(value), value.card.signature, value.backend
        case tuple() | list():
            return type(value), *map(build_key, value)
        case None | str() | int() | float():
            return type(value), value
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(build_key(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, Hashable):
        return value
    raise NotSharedError


class Memory:
    """Results by function and inputs, up to a number of bytes: the oldest go first."""

    def __init__(self) -> None:
        self.results: OrderedDict[Hashable, object] = OrderedDict()
        self.size = 0

    def remember(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with this memory in front of it."""

        @wraps(function)
        def call(*arguments: Any, **options: Any) -> Any:
            try:
                key = (function, build_key(arguments), build_key(tuple(sorted(options.items()))))
            except NotSharedError:
                return function(*arguments, **options)
            # Threads may call at once.
            found = self.results.get(key)
            if found is None:
                self.results[key] = found = function(*arguments, **options)
                self.size += measure(found)
                while self.size > LARGEST and self.results:
                    self.size -= measure(self.results.popitem(last=False)[1])
            return found.copy() if isinstance(found, np.ndarray) else found

        return call


def measure(result: object) -> int:
    """Return the bytes of arrays in a result."""
    if isinstance(result, np.ndarray):
        return result.nbytes
    if is_dataclass(result):
        result = tuple(getattr(result, field.name) for field in fields(result))
    return sum(map(measure, result)) if isinstance(result, tuple) else 0


def replace_everywhere(old: object, new: object, name: str) -> None:
    """Put `new` where modules of symid have `old` under a name."""
    for place, module in list(sys.modules.items()):
        if place.startswith("symid") and vars(module).get(name) is old:
            setattr(module, name, new)


MEMORY = Memory()
FUNCTIONS: dict[tuple[str, str], tuple[Callable[..., Any], Callable[..., Any]]] = {}


@contextmanager
def share_work(shared: Sequence[tuple[str, str]] = SHARED) -> Iterator[None]:
    """Let functions remember their results; what was found before is there again."""
    pairs = []
    for place, name in shared:
        if (place, name) not in FUNCTIONS:
            function = getattr(import_module(place), name)
            FUNCTIONS[place, name] = function, MEMORY.remember(function)
        pairs.append((name, *FUNCTIONS[place, name]))
    for name, function, memory in pairs:
        replace_everywhere(function, memory, name)
    try:
        yield
    finally:
        for name, function, memory in pairs:
            replace_everywhere(memory, function, name)
