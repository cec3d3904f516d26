"""The cost of `consistent`: value, gradient and Hessian in log-Cholesky coordinates.

Input: a triangle of weighted rows, the bodies expected. Output: `ConsistentCost`, and a start for its search.

Unknowns: of each link the ten entries of C, row by row, the logarithm of those on the diagonal; log u of the
rotors; friction that is not negative, and what may have either sign, over its standard deviation. With
f = |F [x; -1]|^2 / 2 and S = sum over k of (F' F [x; -1])_k X_k, dx_k = tr(X_k dQ),

    dQ = dC C' + C dC',  df = 2 tr(S C dC'),  d2f = |F (dx)|^2 + 2 tr(S dC dC')

Supported: what `Bodies` holds.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.identification.bodies import Bodies

__all__ = ["ConsistentCost", "build_cost"]

_LOWER = np.tril_indices(4)
_DIAGONAL = np.flatnonzero(_LOWER[0] == _LOWER[1])
_SMALL = 1e-8
_LOOSE = 1e-9
"""Weight of numbers of either sign in the convex method, which wants one: none, as far as it matters."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsistentCost:
    """The cost.

    Args:
        triangle: F (k, p + 1).
        forms: (p, n, 4, 4) X of the links, scaled by the bodies expected; roots: (n, 4, 4) theirs, L.
        positive: (p, a) effect of one unit of u; others: (p, b) of one unit of friction and the rest.
        weight: g.
        lower: (u,) bounds of the unknowns; start: (u,) the bodies expected.
    """

    triangle: FloatArray
    forms: FloatArray
    roots: FloatArray
    positive: FloatArray
    others: FloatArray
    weight: float
    lower: FloatArray
    start: FloatArray

    def _split(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return C (n, 4, 4), u (a,), the others (b,)."""
        links, rotors = self.forms.shape[1], self.positive.shape[1]
        entries = z[: 10 * links].reshape(links, 10).copy()
        # Far steps of a line search overflow to infinity, which the solver takes back.
        with np.errstate(over="ignore"):
            entries[:, _DIAGONAL] = np.exp(entries[:, _DIAGONAL])
            rotor = np.exp(z[10 * links : 10 * links + rotors])
        lower = np.zeros((links, 4, 4))
        lower[:, _LOWER[0], _LOWER[1]] = entries
        return lower, rotor, z[10 * links + rotors :]

    def find_bodies(self, z: FloatArray) -> FloatArray:
        """Return the pseudo-inertias (n, 4, 4)."""
        lower = self.roots @ self._split(z)[0]
        bodies: FloatArray = lower @ lower.transpose(0, 2, 1)
        return bodies

    def find_parameters(self, z: FloatArray) -> FloatArray:
        """Return the standard parameters (n, 10) of the links."""
        from symid.parameters.consistency_prior import find_parameters

        return find_parameters(self.find_bodies(z))

    def find_values(self, z: FloatArray) -> FloatArray:
        """Return the base parameters x (p,)."""
        lower, rotor, rest = self._split(z)
        bodies = lower @ lower.transpose(0, 2, 1)
        values: FloatArray = np.einsum("pnab,nab->p", self.forms, bodies)
        return values + self.positive @ rotor + self.others @ rest

    def find_value(self, z: FloatArray) -> float:
        """Return the cost."""
        lower, rotor, _ = self._split(z)
        links, rotors = self.forms.shape[1], self.positive.shape[1]
        logs = z[: 10 * links].reshape(links, 10)[:, _DIAGONAL]
        distance = float(np.sum(lower**2) - 2.0 * logs.sum() - 4 * links)
        distance += float(np.sum(rotor - z[10 * links : 10 * links + rotors] - 1.0))
        errors = self.triangle @ np.append(self.find_values(z), -1.0)
        return 0.5 * float(errors @ errors) + self.weight * distance

    def _find_slopes(self, z: FloatArray) -> FloatArray:
        """Return dx / dz (p, u)."""
        lower, rotor, _ = self._split(z)
        # tr(X (dC C' + C dC')) = 2 tr(C' X dC) for symmetric X.
        steps = 2.0 * (self.forms @ lower)[:, :, _LOWER[0], _LOWER[1]]
        steps[:, :, _DIAGONAL] *= lower[:, range(4), range(4)]
        return np.hstack([steps.reshape(len(steps), -1), self.positive * rotor, self.others])

    def find_gradient(self, z: FloatArray) -> FloatArray:
        """Return the gradient (u,)."""
        errors = self.triangle @ np.append(self.find_values(z), -1.0)
        slope: FloatArray = self._find_slopes(z).T @ (self.triangle[:, :-1].T @ errors)
        return slope + self._find_pull(z)

    def _find_pull(self, z: FloatArray) -> FloatArray:
        lower, rotor, rest = self._split(z)
        entries = 2.0 * lower[:, _LOWER[0], _LOWER[1]]
        entries[:, _DIAGONAL] = 2.0 * lower[:, range(4), range(4)] ** 2 - 2.0
        return self.weight * np.concatenate([entries.ravel(), rotor - 1.0, np.zeros(len(rest))])

    def find_hessian(self, z: FloatArray) -> FloatArray:
        """Return the Hessian (u, u)."""
        lower, rotor, _ = self._split(z)
        errors = self.triangle @ np.append(self.find_values(z), -1.0)
        forces = self.triangle[:, :-1].T @ errors
        slopes = self.triangle[:, :-1] @ self._find_slopes(z)
        hessian = slopes.T @ slopes
        pull = np.einsum("p,pnab->nab", forces, self.forms)
        for link, (force, factor) in enumerate(zip(pull, lower, strict=True)):
            place = slice(10 * link, 10 * link + 10)
            hessian[place, place] += self._find_curvature(force, factor)
        first = 10 * len(lower)
        spots = np.arange(first, first + len(rotor))
        hessian[spots, spots] += rotor * (self.positive.T @ forces + self.weight)
        return hessian

    def _find_curvature(self, force: FloatArray, factor: FloatArray) -> FloatArray:
        """Return 2 tr((S + g) dC dC') (10, 10), and what the exponential on the diagonal adds."""
        whole = force + self.weight * np.eye(4)
        same = _LOWER[1][:, None] == _LOWER[1][None, :]
        block: FloatArray = 2.0 * whole[_LOWER[0][:, None], _LOWER[0][None, :]] * same
        size = np.ones(10)
        size[_DIAGONAL] = np.diag(factor)
        block = block * np.outer(size, size)
        block[_DIAGONAL, _DIAGONAL] += 2.0 * np.diag(whole @ factor) * np.diag(factor)
        return block


def build_cost(triangle: FloatArray, centre: FloatArray, bodies: Bodies, weight: float) -> ConsistentCost:
    """Return the cost of rows condensed to `triangle` F (k, p + 1) for these bodies.

    Args:
        triangle: of the weighted rows over the standard deviation of their noise.
        centre: (p,) the parameters without bounds, at which |F [x; -1]| is least; bodies of unknown mass get
            the one that suits them.
        bodies: what links the parameters to bodies.
        weight: of the distance to the bodies expected.
    """
    from symid.parameters.consistency_prior import FORMS, build_pseudo_inertias

    expected = build_pseudo_inertias(bodies.stated * _find_size(centre, bodies))
    roots = np.asarray(np.linalg.cholesky(expected), dtype=np.float64)
    forms = roots.transpose(0, 2, 1) @ np.einsum("pnk,kab->pnab", bodies.links, FORMS) @ roots
    matrix = triangle[:, :-1]
    # What no parameters explain is left out: the cost begins at zero, and the last digits count.
    triangle = np.column_stack([matrix, matrix @ centre])
    rotors = bodies.positive * _find_rotors(centre, bodies)
    loose = np.hstack([bodies.bounded, bodies.free])
    lengths = np.linalg.norm(matrix @ loose, axis=0)
    sizes = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    first = np.linalg.lstsq(loose, centre, rcond=None)[0] / sizes if loose.size else np.zeros(0)
    dissipating = bodies.bounded.shape[1]
    first[:dissipating] = np.maximum(first[:dissipating], 1.0)
    fixed = np.zeros(10 * len(roots) + rotors.shape[1])
    lower = np.concatenate([np.full(len(fixed), -np.inf), np.zeros(dissipating)])
    lower = np.append(lower, np.full(bodies.free.shape[1], -np.inf))
    cost = ConsistentCost(
        triangle=triangle,
        forms=forms,
        roots=roots,
        positive=rotors,
        others=loose * sizes,
        weight=weight,
        lower=lower,
        start=np.append(fixed, first),
    )
    start = _find_convex_start(cost)
    return cost if start is None else replace(cost, start=start)


def _find_convex_start(cost: ConsistentCost) -> FloatArray | None:
    """Return the optimum in Q where friction has no bounds, by the convex method; None where it finds none.

    The cost over g is the distance plus |F dx|^2 / (2 g): equations with a slack of g.
    """
    from symid.parameters.consistency_problem import Problem
    from symid.parameters.consistency_solver import find_nearest

    matrix, target = cost.triangle[:, :-1], cost.triangle[:, -1]
    links, rotors, others = cost.forms.shape[1], cost.positive.shape[1], cost.others.shape[1]
    problem = Problem(
        blocks=np.einsum("kp,pnab->knab", matrix, cost.forms),
        positive=matrix @ cost.positive,
        free=matrix @ cost.others,
        target=target,
        slack=np.full(len(target), cost.weight),
        weights=np.concatenate([np.ones(links + rotors), np.full(others, _LOOSE)]),
    )
    with np.errstate(all="ignore"):
        found = find_nearest(problem)
    if found is None or np.linalg.eigvalsh(found.blocks).min() <= 0.0 or np.any(found.positive <= 0.0):
        return None
    entries = np.linalg.cholesky(found.blocks)[:, _LOWER[0], _LOWER[1]]
    entries[:, _DIAGONAL] = np.log(entries[:, _DIAGONAL])
    start = np.concatenate([entries.ravel(), np.log(found.positive), found.free])
    bounded: FloatArray = np.maximum(start, cost.lower)
    return bounded


def _find_size(centre: FloatArray, bodies: Bodies) -> float:
    """Return the mass with which bodies of unit mass come next to the parameters; one for stated bodies."""
    if not bodies.unit:
        return 1.0
    values = np.einsum("pnk,nk->p", bodies.links, bodies.stated)
    sizes = np.einsum("pnk,nk->p", np.abs(bodies.links), np.abs(bodies.stated))
    kept = sizes > 0.0
    share, wanted = (values[kept] / sizes[kept]), centre[kept] / sizes[kept]
    mass = float(share @ wanted) / max(float(share @ share), np.finfo(float).tiny)
    return mass if mass > 0.0 else max(float(np.abs(wanted).max(initial=0.0)), _SMALL)


def _find_rotors(centre: FloatArray, bodies: Bodies) -> FloatArray:
    """Return the rotor inertias (a,) expected: half of the parameter that they are part of."""
    sizes = np.array([float(np.abs(centre[column > 0.0]).max(initial=0.0)) for column in bodies.positive.T])
    return np.maximum(0.5 * sizes, _SMALL)
