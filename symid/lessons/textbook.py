"""Exact polynomials written as a textbook writes them: sums of angles, common factors, short products.

Polynomial over s_i, c_i, parameters, lengths and rates -> `Sum`, a tree of sums and products with c23 for
cos(q2 + q3); `Sum` -> LaTeX with break points at its sums, plain text, code, and the polynomial again.

Joints that turn about parallel axes form a chain. In a chain of n joints any n independent sums of successive
angles describe all the others with whole numbers, so sines and cosines of the joints are polynomials in those
of the sums, exactly. The coefficient of each product of parameters is written in every such choice of sums,
in normal form (s^2 = 1 - c^2), and the one with the fewest terms is taken. Nothing is guessed:
`expand_sum` turns every tree back into the polynomial it was made from.

The letters are those of a book; letters of the robot file (l1, m1, g) are kept in each. Lengths are those of
the link itself (siciliano, standard Denavit-Hartenberg rows), or of modified rows (craig, khalil).

Supported: chains of any length, axes that point the opposite way, coefficients with roots of two and three.
Not supported: joints that follow others, in sums of angles (their sines stay their own).
"""

import itertools
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any, TypeAlias

from sympy import QQ, Add, Matrix, Mul, Rational
from sympy.polys.rings import PolyElement, PolyRing

from symid.dynamics import ExactAlgebra, PointAlgebra
from symid.environment import locate_resource_folder
from symid.errors import Notice, UsageError
from symid.robot import Exact, JointKind, Robot

Angle: TypeAlias = tuple[tuple[int, int], ...]
"""A sum of joint angles: number and sign of each, the first one positive."""
Letter: TypeAlias = str | tuple[str, Angle] | tuple[str, int]
"""A symbol by its name, ("s" or "c", angle), or ("root", 2) for a square root."""
Monomial: TypeAlias = tuple[tuple[Letter, int], ...]
Terms: TypeAlias = dict[Monomial, Fraction]

_ONE = Exact.of(1)
_Axes: TypeAlias = tuple[tuple[Exact, ...], ...]

_PARAMETERS = ("m", "M", "I", "J", "X", "Y", "Z", "K")
_LONGEST_CHAIN = 3
"""Up to here all choices of sums are tried, 16 of them; beyond only the joints' own and those from an end."""


