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
    fill_chapter,
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
from symid.robot import Robot

_MOST_TERMS = 24
"""Products of the longest element of M with which four joints are written out too."""


def build_lesson(
    robot: Robot, book: Book, form: matrices.Parameterisation | None = None, language: str = "en"
) -> Lesson:
    """Return the lesson on `robot` in the letters of `book`; a SymidError where derivations do not agree."""
    if book.name == "symid" and robot.convention == "standard":
        book = replace(book, standard=True, shift=-1)
    slides, names = list_slides(robot), {name for name, _ in robot.symbols}
    if names & {write_name(f"q{number}", book, slides) for number in range(1, robot.size + 1)}:
        # No coordinate is called as a symbol of the file.
        book = replace(book, angle="q", slide="q", coordinates="q")
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
    writer = ChapterWriter(model=model, book=book, style=build_style(book, slides))
    values, beta, stand_ins = build_values(robot, model)
    chapters = [write_frames(writer), *write_kinematics(writer)]
    if isinstance(derived, matrices.Equations):
        chapters += _write_short(writer, derived)
    else:
        chapters += _write_long(writer, derived)
    chapters += [*_write_joints(robot), *_write_elastic(robot, book)]
    return Lesson(
        robot=robot,
        model=model,
        book=book,
        chapters=tuple(translate_chapter(chapter, language) for chapter in chapters),
        values=values,
        beta=beta,
        stand_ins=stand_ins,
        language=language,
    )


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
    model, book = writer.model, writer.book
    yield fill_chapter(
        "energies",
        book,
        energies=(
            writer.formula(book.kinetic, equations.kinetic, "T_", "J"),
            writer.formula(book.potential, equations.potential, "V_", "J"),
        ),
        slopes=_write_slopes(writer, _list_energy_slopes(writer, equations)),
    )
    yield write_base(writer)
    curved = matrices.check_mass_is_curvature(equations)
    require(curved, "M is not the second derivative of the kinetic energy")
    texts = [[writer.latex(value) for value in row] for row in equations.mass]
    mass = []
    if len(texts) <= 2 and _is_small(texts, 120):
        shown = [[r"\text{sym.}" if j < i else x for j, x in enumerate(row)] for i, row in enumerate(texts)]
        mass.append(write_matrix(book.mass, shown))
    for i, row in enumerate(equations.mass):
        for j, value in enumerate(row[i:], start=i):
            unit = _find_unit(writer, i, j)
            left = rf"{book.mass}_{{{i + 1}{j + 1}}}"
            mass.append(writer.formula(left, value, f"M{i + 1}_{j + 1}", unit))
    yield fill_chapter("mass", book, elements=_gather_zeros(mass))
    yield _write_coriolis(writer, equations)
    yield fill_chapter("gravity", book, elements=_write_gravity(writer, equations.gravity))
    require(matrices.check_newton_euler(equations), "Lagrange and Newton-Euler differ")
    require(matrices.check_power(equations), "the power of the torques is not the change of the energy")
    columns = compute_torque_columns(matrices.build_model_recursion(model), model.base.keys)
    slopes = (
        (f"{book.torque}_{{{k}}}", entry.name, value)
        for entry in model.base.parameters
        for k, value in enumerate(fold_vector(model.robot, model.algebra, columns[entry.label]), start=1)
    )
    yield fill_chapter("motion", book, craig=book.name == "craig", slopes=_write_slopes(writer, slopes))


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
    found = [replace(item, kind="value") if item in zero else item for item in items]
    told = "This is zero" if len(zero) == 1 else "These are zero"
    return [*found, *([say(f"{told}: {names}.")] if zero else [])]


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
    # Christoffel symbols that differ by more than a sign and a number have letters: h, or h with a number,
    # or another letter where the robot file has such symbols.
    known = " ".join(name for name, _ in writer.model.robot.symbols)
    head = next(x for x in "hbefuw" if not re.search(rf"\b{x}_?\d*\b", known))
    found: dict[tuple[int, int, int], PolyElement] = {}
    for place, value in equations.christoffel.items():
        if value and not any(_find_ratio(value, other) for other in found.values()):
            found[place] = value
    named, symbols = list[tuple[str, str, PolyElement]](), []
    for number, (place, value) in enumerate(found.items(), start=1):
        letter = head if len(found) == 1 else f"{head}_{{{number}}}"
        turning = sum(not writer.model.robot.axes[joint].prismatic for joint in place)
        indices = [str(joint + 1) for joint in place]
        named.append((letter, f"h{'_'.join(indices)}", value))
        left, unit = f"{letter} = c_{{{''.join(indices)}}}", ("kg", "kg m", "kg m²")[turning - 1]
        symbols.append(writer.formula(left, value, named[-1][1], unit))
    products = _write_products(writer, equations, named) if named else []
    return fill_chapter("coriolis", writer.book, symbols=symbols, elements=products)


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


