r"""A lesson as chapters: sentences, formulas, numbers, checks; here those on geometry and parameters.

Robot, book -> `Chapter`s of `Item`s: frames, transforms, velocities, Jacobian, base parameters; the numbers
that formulas start from. Text and formulas only: `page` draws them. In texts `$...$` is LaTeX. A formula with
a `code` has a value at the posture that the reader chooses, from the formula itself.

Supported: robots of the exact algebra. Not supported: more than one tool; loops.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product
from typing import TypeAlias

import numpy as np
from sympy.polys.rings import PolyElement

from symid import dynamics
from symid.errors import Notice, SymidError
from symid.lessons import textbook
from symid.lessons.matrices import (
    LessonModel,
    build_model,
    build_model_recursion,
    derive_standard_transforms,
    find_standard_rows,
)
from symid.lessons.words import Words
from symid.notation import INERTIAL
from symid.robot import Exact, Placement, Robot

WRITTEN_OUT = 3
"""Joints up to which a lesson writes everything out."""
Writer: TypeAlias = Callable[[str], str]


@dataclass(frozen=True, slots=True)
class Item:
    """A piece of a chapter.

    Args:
        kind: "text", "formula", "matrix", "table", "check"; "widget" and "hint" of the page alone.
        text: of a text or check; the summary where there are `items`, which a reader opens; the right side of
            a formula in plain letters of the book.
        latex: of a formula. name: of its value, for later formulas. code: its value in JavaScript.
        sympy: the right side for SymPy. unit: of the value.
        rows: of a table, the first its head; or of a matrix of formulas.
    """

    kind: str
    text: str = ""
    latex: str = ""
    name: str = ""
    code: str = ""
    sympy: str = ""
    unit: str = ""
    rows: tuple[tuple[str, ...], ...] = ()
    items: tuple["Item", ...] = ()


def say(text: str) -> Item:
    """Return a text."""
    return Item("text", text)


def show(latex: str) -> Item:
    """Return a formula without a value."""
    return Item("formula", latex=latex)


@dataclass(frozen=True, slots=True)
class Chapter:
    """A numbered chapter: its title, and an anchor for the list of contents."""

    title: str
    anchor: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """A derivation for the page: chapters, and the numbers that its formulas start from.

    Attributes:
        robot: of the file. model: what the formulas are written in. book: their letters.
        values: of lengths and parameters. stand_ins: whether some were made up.
        beta: the base parameters, in the order of generated functions. language: one of `LANGUAGES`.
        title: in place of that of the robot. author: below it.
    """

    robot: Robot
    model: LessonModel
    book: textbook.Book
    chapters: tuple[Chapter, ...]
    values: Mapping[str, float]
    beta: tuple[float, ...]
    stand_ins: bool
    language: str
    title: str = ""
    author: str = ""


def translate_chapter(chapter: Chapter, words: Words) -> Chapter:
    """Return a chapter in the language of `words`, its formulas as they are but for words inside."""

    def turn(item: Item) -> Item:
        cells = tuple(tuple(map(words, row)) for row in item.rows)
        latex = re.sub(r"\\text\{([^{}]*)\}", lambda match: rf"\text{{{words(match[1])}}}", item.latex)
        text = words(item.text) if item.kind in ("text", "hint", "check", "details") else item.text
        return replace(item, text=text, latex=latex, rows=cells, items=tuple(map(turn, item.items)))

    return replace(chapter, title=words(chapter.title), items=tuple(map(turn, chapter.items)))


_MARKED = re.compile(r"(\$[^$]+\$|`[^`]+`)")


def write_marked(text: str, plain: Writer, formula: Writer, code: Writer) -> str:
    """Return a text by what its plain parts, its $formulas$ and its `code` become."""
    write = {"$": formula, "`": code}
    parts = enumerate(_MARKED.split(text))
    return "".join(write[part[0]](part[1:-1]) if k % 2 else plain(part) for k, part in parts)


def list_items(items: Sequence[Item]) -> Iterator[Item]:
    """Yield items with those inside of them."""
    for item in items:
        yield item
        yield from list_items(item.items)


def require(holds: bool, otherwise: str) -> None:  # noqa: FBT001  reads as an assertion
    """Raise if an identity does not hold: then symid itself is wrong."""
    if not holds:
        text = f"the lesson contradicts itself: {otherwise}; please report this robot"
        raise SymidError(Notice(code="dynamics.contradiction", text=text))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChapterWriter:
    """Writes polynomials of a model in the letters of a book; every formula is read back and compared."""

    model: LessonModel
    book: textbook.Book
    style: textbook.Style

    def write(self, value: PolyElement) -> textbook.Sum:
        """Return a polynomial as a textbook writes it."""
        total = textbook.write_sum(value, self.model.sums)
        require(textbook.expand_sum(total, self.model.algebra) == value, "a formula is not what was derived")
        return total

    def latex(self, value: PolyElement) -> str:
        """Return the same in LaTeX."""
        return textbook.write_latex(self.write(value), self.style)

    def formula(self, left: str, value: PolyElement, name: str = "", unit: str = "") -> Item:
        """Return left = value with its value by `name`, and the right side for SymPy."""
        total = self.write(value)
        return Item(
            "formula",
            latex=f"{left} = {textbook.write_latex(total, self.style)}",
            name=name,
            code=textbook.write_code(total, "v") if name else "",
            sympy=textbook.write_code(total),
            text=textbook.write_text(total, self.book, list_slides(self.model.robot)).replace("**", "^"),
            unit=unit.replace("^2", "²"),
        )

    def symbol(self, name: str) -> str:
        """Return a symbol in LaTeX."""
        return textbook.write_symbol(name, self.book, list_slides(self.model.robot))

    def coordinate(self, joint: int, dots: str = "") -> str:
        """Return the coordinate of a joint, `dots` d for its rate, in LaTeX."""
        return self.symbol(f"{dots}q{joint + 1}")


def list_slides(robot: Robot) -> frozenset[int]:
    """Return the numbers of prismatic joints."""
    return frozenset(k for k, joint in enumerate(robot.joints, start=1) if joint.prismatic)


def build_values(robot: Robot, model: LessonModel) -> tuple[dict[str, float], tuple[float, ...], bool]:
    """Return the values of all letters, of beta, and whether links of the file lack values.

    Links without values get those of a rod of 3 kg, less by a quarter from link to link, that reaches half
    the way to the next joint: what a page needs to move, and says that it made up.
    """
    bodies = [joint.inertial or _make_body(robot, index) for index, joint in enumerate(robot.joints)]
    base = dynamics.derive_base_parameters(robot)
    known = dynamics.compute_parameter_values(robot, base)
    missing = [entry for entry in base.parameters if entry.name not in known]
    pairs = product(enumerate(bodies), enumerate(INERTIAL))
    numbers = {(link, name): body[k] for (link, body), (k, name) in pairs}
    rotors = {link: joint.drive.rotor_inertia for link, joint in enumerate(robot.joints)}
    numbers |= {(link, "IA"): value for link, value in rotors.items() if value is not None}
    defaults = {"IA": 0.1, "KS": 10.0, "KR": 0.0}
    grouping = dynamics.build_grouping(robot, base)
    standard = np.array([numbers.get(label, defaults.get(label[1], 0.0)) for label in grouping.labels])
    made = zip(grouping.parameters, map(float, grouping.matrix @ standard), strict=True)
    stand_ins = {entry.name: value for entry, value in made}
    beta = {entry.name: known.get(entry.name, stand_ins[entry.name]) for entry in base.parameters}
    drives = {
        dynamics.write_label(robot, label): x
        for label, x in zip(grouping.labels, standard.tolist(), strict=True)
        if label[1] == "IA"
    }
    values = {**dict(model.robot.symbols), **drives, **beta}
    for number, body in enumerate(bodies, start=1):
        # Mass, centre of mass and central inertia by the letters of lessons.
        mass = body[9]
        c = np.array(body[6:9]) / mass if mass else np.zeros(3)
        central = np.array(body[:6]) - (mass * (c @ c * np.eye(3) - np.outer(c, c)))[np.triu_indices(3)]
        places = combinations_with_replacement("xyz", 2)
        values |= {f"m{number}": mass}
        values |= {f"l{axis}{number}": x for axis, x in zip("xyz", c.tolist(), strict=True)}
        values |= {f"I{number}{i}{j}": x for (i, j), x in zip(places, central.tolist(), strict=True)}
    return values, tuple(beta.values()), bool(missing)


def _make_body(robot: Robot, index: int) -> tuple[float, ...]:
    """Return the ten parameters of a stand-in: a rod with thickness, and its mass in the middle."""
    symbols = dict(robot.symbols)
    after = [joint for joint in robot.joints if joint.parent == index]
    end = [value.to_float(symbols) for value in after[0].placement.translation] if after else [0.1, 0.0, 0.05]
    if not any(end):
        end = [0.02, 0.03, 0.1]
    mass, c = 3.0 * 0.75**index, np.array(end) / 2
    tensor = mass * (c @ c * np.eye(3) - np.outer(c, c)) * (4.0 / 3.0) + 0.002 * mass * np.eye(3)
    return (*tensor[np.triu_indices(3)].tolist(), *(mass * c).tolist(), mass)


def find_tip(robot: Robot, index: int) -> tuple[float, float, float]:
    """Return twice the centre of mass of a link: where a drawing lets a last link end."""
    body = robot.joints[index].inertial or _make_body(robot, index)
    x, y, z = (2.0 * moment / body[9] if body[9] else 0.0 for moment in body[6:9])
    return x, y, z


# Geometry.


def _write_exact(value: Exact, writer: ChapterWriter) -> str:
    return writer.latex(writer.model.algebra.constant(value))


def _write_degrees(cosine: Exact, sine: Exact) -> str:
    """Return an angle from its cosine and sine: a multiple of pi, else in degrees."""
    angle = float(np.arctan2(sine.to_float(), cosine.to_float()))
    twelfths = round(angle / (np.pi / 12))
    if abs(angle - twelfths * np.pi / 12) > 1e-9:
        return rf"{np.degrees(angle):.6g}^\circ"
    if not twelfths:
        return "0"
    top, bottom = twelfths // np.gcd(twelfths, 12), 12 // np.gcd(twelfths, 12)
    number = {1: r"\pi", -1: r"-\pi"}.get(int(top), rf"{top}\pi")
    return number if bottom == 1 else rf"{'-' if top < 0 else ''}\tfrac{{{number.lstrip('-')}}}{{{bottom}}}"


def _write_row(writer: ChapterWriter, index: int) -> tuple[str, ...]:
    """Return the row of a joint: type, parent, alpha, a, theta, d where it has one, else its placement."""
    joint = writer.model.robot.joints[index]
    (xx, xy, xz), (_, _, yz), (_, _, zz) = joint.placement.rotation
    x, y, z = joint.placement.translation
    kind = "prismatic" if joint.prismatic else "revolute"
    start = (str(index + 1), joint.name, kind, str(joint.parent + 1) if joint.parent >= 0 else "base")
    if xz:
        axis = ", ".join(_write_exact(value, writer) for value in (xz, yz, zz))
        origin = ", ".join(_write_exact(value, writer) for value in (x, y, z))
        return (*start, f"$z = ({axis})$", "", "", f"$p = ({origin})$")
    # d of a row whose axis is (0, -sin alpha, cos alpha).
    theta, d = _write_variables(writer, index, _write_degrees(xx, -xy), yz * y + zz * z)
    return (*start, f"${_write_degrees(zz, -yz)}$", f"${_write_exact(x, writer)}$", theta, d)


def _write_variables(writer: ChapterWriter, index: int, turn: str, offset: Exact) -> tuple[str, str]:
    """Return theta and d of a row, the coordinate of its joint in one of them."""
    q, d = writer.coordinate(index), _write_exact(offset, writer)
    if writer.model.robot.joints[index].prismatic:
        return f"${turn}$", f"${q} + {d}$" if d != "0" else f"${q}$"
    return f"${q} + {turn}$" if turn != "0" else f"${q}$", f"${d}$"


def _write_standard_row(
    writer: ChapterWriter, index: int, near: Placement, far: Placement
) -> tuple[str, ...]:
    """Return the standard row of a joint: type, parent, a, alpha, d, theta."""
    joint, ((xx, _, _), (yx, _, _), _) = writer.model.robot.joints[index], near.rotation
    theta, d = _write_variables(writer, index, _write_degrees(xx, yx), near.translation[2])
    length, turn = (
        _write_exact(far.translation[0], writer),
        _write_degrees(far.rotation[2][2], far.rotation[2][1]),
    )
    start = str(index + 1), joint.name, "prismatic" if joint.prismatic else "revolute"
    return (*start, str(index) if index else "base", f"${length}$", f"${turn}$", d, theta)


def _write_table(writer: ChapterWriter) -> Iterator[Item]:
    """Yield the table of frames: standard rows where book and robot have them, else modified ones."""
    book, robot = writer.book, writer.model.robot
    a, d = rf"${book.length}$", rf"${book.offset}$"
    standard = find_standard_rows(robot) if book.standard else ()
    if standard:
        yield say(
            f"Frame $j$ is fixed to link $j$; its $z$ axis is the axis of joint $j + 1$. The table has the "
            f"standard Denavit-Hartenberg parameters: from frame $j - 1$, turn by $\\theta$ about its $z$ "
            f"axis, the axis of joint $j$, move by {d} along it, move by {a} along the new $x$ axis, turn by "
            f"$\\alpha$ about it."
        )
        head = ("joint", "name", "type", "parent", a, r"$\alpha$", d, r"$\theta$")
        yield Item(
            "table",
            rows=(head, *(_write_standard_row(writer, k, *row) for k, row in enumerate(standard))),
        )
        yield say(
            "Below, from the velocities on, frame $j$ is the one that the table reaches after its first two "
            "steps: its $z$ axis is the axis of joint $j$ itself, so that the parameters of link $j$ are "
            "about its own axis. The drawing shows these frames."
        )
        return
    yield say(
        f"Every link has a frame whose $z$ axis is the axis of its joint. The table has the modified "
        f"Denavit-Hartenberg parameters: from the frame of the parent, turn by $\\alpha$ about $x$, move by "
        f"{a} along it, turn by $\\theta$ about the new $z$, move by {d} along it."
    )
    if robot.convention == "standard":
        yield say("The file has standard rows; they were converted exactly.")
    head = ("joint", "name", "type", "parent", r"$\alpha$", a, r"$\theta$", d)
    yield Item("table", rows=(head, *(_write_row(writer, index) for index in range(robot.size))))


def write_frames(writer: ChapterWriter) -> Chapter:
    """Return the chapter on the frames."""
    model = writer.model
    items = [*_write_table(writer), Item("widget", "frames")]
    if model.lengths:
        named = [
            (f"${writer.symbol(name)}$", f"{value:g}", "m/s²" if name == "g" else "m")
            for name, value in model.lengths.items()
        ]
        items.append(say("Lengths of the file have names, so that formulas show where they come from:"))
        items.append(Item("table", rows=(("letter", "value", "unit"), *named)))
    followers = [
        rf"Joint {k} follows joint {joint.mimic.master + 1}: ${writer.coordinate(k - 1)} = "
        rf"{'-' if joint.mimic.multiplier < 0 else ''}{textbook.write_number(abs(joint.mimic.multiplier))}"
        rf"\,{writer.coordinate(joint.mimic.master)}$."
        for k, joint in enumerate(model.robot.joints, start=1)
        if joint.mimic is not None
    ]
    items += map(say, followers)
    gravity = ", ".join(_write_exact(value, writer) for value in model.robot.gravity)
    items.append(say(f"Gravity is $({gravity})$ in the base frame."))
    return Chapter("Frames", "frames", tuple(items))


def write_matrix(left: str, rows: Sequence[Sequence[str]]) -> Item:
    """Return left = matrix, its elements in LaTeX."""
    body = r" \\ ".join(" & ".join(row) for row in rows)
    return Item("matrix", latex=rf"{left} = \begin{{bmatrix}} {body} \end{{bmatrix}}")


def _fold(items: Sequence[Item], title: str, most: int = 4) -> tuple[Item, ...]:
    """Return the items, closed under a title where there are many."""
    if len(items) <= most:
        return tuple(items)
    return (Item("details", f"{title} ({len(items)})", items=tuple(items)),)


def write_kinematics(writer: ChapterWriter) -> Iterator[Chapter]:
    """Yield the chapters from the transforms to the Jacobian."""
    recursion, robot, algebra = build_model_recursion(writer.model), writer.model.robot, writer.model.algebra
    standard = derive_standard_transforms(writer.model) if writer.book.standard else ()
    s, c = writer.book.sine, writer.book.cosine
    short = (
        f"${s}_j$ and ${c}_j$ stand for sine and cosine of the angle of joint $j$, ${c}_{{12}}$ for the "
        "cosine of the sum of two."
    )
    frames = "Rotation and origin of the frame of link $j$, in the frame of its parent:"
    if standard:
        frames = "The same for the frames of the velocities below, each in that of the link before:"
    matrices = []
    for index, frame in enumerate(recursion.frames):
        rotation = frame.fixed
        if frame.turn is not None:
            (cosine, sine), zero = frame.turn, algebra.zero
            turn = ((cosine, algebra.neg(sine), zero), (sine, cosine, zero), (zero, zero, algebra.one))
            rotation = algebra.multiply_matrices(rotation, turn)
        left = rf"{{}}^{{{robot.joints[index].parent + 1}}}T_{{{index + 1}}}"
        matrices.append(_write_transform(writer, left, rotation, frame.origin))
    items: tuple[Item, ...] = (
        *_write_standard(writer, standard),
        *(() if writer.book.long else (say(short),)),
        say(frames),
        *_fold(matrices, "All transforms"),
    )
    yield Chapter("Transforms", "transforms", items)
    law = (
        r"\omega_j = R_j^{\mathsf T}\,\omega_{j-1} + \dot q_j\, z, \qquad "
        r"v_j = R_j^{\mathsf T}\,(v_{j-1} + \omega_{j-1}\times p_j)"
    )
    shown = range(robot.size) if robot.size <= WRITTEN_OUT + 1 else range(3)
    vectors = []
    for index in shown:
        motion = recursion.motions[index]
        for letter, vector in ((r"\omega", motion.angular), ("v", motion.linear)):
            vectors.append(write_matrix(rf"{letter}_{{{index + 1}}}", [[writer.latex(x)] for x in vector]))
    items = (
        say(
            r"From the base outwards: the velocity of the link before, in the axes of this link, plus that "
            r"of its own joint. $R_j$ and $p_j$ are rotation and origin in the transform above. At a "
            r"revolute joint,"
        ),
        show(law.replace(r"\dot q", rf"\dot {writer.book.angle}")),
        say(rf"A prismatic joint adds $\dot {writer.book.slide}_j\, z$ to $v_j$ instead."),
        *_fold(vectors, "Velocities of the links", 8),
    )
    if len(shown) < robot.size:
        items += (say("The links beyond go on in the same way; below, composite bodies take their place."),)
    yield Chapter("Velocities", "velocities", items)
    items = (
        say(
            "The column of joint $j$ is the velocity of the last link, at the origin $p_e$ of the last frame "
            "of the table, per unit of its rate. With the axis $z_j$ and a point $p_j$ on it, in the base "
            "frame, it is for a revolute joint, and for a prismatic one,"
        ),
        show(
            r"J_j = \begin{bmatrix} z_j \times (p_e - p_j) \\ z_j \end{bmatrix}, \qquad "
            r"J_j = \begin{bmatrix} z_j \\ 0 \end{bmatrix}."
        ),
    )
    if robot.size <= WRITTEN_OUT + 1:
        folded = (dynamics.fold_vector(robot, algebra, row) for row in dynamics.compute_jacobian(recursion))
        items += (write_matrix("J", [list(map(writer.latex, row)) for row in folded]),)
    else:
        for k, pose in enumerate(dynamics.compute_poses(recursion)[:3], start=1):
            axis, origin = [row[2] for row in pose.rotation], pose.origin
            items += (write_matrix(rf"z_{{{k}}}", [[writer.latex(x)] for x in axis]),)
            items += (write_matrix(rf"p_{{{k}}}", [[writer.latex(x)] for x in origin]),)
        items += (say("Those beyond are products of the transforms; their numbers follow the posture."),)
    items += (Item("widget", "jacobian"),)
    yield Chapter("Jacobian", "jacobian", items)


def _write_standard(
    writer: ChapterWriter,
    transforms: Sequence[tuple[dynamics.Matrix[PolyElement], dynamics.Vector[PolyElement]]],
) -> Iterator[Item]:
    """Yield the matrices A of standard rows, and for short robots their product."""
    if not transforms:
        return
    algebra, upper = writer.model.algebra, writer.book.name == "siciliano"
    yield say("A row of the table is a homogeneous transform, from frame $j - 1$ to frame $j$:")
    total: tuple[dynamics.Matrix[PolyElement], dynamics.Vector[PolyElement]] | None = None
    items = []
    for number, (rotation, origin) in enumerate(transforms, start=1):
        items.append(
            _write_transform(
                writer, f"A{f'^{{{number - 1}}}' if upper else ''}_{{{number}}}", rotation, origin
            )
        )
        if total is None:
            total = rotation, origin
        else:
            moved = algebra.add_vectors(algebra.apply_matrix(total[0], origin), total[1])
            total = algebra.multiply_matrices(total[0], rotation), moved
    yield from _fold(items, "All matrices $A$")
    if total is not None and 1 < len(transforms) <= WRITTEN_OUT:
        yield say("Their product places the last frame in the base:")
        yield _write_transform(writer, f"T^{{0}}_{{{len(transforms)}}}", *total)


def _write_transform(
    writer: ChapterWriter,
    left: str,
    rotation: dynamics.Matrix[PolyElement],
    origin: dynamics.Vector[PolyElement],
) -> Item:
    rows = [[writer.latex(value) for value in (*row, x)] for row, x in zip(rotation, origin, strict=True)]
    return write_matrix(left, [*rows, ["0", "0", "0", "1"]])


# Parameters.


def write_base(writer: ChapterWriter) -> Chapter:
    """Return the chapter on base parameters, each group with its reason."""
    model = writer.model
    robot, base = model.robot, model.base
    total = sum(name in (*INERTIAL, "IA", "KS", "KR") for _, name in base.labels)
    rows = [("name", "stands for", "why", "show")]
    for entry in base.parameters:
        # The drawing shows what lies on the axis of a joint: of the first such member of the group.
        members = (label for label, _ in entry.terms[1:] if label[0] < robot.size)
        turned = (
            (k, name) for k, name in members if name in ("M", "MZ", "YY") and not robot.joints[k].prismatic
        )
        shown = next((f"show:{k + 1}:{name}" for k, name in turned), "")
        terms = _write_group(writer, entry)
        rows.append((f"${writer.symbol(entry.name)}$", f"${terms}$", entry.reason, shown))
    gone: dict[str, list[str]] = {}
    for lost in base.eliminated:
        gone.setdefault(lost.reason, []).append(f"${writer.symbol(dynamics.write_label(robot, lost.label))}$")
    lost_rows = (("eliminated", "why"), *((", ".join(names), reason) for reason, names in gone.items()))
    lost_title = f"What no torque shows alone ({len(base.eliminated)} parameters)"
    items = [
        say(
            f"The energies are linear in the {total} standard parameters of links, rotors and springs. Only "
            f"{base.count} combinations of them change any torque: the base parameters, found exactly from "
            f"the energies (Gautier and Khalil 1990). Each has a reason."
        ),
        Item("hint", 'A button "show" plays the motion that does not separate the members of a group.'),
        Item("table", rows=tuple(rows), text="base"),
        Item("details", lost_title, items=(Item("table", rows=lost_rows),)),
    ]
    own = writer
    if model.form == "base" and writer.book.bodies:
        # Of a long robot, whose formulas are in base parameters.
        own = replace(writer, model=build_model(robot, "bodies", book=writer.book))
    if own.model.form != "base":
        formulas = []
        for entry in base.parameters:
            left, value = writer.symbol(entry.name), own.model.parameters[entry.label]
            unit = dynamics.get_label_unit(robot, entry.label)
            formulas.append(own.formula(left, value, f"beta_{entry.name}", unit))
        title = "In masses, centres of mass and central inertias"
        if own.model.form == "symbols":
            title = "In the letters of the robot file"
        items += [say(f"{title}:"), *formulas] if own is writer else _fold(formulas, title, 0)
    return Chapter("Base parameters", "base", tuple(items))


def _write_group(writer: ChapterWriter, entry: dynamics.BaseParameter) -> str:
    """Return a group as a sum of standard parameters with factors in lengths."""
    text = ""
    for label, factor in entry.terms:
        symbol = writer.symbol(dynamics.write_label(writer.model.robot, label))
        try:
            share = writer.write(writer.model.algebra.ring.from_expr(factor))
        except (ValueError, TypeError):
            return rf"\text{{{entry.expression}}}"
        written = textbook.write_latex(share, writer.style)
        negative = len(share.products) == 1 and written.startswith("-")
        written = written.removeprefix("-") if negative else written
        bracket = f"({written})" if len(share.products) > 1 else written
        product = symbol if bracket == "1" else rf"{bracket}\,{symbol}"
        text += f" {'-' if negative else '+'} {product}" if text else f"{'-' if negative else ''}{product}"
    return text