@dataclass(frozen=True, slots=True)
class Product:
    """number * letters^powers * (inner); `inner` None stands for one."""

    number: Fraction
    letters: Monomial
    inner: "Sum | None" = None


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum of products; without any it is zero."""

    products: tuple[Product, ...] = ()

    def count_terms(self) -> int:
        """Return how many products of letters the sum has when its brackets stay closed inside products."""
        return sum(max(1, p.inner.count_terms() if p.inner else 1) for p in self.products)


@dataclass(frozen=True, slots=True)
class _Choice:
    """A choice of sums of angles: sine and cosine of every joint as polynomials in those of the sums."""

    angles: tuple[Angle, ...]
    images: Mapping[Letter, PolyElement]
    algebra: ExactAlgebra


AngleSums: TypeAlias = tuple[tuple[_Choice, ...], ...]
"""The chains of parallel axes of a robot, each with all its choices of sums."""


def list_chains(robot: Robot) -> tuple[Angle, ...]:
    """Return the longest runs of revolute joints about parallel axes: number and sense of each joint."""
    open_chains: list[Angle] = []
    turned: list[tuple[int, _Axes | None]] = []
    for index, joint in enumerate(robot.joints):
        chain, rotation = turned[joint.parent] if joint.parent >= 0 else (-1, None)
        total: _Axes = joint.placement.rotation
        if rotation is not None:
            columns = list(zip(*total, strict=True))
            total = tuple(tuple(x * u + y * v + z * w for u, v, w in columns) for x, y, z in rotation)
        if joint.kind is JointKind.PRISMATIC or joint.mimic is not None:
            turned.append((chain if joint.mimic is None else -1, total if chain >= 0 else None))
            continue
        sense = 1 if total[2][2] == _ONE else -1 if total[2][2] == -_ONE else 0
        # The chain must end at the last joint that this one turns after, not go on beyond it.
        before = joint.parent
        while before >= 0 and robot.joints[before].kind is JointKind.PRISMATIC:
            before = robot.joints[before].parent
        if chain >= 0 and sense and open_chains[chain][-1][0] == before + 1:
            open_chains[chain] = (*open_chains[chain], (index + 1, open_chains[chain][-1][1] * sense))
        else:
            open_chains.append(((index + 1, 1),))
            chain = len(open_chains) - 1
        turned.append((chain, None))
    return tuple(open_chains)


def build_angle_sums(robot: Robot) -> AngleSums:
    """Return the chains of a robot with their choices of sums."""
    return tuple(tuple(_list_choices(chain)) for chain in list_chains(robot))


def _list_choices(chain: Angle) -> Iterator[_Choice]:
    """Yield the joints' own angles first, then every other independent choice of successive sums."""
    size = len(chain)
    runs = [(a, b) for a in range(size) for b in range(a, size)]
    own = tuple((k, k) for k in range(size))
    ends = (tuple((0, k) for k in range(size)), tuple((k, size - 1) for k in range(size)))
    every: Iterable[tuple[tuple[int, int], ...]] = itertools.combinations(runs, size)
    others = every if size <= _LONGEST_CHAIN else ends
    for choice in (own, *(other for other in others if other != own)):
        rows = [[sign if a <= k <= b else 0 for k, (_, sign) in enumerate(chain)] for a, b in choice]
        matrix = Matrix(rows)
        if matrix.det() == 0:
            continue
        turns = [chain[a : b + 1] for a, b in choice]
        angles = tuple(tuple((number, sign * run[0][1]) for number, sign in run) for run in turns)
        senses = [chain[a][1] for a, _ in choice]
        inverse = matrix.inv()
        shares = [[int(inverse[k, n]) * senses[n] for n in range(size)] for k in range(size)]
        # Every joint's angle is a sum of whole multiples, its share, of those sums.
        ring = PolyRing([f"{kind}{k}" for k in range(len(angles)) for kind in "sc"], QQ)
        algebra = ExactAlgebra(ring, tuple((2 * k, 2 * k + 1) for k in range(len(angles))))
        images: dict[Letter, PolyElement] = {}
        for (number, _), row in zip(chain, shares, strict=True):
            turns_of_sums = zip(ring.gens[::2], ring.gens[1::2], row, strict=True)
            images["s", ((number, 1),)], images["c", ((number, 1),)] = add_angles(algebra, turns_of_sums)
        yield _Choice(angles, images, algebra)


def add_angles(
    algebra: ExactAlgebra | PointAlgebra, angles: Iterable[tuple[Any, Any, int]]
) -> tuple[Any, Any]:
    """Return sine and cosine of a sum of angles, given by sine, cosine and multiple of each."""
    sine, cosine = algebra.zero, algebra.one
    for s, c, times in angles:
        turn = s if times > 0 else algebra.neg(s)
        for _ in range(abs(times)):
            sine, cosine = (
                algebra.mul(sine, c) + algebra.mul(cosine, turn),
                algebra.mul(cosine, c) - algebra.mul(sine, turn),
            )
    return sine, cosine


def sort_letter(letter: Letter) -> tuple[object, ...]:
    """Return the order of letters in a product: roots, parameters, lengths, gravity, sines, rates."""
    if isinstance(letter, tuple):
        return (0, 0, str(letter[1])) if letter[0] == "root" else (4, letter[1], letter[0])
    head = letter.rstrip("0123456789")
    number = int(letter[len(head) :] or 0)
    if head in ("dq", "ddq"):
        return (5, number, head)
    return (3 if letter == "g" else 1 if head[:1] in _PARAMETERS else 2, number, head)


def _sort(monomial: Mapping[Letter, int]) -> Monomial:
    return tuple(sorted(((k, n) for k, n in monomial.items() if n), key=lambda item: sort_letter(item[0])))


