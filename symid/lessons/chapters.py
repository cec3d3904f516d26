r"""A lesson as chapters: sentences, formulas, numbers, checks; here those on geometry and parameters.

Robot, book -> `Chapter`s of `Item`s: frames, transforms, velocities, Jacobian, base parameters; the numbers
that formulas start from. Text and formulas only: `page` draws them. In texts `$...$` is LaTeX. A formula with
a `code` has a value at the posture that the reader chooses, from the formula itself.

A language has sentences for those in English, `templates/lesson/LANGUAGE.toml`, in which {0}, {1} stand for
what differs from robot to robot. Such a part is translated too where the table has it.

Supported: robots of the exact algebra; English and German. Not supported: more than one tool; loops; texts of
robot files and comments of code in other languages than their own.
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations_with_replacement, product
from typing import TypeAlias

import numpy as np
from sympy.polys.rings import PolyElement

from symid import dynamics
from symid.environment import locate_resource_folder
from symid.errors import Notice, SymidError
from symid.lessons import textbook
from symid.lessons.matrices import (
    LessonModel,
    build_model,
    build_model_recursion,
    derive_standard_transforms,
    find_standard_rows,
)
from symid.notation import INERTIAL
from symid.robot import Exact, Placement, Robot

WRITTEN_OUT = 3
"""Joints up to which a lesson writes everything out."""
Writer: TypeAlias = Callable[[str], str]
LANGUAGES = ("en", "de")
Words: TypeAlias = Callable[[str], str]
"""A text in English to the same in the language of a lesson; one that the table has not stays."""


@cache
def load_pairs(language: str) -> Mapping[str, str]:
    """Return the sentences of a language by those in English; none for English itself."""
    path = locate_resource_folder("templates") / "lesson" / f"{language}.toml"
    if language == "en":
        return {}
    return dict(tomllib.loads(path.read_text(encoding="utf-8"))["pairs"])


@cache
def load_words(language: str) -> Words:
    """Return what translates texts to one of `LANGUAGES`."""
    pairs = load_pairs(language)
    patterns = []
    # The longest first: what has fewer parts that differ is meant.
    for text in sorted((text for text in pairs if "{0}" in text), key=len, reverse=True):
        # All texts of a form with {0}, {1}; only behind a sign at the end are lists.
        pieces, seen, pattern = re.split(r"\{(\d)\}", text), set[str](), ""
        for k, piece in enumerate(pieces):
            if k % 2 == 0:
                pattern += re.escape(piece)
                continue
            ends = k == len(pieces) - 2 and not pieces[-1] and pieces[k - 1].endswith((": ", ". "))
            any_text = ".+?" if ends else "(?:(?!; |: ).)+?"
            pattern += f"(?P=part{piece})" if piece in seen else f"(?P<part{piece}>{any_text})"
            seen.add(piece)
        patterns.append((re.compile(pattern, re.DOTALL), pairs[text]))

    def translate(text: str) -> str:
        if text in pairs:
            return pairs[text]
        for pattern, form in patterns:
            if match := pattern.fullmatch(text):
                parts = {name: translate(part) for name, part in match.groupdict().items()}
                pieces = enumerate(re.split(r"\{(\d)\}", form))
                return "".join(parts[f"part{piece}"] if k % 2 else piece for k, piece in pieces)
        # A list of reasons, each behind its names.
        for mark in ("; ", ": ") if pairs else ():
            if mark in text:
                return mark.join(map(translate, text.split(mark)))
        return text

    return translate


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


@cache
def _load_texts() -> Mapping[str, tuple[str, tuple[str, ...]]]:
    """Return titles and paragraphs of all chapters, by their addresses."""
    text = (locate_resource_folder("templates") / "lesson" / "chapters.md").read_text(encoding="utf-8")
    found = {}
    for part in text.split("\n# ")[1:]:
        head, *paragraphs = (" ".join(lines.split()) for lines in part.strip().split("\n\n"))
        title, _, key = head.removesuffix("}").rpartition(" {")
        found[key] = title, tuple(paragraphs)
    return found


def fill_chapter(key: str, book: textbook.Book, **parts: str | int | Iterable[Item]) -> Chapter:
    """Return a chapter of `templates/lesson/chapters.md` in the letters of a book, its parts put in."""
    title, paragraphs = _load_texts()[key]
    letters = {"M": book.mass, "C": book.coriolis, "g": book.gravity, "tau": book.torque, "T": book.kinetic}
    letters |= {"V": book.potential, "q": book.coordinates, "angle": book.angle, "slide": book.slide}
    letters |= {"a": book.length, "d": book.offset, "s": book.sine, "c": book.cosine}
    # Angles of rows and of motors: where joints have the letter theta, a row has the same, a motor another.
    theta = "theta" in book.angle
    letters |= {"turn": book.angle if theta else r"\theta"}
    letters |= {"motor": r"{\theta_{\mathrm m}}" if theta else r"\theta"}
    letters |= {name: str(part) for name, part in parts.items() if isinstance(part, str | int)}
    lists = {name: tuple(part) for name, part in parts.items() if not isinstance(part, str | int)}
    items: list[Item] = []
    for paragraph in paragraphs:
        condition = re.match(r"\?(!?)(\w+) ", paragraph)
        if condition and bool(lists.get(condition[2], parts[condition[2]])) is bool(condition[1]):
            continue
        text = paragraph[condition.end() :] if condition else paragraph
        text = re.sub(r"<(\w+)>", lambda match: letters[match[1]], text)
        mark, _, rest = text.partition(" ")
        if listed := re.fullmatch(r"(?:\+(\d*) (.*) )?\{\{(\w+)\}\}", text):
            most, summary, inner = listed[1], listed[2], lists[listed[3]]
            if summary is None or (most and len(inner) <= int(most)):
                items += inner
            else:
                items.append(Item("details", f"{summary} ({len(inner)})" if most else summary, items=inner))
        elif widget := re.fullmatch(r"\[\[([\w-]+)\]\]", text):
            items.append(Item("widget", widget[1]))
        elif mark == "$$":
            items.append(show(rest.removesuffix(" $$")))
        else:
            kind = {">": "check", "~": "hint"}.get(mark)
            items.append(Item(kind, rest) if kind else say(text))
    return Chapter(title, key.partition(" ")[0], tuple(items))


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

    @property
    def formulas(self) -> list[Item]:
        """Return the formulas with values, each after those that it needs."""
        every = list_items([item for chapter in self.chapters for item in chapter.items])
        return [item for item in every if item.name and item.code]


def write_decimals(text: str, language: str, *, tex: bool = False) -> str:
    """Return numbers, or a formula in LaTeX, with the marks of a language: 0,5 and (0; 0,5) in German."""
    comma = r"\1{,}\2" if tex else r"\1,\2"
    found = text if language == "en" else re.sub(r"(?<![\w.])(\d+)\.(\d+)(?![\w.])", comma, text)
    return found if found == text else found.replace(", ", r";\; " if tex else "; ")


def translate_chapter(chapter: Chapter, language: str) -> Chapter:
    """Return a chapter in a language, its formulas as they are but for words and decimal marks inside."""
    words = load_words(language)

    def write(text: str) -> str:
        def formula(inner: str) -> str:
            return f"${write_decimals(inner, language, tex=True)}$"

        found = write_marked(words(text), str, formula, "`{}`".format)
        # Values of a list stand apart as those of a vector do.
        return found if language == "en" else re.sub(r"(\d\}\$), (?=\$)", r"\1; ", found)

    def turn(item: Item) -> Item:
        cells = tuple(
            tuple(write_decimals(text, language) if _NUMBER.fullmatch(text) else write(text) for text in row)
            for row in item.rows
        )
        latex = re.sub(r"\\text\{([^{}]*)\}", lambda match: rf"\text{{{words(match[1])}}}", item.latex)
        latex = write_decimals(latex, language, tex=True)
        text = write(item.text) if item.kind in ("text", "hint", "check", "details") else item.text
        return replace(item, text=text, latex=latex, rows=cells, items=tuple(map(turn, item.items)))

    return replace(chapter, title=words(chapter.title), items=tuple(map(turn, chapter.items)))


_NUMBER = re.compile(r"-?[\d.]+(?:e-?\d+)?")
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
        return (*start, f"$z = ({axis})$", "", "", rf"$\rho = ({origin})$")
    # d of a row whose axis is (0, -sin alpha, cos alpha).
    theta, d = _write_variables(writer, index, _write_degrees(xx, -xy), yz * y + zz * z)
    return (*start, f"${_write_degrees(zz, -yz)}$", f"${_write_exact(x, writer)}$", theta, d)


def _write_variables(writer: ChapterWriter, index: int, turn: str, offset: Exact) -> tuple[str, str]:
    """Return theta and d of a row, the coordinate of its joint in one of them."""
    q, d = writer.coordinate(index), _write_exact(offset, writer)
    slides = writer.model.robot.joints[index].prismatic
    fixed = d if slides else turn
    moving = q if fixed == "0" else f"{q} - {fixed[1:]}" if fixed.startswith("-") else f"{q} + {fixed}"
    return (f"${turn}$", f"${moving}$") if slides else (f"${moving}$", f"${d}$")


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


def write_frames(writer: ChapterWriter) -> Chapter:
    """Return the chapter on the frames: standard rows where book and robot have them, else modified ones."""
    model, book = writer.model, writer.book
    robot, a, d = model.robot, rf"${book.length}$", rf"${book.offset}$"
    theta = f"${book.angle}$" if "theta" in book.angle else r"$\theta$"
    standard = find_standard_rows(robot) if book.standard else ()
    head = ("joint", "name", "type", "parent", r"$\alpha$", a, theta, d)
    rows = [_write_row(writer, index) for index in range(robot.size)]
    if standard:
        head = ("joint", "name", "type", "parent", a, r"$\alpha$", d, theta)
        rows = [_write_standard_row(writer, k, *row) for k, row in enumerate(standard)]
    named = [
        (f"${writer.symbol(name)}$", f"{value:g}", "m/s²" if name == "g" else "m")
        for name, value in model.lengths.items()
    ]
    own = [(name, value) for name, value in robot.symbols if name not in model.lengths]
    letters = [(f"${writer.symbol(name)}$", f"{value:.6g}") for name, value in own]
    followers = [
        rf"Joint {k} follows joint {joint.mimic.master + 1}: ${writer.coordinate(k - 1)} = "
        rf"{'-' if joint.mimic.multiplier < 0 else ''}{textbook.write_number(abs(joint.mimic.multiplier))}"
        rf"\,{writer.coordinate(joint.mimic.master)}$."
        for k, joint in enumerate(robot.joints, start=1)
        if joint.mimic is not None
    ]
    return fill_chapter(
        "frames",
        book,
        standard=bool(standard),
        converted=not standard and robot.convention == "standard",
        table=[Item("table", rows=(head, *rows))],
        lengths=[Item("table", rows=(("letter", "value", "unit"), *named))] if named else [],
        letters=[Item("table", rows=(("letter", "value"), *letters))] if letters else [],
        followers=map(say, followers),
        gravity=", ".join(_write_exact(value, writer) for value in robot.gravity),
    )


def write_matrix(left: str, rows: Sequence[Sequence[str]]) -> Item:
    """Return left = matrix, its elements in LaTeX."""
    body = r" \\ ".join(" & ".join(row) for row in rows)
    return Item("matrix", latex=rf"{left} = \begin{{bmatrix}} {body} \end{{bmatrix}}")


def write_kinematics(writer: ChapterWriter) -> Iterator[Chapter]:
    """Yield the chapters from the transforms to the Jacobian."""
    recursion, robot, algebra = build_model_recursion(writer.model), writer.model.robot, writer.model.algebra
    standard, book = derive_standard_transforms(writer.model) if writer.book.standard else (), writer.book
    matrices = []
    for index, frame in enumerate(recursion.frames):
        rotation = frame.fixed
        if frame.turn is not None:
            (cosine, sine), zero = frame.turn, algebra.zero
            turn = ((cosine, algebra.neg(sine), zero), (sine, cosine, zero), (zero, zero, algebra.one))
            rotation = algebra.multiply_matrices(rotation, turn)
        left = rf"{{}}^{{{robot.joints[index].parent + 1}}}T_{{{index + 1}}}"
        matrices.append(_write_transform(writer, left, rotation, frame.origin))
    # The matrices A of standard rows, and for short robots their product.
    rows, product = [], []
    for number, (rotation, origin) in enumerate(standard, start=1):
        above = f"^{{{number - 1}}}" if book.name == "siciliano" else ""
        rows.append(_write_transform(writer, f"A{above}_{{{number}}}", rotation, origin))
    if 1 < len(standard) <= WRITTEN_OUT:
        (rotation, origin), *others = standard
        for turn, place in others:
            origin = algebra.add_vectors(algebra.apply_matrix(rotation, place), origin)
            rotation = algebra.multiply_matrices(rotation, turn)
        product = [_write_transform(writer, f"T^{{0}}_{{{len(standard)}}}", rotation, origin)]
    transforms = {"rows": rows, "product": product, "matrices": matrices}
    yield fill_chapter("transforms", book, **transforms, long=book.long)
    beyond = robot.size > WRITTEN_OUT + 1
    vectors = [
        write_matrix(rf"{letter}_{{{index + 1}}}", [[writer.latex(x)] for x in vector])
        for index, motion in enumerate(recursion.motions[: 3 if beyond else robot.size])
        for letter, vector in ((r"\omega", motion.angular), ("v", motion.linear))
    ]
    yield fill_chapter("velocities", book, vectors=vectors, beyond=beyond)
    if not beyond:
        jacobian = [dynamics.fold_vector(robot, algebra, row) for row in dynamics.compute_jacobian(recursion)]
        columns = [write_matrix("J", [list(map(writer.latex, row)) for row in jacobian])]
        # Its elements have names and values, but stand in the matrix alone.
        for i, row in enumerate(jacobian, start=1):
            for k, value in enumerate(row, start=1):
                element = writer.formula(f"J_{{{i}{k}}}", value, f"J{i}_{k}")
                columns.append(replace(element, kind="value"))
    else:
        columns = [
            write_matrix(rf"{letter}_{{{k}}}", [[writer.latex(x)] for x in vector])
            for k, pose in enumerate(dynamics.compute_poses(recursion)[:3], start=1)
            for letter, vector in (("z", [row[2] for row in pose.rotation]), ("p", pose.origin))
        ]
    yield fill_chapter("jacobian", book, matrices=columns, beyond=beyond)


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
    own = writer
    if model.form == "base" and writer.book.bodies:
        # Of a long robot, whose formulas are in base parameters.
        own = replace(writer, model=build_model(robot, "bodies", book=writer.book))
    formulas: dict[str, list[Item]] = {"bodies": [], "symbols": [], "closed": []}
    if own.model.form != "base":
        listed = formulas[own.model.form if own is writer else "closed"]
        for entry in base.parameters:
            left, value = writer.symbol(entry.name), own.model.parameters[entry.label]
            unit = dynamics.get_label_unit(robot, entry.label)
            listed.append(own.formula(left, value, f"beta_{entry.name}", unit))
    return fill_chapter(
        "base",
        writer.book,
        total=sum(name in (*INERTIAL, "IA", "KS", "KR") for _, name in base.labels),
        count=base.count,
        groups=[Item("table", rows=tuple(rows), text="base")],
        lost=len(base.eliminated),
        eliminated=[Item("table", rows=lost_rows)],
        **formulas,
    )


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
