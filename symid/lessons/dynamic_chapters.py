r"""The chapters of a lesson on the dynamics of a robot, its joints rigid or elastic, and the whole lesson.

Robot, book -> `Lesson`: energies, base parameters, M, C, g, equation of motion, drives and friction. Up to
three joints, and where four give short formulas, all is written out; beyond, composite bodies and their
momenta have names, and torques are those of the recursion. What is stated as checked was compared before.
Then, on elastic joints, motor and link, springs, energies, inverse, two steps; the page runs the generated
step of the springs beside them (Kuhnen 2003; Zhang and Zhang 2023 for the two-step method).

Supported: robots of the exact algebra; springs with stops, knees and a cubic part.
Not supported: a closed form of C beyond four joints; branches of other models (named only).
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from sympy.polys.rings import PolyElement

from symid.dynamics import compute_torque_columns, fold_vector
from symid.lessons import matrices
from symid.lessons.chapters import (
    WRITTEN_OUT,
    Chapter,
    ChapterWriter,
    Item,
    Lesson,
    build_values,
    list_slides,
    require,
    say,
    show,
    translate_chapter,
    write_base,
    write_frames,
    write_kinematics,
    write_matrix,
)
from symid.lessons.derivation import describe_friction
from symid.lessons.textbook import Book, build_style, write_code, write_name, write_sum
from symid.lessons.words import load_words
from symid.robot import Robot

_MOST_TERMS = 24
"""Products of the longest element of M with which four joints are written out too."""


def build_lesson(
    robot: Robot, book: Book, form: matrices.Parameterisation | None = None, language: str = "en"
) -> Lesson:
    """Return the lesson on `robot` in the letters of `book`; a SymidError where derivations do not agree."""
    book = fit_book(book, robot)
    plain = all(joint.form is None for joint in robot.joints)
    forms: tuple[matrices.Parameterisation | None, ...] = (form,)
    if form is None and book.bodies and plain:
        forms = ("bodies", None)
    equations = None
    for one in forms if robot.freedom <= WRITTEN_OUT + 1 else ():
        found = matrices.derive_equations(matrices.build_model(robot, one, book=book))
        elements = (write_sum(value, found.model.sums) for row in found.mass for value in row)
        if robot.freedom <= WRITTEN_OUT or all(x.count_terms() <= _MOST_TERMS for x in elements):
            equations = found
            break
    derived = equations or matrices.derive_composites(robot, book)
    model = derived.model
    writer = ChapterWriter(model=model, book=book, style=build_style(book, list_slides(robot)))
    values, beta, stand_ins = build_values(robot, model)
    chapters = [write_frames(writer), *write_kinematics(writer)]
    if isinstance(derived, matrices.Equations):
        chapters += _write_short(writer, derived)
    else:
        chapters += _write_long(writer, derived)
    chapters += [*_write_joints(robot), *_write_elastic(robot, book)]
    words = load_words(language)
    return Lesson(
        robot=robot,
        model=model,
        book=book,
        chapters=tuple(translate_chapter(chapter, words) for chapter in chapters),
        values=values,
        beta=beta,
        stand_ins=stand_ins,
        language=language,
    )


def fit_book(book: Book, robot: Robot) -> Book:
    """Return the letters of a book for a robot: no coordinate is called as a symbol of its file."""
    if book.name == "symid" and robot.convention == "standard":
        book = replace(book, standard=True, shift=-1)
    slides, names = list_slides(robot), {name for name, _ in robot.symbols}
    if names & {write_name(f"q{number}", book, slides) for number in range(1, robot.size + 1)}:
        return replace(book, angle="q", slide="q", coordinates="q")
    return book


# Short robots: all is written out.


def _write_slopes(writer: ChapterWriter, slopes: Iterable[tuple[str, str, PolyElement]]) -> tuple[Item, ...]:
    """Return d(symbol)/d(parameter) = value for all that are not zero."""
    left = r"\frac{{\partial {}}}{{\partial {}}}".format
    return tuple(writer.formula(left(top, writer.symbol(name)), x) for top, name, x in slopes if x)


def _list_energy_slopes(
    writer: ChapterWriter, equations: matrices.Equations
) -> Iterator[tuple[str, str, PolyElement]]:
    """Yield both energies per unit of each letter that all parameters are linear in: masses and inertias."""
    model, book = writer.model, writer.book
    names = [entry.name for entry in model.base.parameters]
    if model.form != "base":
        names = []
        for name, letter in model.algebra.generators.items():
            used = [value for value in model.parameters.values() if value.diff(letter)]
            if used and all(not value.diff(letter).diff(letter) for value in used) and name[0] in "mMI":
                names.append(name)
    for name in names:
        letter = model.algebra.generators[name]
        yield book.kinetic, name, equations.kinetic.diff(letter)
        yield book.potential, name, equations.potential.diff(letter)


def _write_short(writer: ChapterWriter, equations: matrices.Equations) -> Iterator[Chapter]:
    model, book, q = writer.model, writer.book, writer.book.coordinates
    M, C, T, V = book.mass, book.coriolis, book.kinetic, book.potential
    yield Chapter(
        "Energies",
        "energies",
        (
            say(
                "The kinetic energy of a link with mass $M$, first moments $\\mathit{MS}$ and inertia $I$ "
                "about the origin of its frame, and its potential in the field $g$:"
            ),
            show(
                rf"{T}_j = \tfrac12\,\omega_j^{{\mathsf T}} I_j\,\omega_j + \omega_j \cdot "
                rf"(\mathit{{MS}}_j \times v_j) + \tfrac12\,M_j\, v_j \cdot v_j, \qquad "
                rf"{V}_j = -g \cdot (M_j\, p_j + R\,\mathit{{MS}}_j)"
            ),
            say("Summed over the links, in the letters of this lesson:"),
            writer.formula(T, equations.kinetic, "T", "J"),
            writer.formula(V, equations.potential, "V", "J"),
            Item(
                "details",
                "The energy regressor: both energies per unit of each parameter",
                items=_write_slopes(writer, _list_energy_slopes(writer, equations)),
            ),
        ),
    )
    yield write_base(writer)
    curved = matrices.check_mass_is_curvature(equations)
    require(curved, "M is not the second derivative of the kinetic energy")
    texts = [[writer.latex(value) for value in row] for row in equations.mass]
    mass = []
    if len(texts) <= 2 and _is_small(texts, 120):
        shown = [[r"\text{sym.}" if j < i else x for j, x in enumerate(row)] for i, row in enumerate(texts)]
        mass.append(write_matrix(M, shown))
    for i, row in enumerate(equations.mass):
        for j, value in enumerate(row[i:], start=i):
            unit = _find_unit(writer, i, j)
            mass.append(writer.formula(rf"{M}_{{{i + 1}{j + 1}}}", value, f"M{i + 1}_{j + 1}", unit))
    yield Chapter(
        "Inertia matrix",
        "mass",
        (
            say(
                rf"The kinetic energy is the square form ${T} = \tfrac12\,\dot {q}^{{\mathsf T}} "
                rf"{M}({q})\,\dot {q}$; the inertia matrix ${M}$ is symmetric, and positive definite for "
                rf"physical bodies."
            ),
            *_gather_zeros(mass),
            Item(
                "check",
                f"exact: ${M}$ from composite bodies equals the second derivatives of ${T}$ by the rates, "
                f"element by element; so it is symmetric",
            ),
            Item("widget", "mass"),
        ),
    )
    yield _write_coriolis(writer, equations)
    slope = rf"${book.gravity}_i = \partial {V} / \partial {q}_i$"
    text = f"At rest the motors hold the slope of the potential: {slope}."
    weights = (say(text), *_write_gravity(writer, equations.gravity), Item("widget", "gravity"))
    yield Chapter("Gravity", "gravity", weights)
    require(matrices.check_newton_euler(equations), "Lagrange and Newton-Euler differ")
    require(matrices.check_power(equations), "the power of the torques is not the change of the energy")
    columns = compute_torque_columns(matrices.build_model_recursion(model), model.base.keys)
    slopes = (
        (f"{book.torque}_{{{k}}}", entry.name, value)
        for entry in model.base.parameters
        for k, value in enumerate(fold_vector(model.robot, model.algebra, columns[entry.label]), start=1)
    )
    yield Chapter(
        "Equation of motion",
        "motion",
        (
            *_write_law(book),
            Item(
                "check",
                f"exact: ${M}\\ddot {q} + {C}\\dot {q} + {book.gravity}$ equals the torques of the "
                f"Newton-Euler recursion (Luh, Walker and Paul 1980), polynomial by polynomial",
            ),
            Item(
                "check",
                rf"exact: $\frac{{d}}{{dt}}({T} + {V}) = \dot {q} \cdot {book.torque}$, the energy theorem",
            ),
            Item("widget", "energy"),
            Item(
                "details",
                "The torque regressor: torques per unit of each base parameter",
                items=_write_slopes(writer, slopes),
            ),
        ),
    )


def _is_small(texts: Sequence[Sequence[str]], most: int) -> bool:
    return all(len(re.sub(r"\\,|\\mathit|\{", "", text)) <= most for row in texts for text in row)


def _find_unit(writer: ChapterWriter, i: int, j: int) -> str:
    """Return the unit of an element of the inertia matrix: of revolute and prismatic joints."""
    return ("kg", "kg m", "kg m²")[sum(not writer.model.robot.axes[k].prismatic for k in (i, j))]


def _gather_zeros(items: Sequence[Item]) -> list[Item]:
    """Return formulas with those that are zero in one sentence at the end."""
    end = " = 0"
    zero = [item for item in items if item.kind == "formula" and item.latex.endswith(end)]
    names = ", ".join(f"${item.latex.removesuffix(end)}$" for item in zero)
    found = [replace(item, kind="value", latex="") if item in zero else item for item in items]
    return [*found, *([say(f"These are zero: {names}.")] if zero else [])]


def _write_gravity(writer: ChapterWriter, values: Sequence[PolyElement]) -> list[Item]:
    units = ["N" if joint.prismatic else "N m" for joint in writer.model.robot.axes]
    return _gather_zeros(
        [
            writer.formula(rf"{writer.book.gravity}_{{{k}}}", value, f"g{k}_", unit)
            for k, (value, unit) in enumerate(zip(values, units, strict=True), start=1)
        ]
    )


def _find_ratio(value: PolyElement, known: PolyElement) -> PolyElement | None:
    """Return the number r with value = r known, None where there is none."""
    if not value or set(value) != set(known):
        return None
    monomial = next(iter(known))
    ratio = value.ring.domain.quo(value[monomial], known[monomial])
    return value.ring.ground_new(ratio) if known.mul_ground(ratio) == value else None


def _write_coriolis(writer: ChapterWriter, equations: matrices.Equations) -> Chapter:
    require(matrices.check_skew(equations), "dM/dt - 2C is not skew")
    M, C, q = writer.book.mass, writer.book.coriolis, writer.book.coordinates
    # Christoffel symbols that differ by more than a sign and a number have letters: h, or h with a number.
    found: list[PolyElement] = []
    units: list[str] = []
    for place, value in equations.christoffel.items():
        if value and not any(_find_ratio(value, known) for known in found):
            found.append(value)
            turning = sum(not writer.model.robot.axes[joint].prismatic for joint in place)
            units.append(("kg", "kg m", "kg m²")[turning - 1])
    single = len(found) == 1
    named = [
        ("h" if single else f"h_{{{k}}}", "h" if single else f"h{k}", value)
        for k, value in enumerate(found, start=1)
    ]
    items = [
        say(
            rf"Many matrices ${C}$ give the same torques ${C}\dot {q}$. That of Christoffel symbols makes "
            rf"$\dot {M} - 2{C}$ skew:"
        ),
        show(
            rf"{C}_{{ij}} = \sum_k c_{{ijk}}\,\dot {q}_k, \qquad c_{{ijk}} = \tfrac12\left(\frac{{\partial "
            rf"{M}_{{ij}}}}{{\partial {q}_k}} + \frac{{\partial {M}_{{ik}}}}{{\partial {q}_j}} - "
            rf"\frac{{\partial {M}_{{jk}}}}{{\partial {q}_i}}\right)"
        ),
    ]
    if not named:
        items.append(say(f"The inertia matrix does not depend on the posture: ${C} = 0$."))
    pairs = zip(named, units, strict=True)
    items += [writer.formula(letter, value, name, unit) for (letter, name, value), unit in pairs]
    items += _write_products(writer, equations, named) if named else []
    items.append(Item("check", rf"exact: $\dot {M} - 2{C}$ plus its transpose is the zero polynomial"))
    items.append(Item("widget", "skew"))
    return Chapter("Coriolis matrix", "coriolis", tuple(items))


def _write_products(
    writer: ChapterWriter, equations: matrices.Equations, named: Sequence[tuple[str, str, PolyElement]]
) -> list[Item]:
    """Return C in the letters of its Christoffel symbols: a matrix where it is short, else its elements."""
    C, joints = writer.book.coriolis, writer.model.robot.coordinates
    places = [(i, j) for i in range(len(joints)) for j in range(len(joints))]
    texts: list[list[str]] = [[] for _ in joints]
    codes = {}
    for i, j in places:
        # Sums of number * h * rate with equal h collected: -h (dq1 + dq2).
        groups: dict[tuple[str, str], list[str]] = {}
        terms = []
        for k, joint in enumerate(joints):
            for letter, name, value in named:
                ratio = _find_ratio(equations.christoffel[i, j, k], value)
                if ratio is not None:
                    number, rate = writer.latex(ratio), writer.coordinate(joint, "d")
                    factor = "" if number in ("1", "-1") else number.lstrip("-") + r"\,"
                    sign = "-" if number.startswith("-") else ""
                    groups.setdefault((sign, letter), []).append(f"{factor}{rate}")
                    terms.append(f"({write_code(writer.write(ratio), 'v')})*v.{name}*v.dq{joint + 1}")
        text = ""
        for (sign, letter), rates in groups.items():
            inner = " + ".join(rates)
            product = rf"{letter}\,{inner}" if len(rates) == 1 else rf"{letter}\,({inner})"
            text += f" {sign or '+'} {product}" if text else f"{sign}{product}"
        texts[i].append(text or "0")
        codes[i, j] = " + ".join(terms) or "0"
    if len(joints) <= WRITTEN_OUT and _is_small(texts, 60):
        values = [Item("value", name=f"C{i + 1}_{j + 1}", code=codes[i, j]) for i, j in places]
        return [write_matrix(C, texts), *values]
    items = []
    for i, j in places:
        latex, name = rf"{C}_{{{i + 1}{j + 1}}} = {texts[i][j]}", f"C{i + 1}_{j + 1}"
        unit = f"{_find_unit(writer, i, j)}/s"
        items.append(Item("formula", latex=latex, name=name, code=codes[i, j], unit=unit))
    return _gather_zeros(items)


def _write_law(book: Book) -> list[Item]:
    q, C = book.coordinates, book.coriolis
    right = rf"{book.mass}({q})\,\ddot {q} + {C}({q}, \dot {q})\,\dot {q} + {book.gravity}({q})"
    law = [show(f"{book.torque} = {right}")]
    if book.name == "craig":
        law.append(say(rf"Craig writes $V(\Theta, \dot\Theta)$ for the vector ${C}\,\dot\Theta$."))
    return law


# Long robots: composite bodies.

_KINDS = {
    "body": r"Composite bodies: link $j$ and all beyond it, as one rigid body in the frame of link $j$",
    "gravity": "The field of gravity in the axes of a link",
    "momentum": (
        r"Momenta of composite bodies: ${}^{j}p^{(k)}$ and ${}^{j}h^{(k)}$ are momentum and moment of "
        "momentum of the composite body $k$ per unit rate of its joint, in the frame of link $j$"
    ),
}


def _write_long(writer: ChapterWriter, composites: matrices.Composites) -> Iterator[Chapter]:
    require(matrices.check_composites(composites), "the named quantities do not give the matrices")
    book, robot, q = writer.book, writer.model.robot, writer.book.coordinates
    yield write_base(writer)
    bodies = [
        say(
            "Written out, the inertia matrix has thousands of terms. It becomes short with the composite "
            "bodies of Walker and Orin (1982): lock all joints beyond joint $j$, and the links from $j$ on "
            "are one body, whose inertia $\\overline{\\mathit{XX}}_j \\ldots$, first moments "
            "$\\overline{\\mathit{MX}}_j \\ldots$ and mass follow from those of the body before it, from the "
            "tip to the base. What is not listed is zero or a parameter itself."
        )
    ]
    for kind, title in _KINDS.items():
        listed = [entry for entry in composites.definitions if entry.kind == kind]
        formulas = tuple(writer.formula(writer.symbol(x.name), x.value, x.name) for x in listed)
        if formulas:
            bodies.append(Item("details", f"{title} ({len(formulas)})", items=formulas))
    yield Chapter("Composite bodies", "composites", tuple(bodies))
    rows: dict[int, list[Item]] = {}
    comma = "," if robot.size > 9 else ""
    for (i, j), value in sorted(composites.mass.items()):
        left, unit = rf"{book.mass}_{{{i + 1}{comma}{j + 1}}}", _find_unit(writer, i, j)
        rows.setdefault(i, []).append(writer.formula(left, value, f"M{i + 1}_{j + 1}", unit))
    mass = (
        say(
            f"The element ${book.mass}_{{ij}}$ is the momentum of the composite body $j$, per unit rate of "
            f"its joint, about the axis of joint $i$. Every element in closed form:"
        ),
        *(
            Item("details", f"Row {i + 1}", items=tuple(_gather_zeros(row)), name="open" if i < 3 else "")
            for i, row in rows.items()
        ),
        Item(
            "check",
            f"exact at a rational point: with all names put in, ${book.mass}$ and ${book.gravity}$ are those "
            f"of the Newton-Euler recursion",
        ),
        Item("widget", "mass"),
    )
    yield Chapter("Inertia matrix", "mass", mass)
    text = "At rest a joint carries the weight of its composite body, by its first moments."
    weights = (say(text), *_write_gravity(writer, composites.gravity), Item("widget", "gravity"))
    yield Chapter("Gravity", "gravity", weights)
    law = (
        say("The torques of a motion follow from the tip to the base, with forces in place of momenta:"),
        show(
            rf"\dot\omega_j = R_j^{{\mathsf T}}\dot\omega_{{j-1}} + \omega_j\times z\,\dot {q}_j + z\,\ddot "
            rf"{q}_j, \qquad a_j = R_j^{{\mathsf T}}\left(a_{{j-1}} + \dot\omega_{{j-1}}\times p_j + "
            rf"\omega_{{j-1}}\times(\omega_{{j-1}}\times p_j)\right)"
        ),
        show(
            r"f_j = M_j a_j + \dot\omega_j\times \mathit{MS}_j + \omega_j\times(\omega_j\times "
            r"\mathit{MS}_j) + \sum R f, \qquad n_j = I_j\dot\omega_j + \omega_j\times I_j\omega_j + "
            r"\mathit{MS}_j\times a_j + \sum (R n + p\times R f)"
        ),
        show(rf"{book.torque}_j = z\cdot n_j, \qquad a_0 = -g"),
        say(
            f"Collected, they are the equation below; ${book.coriolis}$ is the matrix of Christoffel "
            f"symbols, which generated code computes in the same recursion (Echeandia and Wensing 2021)."
        ),
        *_write_law(book),
        Item("widget", "skew"),
        say(
            rf"The energy theorem holds along every motion: "
            rf"$\frac{{d}}{{dt}}({book.kinetic} + {book.potential}) = \dot {q}\cdot {book.torque}$."
        ),
        Item("widget", "energy"),
    )
    yield Chapter("Equation of motion", "motion", law)


# Joints: drives and friction.


def _write_joints(robot: Robot) -> Iterator[Chapter]:
    items: list[Item] = []
    numbers = enumerate(robot.joints, start=1)
    rotors = [str(k) for k, joint in numbers if joint.drive.has_rotor and joint.elasticity is None]
    if rotors or robot.couplings:
        text = (
            f"The rotors of joints {', '.join(rotors)} turn with their joints: $\\mathit{{IA}}_j\\,\\dot "
            f"q_j^2/2$ is added to the kinetic energy, $\\mathit{{IA}}_j$ the inertia on the joint side. "
        )
        drive = "Drive {} turns with several joints, so its inertia couples them."
        drives = " ".join(drive.format(one.name) for one in robot.couplings)
        items.append(say((text if rotors else "") + drives))
    friction = describe_friction(robot)
    if friction is not None:
        items.append(say(friction.sentence))
        items += [show(f"{entry.left_latex} = {entry.latex}") for entry in friction.formulas]
        if friction.check:
            items.append(Item("check", friction.check))
    if items:
        yield Chapter("Drives and friction", "joints", tuple(items))


# Elastic joints.

_PLAY = (
    r"P_r[x](t) = \max\bigl(x - r,\ \min(x + r,\ P_r(t^-))\bigr), \qquad E_r[x] = x - P_r[x], \qquad "
    r"|E_r| \le r"
)
_SPRING = r"v = k_0\,\varphi + \sum_i k_i\,E_{r_i}[\varphi], \qquad \tau_J = S(v)"
_CUBIC_SPRING = _SPRING.replace(r"\varphi +", r"\varphi + k_3\,\varphi^3 +", 1)
_DEAD = r"S(v) = v + \sum_{R_j > 0} s_j \max(v - R_j, 0) + \sum_{R_j < 0} s_j \min(v - R_j, 0)"
_STORED = r"U = \tfrac12 k_0\,\varphi^2 + \tfrac12 \sum_i k_i\,E_i^2, \qquad D = \sum_i k_i\, r_i \int |dP_i|"
_THEOREM = r"\int \tau_J\, d\varphi = U(t) - U(0) + D(t), \qquad \dot D \ge 0"
_MASING = (
    r"\tau_J - \tau_r = 2\,f\!\left(\tfrac12(\varphi - \varphi_r)\right), \qquad "
    r"f \text{ the first curve from rest}"
)
_INVERSE = (
    r"\varphi = w'_0\,v + \sum_i w'_i\,P_{r'_i}[v], \qquad v = S^{-1}(\tau_J), \qquad w'_0 = \frac{1}{W_0}, "
    r"\quad w'_i = \frac{1}{W_i} - \frac{1}{W_{i-1}}, \quad r'_i = r'_{i-1} + W_{i-1}\,(r_i - r_{i-1})"
)
_ENERGY_ROWS = (
    r"\Delta\bigl(h_T + h_V\bigr)\,\beta + \Delta\bigl(\tfrac12 \dot\theta^2\bigr) I_a + \int \dot\theta\, "
    r"F(\dot\theta)\,dt\; f = \int \dot\theta\,\tau_m\,dt - \int \tau_J\,\dot\varphi\,dt"
)


def _write_elastic(robot: Robot, book: Book) -> Iterator[Chapter]:
    """Yield the chapters on elastic joints; none where no joint is elastic."""
    springs = {str(k): joint.elasticity for k, joint in enumerate(robot.joints, start=1) if joint.elasticity}
    if not springs:
        return
    q = book.coordinates
    where = "All joints are" if len(springs) == robot.size else f"Joints {', '.join(springs)} are"
    sides = (
        say(
            rf"{where} elastic: a gear with a flexible spline, a belt or a long shaft stands between motor "
            rf"and link. The link is at ${q}$, the motor, seen through the gear, at $\theta$; the torsion is "
            rf"the difference."
        ),
        show(rf"\varphi = \theta - {q}"),
        say(
            "The equation of motion above is that of the links, with the torque of the springs on its left "
            "side; the rotors have equations of their own (Spong 1987):"
        ),
        show(
            rf"{book.mass}({q})\,\ddot {q} + {book.coriolis}({q},\dot {q})\,\dot {q} + "
            rf"{book.gravity}({q}) = \tau_J"
        ),
        show(r"I_a\,\ddot\theta + \tau_f(\dot\theta) + \tau_J = \tau_m"),
        Item("widget", "sides"),
    )
    yield Chapter("Motor and link", "sides", sides)
    cubic, knees = (any(getattr(spring, part) for spring in springs.values()) for part in ("cubic", "knees"))
    rows = [("joint", "part", "threshold", "stiffness, N m/rad (knees: slope)")]
    for number, one in springs.items():
        rows.append((number, "$k_0$", "-", f"{one.stiffness:g}" if one.stiffness else "open"))
        for k, stop in enumerate(one.stops, start=1):
            value = "open" if stop.stiffness is None else f"{stop.stiffness:g}"
            rows.append((number, f"stop $k_{k}$", f"$r_{k}$ = {stop.threshold:g} rad", value))
        for k, knee in enumerate(one.knees, start=1):
            rows.append((number, f"knee $s_{k}$", f"$R_{k}$ = {knee.threshold:g} N m", f"{knee.slope:g}"))
    others = sorted({branch.kind for spring in springs.values() for branch in spring.branches})
    items = [
        say(
            "A spring behind dry friction holds until its own torsion reaches its threshold, then slips. "
            "That is the stop operator; what it lags behind is the play. A few of them beside a plain spring "
            "make a loop of any shape with memory (Prandtl 1928, Ishlinskii 1944); a function behind makes "
            "it harden (modified Prandtl-Ishlinskii model, Kuhnen 2003)."
        ),
        show(_PLAY),
        show(_CUBIC_SPRING if cubic else _SPRING),
        show(_DEAD),
        Item("table", rows=tuple(rows)),
        Item("widget", "hysteresis"),
        say(
            "Drag the torsion: from rest the torque follows the first curve. After each reversal every stop "
            "has to give back twice its threshold before it slips again, so the branch is the first curve at "
            "twice its size, until it meets the curve that it left before (Masing 1926):"
        ),
        show(_MASING),
    ]
    if others:
        items.append(say(f"Beside these the file has branches of other models: {', '.join(others)}."))
    yield Chapter("Springs that remember", "springs", tuple(items))
    energies = (
        say(
            "What the torque does on the torsion is stored in the springs or lost in the stops that "
            "slip. " + ("Without knees" if knees else "Here")
        ),
        show(_STORED),
        show(_THEOREM),
        Item("widget", "balance"),
        say(
            r"The spring can be turned round: the inverse is a sum of plays again, in closed form. A "
            r"controller computes with it the torsion that a wanted torque needs. With $W_i = k_0 + "
            r"\sum_{j>i} k_j$, $r_0 = r'_0 = 0$:"
        ),
        show(_INVERSE),
        Item("widget", "inverse"),
    )
    yield Chapter("Energy of the springs, and their inverse", "springs-energy", energies)
    method = (
        say(
            "Dynamics and springs are unknown together, and their product is no linear problem. The two-step "
            "method (after Zhang and Zhang 2023) takes turns. First, with the springs held, energies are "
            "linear in the base parameters, rotors and friction:"
        ),
        show(_ENERGY_ROWS),
        say(
            "Then, with those held, the motor's equation gives the torque of each spring, and stiffness and "
            "stops are linear in it for given thresholds:"
        ),
        show(
            r"\tau_J = \tau_m - I_a\,\ddot\theta - \tau_f(\dot\theta) \approx k_0\,\varphi + \sum_i "
            r"k_i\,E_{r_i}[\varphi]"
        ),
        say(
            "The steps alternate until nothing changes; `symid identify` compares it with four other methods."
        ),
    )
    yield Chapter("The two-step method", "two-step", method)