def list_terms(value: PolyElement) -> Terms:
    """Return the terms of a polynomial, roots of two and three as letters of their own."""
    plain = map(str, value.ring.symbols)
    names: list[Letter] = [
        (x[0], ((int(x[1:]), 1),)) if x[0] in "sc" and x[1:].isdigit() else x for x in plain
    ]
    result: Terms = {}
    for exponents, coefficient in value.terms():
        letters = {names[k]: power for k, power in enumerate(exponents) if power}
        # A number of Q(sqrt 2, sqrt 3): rational multiples of square roots.
        for term in Add.make_args(value.ring.domain.to_sympy(coefficient)):
            number, root = Fraction(1), 1
            for factor in Mul.make_args(term):
                if isinstance(factor, Rational):
                    number *= Fraction(int(factor.p), int(factor.q))
                else:
                    root *= int(factor**2)
            key = _sort({**letters, **({("root", root): 1} if root > 1 else {})})
            result[key] = result.get(key, Fraction(0)) + number
    return result


def write_sum(value: PolyElement, sums: AngleSums) -> Sum:
    """Return a polynomial as a textbook writes it."""
    groups: dict[Monomial, Terms] = {}
    for monomial, number in list_terms(value).items():
        plain = tuple(item for item in monomial if not _is_angle(item[0]))
        waves = tuple(item for item in monomial if _is_angle(item[0]))
        groups.setdefault(plain, {})[waves] = number

    def measure(form: Terms) -> tuple[int, int]:
        items = [(letter[1], power) for key in form for letter, power in key]
        return len(form), sum(power * (3 + len(angle)) for angle, power in items if isinstance(angle, tuple))

    terms: Terms = {}
    for plain, share in groups.items():
        # Sines and cosines go into the sums of angles that give them the fewest terms.
        joined = share
        for choices in sums:
            own = choices[0].images
            if any(letter in own for monomial in joined for letter, _ in monomial):
                forms = (_complete_squares(_substitute(joined, choice), choice.angles) for choice in choices)
                joined = min(forms, key=measure)
        for monomial, number in joined.items():
            terms[_sort({**dict(plain), **dict(monomial)})] = number
    return _collect(terms)


def _is_angle(letter: Letter) -> bool:
    return isinstance(letter, tuple) and isinstance(letter[1], tuple)


def _substitute(waves: Terms, choice: _Choice) -> Terms:
    """Return the polynomial with the joints of one chain in the sums of `choice`."""
    result: Terms = {}
    letters: list[Letter] = [(kind, angle) for angle in choice.angles for kind in "sc"]
    for monomial, number in waves.items():
        image = choice.algebra.one
        rest = []
        for letter, power in monomial:
            if letter in choice.images:
                for _ in range(power):
                    image = choice.algebra.mul(image, choice.images[letter])
            else:
                rest.append((letter, power))
        for exponents, factor in image.terms():
            key = _sort({**dict(rest), **{letters[k]: n for k, n in enumerate(exponents) if n}})
            share = number * Fraction(int(factor.numerator), int(factor.denominator))
            result[key] = result.get(key, Fraction(0)) + share
            if not result[key]:
                del result[key]
    return result


def _complete_squares(terms: Terms, angles: Sequence[Angle]) -> Terms:
    """Return the terms with s^2 for 1 - c^2, and c^2 - s^2 for 2 c^2 - 1."""
    terms = dict(terms)
    for angle in angles:
        sine, cosine = ("s", angle), ("c", angle)
        for monomial in tuple(terms):
            powers, number = dict(monomial), terms.get(monomial)
            square = _sort({**powers, cosine: powers.get(cosine, 0) + 2})
            other = terms.get(square)
            if number is None or other is None or powers.get(sine):
                continue
            if other in (-number, -2 * number):
                del terms[monomial]
                terms[_sort({**powers, sine: 2})] = number
                terms[square] = other + number
                if not terms[square]:
                    del terms[square]
    return terms


# The largest ratio of two numbers that a common factor may leave.
_LARGE = 4


