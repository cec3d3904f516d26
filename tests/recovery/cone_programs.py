"""The consistent fit as programs over cones, for clarabel: another method, without coordinates C C'.

Unknowns: symmetric Q_i = sum q_ik U_k of the links, P = L Q L' with any L near the answer, what is positive,
what is not negative and what is free (see `Bodies`), and for log det Q a lower triangular Z (n, 10) and t (n,
4) with

    [[Q, Z], [Z', diag Z]] >= 0,  t_i <= log Z_ii   =>   sum t <= log det Q, with equality at the optimum

The weighted errors are unknowns of their own, with equations for them: squares of ill-conditioned rows are
not taken.
"""

from typing import NamedTuple

import numpy as np

from symid.dynamics.nearest_bodies import build_pseudo_inertias, compute_standard_parameters
from symid.notation import INERTIAL

UNITS = build_pseudo_inertias(np.eye(len(INERTIAL)))
LOWER = [(i, j) for i in range(4) for j in range(i + 1)]


class Answer(NamedTuple):
    """Base parameters (p,), pseudo-inertias (n, 4, 4), what is positive (a,), the rest, how it ended."""

    values: np.ndarray
    bodies: np.ndarray
    positive: np.ndarray
    loose: np.ndarray
    status: str


class Program:
    """Rows, cones and a slope to be filled, and the bodies behind the unknowns."""

    def __init__(self, triangle, bodies, roots, units, extra):
        """Take F (k, p + 1), bodies, L (n, 4, 4), units of what is positive (a,), number of more unknowns."""
        self.roots, self.units = roots, units
        pi = np.array([compute_standard_parameters(root @ UNITS @ root.T) for root in roots])
        links = np.einsum("pnk,njk->pnj", bodies.links, pi).reshape(len(bodies.names), -1)
        loose = np.hstack([bodies.bounded, bodies.free])
        lengths = np.linalg.norm(triangle[:, :-1] @ loose, axis=0)
        seen = lengths > 0.0
        bounded = np.count_nonzero(seen[: bodies.bounded.shape[1]])
        self.effects = np.hstack([links, bodies.positive * units, loose[:, seen] / lengths[seen]])
        self.errors = len(triangle)
        self.known = self.errors + self.effects.shape[1]
        self.size = self.known + extra
        self.slope, self.held, self.right, self.cones = np.zeros(self.size), [], [], []
        import clarabel

        rows = np.hstack([-np.eye(self.errors), triangle[:, :-1] @ self.effects])
        self.hold(rows.T, range(self.known), -triangle[:, -1], clarabel.ZeroConeT(self.errors))
        self.links = [
            range(self.errors + 10 * link, self.errors + 10 * link + 10) for link in range(len(roots))
        ]
        first = self.errors + 10 * len(roots)
        self.positive = range(first, first + len(units))
        self.bounded = range(first + len(units), first + len(units) + bounded)
        self.loose = range(first + len(units), self.known)
        self.square = np.zeros(self.size)
        self.square[: self.errors] = 1.0

    def hold(self, columns, places, constant, cone):
        """Demand that `columns` times the unknowns at `places`, plus `constant`, lies in a cone."""
        rows = np.zeros((len(constant), self.size))
        rows[:, places] = -np.array(columns).T
        self.held.append(rows)
        self.right.append(np.array(constant))
        self.cones.append(cone)

    def run(self):
        """Return the answer of least |errors|^2 / 2 + slope."""
        import clarabel
        from scipy import sparse

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = 400
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        parts = sparse.diags(self.square, format="csc"), self.slope, sparse.csc_matrix(np.vstack(self.held))
        answer = clarabel.DefaultSolver(*parts, np.concatenate(self.right), self.cones, settings).solve()
        unknowns = np.array(answer.x)
        blocks = np.array([np.einsum("k,kab->ab", unknowns[own], UNITS) for own in map(list, self.links)])
        return Answer(
            self.effects @ unknowns[self.errors : self.known],
            self.roots @ blocks @ self.roots.transpose(0, 2, 1),
            self.units * unknowns[self.positive],
            unknowns[self.loose],
            str(answer.status),
        )


