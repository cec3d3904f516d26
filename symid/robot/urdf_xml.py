"""The XML of a URDF: elements that know their place, and typed values with a notice for each mistake.

An XML text -> `XmlDocument`, a tree of `XmlElement` records that know where they and their attributes
stand. Elements -> numbers, vectors and names as the file writes them, exactly; what is wrong or left unused
goes to the `UrdfReading`.

Supported: well-formed XML, at most 100 elements deep; decimals with or without exponent, below 1e-30 taken
as zero.
Not supported: document types and the entities that they define (a few lines of them fill any memory);
xacro; nan, inf (except in limits, where it means that there is none), hexadecimal numbers.
"""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from xml.parsers import expat

from symid.errors import Notice, RobotError
from symid.robot.toml_values import InputReport, Place, Places, show, suggest_names, to_decimal

_ATTRIBUTE = re.compile(rb"([^\s=/>\"']+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_DEEPEST = 100
_TOO_DEEP = f"elements stand more than {_DEEPEST} deep in each other; a URDF needs five"
_DTD = (
    "a document type (<!DOCTYPE ...>) is not read: what it defines can grow without end; a URDF needs none, "
    "remove it"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class XmlElement:
    """An element: its name, attributes, the elements and the text inside, and its place in the file."""

    tag: str
    attributes: Mapping[str, str]
    offset: int
    children: list["XmlElement"] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Return the text between the tags."""
        return "".join(self.texts).strip()

    def find_all(self, *tags: str) -> Iterator["XmlElement"]:
        """Return the elements inside that have one of these names, in their order."""
        return (child for child in self.children if child.tag in tags)

    def find(self, *tags: str) -> "XmlElement | None":
        """Return the first element inside that has one of these names."""
        return next(self.find_all(*tags), None)

    def walk(self) -> Iterator["XmlElement"]:
        """Return this element and all inside, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class XmlDocument:
    """An XML text: its outermost element, and what is needed to tell places."""

    root: XmlElement
    file: str
    source: bytes
    lines: tuple[int, ...]

    def find_place(self, element: XmlElement, attribute: str = "") -> Place:
        """Return where an element stands, or where the value of one of its attributes does."""
        if attribute not in element.attributes:
            return self._place(element.offset)
        position = element.offset
        while match := _ATTRIBUTE.search(self.source, position):
            if match[1].decode() == attribute:
                return self._place(match.start(2) + 1, element.attributes[attribute])
            position = match.end()
        return self._place(element.offset)

    def _place(self, offset: int, text: str = "") -> Place:
        line = bisect_right(self.lines, offset) - 1
        before = self.source[self.lines[line] : offset].decode(errors="replace")
        return Place(self.file, line + 1, len(before) + 1, text)


class _XmlBuilder:
    """What has been read so far."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate("utf-8")
        self.open: list[XmlElement] = []
        self.root: XmlElement | None = None
        self.refused = ""
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refuse_type

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag=tag, attributes=attributes, offset=self.parser.CurrentByteIndex)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)
        if len(self.open) > _DEEPEST:
            self._stop(_TOO_DEEP)

    def _end(self, _: str) -> None:
        self.open.pop()

    def _text(self, text: str) -> None:
        if self.open and not text.isspace():
            self.open[-1].texts.append(text)

    def _refuse_type(self, *_: object) -> None:
        self._stop(_DTD)

    def _stop(self, reason: str) -> None:
        self.refused = reason
        raise RobotError


def parse_document(text: str, file: str) -> XmlDocument:
    """Return the elements of `text`; messages call the text `file`.

    Raises:
        RobotError: it is no well-formed XML, has a document type, or is nested too deeply.
    """
    source = text.encode(errors="surrogatepass")
    lines = (0, *(match.end() for match in re.finditer(rb"\n", source)))
    builder = _XmlBuilder()
    try:
        builder.parser.Parse(source, True)
    except expat.ExpatError as error:
        words = f"not well-formed XML: {expat.ErrorString(error.code)}"
        words += f" (inside <{builder.open[-1].tag}>)" if builder.open else ""
        column = error.offset + 1
        raise RobotError(
            Notice(code="robot.syntax", text=words, file=file, line=error.lineno, column=column)
        ) from error
    except RobotError:
        line, column = builder.parser.CurrentLineNumber, builder.parser.CurrentColumnNumber + 1
        notice = Notice(code="robot.urdf-refused", text=builder.refused, file=file, line=line, column=column)
        raise RobotError(notice) from None
    if builder.root is None:  # expat refuses a text without an element
        raise RobotError(Notice(code="robot.syntax", text="no element in the file", file=file, line=1))
    return XmlDocument(root=builder.root, file=file, source=source, lines=lines)


_DECIMAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_LONGEST = 100
_DUST = Decimal("1e-30")
_LOOKS = ("visual", "collision", "material", "gazebo")
_SHOWN = 3
_WORDS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfReading:
    """A URDF that is being read: what is wrong, what is worth saying, what is not used.

    `unused` holds, for each kind of thing that symid does not use, where it stands; `grouped` the same for
    remarks that are made once: (code, text) and the places; `looks` where the tags stand that are for the eye
    and for simulators.
    """

    document: XmlDocument
    report: InputReport
    unused: dict[str, list[Place]] = field(default_factory=dict)
    grouped: dict[tuple[str, str], list[tuple[str, Place]]] = field(default_factory=dict)
    looks: dict[str, list[Place]] = field(default_factory=dict)

    @staticmethod
    def of(document: XmlDocument) -> "UrdfReading":
        """Return a reading with nothing said yet."""
        whole = Place(document.file, 1, 1)
        return UrdfReading(document=document, report=InputReport(Places(keys={}, values={}, whole=whole)))

    def refuse(self, code: str, text: str, element: XmlElement, attribute: str = "") -> None:
        """Add an error at an element or at the value of one of its attributes."""
        self.report.errors.append(self.document.find_place(element, attribute).notice(code, text))

    def warn(self, code: str, text: str, element: XmlElement, attribute: str = "") -> None:
        """Add a warning at an element or at the value of one of its attributes."""
        self.report.warnings.append(self.document.find_place(element, attribute).notice(code, text))

    def remark(self, code: str, text: str, name: str, element: XmlElement, attribute: str = "") -> None:
        """Add `name` to a warning that is made once for many; its {} stands for the names."""
        place = self.document.find_place(element, attribute)
        self.grouped.setdefault((code, text), []).append((name, place))

    def skip(self, kind: str, element: XmlElement, attribute: str = "") -> None:
        """Remember something that the file says and symid does not use."""
        self.unused.setdefault(kind, []).append(self.document.find_place(element, attribute))

    def skip_others(self, element: XmlElement, tags: Iterable[str], attributes: Iterable[str]) -> None:
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
            notices.append(places[0].notice("robot.urdf-unused", text))
        if self.looks:
            counts = ", ".join(f"<{tag}> ({len(places)})" for tag, places in self.looks.items())
            everywhere = [place for places in self.looks.values() for place in places]
            first = min(everywhere, key=lambda place: (place.line, place.column))
            text = f"not used, and not needed for the dynamics: {counts}"
            notices.append(first.notice("robot.urdf-unused", text))
        for (code, words), found in self.grouped.items():
            text = words.format(list_words(name for name, _ in found))
            notices.append(found[0][1].notice(code, text))
        return tuple(sorted(notices, key=lambda notice: (notice.line, notice.column)))


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


def get_single(reading: UrdfReading, owner: str, element: XmlElement, tag: str) -> XmlElement | None:
    """Return the element of this name inside another; a second one is a mistake."""
    found = list(element.find_all(tag))
    for other in found[1:]:
        reading.refuse("robot.two-forms", f"{owner}: a second <{tag}>; keep one of them", other)
    return found[0] if found else None


def _parse_decimal(text: str) -> Decimal | None:
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


def is_infinite(element: XmlElement, attribute: str) -> bool:
    """Return whether the attribute says "inf", with either sign."""
    return element.attributes.get(attribute, "").strip().lstrip("+-").lower() in {"inf", "infinity"}


def refuse_text(reading: UrdfReading, owner: str, element: XmlElement, example: str) -> None:
    """Add an error where numbers stand between the tags, and not in attributes."""
    if element.text and not {"xyz", "rpy"} & set(element.attributes):
        words = f'{owner}: <{element.tag}> has text, "{show(element.text)}", and no xyz'
        text = f"{words}; numbers stand in attributes: write <{element.tag} {example}/>"
        reading.refuse("robot.stray-text", text, element)


def read_decimal(
    reading: UrdfReading, owner: str, element: XmlElement, attribute: str, *, endless: bool = False
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
    if endless and is_infinite(element, attribute):
        return None
    number = _parse_decimal(text.strip())
    if number is None:
        name = f"{element.tag} {attribute}".strip()
        words = f'{owner}: {name}: expected a finite number, got "{show(text)}"{_explain(text)}'
        reading.refuse("robot.bad-number", words, element, attribute)
    return number


def read_vector(
    reading: UrdfReading, owner: str, element: XmlElement, attribute: str
) -> tuple[Decimal, Decimal, Decimal] | None:
    """Return the three numbers at an attribute, None where it is absent or wrong."""
    text = element.attributes.get(attribute)
    if text is None:
        return None
    numbers = [_parse_decimal(part) for part in text.split()]
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
    reading: UrdfReading,
    owner: str,
    element: XmlElement,
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
    hint = suggest_names(name, names)
    text = f'{owner}: there is no {kind} "{show(name)}" in this file'
    reading.refuse("robot.unknown-name", f"{text}; {hint}" if hint else text, element, attribute)
    return None
