"""A derivation as a list of steps: a sentence, formulas, and a check that was really made.

Robot -> `Step` records, from the frames to torques and friction, each with formulas in text and LaTeX.

Supported: every robot of the exact algebra. Beyond three coordinates the torques are too long to print; they
are checked at an exact rational point instead of term by term, and the lesson as a page has M and g.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from sympy import Add, Symbol, latex
from sympy.polys.rings import PolyElement

from symid import dynamics, joint_models
from symid.lessons import matrices
from symid.lessons.chapters import WRITTEN_OUT, require
from symid.lessons.friction_formulas import write_friction
from symid.lessons.textbook import Product, Sum, build_style, write_latex, write_sum, write_text
from symid.notation import INERTIAL
from symid.robot import JointKind, Robot


@dataclass(frozen=True, slots=True)
class Formula:
    """An equation `left = right`, both sides in plain text and in LaTeX."""

    left: str
    text: str
    latex: str
    left_latex: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step: what is done and why, the formulas, and what was checked (empty: nothing)."""

    title: str
    sentence: str
    formulas: tuple[Formula, ...] = ()
    check: str = ""


def _write_formula(left: str, text: str, latex: str = "") -> Formula:
    """Return left = text, without `latex` a sentence."""
    return Formula(left, text, latex or rf"\text{{{text}}}", dynamics.write_name_latex(left))


def _describe_frames(robot: Robot) -> Step:
    formulas = []
    for number, joint in enumerate(robot.joints, start=1):
        place = joint.placement
        axis = "(" + ", ".join(str(row[2]) for row in place.rotation) + ")"
        origin = "(" + ", ".join(str(value) for value in place.translation) + ")"
        before = f"link {joint.parent + 1}" if joint.parent >= 0 else "the base"
        motion = "revolute about" if joint.kind is JointKind.REVOLUTE else "prismatic along"
        text = f"{motion} z = {axis}, origin {origin} m, in the frame of {before}"
        if joint.mimic is not None:
            master = joint.mimic.master + 1
            share = _write_sum([(joint.mimic.multiplier, f"q{master}")])
            text += f"; it follows joint {master}: q{number} = {share}"
        formulas.append(_write_formula(f"joint {number} ({joint.name})", text))
    for drive in robot.couplings:
        speed = _write_sum([(factor, f"dq{index + 1}") for index, factor in drive.terms])
        formulas.append(_write_formula(f"drive {drive.name}", speed))
    gravity = ", ".join(str(value) for value in robot.gravity)
    return Step(
        title="Frames",
        sentence="The z axis of every link frame is the axis of its joint. "
        f"All lengths and rotations are exact; gravity is ({gravity}) m/s^2 in the base frame.",
        formulas=tuple(formulas),
    )


def _write_sum(terms: Sequence[tuple[Fraction, str]]) -> str:
    """Return a sum of multiples such as `q1 - 63/100*q2`."""
    return write_text(
        Sum(tuple(Product(factor, ((name, 1),)) for factor, name in terms)), matrices.PLAIN_BOOK
    )


def _describe_energy(energy: dynamics.ExactEnergy, base: dynamics.BaseParameters) -> Step:
    formulas = [
        _write_formula(f"d{letter}/d{parameter.name}", *dynamics.write_polynomial(part[parameter.label]))
        for parameter in base.parameters
        for letter, part in (("T", energy.kinetic), ("V", energy.potential))
        if part[parameter.label]
    ]
    # The grouping is checked, h pi = h_b K pi, coefficient by coefficient.
    rest = dict(energy.kinetic), dict(energy.potential)
    for parameter in base.parameters:
        for label, coefficient in parameter.terms:
            if label not in rest[0]:
                continue
            factor = energy.algebra.ring.from_expr(coefficient)
            for left, whole in zip(rest, (energy.kinetic, energy.potential), strict=True):
                left[label] -= energy.algebra.mul(factor, whole[parameter.label])
    # A potential that no coordinate changes, as of a link that stays up, is no information.
    basis = dynamics.build_basis(energy.robot, energy.algebra, dynamics.build_field(energy.robot))
    constant = dynamics.build_power_function(basis)
    entries = [*rest[0].items(), *rest[1].items()]
    lost = [label for label, value in entries if {*dynamics.split_polynomial(basis, value)} - {constant}]
    require(not lost, f"the grouping loses {lost}")
    return Step(
        title="Energy",
        sentence="Both energies are linear in the parameters of links, rotors and springs: T = hT beta, "
        "V = hV beta (Gautier and Khalil 1988). These are the entries of the base parameters; those that are "
        "not listed are zero.",
        formulas=tuple(formulas),
        check="verified exactly: energy per standard parameter = energy per base parameter times the "
        "grouping",
    )