def _collect(terms: Terms) -> Sum:
    """Return the sum with common factors taken out, again and again the one that saves most letters."""
    products: list[Product] = []
    rest = dict(terms)
    while rest:
        # The product of letters that saves most when it is taken out of the terms that share it.
        keys = [dict(key) for key in rest]
        saved: dict[Monomial, int] = {}
        for left, right in itertools.combinations(keys, 2):
            common = _sort({letter: n for letter, n in left.items() if right.get(letter) == n})
            if common and common not in saved:
                weight = sum(n * (2 if _is_angle(letter) else 1) for letter, n in common)
                saved[common] = (sum(_divides(dict(common), key) for key in keys) - 1) * weight
        best = max(saved, key=lambda key: (saved[key], -len(key)), default=())
        if saved.get(best, 0) <= 0:
            products += [Product(number, monomial) for monomial, number in rest.items()]
            break
        divisor = dict(best)
        chosen = {key: rest.pop(key) for key in tuple(rest) if _divides(divisor, dict(key))}
        inner = {
            _sort({letter: power - divisor.get(letter, 0) for letter, power in key}): number
            for key, number in chosen.items()
        }
        numbers = list(inner.values())
        factor = Fraction(
            math.gcd(*(x.numerator for x in numbers)), math.lcm(*(x.denominator for x in numbers))
        )
        factor = -factor if all(number < 0 for number in numbers) else factor
        if any(abs(number / factor) > _LARGE for number in numbers):
            factor = Fraction(1)
        bracket = _collect({key: number / factor for key, number in inner.items()})
        products.append(Product(factor, best, bracket))
    ordered = sorted(products, key=_sort_product)
    # A sum begins with a term that is added, where it has one.
    first = next((k for k, product in enumerate(ordered) if product.number > 0), 0)
    return Sum((ordered[first], *ordered[:first], *ordered[first + 1 :]) if ordered else ())


def _divides(divisor: Mapping[Letter, int], monomial: Mapping[Letter, int]) -> bool:
    """Return whether a product holds the divisor, and no more of its letters: squares stay whole."""
    return all(monomial.get(letter, 0) == power for letter, power in divisor.items())


def _sort_product(product: Product) -> tuple[object, ...]:
    """Return the order of products in a sum: without sines first, then by letters."""
    waves = sum(_is_angle(letter) for letter, _ in product.letters)
    keys = tuple((sort_letter(letter), -power) for letter, power in product.letters)
    some = min(waves + _count_waves(product.inner), 1)
    return (some, product.inner is not None, waves, not keys, str(keys))


def _count_waves(total: Sum | None) -> int:
    return sum(
        _count_waves(p.inner) + sum(_is_angle(letter) for letter, _ in p.letters)
        for p in (total.products if total else ())
    )


def expand_sum(total: Sum, algebra: ExactAlgebra) -> PolyElement:
    """Return a sum as the polynomial of `algebra` that it stands for."""
    known, ring, result = algebra.generators, algebra.ring, algebra.zero
    for product in total.products:
        number = QQ(product.number.numerator, product.number.denominator)
        value = algebra.one * ring.domain.convert(number)
        for letter, power in product.letters:
            if isinstance(letter, str):
                factor = known[letter]
            elif isinstance(letter[1], int):
                factor = ring.ground_new(ring.domain.from_sympy(Rational(letter[1]) ** Rational(1, 2)))
            else:
                angles = ((known[f"s{joint}"], known[f"c{joint}"], sign) for joint, sign in letter[1])
                factor = add_angles(algebra, angles)[letter[0] == "c"]
            for _ in range(power):
                value = algebra.mul(value, factor)
        if product.inner is not None:
            value = algebra.mul(value, expand_sum(product.inner, algebra))
        result += value
    return result


Style: TypeAlias = Callable[[Letter, int], str]
"""How a letter with its power is written in LaTeX."""


def write_latex(total: Sum, style: Style) -> str:
    """Return a sum in LaTeX; its signs stand outside of groups, so that lines can break there."""
    if not total.products:
        return "0"
    text = ""
    for k, product in enumerate(total.products):
        negative = product.number < 0
        sign = "-" if negative else "+" if k else ""
        text += f" {sign} " if k else sign
        number, inner = abs(product.number), product.inner
        alone = inner is None and not product.letters
        parts = [] if number == 1 and not alone else [write_number(number)]
        letters = [style(letter, power) for letter, power in product.letters]
        if inner is not None:
            # A bracket without sines stands before the sines: (m1 lc1 + m2 l1) g c1.
            early = (isinstance(x, str) and sort_letter(x)[0] != 5 for x, _ in product.letters)
            place = len(letters) if _count_waves(inner) else sum(early)
            letters.insert(place, rf"({write_latex(inner, style)})")
        text += r" \, ".join([*parts, *letters])
    return text


