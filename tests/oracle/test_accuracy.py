"""What the emitted programs lose to rounding, against the same programs in 40 digits."""

import mpmath
import numpy as np

from symid.codegen.functions import list_robot_specs
from symid.codegen.routes import choose_route
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import LWR4, PANDA, PUMA560, TWO_LINK, each_robot
from tests.sx_programs import run_program, run_with_mpmath

# Of the largest element of all states; a solved system loses the digits that its matrix's condition costs.
TOLERANCE = 2e-14
SOLVED = 1e-9


@each_robot(TWO_LINK, PUMA560, LWR4, PANDA)
def test_emitted_programs_are_accurate(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(2)
    for spec in list_robot_specs(robot, base):
        program = choose_route(robot, base, spec).program
        errors, scales = [], []
        for _ in range(4):
            inputs = {port.name: rng.uniform(-2, 2, port.shape) for port in spec.inputs}
            with mpmath.workdps(40):
                exact = [
                    np.array([float(value) for value in row])
                    for row in run_with_mpmath(program, [np.ravel(inputs[port.name]) for port in spec.inputs])
                ]
            found = run_program(program, inputs)
            errors.append([np.abs(f.ravel() - e).max() for f, e in zip(found, exact, strict=True)])
            scales.append([np.abs(e).max() for e in exact])
        # A scalar may vanish by chance at one state: its size is that of the largest of them.
        relative = np.max(errors, axis=0) / np.max(scales, axis=0)
        solved = spec.name in {"forward_dynamics", "forward_dynamics_derivatives"}
        assert relative.max() < (SOLVED if solved else TOLERANCE), spec.name