def list_triangle(block):
    """Return the upper triangle of a symmetric matrix by columns, as the cone takes it."""
    size = len(block)
    scale = np.where(np.eye(size, dtype=bool), 1.0, np.sqrt(2.0))
    return np.array([(scale * block)[i, j] for j in range(size) for i in range(j + 1)])


def place_pair(size, i, j):
    """Return the symmetric matrix of zeros with ones at (i, j) and (j, i)."""
    block = np.zeros((size, size))
    block[i, j] = block[j, i] = 1.0
    return block


def solve_closed_cone(triangle, bodies):
    """Return the bodies of the least |F [x; -1]| over all P >= 0, without any distance."""
    import clarabel

    links, rotors = bodies.links.shape[1], bodies.positive.shape[1]
    program = Program(triangle, bodies, np.tile(np.eye(4), (links, 1, 1)), np.ones(rotors), 0)
    for own in program.links:
        program.hold([*map(list_triangle, UNITS)], own, np.zeros(10), clarabel.PSDTriangleConeT(4))
    loose = [*program.positive, *program.bounded]
    program.hold(np.eye(len(loose)), loose, np.zeros(len(loose)), clarabel.NonnegativeConeT(len(loose)))
    return program.run()


def solve_with_distance(triangle, bodies, expected, weight, *, about, units, rotors, loose, middle):
    """Return the bodies of the least |F [x; -1]|^2 / 2 + weight sum D + loose |v - middle|^2 / 2.

    D is tr P0^-1 P - log det P for links, P0 = `expected` (n, 4, 4), and u - log u for what is positive, u in
    units of `rotors` (a,). Unknowns are scaled about L = `about` (n, 4, 4) and `units` (a,), which changes no
    optimum.
    """
    import clarabel

    links = bodies.links.shape[1]
    # All over the square root of the weight, which leaves one before the distance.
    program = Program(triangle / np.sqrt(weight), bodies, about, units, 14 * links + len(units))
    # Friction is in standard deviations, so in units that the weight scales.
    shift = np.sqrt(weight)
    program.square[program.loose] = loose
    program.slope[program.loose] = -loose * middle / shift
    pulls = about.transpose(0, 2, 1) @ np.linalg.inv(expected) @ about
    whole = [np.pad(unit, (0, 4)) for unit in UNITS]
    for i, j in LOWER:
        whole.append(place_pair(8, i, 4 + j) + (place_pair(8, 4 + i, 4 + i) if i == j else 0.0))
    for link, own in enumerate(program.links):
        first = program.known + 14 * link
        program.slope[own] += np.einsum("ab,kab->k", pulls[link], UNITS)
        places = [*own, *range(first, first + 10)]
        program.hold([*map(list_triangle, whole)], places, np.zeros(36), clarabel.PSDTriangleConeT(8))
        for i in range(4):
            hold_logarithm(program, first + 10 + i, first + LOWER.index((i, i)))
    for index, own in enumerate(program.positive):
        program.slope[own] += units[index] / rotors[index]
        hold_logarithm(program, program.known + 14 * links + index, own)
    count = len(program.bounded)
    program.hold(np.eye(count), program.bounded, np.zeros(count), clarabel.NonnegativeConeT(count))
    found = program.run()
    return found._replace(loose=shift * found.loose)


def hold_logarithm(program, height, own):
    """Demand t <= log u of the unknowns at `height` and `own`, and ask for a great t."""
    import clarabel

    program.slope[height] -= 1.0
    # (t, 1, u): exp(t) <= u.
    program.hold(
        [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)], [height, own], (0.0, 1.0, 0.0), clarabel.ExponentialConeT()
    )
