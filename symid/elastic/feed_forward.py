"""What motors must be told so that the links of an elastic robot follow a motion.

Input: a library with the springs' functions, identified values, a trajectory of the links.
Output: `MotorReference`: angle, speed and torque of the motors at the control ticks.

    elastic  tau_J = inverse dynamics of the links, theta = q + H^-1[tau_J],
             tau = IA ddtheta + F(dtheta) + tau_J
    rigid    theta = q, tau = inverse dynamics of the links + IA ddq + F(dq)

The elastic one is the generated function `elastic_inverse_dynamics`, called tick by tick as a controller
would, its memory empty at the start.

Supported: springs with stops and knees. Not supported: what the generated function does not support.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.codegen.springs import find_spring_vector
from symid.elastic.fit import ElasticFit
from symid.errors import Notice, UsageError
from symid.excitation.trajectories import Trajectory
from symid.simulation.elastic_options import MotorReference

__all__ = ["find_elastic_reference", "find_rigid_reference"]

_FUNCTION = "elastic_inverse_dynamics"


def find_elastic_reference(
    library: Library, fit: ElasticFit, trajectory: Trajectory, time: FloatArray
) -> MotorReference:
    """Return angle, speed and torque of the motors under which the links follow `trajectory`.

    Args:
        library: of a robot whose springs have as many stops and knees as those of `fit`.
        fit: the model of the controller.
        trajectory: of the links.
        time: (N,) s, the control ticks.

    Raises:
        UsageError: the library has no such function, or springs of another size.
    """
    if _FUNCTION not in {function.name for function in library.card.functions}:
        text = (
            f"robot {library.card.robot!r} has no function {_FUNCTION}: all its joints must be elastic and "
            "driven by motors with a rotor_inertia, without damping, cubic springs or couplings"
        )
        raise UsageError(Notice(code="usage.no-feed-forward", text=text))
    springs = find_spring_vector(fit.elasticity, library.card)
    spec = next(function for function in library.card.functions if function.name == _FUNCTION)
    shared = {"beta": fit.beta, "IA": fit.rotor, "f": fit.friction, "h": springs}
    parameters = [shared[port.name] for port in spec.inputs if port.name in shared]
    remembers = any(port.name == "Q" for port in spec.inputs)
    memory = np.zeros(sum(len(spring.stops) for spring in fit.elasticity))
    call = library.bind(_FUNCTION)
    motion = np.stack(trajectory.evaluate_derivatives(time, 4), axis=1)
    angle, speed, torque = (np.empty((len(time), library.card.size)) for _ in range(3))
    for tick, state in enumerate(motion):
        outputs = call(*state, *parameters, *([memory] if remembers else []))
        torque[tick], angle[tick], speed[tick] = outputs[:3]
        if remembers:
            memory = outputs[3].copy()
    return MotorReference(angle=angle, speed=speed, torque=torque)


def find_rigid_reference(
    library: Library, fit: ElasticFit, trajectory: Trajectory, time: FloatArray
) -> MotorReference:
    """Return the same for a controller that takes the joints as rigid; arguments as above."""
    q, dq, ddq = trajectory.evaluate(time)
    (torque,) = library.evaluate("inverse_dynamics", q, dq, ddq, fit.beta)
    torque = torque + fit.rotor * ddq
    if library.card.friction:
        torque = torque + library.evaluate("friction", dq, fit.friction)[0]
    return MotorReference(angle=q, speed=dq, torque=torque)