def _describe_matrices(robot: Robot) -> list[Step]:
    """Return M, C and g as textbooks write them, with their checks; beyond three coordinates nothing."""
    if robot.freedom > WRITTEN_OUT:
        return []
    equations = matrices.derive_equations(matrices.build_model(robot))
    require(
        matrices.check_mass_is_curvature(equations), "M is not the second derivative of the kinetic energy"
    )
    require(matrices.check_skew(equations), "dM/dt - 2C is not skew")
    size, sums = range(robot.freedom), equations.model.sums
    style = build_style(matrices.PLAIN_BOOK, frozenset(k + 1 for k in size if robot.axes[k].prismatic))

    def write(letter: str, value: PolyElement, *place: int) -> Formula:
        total, below = write_sum(value, sums), "".join(str(k + 1) for k in place)
        text, right = write_text(total, matrices.PLAIN_BOOK).replace("**", "^"), write_latex(total, style)
        return Formula(f"{letter}{below}", text, right, f"{letter}_{{{below}}}")

    mass = [write("M", equations.mass[i][j], i, j) for i in size for j in size if j >= i]
    coriolis = [write("C", equations.coriolis[i][j], i, j) for i in size for j in size]
    gravity = [write("g", equations.gravity[i], i) for i in size]
    return [
        Step(
            title="Inertia matrix",
            sentence="T = dq' M(q) dq / 2, by composite bodies; c12 stands for cos(q1 + q2).",
            formulas=tuple(mass),
            check="verified exactly: the second derivatives of the kinetic energy by the rates",
        ),
        Step(
            title="Coriolis matrix",
            sentence="C = sum of c_ijk dq_k, of Christoffel symbols of M.",
            formulas=tuple(coriolis),
            check="verified exactly: dM/dt - 2 C is skew",
        ),
        Step(title="Gravity", sentence="The slope of the potential: g = dV/dq.", formulas=tuple(gravity)),
    ]


def _describe_torques(robot: Robot, energy: dynamics.ExactEnergy, base: dynamics.BaseParameters) -> Step:
    algebra = energy.algebra
    sentence = "Lagrange: tau = d/dt(dT/ddq) - dT/dq + dV/dq, per base parameter, from the energy alone."
    if robot.freedom > WRITTEN_OUT:
        sentence += " The expressions are too long to print; generated code evaluates them."
        values = matrices.build_exact_point(robot, algebra)
        from_energy = dynamics.evaluate_torque_columns(energy, base.keys, values)
        numbers = dynamics.PointAlgebra(algebra.ring.domain, values)
        recursion = dynamics.build_recursion(robot, numbers, dynamics.build_state(robot, numbers, values))
        by_recursion = dynamics.compute_torque_columns(recursion, base.keys)
        folded = {key: dynamics.fold_vector(robot, numbers, by_recursion[key]) for key in base.keys}
        same = all(folded[key] == tuple(from_energy[key]) for key in base.keys)
        require(same, "Lagrange and Newton-Euler differ at a rational point")
        check = "verified exactly at a rational point: equal to the Newton-Euler recursion"
        return Step(title="Torques", sentence=sentence, check=check)
    columns = dynamics.derive_torque_columns(energy, base.keys)
    formulas = [
        _write_formula(
            f"dtau{joint + 1}/d{parameter.name}",
            *dynamics.write_polynomial(columns[parameter.label][position]),
        )
        for position, joint in enumerate(robot.coordinates)
        for parameter in base.parameters
        if columns[parameter.label][position]
    ]
    state = dynamics.build_state(robot, algebra, algebra.generators)
    other = dynamics.compute_torque_columns(dynamics.build_recursion(robot, algebra, state), base.keys)
    same = all(dynamics.fold_vector(robot, algebra, other[key]) == tuple(columns[key]) for key in base.keys)
    require(same, "Lagrange and Newton-Euler give different polynomials")
    check = "verified exactly: the same polynomials as by the Newton-Euler recursion"
    return Step(title="Torques", sentence=sentence, formulas=tuple(formulas), check=check)


