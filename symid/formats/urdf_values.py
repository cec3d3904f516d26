"""Values out of the elements of a URDF, with a notice for each mistake.

Input: elements. Output: numbers, vectors and names as the file writes them, exactly; what is wrong or left
unused goes to the `Reading`.

Supported: decimals with or without exponent. A number below 1e-30 is dust of somebody's arithmetic: zero.
Not supported: nan, inf (but in limits, where it means that there is none), hexadecimal numbers.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from decimal import Decimal

from symid.errors import Notice
from symid.formats.positions import Place, Places
from symid.formats.section import Report, find_nearest, show, to_decimal
from symid.formats.urdf_elements import Document, Element

__all__ = [
    "Reading",
    "find_only",
    "is_endless",
    "list_words",
    "read_decimal",
    "read_name",
    "read_vector",
    "refuse_text",
]

_DECIMAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_LONGEST = 100
_DUST = Decimal("1e-30")
_LOOKS = ("visual", "collision", "material", "gazebo")
_SHOWN = 3
_WORDS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A URDF that is being read: what is wrong, what is worth saying, what is not used.

    `unused` holds, for each kind of thing that symid does not use, where it stands; `grouped` the same for
    remarks that are made once: (code, text) and the places; `looks` where the tags stand that are for the eye
    and for simulators.
    """

    document: Document
    report: Report
    unused: dict[str, list[Place]] = field(default_factory=dict)
    grouped: dict[tuple[str, str], list[tuple[str, Place]]] = field(default_factory=dict)
    looks: dict[str, list[Place]] = field(default_factory=dict)

    @staticmethod
    def of(document: Document) -> "Reading":
        """Return a reading with nothing said yet."""
        whole = Place(document.file, 1, 1)
        return Reading(document=document, report=Report(Places(keys={}, values={}, whole=whole)))

    def refuse(self, code: str, text: str, element: Element, attribute: str = "") -> None:
        """Add an error at an element or at the value of one of its attributes."""
        self.report.errors.append(self._notice(code, text, element, attribute))

    def warn(self, code: str, text: str, element: Element, attribute: str = "") -> None:
        """Add a warning at an element or at the value of one of its attributes."""
        self.report.warnings.append(self._notice(code, text, element, attribute))

    def remark(self, code: str, text: str, name: str, element: Element, attribute: str = "") -> None:
        """Add `name` to a warning that is made once for many; its {} stands for the names."""
        place = self.document.find_place(element, attribute)
        self.grouped.setdefault((code, text), []).append((name, place))

    def skip(self, kind: str, element: Element, attribute: str = "") -> None:
        """Remember something that the file says and symid does not use."""
        self.unused.setdefault(kind, []).append(self.document.find_place(element, attribute))

    def skip_others(self, element: Element, tags: Iterable[str], attributes: Iterable[str]) -> None:
        """Remember all inside `element` that has none of these names, and the text between its tags."""
        known = tuple(tags)
        for child in element.children:
            if child.tag in _LOOKS:
                self.looks.setdefault(child.tag, []).append(self.document.find_place(child))
            elif child.tag not in known:
                self.skip(f"<{child.tag}> in <{element.tag}>", child)
        if element.text:
            self.skip(f'the text "{show(element.text)}" in <{element.tag}>', element)
        known = tuple(attributes)
        for name in element.attributes:
            if name not in known:
                self.skip(f'attribute {name}="..." of <{element.tag}>', element, name)

    def list_remarks(self) -> tuple[Notice, ...]:
        """Return all warnings in the order of their places, those on unused things among them."""
        notices = list(self.report.warnings)
        for kind, places in self.unused.items():
            often = "once" if len(places) == 1 else f"{len(places)} times"
            text = f"not used: {kind} ({often}, {_describe_places(places)})"
            notices.append(_at("robot.urdf-unused", text, places[0]))
        if self.looks:
            counts = ", ".join(f"<{tag}> ({len(places)})" for tag, places in self.looks.items())
            first = min((place for places in self.looks.values() for place in places), key=_order)
            text = f"not used, and not needed for the dynamics: {counts}"
            notices.append(_at("robot.urdf-unused", text, first))
        for (code, words), found in self.grouped.items():
            text = words.format(list_words(name for name, _ in found))
            notices.append(_at(code, text, found[0][1]))
        return tuple(sorted(notices, key=lambda notice: (notice.line, notice.column)))

    def _notice(self, code: str, text: str, element: Element, attribute: str) -> Notice:
        return _at(code, text, self.document.find_place(element, attribute))