# Long robots: composite bodies.


def _write_long(writer: ChapterWriter, composites: matrices.Composites) -> Iterator[Chapter]:
    require(matrices.check_composites(composites), "the named quantities do not give the matrices")
    book, comma = writer.book, "," if writer.model.robot.size > 9 else ""
    yield write_base(writer)
    named: dict[str, list[Item]] = {"body": [], "gravity": [], "momentum": []}
    for entry in composites.definitions:
        named[entry.kind].append(writer.formula(writer.symbol(entry.name), entry.value, entry.name))
    yield fill_chapter("composites", book, **named)
    rows: dict[int, list[Item]] = {}
    for (i, j), value in sorted(composites.mass.items()):
        left, unit = rf"{book.mass}_{{{i + 1}{comma}{j + 1}}}", _find_unit(writer, i, j)
        rows.setdefault(i, []).append(writer.formula(left, value, f"M{i + 1}_{j + 1}", unit))
    folded = [
        Item("details", f"Row {i + 1}", items=tuple(_gather_zeros(row)), name="open" if i < 3 else "")
        for i, row in rows.items()
    ]
    yield fill_chapter("mass long", book, rows=folded)
    yield fill_chapter("gravity long", book, elements=_write_gravity(writer, composites.gravity))
    yield fill_chapter("motion long", book, craig=book.name == "craig")


# Joints: drives and friction.


def _write_joints(robot: Robot) -> Iterator[Chapter]:
    items: list[Item] = []
    numbers = enumerate(robot.joints, start=1)
    rotors = [str(k) for k, joint in numbers if joint.drive.has_rotor and joint.elasticity is None]
    if rotors or robot.couplings:
        text = f"The rotors of joints {', '.join(rotors)} turn with their joints: $\\mathit{{IA}}_j\\,\\dot "
        text += "q_j^2/2$ is added to the kinetic energy, $\\mathit{IA}_j$ the inertia on the joint side. "
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


def _write_elastic(robot: Robot, book: Book) -> Iterator[Chapter]:
    """Yield the chapters on elastic joints; none where no joint is elastic."""
    springs = {str(k): joint.elasticity for k, joint in enumerate(robot.joints, start=1) if joint.elasticity}
    if not springs:
        return
    where = "All joints are" if len(springs) == robot.size else f"Joints {', '.join(springs)} are"
    yield fill_chapter("sides", book, where=where)
    cubic, knees = (any(getattr(spring, part) for spring in springs.values()) for part in ("cubic", "knees"))
    rows = [("joint", "part", "threshold", "stiffness, N m/rad (knees: slope)")]
    for number, one in springs.items():
        rows.append((number, "$k_0$", "-", f"{one.stiffness:g}" if one.stiffness else "open"))
        for k, stop in enumerate(one.stops, start=1):
            value = "open" if stop.stiffness is None else f"{stop.stiffness:g}"
            rows.append((number, f"stop $k_{k}$", rf"$r_{k} = {stop.threshold:g}$ rad", value))
        for k, knee in enumerate(one.knees, start=1):
            rows.append((number, f"knee $s_{k}$", rf"$R_{k} = {knee.threshold:g}$ N m", f"{knee.slope:g}"))
    others = ", ".join(sorted({branch.kind for spring in springs.values() for branch in spring.branches}))
    yield fill_chapter("springs", book, cubic=cubic, table=[Item("table", rows=tuple(rows))], others=others)
    yield fill_chapter("springs-energy", book, knees=knees)
    yield fill_chapter("two-step", book)
