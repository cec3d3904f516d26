"""The letters of textbooks: how a lesson writes matrices, coordinates, lengths and parameters in LaTeX.

    symid       M, C, g, tau   q   c_12   first moments, names of Khalil with the group as an upper index
    siciliano   B, C, g, tau   theta      lengths a_i of the link itself (standard Denavit-Hartenberg rows)
    craig       M, V, G, tau   theta      lengths a_{i-1} of modified rows; V is the vector of velocities
    khalil      A, C, Q, Gamma q   C12    lengths d_j and r_j of modified rows; energies E and U

Siciliano, Sciavicco, Villani and Oriolo 2009; Craig 2005; Khalil and Dombre 2002. Letters of the robot file
(l1, m1, g) are kept in every notation.
"""

import re
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

from symid.errors import Notice, UsageError
from symid.lessons.textbook import Angle, Letter, Style

BookName: TypeAlias = Literal["symid", "siciliano", "craig", "khalil"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Book:
    """Letters in LaTeX.

    Attributes:
        name: as the option has it. title: authors, title, year; empty for symid's own.
        mass, coriolis, gravity, torque: the matrices. kinetic, potential: the energies.
        angle, slide: of revolute and prismatic joints. coordinates: the vector of both.
        sine, cosine: of the short form. length, offset: of the table's rows. shift: what the number of a
            length is more than that of its row. long: write cos(q1 + q2) in place of c12.
    """

    name: BookName
    title: str = ""
    mass: str = "M"
    coriolis: str = "C"
    gravity: str = "g"
    torque: str = r"\tau"
    kinetic: str = "T"
    potential: str = "V"
    angle: str = "q"
    slide: str = "q"
    coordinates: str = "q"
    sine: str = "s"
    cosine: str = "c"
    length: str = "a"
    offset: str = "d"
    shift: int = 0
    grouped: str = "{name}_{{{number}}}^{{\\mathrm R}}"
    long: bool = False


_SICILIANO = Book(
    name="siciliano",
    title="Siciliano, Sciavicco, Villani, Oriolo: Robotics - Modelling, Planning and Control (2009)",
    mass="B",
    kinetic=r"\mathcal T",
    potential=r"\mathcal U",
    angle=r"\vartheta",
    slide="d",
    shift=-1,
)
_CRAIG = Book(
    name="craig",
    title="Craig: Introduction to Robotics - Mechanics and Control (3rd edition, 2005)",
    coriolis="C",
    gravity="G",
    kinetic="k",
    potential="u",
    angle=r"\theta",
    slide="d",
    coordinates=r"\Theta",
    shift=-1,
)
_KHALIL = Book(
    name="khalil",
    title="Khalil, Dombre: Modeling, Identification and Control of Robots (2002)",
    mass="A",
    gravity="Q",
    torque=r"\Gamma",
    kinetic="E",
    potential="U",
    slide="r",
    sine="S",
    cosine="C",
    length="d",
    offset="r",
    grouped="{name}_{{\\mathrm R{number}}}",
)
_BOOKS = {book.name: book for book in (Book(name="symid"), _SICILIANO, _CRAIG, _KHALIL)}
BOOK_NAMES: tuple[BookName, ...] = ("symid", "siciliano", "craig", "khalil")


def get_book(name: str, *, angle: str | None = None, long: bool = False) -> Book:
    """Return the letters of a book.

    Args:
        name: one of `BOOK_NAMES`.
        angle: "q" or "theta" in place of the book's own letter of an angle.
        long: whether to write cos(q1 + q2) in place of c12.

    Raises:
        UsageError: there is no such book.
    """
    if name not in _BOOKS:
        text = f"there is no notation {name!r}; it is one of {', '.join(BOOK_NAMES)}"
        raise UsageError(Notice(code="usage.notation", text=text))
    book = replace(_BOOKS[name], long=long)
    letters = {"q": "q", "theta": r"\theta"}
    return replace(book, angle=letters[angle], coordinates=letters[angle]) if angle else book


_COMPOSITE = re.compile(r"^(XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M)c(\d+)$")
_PULL = re.compile(r"^G(\d+)([xyz])$")
_MOMENTUM = re.compile(r"^([FN])(\d+)_(\d+)([xyz])$")
_ROW = re.compile(r"^([ad])(\d+)$")
_RATE = re.compile(r"^(d{0,2})q(\d+)$")
_KHALIL_NAME = re.compile(r"^(XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M|IA|KS|KR)(R?)(\d+)$")
_CENTRE = re.compile(r"^l([xyz])(\d+)$")
_CENTRAL = re.compile(r"^I(\d+)([xyz]{2})$")
_PLAIN = re.compile(r"^([A-Za-z])([A-Za-z]*)_?(\d*)$")
_GREEK = "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi chi psi omega"


def write_symbol(name: str, book: Book, slides: frozenset[int] = frozenset()) -> str:
    """Return the symbol `name` in LaTeX; `slides` are the numbers of prismatic joints."""
    if match := _RATE.match(name):
        letter = book.slide if int(match[2]) in slides else book.angle
        dots = {"": "", "d": r"\dot ", "dd": r"\ddot "}[match[1]]
        return f"{dots}{{{letter}}}_{{{match[2]}}}" if dots else f"{letter}_{{{match[2]}}}"
    if match := _COMPOSITE.match(name):
        return rf"\overline{{\mathit{{{match[1]}}}}}_{{{match[2]}}}"
    if match := _PULL.match(name):
        return rf"{{}}^{{{match[1]}}}g_{{{match[2]}}}"
    if match := _MOMENTUM.match(name):
        letter = "p" if match[1] == "F" else "h"
        return rf"{{}}^{{{match[3]}}}{letter}^{{({match[2]})}}_{{{match[4]}}}"
    if match := _ROW.match(name):
        shift = book.shift if match[1] == "a" else 0
        letter = book.length if match[1] == "a" else book.offset
        return f"{letter}_{{{int(match[2]) + shift}}}"
    if match := _KHALIL_NAME.match(name):
        letters = rf"\mathit{{{match[1]}}}" if len(match[1]) > 1 else match[1]
        if match[2]:
            return book.grouped.format(name=letters, number=match[3])
        return f"{letters}_{{{match[3]}}}"
    if match := _CENTRE.match(name):
        return f"\\ell_{{{match[2]}{match[1]}}}"
    if match := _CENTRAL.match(name):
        return f"I_{{{match[1]},{match[2]}}}"
    return _write_plain(name)


def _write_plain(name: str) -> str:
    head = name.rstrip("0123456789_")
    if head.lower() in _GREEK.split():
        number = name[len(head) :].strip("_")
        return f"\\{head}_{{{number}}}" if number else f"\\{head}"
    if match := _PLAIN.match(name):
        word = rf"\mathrm{{{match[2]}}}" if match[2] else ""
        below = f"{word}{match[3]}"
        return f"{match[1]}_{{{below}}}" if below else match[1]
    escaped = name.replace("_", r"\_")
    return rf"\mathit{{{escaped}}}"


def write_angle(angle: Angle, book: Book) -> str:
    """Return a sum of joint angles."""
    text = "".join(f" {'+' if sign > 0 else '-'} {book.angle}_{{{number}}}" for number, sign in angle)
    return text.removeprefix(" + ")


def _write_wave(kind: str, angle: Angle, power: int, book: Book) -> str:
    above = f"^{{{power}}}" if power > 1 else ""
    simple = all(sign > 0 for _, sign in angle)
    if book.long:
        name = r"\sin" if kind == "s" else r"\cos"
        inner = write_angle(angle, book)
        return rf"{name}{above} {inner}" if len(angle) == 1 else rf"{name}{above}({inner})"
    letter = book.sine if kind == "s" else book.cosine
    comma = "," if any(number > 9 for number, _ in angle) else ""
    numbers = [f"{'' if sign > 0 else '-'}{number}" for number, sign in angle]
    below = comma.join(numbers) if simple else "".join(numbers)
    return f"{letter}_{{{below}}}{above}"


def _write_letter(book: Book, slides: frozenset[int], letter: Letter, power: int) -> str:
    if isinstance(letter, str):
        text = write_symbol(letter, book, slides)
        if power == 1:
            return text
        busy = "^" in text or text.startswith(r"\d")
        return (
            f"({text})^{{{power}}}"
            if "^" in text
            else f"{text}^{{{power}}}"
            if not busy
            else f"{text}^{{\\,{power}}}"
        )
    kind, what = letter
    if isinstance(what, int):
        return rf"\sqrt{{{what}}}"
    return _write_wave(kind, what, power, book)


def build_style(book: Book, slides: frozenset[int] = frozenset()) -> Style:
    """Return how sums are written in the letters of a book."""
    return Style(write=partial(_write_letter, book, slides))