_LONG_WAY = 1e9
"""Rad or m, after which all bristles slip."""
_AGREEMENT = 1e-12
_BRISTLES = (
    r"\sigma_0 z + {damping}f_V \, \dot q, \quad \dot z = \dot q - \sigma_0 \frac{|\dot q|}{g(\dot q)} z"
)
_ELEMENTS = (
    r"\sum_k s_k z_k + f_V \, \dot q, "
    r"\quad \dot z_k = \dot q \text{ until } |z_k| = a_k \frac{g(\dot q)}{s_k}"
)


def describe_friction(robot: Robot) -> Step | None:
    """Return the friction laws of all joints with their sources; None without any."""
    formulas, sentences, checked = [], [], ""
    for number, joint in enumerate(robot.joints, start=1):
        law = joint_models.get_friction_law(joint.friction)
        if law is None:
            continue
        sentences.append(f"{joint.name}: {law.name} ({law.source})")
        steady = write_friction(law)
        if law.memory:
            damping = r"\sigma_1 \dot z + " if len(law.memory) > 1 else ""
            bent = _ELEMENTS if law.elements else _BRISTLES.replace("{damping}", damping)
            bent += r" + \tau_0" if law.linear[-1].name == "offset" else ""
            steady = rf"{bent}, \quad \text{{steady: }} {steady}"
            # At numbers of its own the state of the law ends at its curve.
            linear = [0.5 + 0.25 * k for k in range(len(law.linear))]
            values = dict(zip((entry.name for entry in law.linear), linear, strict=True))
            values |= joint_models.list_memory_values(law, joint.friction)
            still = (0.0,) * joint_models.count_states(law, joint.friction)
            carrier, speed = joint_models.build_float_carrier(), {"velocity": np.array([0.3])}
            torque, _ = joint_models.advance_memory(carrier, values, 0.3, _LONG_WAY, still)
            curve = joint_models.compute_friction_torque(law, speed, linear, joint.friction.shape)
            same = abs(torque - float(curve[0])) <= _AGREEMENT * abs(torque)
            require(same, "bristles do not end at the curve of steady sliding")
            checked = "verified at a speed: after a long displacement bristles give the curve of steady "
            checked += "sliding"
        formulas.append(Formula(f"tau_f{number}", law.formula, steady, rf"\tau_{{f{number}}}"))
    if not sentences:
        return None
    return Step(
        title="Friction",
        sentence=f"Friction is added to these torques, against positive velocity. {'; '.join(sentences)}.",
        formulas=tuple(formulas),
        check=checked,
    )


def derive_lesson(robot: Robot) -> tuple[Step, ...]:
    """Return the derivation of the dynamics, step by step; a SymidError where derivations do not agree."""
    base, energy = dynamics.derive_base_parameters(robot), dynamics.derive_energy(robot)
    state = dynamics.build_state(robot, energy.algebra, energy.algebra.generators)
    motions = dynamics.build_recursion(robot, energy.algebra, state).motions
    velocities = [
        _write_formula(f"{letter}{number}{axis}", *dynamics.write_polynomial(entry))
        for number, motion in enumerate(motions, start=1)
        for letter, vector in (("w", motion.angular), ("v", motion.linear))
        for axis, entry in zip("xyz", vector, strict=True)
        if entry
    ]
    groups = []
    for parameter in base.parameters:
        # In its own order.
        products = [factor * Symbol(dynamics.write_label(robot, label)) for label, factor in parameter.terms]
        formula = str(latex(Add(*products, evaluate=False), order="none"))
        groups.append(_write_formula(parameter.name, parameter.expression, formula))
    total = sum(name in (*INERTIAL, *dynamics.DRIVE_PARAMETERS) for _, name in base.labels)
    friction = describe_friction(robot)
    return (
        _describe_frames(robot),
        Step(
            title="Velocities",
            sentence="From the base outwards: the velocity of the link before, in the axes of this link, "
            "plus that of its own joint. s1, c1 stand for sin q1, cos q1. Entries that are not listed are "
            "zero.",
            formulas=tuple(velocities),
        ),
        _describe_energy(energy, base),
        Step(
            title="Base parameters",
            sentence=f"Of {total} inertial parameters only {base.count} combinations are identifiable.",
            formulas=tuple(groups),
        ),
        *_describe_matrices(robot),
        _describe_torques(robot, energy, base),
        *([] if friction is None else [friction]),
    )
