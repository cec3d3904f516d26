"""The elements of an XML text, each with its place.

Input: an XML text. Output: `Document`, a tree of `Element` records that know where they and their attributes
stand.

Supported: well-formed XML without a document type, at most 100 elements deep.
Not supported: document types and the entities that they define (a few lines of them fill any memory);
xacro, which is a language of its own.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from symid.errors import Notice, RobotError
from symid.formats.positions import Place

__all__ = ["Document", "Element", "parse_document"]

_ATTRIBUTE = re.compile(rb"([^\s=/>\"']+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_DEEPEST = 100
_TOO_DEEP = f"elements stand more than {_DEEPEST} deep in each other; a URDF needs five"
_DTD = (
    "a document type (<!DOCTYPE ...>) is not read: what it defines can grow without end; a URDF needs none, "
    "remove it"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Element:
    """An element: its name, attributes, the elements and the text inside, and its place in the file."""

    tag: str
    attributes: Mapping[str, str]
    offset: int
    children: list["Element"] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Return the text between the tags."""
        return "".join(self.texts).strip()

    def find_all(self, *tags: str) -> Iterator["Element"]:
        """Return the elements inside that have one of these names, in their order."""
        return (child for child in self.children if child.tag in tags)

    def find(self, *tags: str) -> "Element | None":
        """Return the first element inside that has one of these names."""
        return next(self.find_all(*tags), None)

    def walk(self) -> Iterator["Element"]:
        """Return this element and all inside, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Document:
    """An XML text: its outermost element, and what is needed to tell places."""

    root: Element
    file: str
    source: bytes
    lines: tuple[int, ...]

    def find_place(self, element: Element, attribute: str = "") -> Place:
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


class _Builder:
    """What has been read so far."""

    def __init__(self) -> None:
        self.parser = expat.ParserCreate("utf-8")
        self.open: list[Element] = []
        self.root: Element | None = None
        self.refused = ""
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refuse_type

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag=tag, attributes=attributes, offset=self.parser.CurrentByteIndex)
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


def parse_document(text: str, file: str) -> Document:
    """Return the elements of `text`; messages call the text `file`.

    Raises:
        RobotError: it is no well-formed XML, has a document type, or is nested too deeply.
    """
    source = text.encode(errors="surrogatepass")
    lines = (0, *(match.end() for match in re.finditer(rb"\n", source)))
    builder = _Builder()
    try:
        builder.parser.Parse(source, True)
    except expat.ExpatError as error:
        words = f"not well-formed XML: {expat.ErrorString(error.code)}{_explain_unclosed(builder.open)}"
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
    return Document(root=builder.root, file=file, source=source, lines=lines)


def _explain_unclosed(elements: list[Element]) -> str:
    return f" (inside <{elements[-1].tag}>)" if elements else ""
