"""Kinetic and potential energy per standard parameter.

Input: motions of the links in any carrier. Output: rows h with T = hT pi and V = hV pi,
ten entries a link in the order of `notation.INERTIAL`; or the energies for given parameters.

Gautier and Khalil 1988, with V_j the velocity of the frame's origin, g_j the gravity vector
in the link's frame, and u_j = -g' P_j:
    hT = (w1^2/2, w1 w2, w1 w3, w2^2/2, w2 w3, w3^2/2,
          w3 V2 - w2 V3, w1 V3 - w3 V1, w2 V1 - w1 V2, V'V/2)
    hV = (0, 0, 0, 0, 0, 0, -g1, -g2, -g3, u)
"""

from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import cross, dot, total
from symid.dynamics.composite import Body
from symid.dynamics.kinematics import Motion

__all__ = ["EnergyRows", "find_body_energy", "find_energy_rows"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyRows(Generic[T]):
    """Energy per parameter of one link: ten kinetic and ten potential entries."""

    kinetic: tuple[T, ...]
    potential: tuple[T, ...]


def find_energy_rows(algebra: Algebra[T], motion: Motion[T]) -> EnergyRows[T]:
    """Return the energy regressor of one link (see the module's equation)."""
    w1, w2, w3 = motion.angular
    v1, v2, v3 = motion.linear
    mul, minus, half, neg = algebra.mul, algebra.sub, algebra.half, algebra.neg
    zero = algebra.zero
    kinetic = (
        half(mul(w1, w1)),
        mul(w1, w2),
        mul(w1, w3),
        half(mul(w2, w2)),
        mul(w2, w3),
        half(mul(w3, w3)),
        minus(mul(w3, v2), mul(w2, v3)),
        minus(mul(w1, v3), mul(w3, v1)),
        minus(mul(w2, v1), mul(w1, v2)),
        half(dot(algebra, motion.linear, motion.linear)),
    )
    g1, g2, g3 = motion.gravity
    potential = (zero, zero, zero, zero, zero, zero, neg(g1), neg(g2), neg(g3), motion.height)
    return EnergyRows(kinetic=kinetic, potential=potential)


def find_body_energy(algebra: Algebra[T], body: Body[T], motion: Motion[T]) -> tuple[T, T]:
    """Return kinetic and potential energy of a link (see the module's equation, its terms put together).

    T = w'(I w / 2 + MS x V) + M V'V / 2;  V = -g'MS + M u.
    """
    tensor, moments, mass = body
    arm = cross(algebra, moments, motion.linear)
    share = algebra.half(algebra.mul(mass, dot(algebra, motion.linear, motion.linear)))
    for i in range(3):
        terms = [algebra.half(algebra.mul(tensor[i][i], motion.angular[i]))]
        terms += [algebra.mul(tensor[i][j], motion.angular[j]) for j in range(i + 1, 3)]
        inner = total(algebra, [*terms, arm[i]])
        share = algebra.add(share, algebra.mul(motion.angular[i], inner))
    weight = algebra.sub(algebra.mul(mass, motion.height), dot(algebra, motion.gravity, moments))
    return share, weight