def write_number(number: Fraction) -> str:
    """Return a positive number in LaTeX: a decimal where it is a short one, else a fraction."""
    if number.denominator == 1:
        return str(number.numerator)
    rest = number.denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    if rest == 1 and number.denominator not in (2, 4, 8):
        text = f"{float(number):.10g}"
        if Fraction(text) == number and len(text) <= 9:
            return text
    if max(number.numerator, number.denominator) > 9999:
        return rf"{float(number):.6g}"
    return rf"\tfrac{{{number.numerator}}}{{{number.denominator}}}"


def _join_products(total: Sum, write: Callable[[Letter, int], list[str]], fraction: str) -> str:
    """Return a sum in ASCII; `write` gives the factors of a letter with its power."""
    text = ""
    for product in total.products:
        number = abs(product.number)
        plain = number == 1 and (product.letters or product.inner is not None)
        factors = [] if plain else [fraction.format(number) if number.denominator > 1 else str(number)]
        for letter, power in product.letters:
            factors += write(letter, power)
        if product.inner is not None:
            factors.append(f"({_join_products(product.inner, write, fraction)})")
        text += (" - " if product.number < 0 else " + ") + "*".join(factors)
    return (text[3:] if text.startswith(" + ") else text.replace(" - ", "-", 1)) or "0"


def write_text(total: Sum, book: "Book", slides: frozenset[int] = frozenset()) -> str:
    """Return a sum in the plain letters of a book, c23 for cos(q2 + q3), ** for powers."""

    def write(letter: Letter, power: int) -> list[str]:
        text, what = (write_name(letter, book, slides), 0) if isinstance(letter, str) else letter
        if isinstance(what, tuple):
            if not book.long and all(sign > 0 and number < 10 for number, sign in what):
                text = (book.sine if text == "s" else book.cosine) + "".join(str(k) for k, _ in what)
            else:
                terms = ((sign, write_name(f"q{number}", book)) for number, sign in what)
                angle = "".join(f" {'+' if sign > 0 else '-'} {name}" for sign, name in terms)
                text = f"{'sin' if text == 's' else 'cos'}({angle.removeprefix(' + ').removeprefix(' ')})"
        elif what:
            text = f"sqrt({what})"
        return [text if power == 1 else f"{text}**{power}"]

    return _join_products(total, write, "{}")


def write_code(total: Sum, values: str = "") -> str:
    """Return a sum as code: SymPy's, or with `values` JavaScript that reads the object of that name."""
    head, function = (f"{values}.", "Math.") if values else ("", "")

    def write(letter: Letter, power: int) -> list[str]:
        if isinstance(letter, str):
            text = f"{head}{letter}"
        elif isinstance(letter[1], int):
            text = f"{function}sqrt({letter[1]})"
        else:
            angle = " ".join(f"{'+' if sign > 0 else '-'} {head}q{number}" for number, sign in letter[1])
            text = f"{function}{'sin' if letter[0] == 's' else 'cos'}({angle.removeprefix('+ ')})"
        return [text] * power if values else [text if power == 1 else f"{text}**{power}"]

    return _join_products(total, write, "({})")


# The letters of books.


@dataclass(frozen=True, slots=True, kw_only=True)
class Book:
    """Letters in LaTeX.

    Attributes:
        name: as the option has it. title: authors, title, year; empty for symid's own.
        mass, coriolis, gravity, torque: the matrices. kinetic, potential: the energies.
        angle, slide: of revolute and prismatic joints. coordinates: the vector of both.
        sine, cosine: of the short form. length, offset: of the table's rows. standard: the rows are standard
            ones where a robot has them. shift: what the number of a length is more than that of its row of
            modified parameters. bodies: masses, centres of mass and central inertias in place of base
            parameters of robots without symbols. long: write cos(q1 + q2) in place of c12.
    """

    name: str
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
    standard: bool = False
    shift: int = 0
    bodies: bool = False
    grouped: str = "{name}_{{{number}}}^{{\\mathrm R}}"
    long: bool = False


@cache
def load_books() -> Mapping[str, Book]:
    """Return the letters of all books by name, symid's own first."""
    path = locate_resource_folder("templates") / "lesson" / "books.toml"
    books = tomllib.loads(path.read_text(encoding="utf-8"))
    return {name: Book(name=name, **letters) for name, letters in books.items()}


