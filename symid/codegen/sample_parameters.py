"""Parameters at which self-tests compute: such that errors of rounding stay what they are.

Input: functions of a robot. Output: values of beta to try; how much the forward dynamics amplifies errors.

Random base parameters belong to no robot: mass matrices come near to singular ones, and the forward dynamics
would be a test of rounding. The mass matrix M is linear in beta, so beta for which it is positive definite
are found by projecting in turn on the matrices with eigenvalues of at least one and on those of some beta:
    M_k <- V max(L, 1) V^T of M(q_k, beta) = V L V^T,  beta <- argmin sum_k |M(q_k, beta) - M_k|^2
(alternating projections on convex sets). A multiple of it is added to random numbers until M is well
conditioned at every state.

Supported: base and standard parameters. Not supported: physical consistency; the functions want none.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard, Port
from symid.codegen.instructions import Program
from symid.codegen.sample_states import PER_UNIT, States, find_values

__all__ = ["find_amplification", "find_parameters"]

_ATTEMPTS = 4
_PROJECTIONS = 30
_MULTIPLES = (0.0, 4.0, 8.0, 16.0, 64.0)
_GOOD = 1e2
_FIT = 1e3
# Where rounding to thousandths has its edges: not at the simple fractions that exact solutions are made of.
_EDGE = 0.137

Evaluate = Callable[[FloatArray], FloatArray]


def _draw(card: ModelCard, states: States) -> list[FloatArray]:
    beta = Port(name=card.vector, shape=(len(card.beta),), unit="", meaning="")
    return list(States(count=_ATTEMPTS, seed=states.seed, shared={}).find(beta))


def _project(columns: FloatArray, size: int) -> FloatArray:
    """Return beta of a positive definite mass matrix at every state, as far as there is one."""
    inverse = np.linalg.pinv(columns, rcond=1e-9)
    states = columns.shape[0] // size**2
    beta = inverse @ np.tile(np.eye(size).ravel(), states)
    for _ in range(_PROJECTIONS):
        values, vectors = np.linalg.eigh((columns @ beta).reshape(states, size, size))
        raised = (vectors * np.maximum(values, 1.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        beta = inverse @ raised.ravel()
    return np.asarray(beta, dtype=np.float64)


def _find_condition(matrices: FloatArray) -> float:
    return float(np.linalg.cond(matrices).max()) if np.isfinite(matrices).all() else np.inf


def _strengthen(card: ModelCard, evaluate: Evaluate, draws: Sequence[FloatArray]) -> list[FloatArray]:
    """Return every draw with as much inertia added as it takes."""
    size, count = card.size, len(card.beta)
    columns = np.stack([evaluate(unit).ravel() for unit in np.eye(count)], axis=1)
    inertia = _project(columns, size)

    def strengthen(draw: FloatArray) -> FloatArray:
        for multiple in _MULTIPLES:
            beta: FloatArray = np.floor((draw + multiple * inertia) * PER_UNIT + _EDGE) / PER_UNIT + 0.0
            if _find_condition((columns @ beta).reshape(-1, size, size)) < _GOOD:
                break
        return beta

    return [strengthen(draw) for draw in draws]


def _takes_parameters(program: Program, card: ModelCard) -> bool:
    """Return whether this is the mass matrix, of parameters that are no constants."""
    return program.spec.name == "mass_matrix" and card.vector in {port.name for port in program.spec.inputs}


def find_parameters(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], states: States
) -> list[tuple[float, ...]]:
    """Return values of beta to try: those of the robot file if they are fit, then others.

    Args:
        card: the model.
        functions: of CasADi.
        programs: of the same functions; without `mass_matrix`, beta is random.
        states: at which the mass matrix counts.
    """
    stated = [parameter.value for parameter in card.beta]
    known = [np.array([value for value in stated if value is not None])]
    given = known if len(known[0]) == len(stated) and np.isfinite(known[0]).all() else []
    draws = _draw(card, states)
    found = [k for k, program in enumerate(programs) if _takes_parameters(program, card)]
    if found and stated:
        function, program = functions[found[0]], programs[found[0]]

        def evaluate(beta: FloatArray) -> FloatArray:
            at = replace(states, shared={card.vector: tuple(beta.tolist())})
            (matrices,) = find_values(function, program, at.find_all(program), states.count)
            return matrices.reshape(-1, card.size, card.size)

        given = [beta for beta in given if _find_condition(evaluate(beta)) < _FIT]
        draws = _strengthen(card, evaluate, draws)
    return [tuple(beta.tolist()) for beta in (*given, *draws)]


def find_amplification(function: ca.Function, program: Program, states: States) -> float:
    """Return by how much more than a well conditioned function `program` may amplify errors of rounding.

    One, but for the forward dynamics where there was no mass matrix to choose parameters by: the condition of
    the inverse mass matrix, its columns the differences of accelerations under unit torques, in units of that
    which is good, as a power of two.
    """
    ports = [port.name for port in program.spec.inputs]
    if program.spec.name != "forward_dynamics" or "tau" not in ports:
        return 1.0
    inputs, place = states.find_all(program), ports.index("tau")
    at_rest, *pushed = (
        find_values(function, program, [*inputs[:place], tau, *inputs[place + 1 :]], states.count)[0]
        for tau in (np.zeros(inputs[place].shape[1]), *np.eye(inputs[place].shape[1]))
    )
    condition = _find_condition(np.stack([values - at_rest for values in pushed], axis=2))
    return float(2.0 ** max(0, int(np.ceil(np.log2(condition / _GOOD))))) if np.isfinite(condition) else 1.0
