"""Random inputs of functions, the same for all that share them, and what CasADi makes of them.

Input: ports. Output: values of every port at every state; outputs of a CasADi function there.

Supported: ports of the catalogue. Not supported: inputs that are matrices.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import Port
from symid.codegen.instructions import Program

__all__ = ["PER_UNIT", "States", "find_values"]

PER_UNIT = 1000
"""Inputs are whole numbers of thousandths, which are short to print."""

_RANGES = {"q": 3.0, "dq": 2.0, "ddq": 5.0, "tau": 20.0}
_RANGES |= {"dddq": 20.0, "ddddq": 100.0, "phi": 0.02, "P": 0.02, "tau_J": 20.0, "Q": 5.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class States:
    """The inputs at which functions are evaluated: `shared` ones by name, others drawn by name and size."""

    count: int
    seed: int
    shared: Mapping[str, tuple[float, ...]]

    def find(self, port: Port) -> FloatArray:
        """Return the port's values: (count, size), or (size,) of a shared port."""
        if port.name in self.shared:
            return np.array(self.shared[port.name], dtype=np.float64)
        # A generator a name: what a function is given does not depend on which others there are.
        rng = np.random.default_rng((self.seed, zlib.crc32(port.name.encode()), port.size))
        reach = _RANGES.get(port.name.removesuffix("r"), 1.0)
        drawn: FloatArray = np.rint(rng.uniform(-reach, reach, (self.count, port.size)) * PER_UNIT) / PER_UNIT
        return drawn[0] if port.shared else drawn

    def find_all(self, program: Program) -> list[FloatArray]:
        """Return the values of all inputs of `program`."""
        return [self.find(port) for port in program.spec.inputs]


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
