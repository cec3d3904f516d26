"""The problem of physically consistent parameters: bodies behind them, and a cost with its derivatives.

Robot -> Bodies: beta = K pi in numbers, and what each parameter may be;  triangle of weighted rows, Bodies
-> ConsistentCost.

Unknowns, in log-Cholesky coordinates: of each link the ten entries of C, row by row, the logarithm of those
on the diagonal; log u of the rotors; friction that is not negative, and what may have either sign, over its
standard deviation. With f = |F [x; -1]|^2 / 2 and S = sum over k of (F' F [x; -1])_k X_k, dx_k = tr(X_k
dQ),

    dQ = dC C' + C dC',  df = 2 tr(S C dC'),  d2f = |F (dx)|^2 + 2 tr(S dC dC')

Q and u are one at the bodies expected, or, after `recentre`, at any others: the distance reads tr B Q - log
det Q with B one at first. About the optimum as centre the Hessian of the entries of C is J' J + 2 g, on
their diagonal J' J + 4 g, of the rotors J' J + g, J the slopes of the errors: it is never nearly singular.

Supported: links, rotors of joints and couplings, friction; symbolic lengths with a value.
Not supported: elastic joints (their rotors are no base parameters).
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.notation import INERTIAL
from symid.robot import Robot

_DISSIPATING = ("Fv", "Fc")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bodies:
    """beta = K pi in numbers.

    Args:
        names: (p,) base parameters, friction among them.
        links: (p, n, 10) coefficients of the links' standard parameters.
        positive: (p, a) coefficients of what must be positive: rotor inertias; `positive_names` (a,).
        bounded: (p, b) coefficients of what must not be negative: viscous and dry friction.
        free: (p, c) coefficients of offsets, springs and the like.
        stated: (n, 10) bodies of the robot file, or round ones in their place: the distance to them decides
            where the log does not. `unit` whether the file states none, and their mass is one each.
    """

    names: tuple[str, ...]
    links: FloatArray
    positive: FloatArray
    bounded: FloatArray
    free: FloatArray
    stated: FloatArray
    unit: bool
    positive_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("links", "positive", "bounded", "free", "stated"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_bodies(robot: Robot) -> Bodies:
    """Return the bodies behind the base parameters of `robot`.

    Raises:
        RobotError: a symbolic length has no value.
    """
    from symid.dynamics import build_grouping, build_prior, derive_base_parameters, write_label

    base = derive_base_parameters(robot)
    names = tuple(entry.name for entry in (*base.parameters, *base.friction))
    grouping = build_grouping(robot, base, names)
    column = {label: index for index, label in enumerate(grouping.labels)}
    used = [label for label in grouping.labels if grouping.matrix[:, column[label]].any()]
    places = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    rotors = [label for label in used if label[1] == "IA"]
    bounded = [label for label in used if label[1].startswith(_DISSIPATING)]
    others = [label for label in used if label[1] not in (*INERTIAL, "IA") and label not in bounded]
    inertial = [column[index, name] for index in range(robot.size) for name in INERTIAL]

    def take(labels: list[tuple[int, str]]) -> FloatArray:
        return grouping.matrix[:, [column[label] for label in labels]].reshape(len(names), len(labels))

    return Bodies(
        names=names,
        links=grouping.matrix[:, places],
        positive=take(rotors),
        bounded=take(bounded),
        free=take(others),
        stated=build_prior(robot, grouping.matrix[:, inertial], np.zeros(len(names))),
        unit=all(joint.inertial is None for joint in robot.joints),
        positive_names=tuple(write_label(robot, label) for label in rotors),
    )


_LOWER = np.tril_indices(4)
_DIAGONAL = np.flatnonzero(_LOWER[0] == _LOWER[1])
_SMALL = 1e-8
_RANK = 1e-13
LOOSE = 1e-9
"""Weight of half the square of what friction and offsets are off the fit without bounds, in their deviations:
nothing, as far as it matters, where the rows see them, and an answer where they do not."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsistentCost:
    """The cost.

    Args:
        triangle: F (k, p + 1).
        forms: (p, n, 4, 4) X of the links, scaled by the bodies at the centre; roots: (n, 4, 4) theirs, L.
        positive: (p, a) effect of one unit of u; others: (p, b + c) of one unit of the friction and
            the rest that the rows see.
        pulls: (n, 4, 4) B; rotor_pulls: (a,) the same of u; constant: what is left of the distance.
        middle: (b + c,) friction and the rest of the fit without bounds; bounded: b, the number of the
        former.
        weight: g.
    """

    triangle: FloatArray
    forms: FloatArray
    roots: FloatArray
    positive: FloatArray
    others: FloatArray
    pulls: FloatArray
    rotor_pulls: FloatArray
    constant: float
    middle: FloatArray
    bounded: int
    weight: float

    @property
    def lower(self) -> FloatArray:
        """(u,) bounds of the unknowns."""
        lower = np.full(10 * len(self.roots) + len(self.rotor_pulls) + len(self.middle), -np.inf)
        lower[len(lower) - len(self.middle) :][: self.bounded] = 0.0
        return lower

    @property
    def centre(self) -> FloatArray:
        """(u,) unknowns of the bodies at the centre, friction and the rest of the fit without bounds."""
        return np.append(np.zeros(10 * len(self.roots) + len(self.rotor_pulls)), self.middle)

    def recentre(self, factors: FloatArray, rotors: FloatArray) -> "ConsistentCost":
        """Return the same cost about other bodies: lower triangular C (n, 4, 4), u (a,)."""
        across = factors.transpose(0, 2, 1)
        logs = 2.0 * np.log(np.diagonal(factors, axis1=1, axis2=2)).sum() + np.log(rotors).sum()
        return replace(
            self,
            forms=across @ self.forms @ factors,
            roots=self.roots @ factors,
            positive=self.positive * rotors,
            pulls=across @ self.pulls @ factors,
            rotor_pulls=self.rotor_pulls * rotors,
            constant=self.constant - float(logs),
        )

    def split(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return C (n, 4, 4), u (a,), the others (b + c,)."""
        links, rotors = self.forms.shape[1], self.positive.shape[1]
        entries = z[: 10 * links].reshape(links, 10).copy()
        # Far steps of a line search overflow to infinity, which the solver takes back.
        with np.errstate(over="ignore"):
            entries[:, _DIAGONAL] = np.exp(entries[:, _DIAGONAL])
            rotor = np.exp(z[10 * links : 10 * links + rotors])
        lower = np.zeros((links, 4, 4))
        lower[:, _LOWER[0], _LOWER[1]] = entries
        return lower, rotor, z[10 * links + rotors :]

    def join(self, lower: FloatArray, rotor: FloatArray, rest: FloatArray) -> FloatArray:
        """Return the unknowns (u,) of C (n, 4, 4), u (a,), the others (b + c,); see `split`."""
        entries = lower[:, _LOWER[0], _LOWER[1]]
        entries[:, _DIAGONAL] = np.log(entries[:, _DIAGONAL])
        return np.concatenate([entries.ravel(), np.log(rotor), rest])

    def find_bodies(self, z: FloatArray) -> FloatArray:
        """Return the pseudo-inertias (n, 4, 4)."""
        lower = self.roots @ self.split(z)[0]
        bodies: FloatArray = lower @ lower.transpose(0, 2, 1)
        return bodies

    def find_parameters(self, z: FloatArray) -> FloatArray:
        """Return the standard parameters (n, 10) of the links."""
        from symid.dynamics import compute_standard_parameters

        return compute_standard_parameters(self.find_bodies(z))

    def find_values(self, z: FloatArray) -> FloatArray:
        """Return the base parameters x (p,)."""
        lower, rotor, rest = self.split(z)
        bodies = lower @ lower.transpose(0, 2, 1)
        values: FloatArray = np.einsum("pnab,nab->p", self.forms, bodies)
        return values + self.positive @ rotor + self.others @ rest

    def find_value(self, z: FloatArray) -> float:
        """Return the cost."""
        lower, rotor, rest = self.split(z)
        links, rotors = len(self.roots), len(rotor)
        logs = z[: 10 * links].reshape(links, 10)[:, _DIAGONAL]
        distance = float(np.sum(lower * (self.pulls @ lower)) - 2.0 * logs.sum()) + self.constant
        distance += float(self.rotor_pulls @ rotor - z[10 * links : 10 * links + rotors].sum())
        errors, off = self.triangle @ np.append(self.find_values(z), -1.0), rest - self.middle
        return 0.5 * float(errors @ errors) + self.weight * distance + 0.5 * LOOSE * float(off @ off)

    def _find_slopes(self, z: FloatArray) -> FloatArray:
        """Return dx / dz (p, u)."""
        lower, rotor, _ = self.split(z)
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
        lower, rotor, rest = self.split(z)
        entries = 2.0 * (self.pulls @ lower)[:, _LOWER[0], _LOWER[1]]
        entries[:, _DIAGONAL] = entries[:, _DIAGONAL] * lower[:, range(4), range(4)] - 2.0
        distance = np.concatenate([entries.ravel(), self.rotor_pulls * rotor - 1.0])
        return np.append(self.weight * distance, LOOSE * (rest - self.middle))

    def find_hessian(self, z: FloatArray) -> FloatArray:
        """Return the Hessian (u, u)."""
        lower, rotor, _ = self.split(z)
        errors = self.triangle @ np.append(self.find_values(z), -1.0)
        forces = self.triangle[:, :-1].T @ errors
        slopes = self.triangle[:, :-1] @ self._find_slopes(z)
        hessian = slopes.T @ slopes
        pull = np.einsum("p,pnab->nab", forces, self.forms) + self.weight * self.pulls
        for link, (force, factor) in enumerate(zip(pull, lower, strict=True)):
            place = slice(10 * link, 10 * link + 10)
            hessian[place, place] += self._find_curvature(force, factor)
        first = 10 * len(lower)
        spots = np.arange(first, first + len(rotor))
        hessian[spots, spots] += rotor * (self.positive.T @ forces + self.weight * self.rotor_pulls)
        spots = np.arange(first + len(rotor), len(hessian))
        hessian[spots, spots] += LOOSE
        return hessian

    def _find_curvature(self, whole: FloatArray, factor: FloatArray) -> FloatArray:
        """Return 2 tr((S + g B) dC dC') (10, 10), and what the exponential on the diagonal adds."""
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
    from symid.dynamics import PSEUDO_INERTIA_FORMS, build_pseudo_inertias

    expected = build_pseudo_inertias(bodies.stated * _estimate_size(centre, bodies))
    roots = np.asarray(np.linalg.cholesky(expected), dtype=np.float64)
    forms = roots.transpose(0, 2, 1) @ np.einsum("pnk,kab->pnab", bodies.links, PSEUDO_INERTIA_FORMS) @ roots
    matrix = triangle[:, :-1]
    # What no parameters explain is left out: the cost begins at zero, and the last digits count.
    triangle = np.column_stack(
        [matrix, matrix @ centre + _compute_explained(matrix, triangle[:, -1], centre)]
    )
    rotors = bodies.positive * _estimate_rotors(centre, bodies)
    loose = np.hstack([bodies.bounded, bodies.free])
    lengths = np.linalg.norm(matrix @ loose, axis=0)
    # What the rows do not see at all stays at zero.
    seen = lengths > 0.0
    loose, lengths = loose[:, seen], lengths[seen]
    middle = np.linalg.lstsq(loose, centre, rcond=None)[0] * lengths if loose.size else np.zeros(0)
    dissipating = int(np.count_nonzero(seen[: bodies.bounded.shape[1]]))
    middle[:dissipating] = np.maximum(middle[:dissipating], 0.0)
    return ConsistentCost(
        triangle=triangle,
        forms=forms,
        roots=roots,
        positive=rotors,
        others=loose / lengths,
        pulls=np.tile(np.eye(4), (len(roots), 1, 1)),
        rotor_pulls=np.ones(rotors.shape[1]),
        constant=-4.0 * len(roots) - rotors.shape[1],
        middle=middle,
        bounded=dissipating,
        weight=weight,
    )


def _compute_explained(matrix: FloatArray, target: FloatArray, centre: FloatArray) -> FloatArray:
    """Return what parameters, refused ones among them, could explain of the errors (k,) at `centre`."""
    lengths = np.linalg.norm(matrix, axis=0)
    left, singular, _ = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    basis = left[:, singular > _RANK * singular.max(initial=0.0)]
    explained: FloatArray = basis @ (basis.T @ (target - matrix @ centre))
    return explained


def _estimate_size(centre: FloatArray, bodies: Bodies) -> float:
    """Return the mass with which bodies of unit mass come next to the parameters; one for stated bodies."""
    if not bodies.unit:
        return 1.0
    values = np.einsum("pnk,nk->p", bodies.links, bodies.stated)
    sizes = np.einsum("pnk,nk->p", np.abs(bodies.links), np.abs(bodies.stated))
    kept = sizes > 0.0
    share, wanted = (values[kept] / sizes[kept]), centre[kept] / sizes[kept]
    mass = float(share @ wanted) / max(float(share @ share), np.finfo(float).tiny)
    return mass if mass > 0.0 else max(float(np.abs(wanted).max(initial=0.0)), _SMALL)


def _estimate_rotors(centre: FloatArray, bodies: Bodies) -> FloatArray:
    """Return the rotor inertias (a,) expected: half of the parameter that they are part of."""
    sizes = np.array([float(np.abs(centre[column > 0.0]).max(initial=0.0)) for column in bodies.positive.T])
    return np.maximum(0.5 * sizes, _SMALL)