def get_book(name: str, *, angle: str | None = None, long: bool = False) -> Book:
    """Return the letters of a book by its name; a UsageError for another one.

    `angle` is "q" or "theta" in place of the book's own letter; `long` writes cos(q1 + q2) in place of c12.
    """
    if name not in (books := load_books()):
        text = f"there is no notation {name!r}; it is one of {', '.join(books)}"
        raise UsageError(Notice(code="usage.notation", text=text))
    book = replace(books[name], long=long)
    letter = {"q": "q", "theta": r"\theta"}.get(angle or "")
    return replace(book, angle=letter, coordinates=letter) if letter else book


_FORMS = (
    (r"(XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M)c(\d+)", r"\overline{{\mathit{{{0}}}}}_{{{1}}}"),
    (r"G(\d+)([xyz])", r"{{}}^{{{0}}}g_{{{1}}}"),
    (r"F(\d+)_(\d+)([xyz])", r"{{}}^{{{1}}}p^{{({0})}}_{{{2}}}"),
    (r"N(\d+)_(\d+)([xyz])", r"{{}}^{{{1}}}h^{{({0})}}_{{{2}}}"),
    (r"l([xyz])(\d+)", r"\ell_{{{1}{0}}}"),
    (r"I(\d+)([xyz]{2})", r"I_{{{0},{1}}}"),
)
"""Letters of all books alike: composite bodies, gravity, momenta; centres and inertias of links."""
_RATE = re.compile(r"^(d{0,2})q(\d+)$")
_KHALIL_NAME = re.compile(r"^(XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M|IA|KS|KR)(R?)(\d+)$")
_PLAIN = re.compile(r"^([A-Za-z])([A-Za-z]*)_?(\d*)$")
_GREEK = "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi chi psi omega"


def write_symbol(name: str, book: Book, slides: frozenset[int] = frozenset()) -> str:
    """Return the symbol `name` in LaTeX; `slides` are the numbers of prismatic joints."""
    if match := _RATE.match(name):
        letter = book.slide if int(match[2]) in slides else book.angle
        dots = {"": "", "d": r"\dot ", "dd": r"\ddot "}[match[1]]
        return f"{dots}{{{letter}}}_{{{match[2]}}}" if dots else f"{letter}_{{{match[2]}}}"
    for pattern, form in _FORMS:
        if match := re.fullmatch(pattern, name):
            return form.format(*match.groups())
    if match := _KHALIL_NAME.match(name):
        letters = rf"\mathit{{{match[1]}}}" if len(match[1]) > 1 else match[1]
        if match[2]:
            return book.grouped.format(name=letters, number=match[3])
        return f"{letters}_{{{match[3]}}}"
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


def write_name(name: str, book: Book, slides: frozenset[int] = frozenset()) -> str:
    """Return the symbol `name` as plain text: only coordinates have other letters than in code."""
    if match := _RATE.match(name):
        letter = book.slide if int(match[2]) in slides else book.angle
        return f"{match[1]}{letter.removeprefix(chr(92)).removeprefix('var')}{match[2]}"
    return name


def build_style(book: Book, slides: frozenset[int] = frozenset()) -> Style:
    """Return how sums are written in the letters of a book."""

    def write(letter: Letter, power: int) -> str:
        if isinstance(letter, str):
            text = write_symbol(letter, book, slides)
            if power == 1:
                return text
            if "^" in text:
                return f"({text})^{{{power}}}"
            return f"{text}^{{\\,{power}}}" if text.startswith(r"\d") else f"{text}^{{{power}}}"
        kind, what = letter
        if isinstance(what, int):
            return rf"\sqrt{{{what}}}"
        above = f"^{{{power}}}" if power > 1 else ""
        if book.long:
            terms = (f" {'+' if sign > 0 else '-'} {book.angle}_{{{number}}}" for number, sign in what)
            name, inner = r"\sin" if kind == "s" else r"\cos", "".join(terms).removeprefix(" + ")
            return rf"{name}{above} {inner}" if len(what) == 1 else rf"{name}{above}({inner})"
        numbers = [f"{'' if sign > 0 else '-'}{number}" for number, sign in what]
        comma = any(number > 9 for number, _ in what)
        below = ("," if comma else "").join(numbers)
        return f"{book.sine if kind == 's' else book.cosine}_{{{below}}}{above}"

    return write
