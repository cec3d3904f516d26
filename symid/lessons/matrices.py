"""The matrices of the equation of motion as exact polynomials: M, C, g, the Jacobian and both energies.

Robot -> `LessonModel`, its geometry with a name for every length, its parameters as polynomials in the
letters that are wanted; `LessonModel` -> `Equations`, and for long chains `Composites`, where every element
is short because composite bodies and their momenta have names.

M and g come out of composite bodies and of the potential, the energies from the motions of the links, torques
from Newton and Euler: what a lesson states is compared as polynomials, or at an exact point where these would
be too long.

    C_ij = sum over k of c_ijk dq_k,  c_ijk = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2   (Christoffel)

Supported: all robots of the exact algebra; parameters as base parameters, in the file's symbols, or as
masses, centres of mass and central inertias.
Not supported: names for lengths of placements that are no Denavit-Hartenberg row (their numbers stay).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, combinations_with_replacement, compress, product
from typing import Any, Literal, TypeAlias

from sympy import QQ, Expr, S, Symbol, preorder_traversal
from sympy.polys.rings import PolyElement, PolyRing

from symid import dynamics
from symid.lessons.textbook import AngleSums, Book, build_angle_sums, write_sum
from symid.notation import INERTIAL
from symid.robot import (
    IDENTITY,
    ONE,
    ZERO,
    Exact,
    Joint,
    Placement,
    Robot,
    compose_placements,
    invert_placement,
)

Parameterisation: TypeAlias = Literal["base", "symbols", "bodies"]
Polynomials: TypeAlias = tuple[PolyElement, ...]
PolynomialMatrix: TypeAlias = tuple[Polynomials, ...]
PLAIN_BOOK = Book(name="symid")
_Vector: TypeAlias = "dynamics.Vector[PolyElement]"


@dataclass(frozen=True, slots=True, kw_only=True)
class LessonModel:
    """A robot as a lesson writes it.

    Attributes:
        robot: with named lengths. lengths: their values in m, and that of g in m/s^2.
        base: its base parameters. algebra: its ring has the letters of the parameters.
        parameters: the representatives as polynomials in those letters. form: which letters.
        sums: sums of angles.
    """

    robot: Robot
    lengths: Mapping[str, float]
    base: dynamics.BaseParameters
    algebra: dynamics.ExactAlgebra
    parameters: Mapping[dynamics.Label, PolyElement]
    form: Parameterisation
    sums: AngleSums


def name_lengths(robot: Robot, book: Book) -> tuple[Robot, dict[str, float]]:
    """Return the robot with a name for each length of its table and for g, and their values.

    The names are those of `book`, with a zero before the number of an offset that a prismatic joint has
    beside its coordinate of the same letter. Names stay away where the robot would have other base parameters
    with them: then its lengths are special.
    """
    lengths: dict[str, float] = {}
    taken = [name for name, _ in robot.symbols]
    joints = list(robot.joints)
    for number, joint in enumerate(robot.joints, start=1):
        # a_i and d_i of a row of a Denavit-Hartenberg table.
        rotation, (x, y, z) = joint.placement.rotation, joint.placement.translation
        axis = [row[2] for row in rotation]
        zero = "0" if joint.prismatic and book.slide == book.offset else ""
        names = (f"{book.length}{number + book.shift}", f"{book.offset}{zero}{number}")
        along = axis[1] * y + axis[2] * z
        numbers = all(value.is_number for value in (x, y, z)) and not set(names) & set(taken)
        if not axis[0] and numbers and (axis[1] * along, axis[2] * along) == (y, z):
            pairs = zip(names, (x, along), strict=True)
            lengths |= {name: value.to_float() for name, value in pairs if value}
            a, d = (Exact.symbol(name) if name in lengths else Exact.of(0) for name in names)
            placement = Placement(rotation=rotation, translation=(a, axis[1] * d, axis[2] * d))
            joints[number - 1] = replace(joint, placement=placement)
    last = joints[-1].frame
    if (
        book.standard
        and robot.convention == "standard"
        and last.translation[0]
        and last.translation[0].is_number
    ):
        # The end of the last link, which no torque knows.
        end = f"{book.length}{robot.size + 1 + book.shift}"
        if end not in taken:
            lengths[end] = last.translation[0].to_float()
            moved = (Exact.symbol(end), *last.translation[1:])
            joints[-1] = replace(joints[-1], frame=replace(last, translation=moved))
    gravity = robot.gravity
    pulls = [value for value in gravity if value]
    if len(pulls) == 1 and pulls[0].is_number and "g" not in taken:
        lengths["g"] = abs(pulls[0].to_float())
        sign = Exact.of(1 if pulls[0].to_float() > 0 else -1)
        x, y, z = (sign * Exact.symbol("g") if value else value for value in gravity)
        gravity = (x, y, z)
    symbols = (*robot.symbols, *lengths.items())
    named = replace(robot, joints=tuple(joints), gravity=gravity, symbols=symbols)
    if dynamics.derive_base_parameters(named).keys != dynamics.derive_base_parameters(robot).keys:
        return robot, {}
    return named, lengths


def build_model(
    robot: Robot,
    form: Parameterisation | None = None,
    further: Sequence[str] = (),
    book: Book = PLAIN_BOOK,
) -> LessonModel:
    """Return the model of `robot`, as its file has it; `further` names generators of its ring.

    `form` is that of the parameters; None takes the file's symbols where it has any, else base parameters.
    """
    named, lengths = name_lengths(robot, book)
    base = dynamics.derive_base_parameters(named)
    formulas = _list_formulas(robot, named, base, form)
    exact = dynamics.build_exact_algebra(named)
    own = [str(symbol) for symbol in exact.ring.symbols]
    letters = [entry.name for entry in base.parameters if entry.name not in formulas]
    parts = chain.from_iterable(map(preorder_traversal, formulas.values()))
    found = {x.name for x in parts if isinstance(x, Symbol)}
    ends = {name for value in named.joints[-1].frame.translation for name in value.symbols}
    before = [*letters, *sorted((found | ends) - set(own) - set(letters)), *further]
    sines = tuple((s + len(before), c + len(before)) for s, c in exact.sines)
    algebra = dynamics.ExactAlgebra(PolyRing([*before, *own], exact.ring.domain), sines)
    values = {name: algebra.ring.from_expr(value) for name, value in formulas.items()}
    known = algebra.generators | values
    return LessonModel(
        robot=named,
        lengths=lengths,
        base=base,
        algebra=algebra,
        parameters={entry.label: known[entry.name] for entry in base.parameters},
        form=form if form == "bodies" else "symbols" if formulas else "base",
        sums=build_angle_sums(named),
    )


def find_standard_rows(robot: Robot) -> tuple[tuple[Placement, Placement], ...]:
    """Return Rz(theta) Tz(d) and Tx(a) Rx(alpha) of each standard row; nothing of a robot without such rows.

    The second part of a row is the first one of the modified row of the joint after it.
    """
    joints, rows = robot.joints, list[tuple[Placement, Placement]]()
    chain_only = all(one.parent == index - 1 and one.mimic is None for index, one in enumerate(joints))
    ends = [one.placement for one in joints[1:]]
    tip, before = (joints[-1].frame if robot.convention == "standard" else IDENTITY), IDENTITY
    for one, after in zip(joints, [*ends, tip], strict=True):
        (_, _, across), (_, _, minus_s), (_, _, c) = after.rotation
        turned = ((ONE, ZERO, ZERO), (ZERO, c, minus_s), (ZERO, -minus_s, c))
        far = Placement(rotation=turned, translation=(after.translation[0], ZERO, ZERO))
        near = compose_placements(invert_placement(before), one.placement)
        if across or any(near.translation[:2]) or near.rotation[2] != IDENTITY.rotation[2]:
            return ()
        rows.append((near, far))
        before = far
    return tuple(rows) if chain_only and before == tip else ()


def derive_standard_transforms(
    model: LessonModel,
) -> tuple[tuple[dynamics.Matrix[PolyElement], _Vector], ...]:
    """Return rotation and origin of A_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) of each standard row."""
    algebra, known = model.algebra, model.algebra.generators
    found = []
    for number, (near, far) in enumerate(find_standard_rows(model.robot), start=1):
        turn, place = (_to_polynomials(algebra, part.rotation) for part in (near, far))
        x, y, z = map(algebra.constant, near.translation)
        if model.robot.joints[number - 1].prismatic:
            z += known[f"q{number}"]
        else:
            s, c, zero = known[f"s{number}"], known[f"c{number}"], algebra.zero
            own = ((c, algebra.neg(s), zero), (s, c, zero), (zero, zero, algebra.one))
            turn = algebra.multiply_matrices(turn, own)
        a, b, c = map(algebra.constant, far.translation)
        origin = algebra.add_vectors(algebra.apply_matrix(turn, (a, b, c)), (x, y, z))
        found.append((algebra.multiply_matrices(turn, place), origin))
    return tuple(found)


def _to_polynomials(
    algebra: dynamics.ExactAlgebra, rows: tuple[tuple[Exact, ...], ...]
) -> "dynamics.Matrix[PolyElement]":
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (tuple(map(algebra.constant, row)) for row in rows)
    return (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)


def _list_formulas(
    robot: Robot, named: Robot, base: dynamics.BaseParameters, form: Parameterisation | None
) -> dict[str, Expr]:
    """Return formulas of the base parameters in the letters of `form`; none where they are letters."""
    if form == "base":
        return {}
    if form == "bodies":
        standard = {
            (link, name): value
            for link, joint in enumerate(named.joints)
            for name, value in zip(INERTIAL, write_body(joint, link + 1), strict=True)
        }
        standard |= {(link, "IA"): Symbol(f"IA{link + 1}") for link in range(named.size)}
        return {
            entry.name: sum((share * standard[label] for label, share in entry.terms), S.Zero).expand()
            for entry in base.parameters
            if all(label in standard for label, _ in entry.terms)
        }
    found = {name: value.expand() for name, value in dynamics.derive_parameter_formulas(robot, base).items()}
    if not found or any(joint.form is None for joint in robot.joints):
        return {}
    if not all(value.as_numer_denom()[1].is_number for value in found.values()):
        return {}
    # The file states that these are zero.
    zero = {
        (link, name)
        for link, joint in enumerate(robot.joints)
        for name, value in zip(INERTIAL, joint.inertial or (1.0,) * 10, strict=True)
        if not value
    }
    lost = (entry.name for entry in base.parameters if {label for label, _ in entry.terms} <= zero)
    return dict.fromkeys(lost, S.Zero) | found


def write_body(joint: Joint, number: int) -> tuple[Expr, ...]:
    """Return the ten standard parameters in mass, centre of mass and central inertia of a link.

    Coordinates of the centre of mass and products of inertia that the file states as zero are left out.
    """
    given = joint.inertial or (1.0,) * 10
    mass, pairs = Symbol(f"m{number}"), [(i, j) for i in range(3) for j in range(i, 3)]
    c = [Symbol(f"l{axis}{number}") if given[6 + k] else S.Zero for k, axis in enumerate("xyz")]
    central = [
        Symbol(f"I{number}{'xyz'[i]}{'xyz'[j]}") if given[k] or i == j else S.Zero
        for k, (i, j) in enumerate(pairs)
    ]
    # Of the point mass at the centre: m (c c I - c c').
    square = sum((x**2 for x in c), S.Zero)
    shift = [mass * ((square if i == j else S.Zero) - c[i] * c[j]) for i, j in pairs]
    return (*(a + b for a, b in zip(central, shift, strict=True)), *(mass * x for x in c), mass)


@dataclass(frozen=True, slots=True, kw_only=True)
class Equations:
    """M(q), c_ijk, g(q), T and V of a model as polynomials; `symbols` of Christoffel by (i, j, k)."""

    model: LessonModel
    mass: PolynomialMatrix
    christoffel: Mapping[tuple[int, int, int], PolyElement]
    gravity: Polynomials
    kinetic: PolyElement
    potential: PolyElement

    @property
    def coriolis(self) -> PolynomialMatrix:
        """Return C(q, dq) of Christoffel symbols."""
        algebra, size = self.model.algebra, range(self.model.robot.freedom)
        pairs = list(enumerate(list_rates(self.model)))

        def add(i: int, j: int) -> PolyElement:
            return algebra.sum_values(algebra.mul(self.christoffel[i, j, k], rate) for k, rate in pairs)

        return tuple(tuple(add(i, j) for j in size) for i in size)


def list_rates(model: LessonModel, letter: str = "dq") -> list[PolyElement]:
    """Return the generators dq, or ddq, of the coordinates."""
    known = model.algebra.generators
    return [known[f"{letter}{joint + 1}"] for joint in model.robot.coordinates]


def build_model_recursion(model: LessonModel) -> dynamics.Recursion[PolyElement]:
    """Return frames and motions of all links as polynomials."""
    state = dynamics.build_state(model.robot, model.algebra, model.algebra.generators)
    return dynamics.build_recursion(model.robot, model.algebra, state)


def derive_equations(model: LessonModel) -> Equations:
    """Return M by composite bodies, C from its slopes, g from the potential, energies from the motions."""
    robot, algebra = model.robot, model.algebra
    recursion = build_model_recursion(model)
    mass = dynamics.fold_matrix(robot, algebra, dynamics.compute_mass_matrix(recursion, model.parameters))
    # Both energies, rotors and springs included, up to a constant.
    kinetic, potential = algebra.zero, algebra.zero
    for link, motion in enumerate(recursion.motions):
        body = dynamics.gather_body(algebra, model.parameters, link)
        parts = dynamics.compute_body_energy(algebra, body, motion)
        kinetic, potential = kinetic + parts[0], potential + parts[1]
    for key, value in model.parameters.items():
        if key[1] not in INERTIAL:
            parts = dynamics.compute_drive_energy(recursion, key)
            kinetic += algebra.mul(value, parts[0])
            potential += algebra.mul(value, parts[1])
    # Terms that no coordinate takes part in are left out.
    moving = [re.fullmatch(r"[scq]\d+", str(symbol)) for symbol in algebra.ring.symbols]
    terms = {key: n for key, n in potential.items() if any(compress(key, moving))}
    potential = algebra.ring.from_dict(terms)
    size, joints = robot.freedom, robot.coordinates
    # M is symmetric: M_ij where i <= j.
    slopes = {
        (i, j, k): dynamics.differentiate(robot, algebra, mass[min(i, j)][max(i, j)], joints[k])
        for i, j, k in product(range(size), repeat=3)
    }
    symbols = {
        (i, j, k): algebra.half(slopes[i, j, k] + slopes[i, k, j] - slopes[j, k, i]) for i, j, k in slopes
    }
    gravity = tuple(dynamics.differentiate(robot, algebra, potential, joint) for joint in joints)
    return Equations(
        model=model, mass=mass, christoffel=symbols, gravity=gravity, kinetic=kinetic, potential=potential
    )


def differentiate_by_time(model: LessonModel, value: PolyElement) -> PolyElement:
    """Return d/dt of a polynomial in coordinates and rates."""
    robot, algebra = model.robot, model.algebra
    total = algebra.zero
    pairs = zip(robot.coordinates, list_rates(model), list_rates(model, "ddq"), strict=True)
    for joint, rate, acceleration in pairs:
        total += algebra.mul(dynamics.differentiate(robot, algebra, value, joint), rate)
        total += algebra.mul(value.diff(rate), acceleration)
    return total


def check_mass_is_curvature(equations: Equations) -> bool:
    """Return whether M of composite bodies is the second derivative of T by the rates."""
    rates = list_rates(equations.model)
    curvature = tuple(tuple(equations.kinetic.diff(a).diff(b) for b in rates) for a in rates)
    return curvature == equations.mass


def check_skew(equations: Equations) -> bool:
    """Return whether dM/dt - 2 C is skew: the sum with its transpose is zero."""
    mass, coriolis, size = equations.mass, equations.coriolis, range(equations.model.robot.freedom)
    rates = [[differentiate_by_time(equations.model, value) for value in row] for row in mass]
    rest = [[rates[i][j] - 2 * coriolis[i][j] for j in size] for i in size]
    return all(rest[i][j] + rest[j][i] == 0 for i in size for j in size)


def compute_torques(equations: Equations) -> Polynomials:
    """Return M ddq + C dq + g."""
    model = equations.model
    algebra, rates = model.algebra, list_rates(model)
    accelerations, coriolis = list_rates(model, "ddq"), equations.coriolis
    rows = []
    for row, turning, weight in zip(equations.mass, coriolis, equations.gravity, strict=True):
        parts = [algebra.mul(a, b) for a, b in zip(row, accelerations, strict=True)]
        parts += [algebra.mul(a, b) for a, b in zip(turning, rates, strict=True)]
        rows.append(algebra.sum_values([*parts, weight]))
    return tuple(rows)


def check_newton_euler(equations: Equations) -> bool:
    """Return whether M ddq + C dq + g is what Newton and Euler give, as polynomials."""
    model = equations.model
    torques = dynamics.compute_inverse_dynamics(build_model_recursion(model), model.parameters)
    return dynamics.fold_vector(model.robot, model.algebra, torques) == compute_torques(equations)


def check_power(equations: Equations) -> bool:
    """Return whether d(T + V)/dt = sum of dq_i tau_i, as polynomials."""
    model = equations.model
    change = differentiate_by_time(model, equations.kinetic + equations.potential)
    pairs = zip(list_rates(model), compute_torques(equations), strict=True)
    power = model.algebra.sum_values(model.algebra.mul(rate, torque) for rate, torque in pairs)
    return bool(change == power)


def build_exact_point(robot: Robot, algebra: dynamics.ExactAlgebra) -> dict[str, Any]:
    """Return a fixed number for every generator, with s^2 + c^2 = 1."""
    values = {str(x): Fraction(3 + k % 5, 7 + k % 3) for k, x in enumerate(algebra.ring.symbols)}
    for k in range(1, robot.size + 1):
        t = Fraction(2 * k + 1, 3 * k + 5)
        values |= {f"s{k}": 2 * t / (1 + t * t), f"c{k}": (1 - t * t) / (1 + t * t), f"q{k}": Fraction(k, 5)}
        values |= {f"dq{k}": Fraction(7 - 2 * k, 3), f"ddq{k}": Fraction(5 * k - 11, 4)}
    convert = dynamics.choose_domain(robot).convert
    return {name: convert(QQ(value.numerator, value.denominator)) for name, value in values.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Definition:
    """A named quantity: its letter, what it is (kind, link, frame, axis), and its polynomial."""

    name: str
    kind: str
    value: PolyElement


@dataclass(frozen=True, slots=True, kw_only=True)
class Composites:
    """M and g of a long chain in quantities that have names, each defined by those before it.

    Attributes:
        model: its ring has the names.
        definitions: composite bodies from the tip, gravity and momenta, in the order of their use.
        mass, gravity: of the joints, in the names.
    """

    model: LessonModel
    definitions: tuple[Definition, ...]
    mass: Mapping[tuple[int, int], PolyElement]
    gravity: Polynomials


_SHORT = 6
"""Terms up to which a quantity has no name of its own."""


def derive_composites(robot: Robot, book: Book = PLAIN_BOOK) -> Composites:
    """Return M and g of a robot in composite bodies and their momenta (Walker and Orin 1982), all named."""
    named, _ = name_lengths(robot, book)
    joints, size, further = named.joints, named.size, list[str]()
    for number, one in enumerate(joints, start=1):
        further += [*(f"{label}c{number}" for label in INERTIAL), *(f"G{number}{axis}" for axis in "xyz")]
        parent = one.parent
        while parent >= 0:
            further += [f"{letter}{number}_{parent + 1}{axis}" for letter in "FN" for axis in "xyz"]
            parent = joints[parent].parent
    model = build_model(robot, "base", further, book)
    algebra, recursion = model.algebra, build_model_recursion(model)
    known, zero, frames = algebra.generators, algebra.zero, recursion.frames
    definitions: list[Definition] = []

    def name(value: PolyElement, letter: str, kind: str, most: int = _SHORT) -> PolyElement:
        """Return the letter of `value`, now defined, or `value` itself where it is short."""
        if len(value) <= 1 or write_sum(value, model.sums).count_terms() <= most:
            return value
        definitions.append(Definition(name=letter, kind=kind, value=value))
        return known[letter]

    def name_vector(vector: _Vector, head: str, kind: str) -> _Vector:
        x, y, z = (name(value, f"{head}{axis}", kind) for value, axis in zip(vector, "xyz", strict=True))
        return x, y, z

    # Composite bodies from the tip to the base, in the frame of their own link.
    bodies: list[Any] = [dynamics.gather_body(algebra, model.parameters, link) for link in range(size)]
    for joint in reversed(range(size)):
        tensor, moments, mass = bodies[joint]
        entries = [tensor[i][j] for i in range(3) for j in range(i, 3)] + [*moments, mass]
        xx, xy, xz, yy, yz, zz, mx, my, mz, m = (
            name(value, f"{label}c{joint + 1}", "body", 1)
            for label, value in zip(INERTIAL, entries, strict=True)
        )
        bodies[joint] = (((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), (mx, my, mz), m)
        parent = joints[joint].parent
        if parent >= 0:
            moved = dynamics.transform_body(algebra, frames[joint], bodies[joint])
            bodies[parent] = dynamics.add_bodies(algebra, bodies[parent], moved)
    # Gravity in every link's frame, from the base outwards.
    x, y, z = map(algebra.constant, named.gravity)
    pulls: list[_Vector] = []
    for index, (one, frame) in enumerate(zip(joints, frames, strict=True)):
        before = pulls[one.parent] if one.parent >= 0 else (x, y, z)
        pulls.append(name_vector(dynamics.rotate_to_link(algebra, frame, before), f"G{index + 1}", "gravity"))
    # Rows of M: the momentum of the composite body of a joint at every joint below it.
    elements: dict[tuple[int, int], PolyElement] = {}
    weights = []
    for joint in range(size):
        (xx, xy, xz), (mx, my, _), total = bodies[joint][0][2], bodies[joint][1], bodies[joint][2]
        x, y, z = pulls[joint]
        if frames[joint].revolute:
            wrench = dynamics.Wrench(force=(-my, mx, zero), moment=(xx, xy, xz))
            weights.append(algebra.mul(my, x) - algebra.mul(mx, y))
        else:
            wrench = dynamics.Wrench(force=(zero, zero, total), moment=(my, -mx, zero))
            weights.append(-algebra.mul(total, z))
        below = joint
        while below >= 0:
            elements[below, joint] = wrench.moment[2] if frames[below].revolute else wrench.force[2]
            parent = joints[below].parent
            if parent >= 0:
                pushed = dynamics.transform_wrench(algebra, frames[below], wrench)
                place = f"{joint + 1}_{parent + 1}"
                force = name_vector(pushed.force, f"F{place}", "momentum")
                moment = name_vector(pushed.moment, f"N{place}", "momentum")
                wrench = dynamics.Wrench(force=force, moment=moment)
            below = parent
    for (index, parameter), value in model.parameters.items():
        if parameter == "IA" and index < size:
            elements[index, index] += value
    # Only what M and g need is defined.
    wanted = {letter for value in (*elements.values(), *weights) for letter in _list_letters(value)}
    used: list[Definition] = []
    for entry in reversed(definitions):
        if entry.name in wanted:
            used.insert(0, entry)
            wanted.update(_list_letters(entry.value))
    return Composites(model=model, definitions=tuple(used), mass=elements, gravity=tuple(weights))


def _list_letters(value: PolyElement) -> list[str]:
    powers = [max(column) for column in zip(*value.keys(), strict=True)] if value else []
    return [str(x) for x, power in zip(value.ring.symbols, powers, strict=bool(powers)) if power]


def evaluate_polynomial(value: PolyElement, point: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return the exact number that a polynomial is at a point, which names the generators in use."""
    names = [str(symbol) for symbol in value.ring.symbols]
    return value.ring.domain.zero + sum(
        coefficient * math.prod(point[name] ** n for name, n in zip(names, powers, strict=True) if n)
        for powers, coefficient in value.terms()
    )


def check_composites(composites: Composites) -> bool:
    """Return whether M and g, all names put in, are those of the recursion at an exact point."""
    model = composites.model
    robot, domain = model.robot, model.algebra.ring.domain
    point = build_exact_point(robot, model.algebra)
    for entry in composites.definitions:
        point[entry.name] = evaluate_polynomial(entry.value, point)
    algebra = dynamics.PointAlgebra(domain, point)
    still = {name: domain.zero if name.startswith(("dq", "ddq")) else value for name, value in point.items()}
    recursion = dynamics.build_recursion(robot, algebra, dynamics.build_state(robot, algebra, still))
    values = {entry.label: point[entry.name] for entry in model.base.parameters}
    mass = dynamics.compute_mass_matrix(recursion, values)
    springs = {label: value for label, value in values.items() if label[1] not in ("KS", "KR")}
    torques = dynamics.compute_inverse_dynamics(recursion, springs)
    places, zero = combinations_with_replacement(range(robot.size), 2), model.algebra.zero
    pairs = [(composites.mass.get((i, j), zero), mass[i][j]) for i, j in places]
    pairs += zip(composites.gravity, torques, strict=True)
    return all(evaluate_polynomial(value, point) == number for value, number in pairs)