def _order(place: Place) -> tuple[int, int]:
    return (place.line, place.column)


def _at(code: str, text: str, place: Place) -> Notice:
    return Notice(code=code, text=text, file=place.file, line=place.line, column=place.column)


def _describe_places(places: list[Place]) -> str:
    """Return the first lines in words."""
    lines = [str(line) for line in dict.fromkeys(place.line for place in places)]
    more = ", ..." if len(lines) > _SHOWN else ""
    return f"line{'s'[: len(lines) > 1]} {', '.join(lines[:_SHOWN])}{more}"


def list_words(words: Iterable[str], *, most: int = _WORDS) -> str:
    """Return names as a list in a sentence, shortened."""
    names = list(words)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def find_only(reading: Reading, owner: str, element: Element, tag: str) -> Element | None:
    """Return the element of this name inside another; a second one is a mistake."""
    found = list(element.find_all(tag))
    for other in found[1:]:
        reading.refuse("robot.two-forms", f"{owner}: a second <{tag}>; keep one of them", other)
    return found[0] if found else None


def _to_number(text: str) -> Decimal | None:
    if len(text) > _LONGEST or not _DECIMAL.fullmatch(text):
        return None
    number = Decimal(text)
    if not number or abs(number) < _DUST:
        return Decimal(0)
    return to_decimal(number)


def _explain(text: str) -> str:
    if "${" in text or "$(" in text:
        return "; this is xacro: run xacro first"
    if "," in text:
        return "; a decimal point is written as a point"
    return ""


def is_endless(element: Element, attribute: str) -> bool:
    """Return whether the attribute says "inf", with either sign."""
    return element.attributes.get(attribute, "").strip().lstrip("+-").lower() in {"inf", "infinity"}


def refuse_text(reading: Reading, owner: str, element: Element, example: str) -> None:
    """Add an error where numbers stand between the tags, and not in attributes."""
    if element.text and not {"xyz", "rpy"} & set(element.attributes):
        words = f'{owner}: <{element.tag}> has text, "{show(element.text)}", and no xyz'
        text = f"{words}; numbers stand in attributes: write <{element.tag} {example}/>"
        reading.refuse("robot.stray-text", text, element)


def read_decimal(
    reading: Reading, owner: str, element: Element, attribute: str, *, endless: bool = False
) -> Decimal | None:
    """Return the number at an attribute, None where it is absent or wrong.

    Args:
        reading: where mistakes go.
        owner: whose number it is, for messages: "joint 'a'".
        element: the element.
        attribute: the name of the attribute; the element's text for the empty name.
        endless: whether "inf" is allowed; it is read as absent.
    """
    text = element.attributes.get(attribute) if attribute else element.text
    if text is None:
        return None
    if endless and is_endless(element, attribute):
        return None
    number = _to_number(text.strip())
    if number is None:
        name = f"{element.tag} {attribute}".strip()
        words = f'{owner}: {name}: expected a finite number, got "{show(text)}"{_explain(text)}'
        reading.refuse("robot.bad-number", words, element, attribute)
    return number


def read_vector(
    reading: Reading, owner: str, element: Element, attribute: str
) -> tuple[Decimal, Decimal, Decimal] | None:
    """Return the three numbers at an attribute, None where it is absent or wrong."""
    text = element.attributes.get(attribute)
    if text is None:
        return None
    numbers = [_to_number(part) for part in text.split()]
    if len(numbers) == 3 and None not in numbers:
        x, y, z = (number or Decimal(0) for number in numbers)
        return (x, y, z)
    words = (
        f"{owner}: {element.tag} {attribute}: expected three finite numbers with spaces between them, "
        f'got "{show(text)}"{_explain(text)}'
    )
    reading.refuse("robot.bad-number", words, element, attribute)
    return None


def read_name(
    reading: Reading,
    owner: str,
    element: Element,
    attribute: str,
    known: Iterable[str] | None = None,
) -> str | None:
    """Return the name at an attribute, one of `known` where these are given; None where it is wrong."""
    kind = element.tag if attribute == "name" else attribute
    name = element.attributes.get(attribute, "")
    if not name.strip():
        text = f'{owner}: <{element.tag}> needs a name: write {attribute}="..."'
        reading.refuse("robot.missing-key", text, element)
        return None
    if known is None:
        return name
    names = list(known)
    if name in names:
        return name
    hint = find_nearest(name, names)
    text = f'{owner}: there is no {kind} "{show(name)}" in this file'
    reading.refuse("robot.unknown-name", f"{text}; {hint}" if hint else text, element, attribute)
    return None
