"""What the emitted programs lose to rounding, against the same programs in 40 digits."""

import mpmath
import numpy as np
import pytest

from symid.codegen.functions import list_robot_specs
from symid.codegen.programs import Op
from symid.codegen.routes import choose_route
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import LWR4, PANDA, PUMA560, TWO_LINK, run_program

RULES = {
    Op.ADD: lambda a, b: a + b,
    Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b,
    Op.DIV: lambda a, b: a / b,
    Op.SIN: mpmath.sin,
    Op.COS: mpmath.cos,
}
# Of the largest element of all states; a solved system loses the digits that its matrix's condition costs.
TOLERANCE = 2e-14
SOLVED = 1e-9


def run_exactly(program, inputs):
    values = [mpmath.mpf(0)]

    def read(ref):
        return values[ref] if ref > 0 else -values[-ref]

    for instruction in program.instructions:
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            values.append(mpmath.mpf(np.ravel(inputs[program.spec.inputs[port].name])[element]))
        elif instruction.op is Op.CONSTANT:
            values.append(mpmath.mpf(instruction.constant))
        else:
            values.append(RULES[instruction.op](*map(read, instruction.args)))
    return [np.array([float(read(ref)) for ref in refs]) for refs in program.outputs]


@pytest.mark.parametrize("robot", [TWO_LINK, PUMA560, LWR4, PANDA], ids=lambda r: r.name)
def test_emitted_programs_are_accurate(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(2)
    for spec in list_robot_specs(robot, base):
        program = choose_route(robot, base, spec).program
        errors, scales = [], []
        for _ in range(4):
            inputs = {port.name: rng.uniform(-2, 2, port.shape) for port in spec.inputs}
            with mpmath.workdps(40):
                exact = run_exactly(program, inputs)
            found = run_program(program, inputs)
            errors.append([np.abs(f.ravel() - e).max() for f, e in zip(found, exact, strict=True)])
            scales.append([np.abs(e).max() for e in exact])
        # A scalar may vanish by chance at one state: its size is that of the largest of them.
        relative = np.max(errors, axis=0) / np.max(scales, axis=0)
        solved = spec.name in {"forward_dynamics", "forward_dynamics_derivatives"}
        assert relative.max() < (SOLVED if solved else TOLERANCE), spec.name
