r"""The chapters of a lesson on the dynamics of a rigid robot, and the lesson as a whole.

Robot, book -> `Lesson`: energies, base parameters, M, C, g, equation of motion, drives and friction. Up to
three joints, and where four give short formulas, all is written out; beyond, composite bodies and their
momenta have names, and torques are those of the recursion. What is stated as checked was compared before.

Supported: robots of the exact algebra. Not supported: a closed form of C beyond four joints.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sympy.polys.rings import PolyElement

from symid.dynamics import compute_torque_columns, fold_vector
from symid.lessons.chapters import (
    WRITTEN_OUT,
    Chapter,
    ChapterWriter,
    Item,
    Lesson,
    build_values,
    find_tip,
    list_slides,
    require,
    write_base,
    write_kinematics,
    write_matrix,
)
from symid.lessons.derivation import describe_friction
from symid.lessons.matrices import (
    Composites,
    Equations,
    LessonModel,
    Parameterisation,
    build_model,
    build_model_recursion,
    check_composites,
    check_mass_is_curvature,
    check_newton_euler,
    check_power,
    check_skew,
    derive_composites,
    derive_equations,
)
from symid.lessons.textbook import Book, build_style, write_code, write_sum
from symid.robot import Robot

_MOST_TERMS = 24
"""Products of the longest element of M with which four joints are written out too."""


def build_lesson(robot: Robot, book: Book, form: Parameterisation | None = None) -> Lesson:
    """Return the lesson on `robot` in the letters of `book`.

    Raises:
        SymidError: two derivations that must agree do not.
    """
    known = any(joint.inertial is not None for joint in robot.joints)
    if form is None and book.name in ("siciliano", "craig") and known and robot.freedom <= WRITTEN_OUT:
        has_symbols = any(joint.form is not None for joint in robot.joints)
        form = None if has_symbols else "bodies"
    equations, composites = None, None
    if robot.freedom <= WRITTEN_OUT + 1:
        equations = derive_equations(build_model(robot, form))
        if robot.freedom > WRITTEN_OUT and not _is_short(equations):
            equations = None
    if equations is None:
        composites = derive_composites(robot)
    model = equations.model if equations else composites.model if composites else build_model(robot, form)
    writer = ChapterWriter(model=model, book=book, style=build_style(book, list_slides(robot)))
    values, beta, stand_ins = build_values(robot, model)
    dynamics = _write_short(writer, equations) if equations else _write_long(writer, composites)
    chapters = [*write_kinematics(writer, robot), *dynamics, *_write_joints(robot)]
    return Lesson(
        robot=robot,
        model=model,
        book=book,
        chapters=tuple(chapters),
        values=values,
        beta=beta,
        stand_ins=stand_ins,
        tips=tuple(find_tip(robot, index) for index in range(robot.size)),
    )


def _is_short(equations: Equations) -> bool:
    sums = equations.model.sums
    return all(write_sum(x, sums).count_terms() <= _MOST_TERMS for row in equations.mass for x in row)


# Short robots: all is written out.


def _write_short(writer: ChapterWriter, equations: Equations) -> Iterator[Chapter]:
    yield _write_energies(writer, equations)
    yield write_base(writer)
    yield _write_mass(writer, equations)
    yield _write_coriolis(writer, equations)
    yield _write_gravity(writer, equations)
    yield _write_motion(writer, equations)


def _write_energies(writer: ChapterWriter, equations: Equations) -> Chapter:
    book = writer.book
    regressor = _write_energy_columns(writer, equations)
    items = [
        Item(
            kind="text",
            text="The kinetic energy of a link with mass $M$, first moments $\\mathit{MS}$ and inertia "
            "$I$ about the origin "
            "of its frame, and its potential in the field $g$:",
        ),
        Item(
            kind="formula",
            latex=rf"{book.kinetic}_j = \tfrac12\,\omega_j^{{\mathsf T}} I_j\,\omega_j + \omega_j \cdot "
            rf"(\mathit{{MS}}_j \times v_j) + \tfrac12\,M_j\, v_j \cdot v_j, \qquad "
            rf"{book.potential}_j = -g \cdot (M_j\, p_j + R\,\mathit{{MS}}_j)",
        ),
        Item(kind="text", text="Summed over the links, in the letters of this lesson:"),
        writer.formula(book.kinetic, equations.kinetic, "T", "J"),
        writer.formula(book.potential, equations.potential, "V", "J"),
        Item(
            kind="details",
            text="The energy regressor: both energies per unit of each parameter",
            items=regressor,
        ),
    ]
    return Chapter(title="Energies", anchor="energies", items=tuple(items))


def _write_energy_columns(writer: ChapterWriter, equations: Equations) -> tuple[Item, ...]:
    model, book, items = writer.model, writer.book, []
    if model.form != "base":
        letters = _list_linear_letters(model)
    else:
        letters = [entry.name for entry in model.base.parameters]
    for name in letters:
        letter = model.algebra.generators[name]
        for symbol, energy in ((book.kinetic, equations.kinetic), (book.potential, equations.potential)):
            slope = energy.diff(letter)
            if slope:
                left = rf"\frac{{\partial {symbol}}}{{\partial {writer.symbol(name)}}}"
                items.append(writer.formula(left, slope))
    return tuple(items)


def _list_linear_letters(model: LessonModel) -> list[str]:
    """Return the letters that all parameters are linear in: masses and inertias."""
    known = model.algebra.generators
    found = []
    for name, letter in known.items():
        used = [value for value in model.parameters.values() if value.diff(letter)]
        if used and all(not value.diff(letter).diff(letter) for value in used) and name[0] in "mMI":
            found.append(name)
    return found


def _is_small(texts: Sequence[str], most: int = 46) -> bool:
    return all(
        len(text.replace(r"\,", "").replace(r"\mathit", "").replace("{", "")) <= most for text in texts
    )


def _write_elements(
    writer: ChapterWriter,
    letter: str,
    rows: Sequence[Sequence[PolyElement]],
    name: str,
    *,
    symmetric: bool,
    unit: str,
) -> list[Item]:
    """Return a matrix as such where its elements are short, else its elements one by one."""
    size = len(rows)
    texts = [[writer.latex(value) for value in row] for row in rows]
    items: list[Item] = []
    if size <= 2 and _is_small([text for row in texts for text in row], 120):
        shown = [
            [r"\text{sym.}" if symmetric and j < i else text for j, text in enumerate(row)]
            for i, row in enumerate(texts)
        ]
        items.append(write_matrix(letter, shown))
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            if symmetric and j < i:
                continue
            index = f"{i + 1}{j + 1}" if size < 10 else f"{i + 1},{j + 1}"
            left = rf"{letter[0]}_{{{index}}}" if len(letter) == 1 else rf"{letter}_{{{index}}}"
            items.append(writer.formula(left, value, f"{name}{i + 1}_{j + 1}", unit if value else ""))
    return items


def _write_mass(writer: ChapterWriter, equations: Equations) -> Chapter:
    require(check_mass_is_curvature(equations), "M is not the second derivative of the kinetic energy")
    book, q = writer.book, writer.book.coordinates
    items = [
        Item(
            kind="text",
            text=rf"The kinetic energy is the square form ${book.kinetic} = \tfrac12\,\dot {q}^{{\mathsf T}} "
            rf"{book.mass}({q})\,\dot {q}$; the inertia matrix ${book.mass}$ is symmetric, and positive "
            rf"definite for "
            "bodies that exist.",
        ),
        *_write_elements(writer, book.mass, equations.mass, "M", symmetric=True, unit="kg m²"),
        Item(
            kind="check",
            text=f"exact: ${book.mass}$ from composite bodies equals the second derivatives of "
            f"${book.kinetic}$ by the "
            "rates, element by element; so it is symmetric",
        ),
        Item(kind="widget", text="mass"),
    ]
    return Chapter(title="Inertia matrix", anchor="mass", items=tuple(items))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    """A Christoffel symbol that has a letter: h, or h with a number."""

    letter: str
    name: str
    value: PolyElement


def _name_symbols(equations: Equations) -> list[_Named]:
    """Return the different Christoffel symbols, up to their sign and a number, with their letters."""
    found: list[PolyElement] = []
    for value in equations.christoffel.values():
        if value and not any(_find_ratio(value, known) for known in found):
            found.append(value)
    single = len(found) == 1
    return [
        _Named(letter="h" if single else f"h_{{{k}}}", name="h" if single else f"h{k}", value=value)
        for k, value in enumerate(found, start=1)
    ]


def _find_ratio(value: PolyElement, known: PolyElement) -> PolyElement | None:
    """Return the number r with value = r known, None where there is none."""
    if not value or set(value) != set(known):
        return None
    domain, monomial = value.ring.domain, next(iter(known))
    ratio = domain.quo(value[monomial], known[monomial]) if domain.is_Field else None
    if ratio is None:
        return None
    scaled = known.mul_ground(ratio)
    return value.ring.ground_new(ratio) if scaled == value else None


def _write_coriolis(writer: ChapterWriter, equations: Equations) -> Chapter:
    require(check_skew(equations), "dM/dt - 2C is not skew")
    book, named = writer.book, _name_symbols(equations)
    M, C = book.mass, book.coriolis
    q = book.coordinates
    items = [
        Item(
            kind="text",
            text=f"Many matrices ${C}$ give the same torques ${C}\\dot {q}$. That of Christoffel symbols "
            f"makes "
            rf"$\dot {M} - 2{C}$ skew:",
        ),
        Item(
            kind="formula",
            latex=rf"{C}_{{ij}} = \sum_k c_{{ijk}}\,\dot {q}_k, \qquad c_{{ijk}} = "
            rf"\tfrac12\left(\frac{{\partial {M}_{{ij}}}}"
            rf"{{\partial {q}_k}} + \frac{{\partial {M}_{{ik}}}}{{\partial {q}_j}} - "
            rf"\frac{{\partial {M}_{{jk}}}}"
            rf"{{\partial {q}_i}}\right)",
        ),
    ]
    if not named:
        items.append(Item(kind="text", text=f"The inertia matrix does not depend on the posture: ${C} = 0$."))
    items += [writer.formula(entry.letter, entry.value, entry.name, "kg m²") for entry in named]
    items += _write_products(writer, equations, named) if named else []
    items.append(
        Item(kind="check", text=rf"exact: $\dot {M} - 2{C}$ plus its transpose is the zero polynomial")
    )
    items.append(Item(kind="widget", text="skew"))
    return Chapter(title="Coriolis matrix", anchor="coriolis", items=tuple(items))


def _write_products(writer: ChapterWriter, equations: Equations, named: Sequence[_Named]) -> list[Item]:
    """Return C in the letters of its Christoffel symbols: a matrix where it is short, else its elements."""
    C, joints = writer.book.coriolis, writer.model.robot.coordinates
    size = len(joints)
    texts: list[list[str]] = []
    codes: list[list[str]] = []
    for i in range(size):
        row = [_list_products(writer, equations, named, (i, j)) for j in range(size)]
        texts.append([_join_rates([part[:3] for part in parts]) for parts in row])
        codes.append([" + ".join(part[3] for part in parts) or "0" for parts in row])
    places = [(i, j) for i in range(size) for j in range(size)]
    if size <= WRITTEN_OUT and _is_small([text for row in texts for text in row], 60):
        values = [Item(kind="value", name=f"C{i + 1}_{j + 1}", code=codes[i][j]) for i, j in places]
        return [write_matrix(C, texts), *values]
    return [
        Item(
            kind="formula",
            latex=rf"{C}_{{{i + 1}{j + 1}}} = {texts[i][j]}",
            name=f"C{i + 1}_{j + 1}",
            code=codes[i][j],
            unit="kg m²/s",
        )
        for i, j in places
    ]


def _list_products(
    writer: ChapterWriter, equations: Equations, named: Sequence[_Named], place: tuple[int, int]
) -> list[tuple[str, str, str, str]]:
    """Return number, letter and rate of every term of an element of C, and the term in JavaScript."""
    found = []
    for k, joint in enumerate(writer.model.robot.coordinates):
        for entry in named:
            ratio = _find_ratio(equations.christoffel[*place, k], entry.value)
            if ratio is not None:
                code = f"({write_code(writer.write(ratio), 'v')})*v.{entry.name}*v.dq{joint + 1}"
                found.append((writer.latex(ratio), entry.letter, writer.coordinate(joint, "d"), code))
    return found


def _join_rates(parts: Sequence[tuple[str, str, str]]) -> str:
    """Return a sum of number * h * rate with equal h collected: -h (dq1 + dq2)."""
    groups: dict[tuple[str, str], list[str]] = {}
    for number, letter, rate in parts:
        sign = "-" if number.startswith("-") else ""
        groups.setdefault((sign, letter), []).append(
            f"{'' if number in ('1', '-1') else number.lstrip('-') + chr(92) + ','}{rate}"
        )
    text = ""
    for (sign, letter), rates in groups.items():
        inner = " + ".join(rates)
        product = rf"{letter}\,{inner}" if len(rates) == 1 else rf"{letter}\,({inner})"
        text += f" {sign or '+'} {product}" if text else f"{sign}{product}"
    return text or "0"


def _write_gravity(writer: ChapterWriter, equations: Equations) -> Chapter:
    book = writer.book
    items = [
        Item(
            kind="text",
            text=f"At rest the motors hold the slope of the potential: ${book.gravity}_i = \\partial "
            f"{book.potential} / "
            f"\\partial {book.coordinates}_i$.",
        ),
        *(
            writer.formula(rf"{book.gravity}_{{{k}}}", value, f"g{k}_", _name_unit(writer.model.robot, k - 1))
            for k, value in enumerate(equations.gravity, start=1)
        ),
        Item(kind="widget", text="gravity"),
    ]
    return Chapter(title="Gravity", anchor="gravity", items=tuple(items))


def _name_unit(robot: Robot, position: int) -> str:
    return "N" if robot.axes[position].prismatic else "N m"


def _write_motion(writer: ChapterWriter, equations: Equations) -> Chapter:
    require(check_newton_euler(equations), "Lagrange and Newton-Euler differ")
    require(check_power(equations), "the power of the torques is not the change of the energy")
    book = writer.book
    items = [
        *_write_law(book),
        Item(
            kind="check",
            text=f"exact: ${book.mass}\\ddot {book.coordinates} + {book.coriolis}\\dot {book.coordinates} + "
            f"{book.gravity}$ equals the torques of the Newton-Euler recursion (Luh, Walker and Paul "
            f"1980), polynomial by polynomial",
        ),
        Item(
            kind="check",
            text=rf"exact: $\frac{{d}}{{dt}}({book.kinetic} + {book.potential}) = \dot {book.coordinates} "
            rf"\cdot {book.torque}$, "
            "the energy theorem",
        ),
        Item(kind="widget", text="energy"),
        Item(
            kind="details",
            text="The torque regressor: torques per unit of each base parameter",
            items=_write_torque_columns(writer),
        ),
    ]
    return Chapter(title="Equation of motion", anchor="motion", items=tuple(items))


def _write_law(book: Book) -> list[Item]:
    q = book.coordinates
    return [
        Item(
            kind="formula",
            latex=rf"{book.torque} = {book.mass}({q})\,\ddot {q} + {book.coriolis}({q}, \dot {q})\,\dot "
            rf"{q} + {book.gravity}({q})",
        ),
        *(
            [
                Item(
                    kind="text",
                    text=rf"Craig writes $V(\Theta, \dot\Theta)$ for the vector "
                    rf"${book.coriolis}\,\dot\Theta$.",
                )
            ]
            if book.name == "craig"
            else []
        ),
    ]


def _write_torque_columns(writer: ChapterWriter) -> tuple[Item, ...]:
    model = writer.model
    columns = compute_torque_columns(build_model_recursion(model), model.base.keys)
    items = []
    for entry in model.base.parameters:
        folded = fold_vector(model.robot, model.algebra, columns[entry.label])
        for k, value in enumerate(folded, start=1):
            if value:
                left = (
                    rf"\frac{{\partial {writer.book.torque}_{{{k}}}}}{{\partial {writer.symbol(entry.name)}}}"
                )
                items.append(writer.formula(left, value))
    return tuple(items)


# Long robots: composite bodies.


def _write_long(writer: ChapterWriter, composites: Composites | None) -> Iterator[Chapter]:
    if composites is None:
        return
    require(check_composites(composites), "the named quantities do not give the matrices")
    yield write_base(writer)
    yield _write_composites(writer, composites)
    yield _write_long_mass(writer, composites)
    yield _write_long_gravity(writer, composites)
    yield _write_long_motion(writer)


_KINDS = {
    "body": r"Composite bodies: link $j$ and all beyond it, as one rigid body in the frame of link $j$",
    "gravity": "The field of gravity in the axes of a link",
    "momentum": (
        r"Momenta of composite bodies: ${}^{j}p^{(k)}$ and ${}^{j}h^{(k)}$ are momentum and moment of "
        "momentum of the composite body $k$ per unit rate of its joint, in the frame of link $j$"
    ),
}


def _write_composites(writer: ChapterWriter, composites: Composites) -> Chapter:
    items = [
        Item(
            kind="text",
            text="Written out, the inertia matrix has thousands of terms. It becomes short with the "
            "composite bodies "
            "of Walker and Orin (1982): lock all joints beyond joint $j$, and the links from $j$ on are "
            "one body, whose inertia "
            "$\\overline{\\mathit{XX}}_j \\ldots$, first moments $\\overline{\\mathit{MX}}_j \\ldots$ and "
            "mass follow from "
            "those of the body before it, from the tip to the base. What is not listed is zero or a "
            "parameter itself.",
        )
    ]
    for kind, title in _KINDS.items():
        listed = [entry for entry in composites.definitions if entry.kind == kind]
        formulas = [writer.formula(writer.symbol(entry.name), entry.value, entry.name) for entry in listed]
        if formulas:
            items.append(Item(kind="details", text=f"{title} ({len(formulas)})", items=tuple(formulas)))
    return Chapter(title="Composite bodies", anchor="composites", items=tuple(items))


def _write_long_mass(writer: ChapterWriter, composites: Composites) -> Chapter:
    book, robot = writer.book, writer.model.robot
    items = [
        Item(
            kind="text",
            text=f"The element ${book.mass}_{{ij}}$ is the momentum of the composite body $j$, per unit "
            f"rate of its joint, about "
            "the axis of joint $i$. Every element in closed form:",
        )
    ]
    rows: dict[int, list[Item]] = {}
    for (i, j), value in sorted(composites.mass.items()):
        comma = "," if robot.size > 9 else ""
        left = rf"{book.mass}_{{{i + 1}{comma}{j + 1}}}"
        rows.setdefault(i, []).append(
            writer.formula(left, value, f"M{i + 1}_{j + 1}", "kg m²" if value else "")
        )
    for i, formulas in rows.items():
        items.append(
            Item(kind="details", text=f"Row {i + 1}", items=tuple(formulas), name="open" if i < 3 else "")
        )
    items.append(
        Item(
            kind="check",
            text=f"exact at a rational point: with all names put in, ${book.mass}$ and ${book.gravity}$ "
            f"are those of the "
            "Newton-Euler recursion",
        )
    )
    items.append(Item(kind="widget", text="mass"))
    return Chapter(title="Inertia matrix", anchor="mass", items=tuple(items))


def _write_long_gravity(writer: ChapterWriter, composites: Composites) -> Chapter:
    book, robot = writer.book, writer.model.robot
    formulas = [
        writer.formula(
            rf"{book.gravity}_{{{k}}}", value, f"g{k}_", "N" if robot.joints[k - 1].prismatic else "N m"
        )
        for k, value in enumerate(composites.gravity, start=1)
    ]
    text = "At rest a joint carries the weight of its composite body, by its first moments."
    items = (Item(kind="text", text=text), *formulas, Item(kind="widget", text="gravity"))
    return Chapter(title="Gravity", anchor="gravity", items=items)


def _write_long_motion(writer: ChapterWriter) -> Chapter:
    book = writer.book
    q = book.coordinates
    law = [
        Item(
            kind="text",
            text="The torques of a motion follow from the tip to the base, with forces in place of momenta:",
        ),
        Item(
            kind="formula",
            latex=rf"\dot\omega_j = R_j^{{\mathsf T}}\dot\omega_{{j-1}} + \omega_j\times z\,\dot {q}_j + "
            rf"z\,\ddot {q}_j, \qquad "
            r"a_j = R_j^{\mathsf T}\left(a_{j-1} + \dot\omega_{j-1}\times p_j + "
            r"\omega_{j-1}\times(\omega_{j-1}\times p_j)\right)",
        ),
        Item(
            kind="formula",
            latex=r"f_j = M_j a_j + \dot\omega_j\times \mathit{MS}_j + \omega_j\times(\omega_j\times "
            r"\mathit{MS}_j) + \sum R f, \qquad "
            r"n_j = I_j\dot\omega_j + \omega_j\times I_j\omega_j + \mathit{MS}_j\times a_j + \sum (R n + "
            r"p\times R f)",
        ),
        Item(kind="formula", latex=rf"{book.torque}_j = z\cdot n_j, \qquad a_0 = -g"),
        Item(
            kind="text",
            text=rf"Collected, they are the equation below; ${book.coriolis}$ is the matrix of "
            rf"Christoffel symbols, "
            "which generated code computes in the same recursion (Echeandia and Wensing 2021).",
        ),
        *_write_law(book),
        Item(kind="widget", text="skew"),
        Item(
            kind="text",
            text=rf"The energy theorem holds along every motion: "
            rf"$\frac{{d}}{{dt}}({book.kinetic} + {book.potential}) = \dot {q}\cdot {book.torque}$.",
        ),
        Item(kind="widget", text="energy"),
    ]
    return Chapter(title="Equation of motion", anchor="motion", items=tuple(law))


# Joints: drives and friction.


def _write_joints(robot: Robot) -> Iterator[Chapter]:
    items: list[Item] = []
    rotors = [
        k
        for k, joint in enumerate(robot.joints, start=1)
        if joint.drive.has_rotor and joint.elasticity is None
    ]
    if rotors or robot.couplings:
        names = ", ".join(map(str, rotors))
        items.append(
            Item(
                kind="text",
                text=(
                    f"The rotors of joints {names} turn with their joints: $\\mathit{{IA}}_j\\,\\dot "
                    f"q_j^2/2$ is added to the kinetic "
                    "energy, $\\mathit{IA}_j$ the inertia on the joint side. "
                    if rotors
                    else ""
                )
                + " ".join(
                    f"Drive {one.name} turns with several joints, so its inertia couples them."
                    for one in robot.couplings
                ),
            )
        )
    friction = describe_friction(robot)
    if friction is not None:
        items.append(Item(kind="text", text=friction.sentence))
        items += [
            Item(kind="formula", latex=f"{entry.left_latex} = {entry.latex}") for entry in friction.formulas
        ]
        if friction.check:
            items.append(Item(kind="check", text=friction.check))
    if items:
        yield Chapter(title="Drives and friction", anchor="joints", items=tuple(items))
