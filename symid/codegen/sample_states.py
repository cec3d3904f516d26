"""Random inputs of functions, the same for all that share them, and what CasADi makes of them.

Input: ports. Output: values of every port at every state; outputs of a CasADi function there.

Most states are near zero. At a few, inputs of which a function takes nothing but sines and cosines lie far
out: code finds these in one way up to a limit, in which whole turns are taken off, and in another beyond it.
Where a function uses an angle otherwise, as a spring does, rounding would hide all else, and it stays near.

Supported: ports of the catalogue. Not supported: inputs that are matrices.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import Port
from symid.codegen.instructions import Op, Program

__all__ = ["LIMITS", "PER_UNIT", "States", "find_angles", "find_values"]

_TURNS = frozenset({Op.SIN, Op.COS})

PER_UNIT = 1000
"""Inputs are whole numbers of thousandths, which are short to print."""

_RANGES = {"q": 3.0, "dq": 2.0, "ddq": 5.0, "tau": 20.0}
_RANGES |= {"dddq": 20.0, "ddddq": 100.0, "phi": 0.02, "P": 0.02, "tau_J": 20.0, "Q": 5.0}


LIMITS = {"double": 1e6, "float": 1e4}
"""Up to which angle the generated code takes whole turns off by itself, in rad."""

# Reaches of the angle's size, in rad or as parts of the limit; single precision holds eighths up to 2^21.
_FIFTY, _WITHIN, _BEYOND = (47.0, 53.0), (0.89, 0.91), (1.1, 1.5)
_EIGHTHS = 8.0
# Far states are as many before the end, this many apart: in other lanes of a vector, with near ones beside.
_APART = 7
_FEWEST = 60

Angles = frozenset[tuple[str, int, int]]
"""Elements of inputs: the port's name, its size, the number of the element."""


def _find_uses(program: Program) -> tuple[Angles, Angles]:
    """Return the elements whose sines or cosines `program` takes, and those that it uses otherwise."""
    taken: set[tuple[str, int, int]] = set()
    otherwise: set[tuple[str, int, int]] = set()
    elements: dict[int, tuple[str, int, int]] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is Op.INPUT:
            port = program.spec.inputs[instruction.args[0]]
            elements[number] = (port.name, port.size, instruction.args[1])
            continue
        found = taken if instruction.op in _TURNS else otherwise
        found.update(elements[abs(ref)] for ref in instruction.args if abs(ref) in elements)
    given = (abs(ref) for refs in program.outputs for ref in refs)
    otherwise.update(elements[ref] for ref in given if ref in elements)
    return frozenset(taken), frozenset(otherwise)


def find_angles(programs: Sequence[Program]) -> Angles:
    """Return the elements of which a program takes nothing but the sine and the cosine."""
    uses = map(_find_uses, programs)
    return frozenset(element for taken, otherwise in uses for element in taken - otherwise)


def _draw_far(rng: np.random.Generator, values: FloatArray, columns: Sequence[int], limit: float) -> None:
    """Put angles far out at a few rows of `values`; eighths are exact in single precision too."""
    parts = (_WITHIN, _WITHIN, _BEYOND, _BEYOND)
    reaches = [_FIFTY] * 3 + [(low * limit, high * limit) for low, high in parts]
    for k, (low, high) in enumerate(reaches):
        size = np.rint(rng.uniform(low, high, len(columns)) * _EIGHTHS) / _EIGHTHS
        values[len(values) - 1 - _APART * k, columns] = size * rng.choice((-1.0, 1.0), len(columns))


@dataclass(frozen=True, slots=True, kw_only=True)
class States:
    """The inputs at which functions are evaluated: `shared` ones by name, others drawn by name and size.

    Attributes:
        count: how many.
        seed: of the generator.
        shared: values of shared ports, by name.
        angles: what lies far out at a few states, where there are enough of them; see `find_angles`.
        limit: see `LIMITS`, in rad.
    """

    count: int
    seed: int
    shared: Mapping[str, tuple[float, ...]]
    angles: Angles = frozenset()
    limit: float = LIMITS["double"]

    def find(self, port: Port, near: Angles = frozenset()) -> FloatArray:
        """Return the port's values: (count, size), or (size,) of a shared port; `near` ones never far out."""
        if port.name in self.shared:
            return np.array(self.shared[port.name], dtype=np.float64)
        # A generator a name: what a function is given does not depend on which others there are.
        rng = np.random.default_rng((self.seed, zlib.crc32(port.name.encode()), port.size))
        reach = _RANGES.get(port.name.removesuffix("r"), 1.0)
        drawn: FloatArray = np.rint(rng.uniform(-reach, reach, (self.count, port.size)) * PER_UNIT) / PER_UNIT
        if port.shared:
            first: FloatArray = drawn[0]
            return first
        columns = [k for k in range(port.size) if (port.name, port.size, k) in self.angles - near]
        if columns and self.count >= _FEWEST:
            _draw_far(rng, drawn, columns, self.limit)
        return drawn

    def _find_near(self, program: Program) -> Angles:
        """Return the elements that stay near: all of a port, if `program` needs one of them to."""
        _, otherwise = _find_uses(program)
        ports = {element[:2] for element in otherwise & self.angles}
        return frozenset(element for element in self.angles if element[:2] in ports)

    def find_all(self, program: Program) -> list[FloatArray]:
        """Return the values of all inputs of `program`."""
        near = self._find_near(program)
        return [self.find(port, near) for port in program.spec.inputs]

    def find_tables(self, program: Program) -> tuple[str, ...]:
        """Return a name of the values of each input; those of the same name are the same values."""
        near = {element[:2] for element in self._find_near(program)}

        def name(port: Port) -> str:
            own = f"{port.name}_{port.size}"
            return port.name if port.shared else f"{own}_near" if (port.name, port.size) in near else own

        return tuple(map(name, program.spec.inputs))


def _stack(port: Port, values: FloatArray, count: int) -> ca.DM:
    """Return samples side by side, as CasADi takes them."""
    return ca.DM(np.broadcast_to(values, (count, port.size)).T)


def _split(port: Port, result: ca.DM, count: int) -> FloatArray:
    many: FloatArray = np.asarray(result.full()).reshape(result.shape[0], count, -1)
    return many.transpose(1, 0, 2).reshape(count, port.size)


def find_values(
    function: ca.Function, program: Program, inputs: Sequence[FloatArray], count: int
) -> list[FloatArray]:
    """Return what CasADi computes per output port, (count, size), row-major.

    Args:
        function: the function that `program` was made with.
        program: its ports count.
        inputs: (count, size) a port, or (size,) of a shared one.
        count: how many states.
    """
    spec = program.spec
    given = [_stack(port, values, count) for port, values in zip(spec.inputs, inputs, strict=True)]
    results = function.map(count).call(given)
    return [_split(port, result, count) for port, result in zip(spec.outputs, results, strict=True)]
