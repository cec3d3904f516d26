"""The text of a URDF, expanded where it is xacro; an XML text as a tree of elements, and changes of it.

A path -> `UrdfText`; a text -> `XmlDocument`, with places; edits of single values -> the text with them, all
else as it is. Xacro files are expanded by the package xacro (the extra `xacro`), no ROS needed; arguments
have their defaults where a call does not give them. Packages of $(find NAME) are looked for around the file,
in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH.

Supported: well-formed XML, at most 100 elements deep (an MJCF model 1000); elements of other files among its
own. Not supported: document types and the entities that they define (a few lines of them fill any memory);
xacro arguments without a default.
"""

import contextlib
import io
import os
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from symid.errors import Notice, RobotError, UsageError
from symid.robot.toml_values import Place, read_text_file, suggest_names

TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Attributes of <inertia>, in the order of the entries of a tensor."""

_ATTRIBUTE = re.compile(rb"([^\s=/>\"']+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_XACRO_ARGUMENT = re.compile(r"<xacro:arg\s[^>]*?\bname\s*=\s*[\"']([^\"']+)")
_QUOTED = re.compile(rb"[^>\"']|\"[^\"]*\"|'[^']*'")
_DEEPEST, _DEEPEST_BODIES = 100, 1000
_TOO_DEEP = "elements are nested more than {} deep; a URDF needs five levels, an MJCF model one a body"
_DTD = "a document type (<!DOCTYPE ...>) is not read, since its entities can grow without limit; remove it"
Edit = tuple[int, int, str]
"""The first byte that is replaced, the byte behind the last one, and what comes in their place."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class XmlElement:
    """An element: its name, attributes, the elements and the text inside, its file and its place there."""

    tag: str
    attributes: Mapping[str, str]
    offset: int
    file: str = ""
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
    """An XML text: its outermost element, its bytes, and offsets of its lines and end tags.

    `ends` has the offset of an element's end tag by that of the element; `included` other files whose
    elements stand among those of this one, by name.
    """

    root: XmlElement
    file: str
    source: bytes
    lines: tuple[int, ...]
    ends: Mapping[int, int]
    included: dict[str, "XmlDocument"] = field(default_factory=dict)

    def locate_place(self, element: XmlElement, attribute: str = "") -> Place:
        """Return the place of an element, or of the value of one of its attributes."""
        if element.file in self.included:
            return self.included[element.file].locate_place(element, attribute)
        offset, text = element.offset, ""
        if attribute in element.attributes:
            offset, text = self.locate_value(element, attribute)[0], element.attributes[attribute]
        line = bisect_right(self.lines, offset) - 1
        before = self.source[self.lines[line] : offset].decode(errors="replace")
        return Place(self.file, line + 1, len(before) + 1, text)

    def locate_value(self, element: XmlElement, attribute: str) -> tuple[int, int]:
        """Return where the value of an attribute that the element has begins and ends, without its quotes."""
        matches = _ATTRIBUTE.finditer(self.source, element.offset)
        match = next(match for match in matches if match[1].decode() == attribute)
        return match.start(2) + 1, match.end(2) - 1

    def locate_inside(self, element: XmlElement) -> tuple[int, int]:
        """Return where the tag of an element ends, and where its end tag begins; both the same for <x/>."""
        end = element.offset
        # Values of attributes may hold what ends a tag.
        while match := _QUOTED.match(self.source, end):
            end = match.end()
        closed = self.source[end - 1 : end + 1] == b"/>"
        return end + 1, end + 1 if closed else self.ends[element.offset]


def parse_document(text: str, file: str) -> XmlDocument:
    """Return the elements of `text`; a RobotError if it is ill-formed, too deep, or has a document type."""
    source = text.encode(errors="surrogatepass")
    parser = expat.ParserCreate("utf-8")
    opened = [XmlElement(tag="", attributes={}, offset=-1)]
    ends: dict[int, int] = {}

    def refuse(reason: str) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        raise RobotError(Notice(code="robot.urdf-refused", text=reason, file=file, line=line, column=column))

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag=tag, attributes=attributes, offset=parser.CurrentByteIndex, file=file)
        opened[-1].children.append(element)
        opened.append(element)
        deepest = _DEEPEST_BODIES if opened[1].tag == "mujoco" else _DEEPEST
        if len(opened) > deepest + 1:
            refuse(_TOO_DEEP.format(deepest))

    def end(_: str) -> None:
        ends[opened.pop().offset] = parser.CurrentByteIndex

    def add_text(part: str) -> None:
        if not part.isspace():
            opened[-1].texts.append(part)

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = add_text
    parser.StartDoctypeDeclHandler = lambda *_: refuse(_DTD)
    try:
        parser.Parse(source, True)
    except expat.ExpatError as error:
        words = f"not well-formed XML: {expat.ErrorString(error.code)}"
        words += f" (inside <{opened[-1].tag}>)" if len(opened) > 1 else ""
        line, column = error.lineno, error.offset + 1
        notice = Notice(code="robot.syntax", text=words, file=file, line=line, column=column)
        raise RobotError(notice) from error
    lines = (0, *(match.end() for match in re.finditer(rb"\n", source)))
    return XmlDocument(root=opened[0].children[0], file=file, source=source, lines=lines, ends=ends)


def apply_edits(document: XmlDocument, edits: Iterable[Edit]) -> str:
    """Return the text with all edits, which must not overlap; of two at one place the first stands before."""
    parts, position = [], 0
    for begin, end, inserted in sorted(edits, key=lambda edit: edit[:2]):
        parts += [document.source[position:begin], inserted.encode()]
        position = end
    return b"".join((*parts, document.source[position:])).decode(errors="surrogatepass")


def set_values(document: XmlDocument, element: XmlElement, values: Mapping[str, str]) -> Iterator[Edit]:
    """Yield what gives attributes other values; those that the element lacks come behind all others."""
    for name in element.attributes:
        if name in values:
            yield (*document.locate_value(element, name), values[name])
    missing = "".join(f' {name}="{text}"' for name, text in values.items() if name not in element.attributes)
    if missing:
        end = document.locate_inside(element)[0] - 1
        end -= document.source[end - 1 : end] == b"/"
        # Blanks before the end of the tag stay behind.
        end = len(document.source[:end].rstrip())
        yield end, end, missing


def insert_element(document: XmlDocument, owner: XmlElement, lines: Sequence[str]) -> Edit:
    """Return what puts the lines of an element in front of all else in `owner`, indented as it is."""
    source = document.source
    before = source[source.rfind(b"\n", 0, owner.offset) + 1 : owner.offset]
    outer = before.decode() if not before.strip() else "    "
    end_of_line = "\r\n" if b"\r\n" in source else "\n"
    text = "".join(f"{end_of_line}{outer}  {line}" for line in lines)
    start, end = document.locate_inside(owner)
    if start != end or source[start - 2 : start] != b"/>":
        return start, start, text
    return start - 2, start, f">{text}{end_of_line}{outer}</{owner.tag}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfText:
    """The text of a URDF, what messages call it, and what its expansion said."""

    text: str
    file: str
    notices: tuple[Notice, ...] = ()


def read_urdf_text(
    path: Path, *, keep_ends: bool = False, arguments: Mapping[str, str] | None = None
) -> UrdfText:
    """Return the text of the URDF at `path`, or of the one that the xacro file there writes.

    `keep_ends`: as of `read_text_file`. `arguments` of the xacro file, by name.

    Raises:
        RobotError: it cannot be read or expanded, or xacro is missing.
        UsageError: the file has no such argument.
    """
    given = arguments or {}
    text = read_text_file(path, keep_ends=keep_ends)
    # A comment may show what a xacro file would have.
    if path.suffix.lower() != ".xacro" and "<xacro:" not in _COMMENT.sub("", text):
        if given:
            words = "only a xacro file has arguments; leave --xacro out"
            raise UsageError(Notice(code="usage.xacro", text=words, file=str(path)))
        return UrdfText(text=text, file=str(path))
    try:
        import xacro
        from xacro import substitution_args
    except ImportError as error:
        words = "this is a xacro file, a program that writes a URDF: install the extra xacro, "
        words += f"pip install 'symid[xacro]', or run `xacro {path.name} > robot.urdf` and give that file"
        raise RobotError(Notice(code="robot.needs-xacro", text=words, file=str(path))) from error
    lost: list[str] = []

    def find(name: str) -> str:
        for folder in filter(Path.is_dir, _list_package_folders(name, path)):
            # The name of a ROS package; without a manifest that of its folder.
            found = None
            with contextlib.suppress(OSError):
                manifest = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
                found = re.search(r"<name>\s*([^<\s]+)\s*</name>", manifest)
            if (found[1] if found else folder.name) == name:
                return str(folder)
        lost.append(name)
        return f"$(find {name})"

    printed, used = io.StringIO(), dict(given)
    before = substitution_args._eval_find  # noqa: SLF001  xacro has no other way to tell where packages are
    try:
        with contextlib.redirect_stderr(printed), contextlib.redirect_stdout(printed):
            _use_finder(substitution_args, find)
            # The text that the program xacro prints, line by line, but without the folder in its head.
            document = xacro.process_file(str(path), mappings=used)
            document.childNodes[1].data = f" expanded by xacro from {path.name} "
            text = document.toprettyxml(indent="  ")
    except Exception as error:  # expressions of the file raise whatever they like
        raise RobotError(_explain_failure(xacro, error, path, lost)) from error
    finally:
        _use_finder(substitution_args, before)
    if unknown := _list_unknown(given, path, map(Path, xacro.all_includes)):
        raise UsageError(*(Notice(code="usage.xacro", text=text, file=str(path)) for text in unknown))
    open_ones = [f"{name}:={value}" for name, value in used.items() if name not in given]
    words = f"expanded by xacro{', with ' if given else ''}"
    words += ", ".join(f"{name}:={value}" for name, value in given.items())
    words += f"{', arguments at their defaults: ' if open_ones else ''}{', '.join(open_ones)}"
    words += f'; lines of messages with "(expanded)" are those that `xacro {path.name}` prints'
    notices = [Notice(code="robot.xacro-arguments", text=words, file=str(path))]
    said = [f"xacro: {entry}" for entry in (printed.getvalue().strip(),) if entry]
    said += [f"{_explain_package(name)}; paths that begin with it are left as they are" for name in lost[:1]]
    notices += [Notice(code="robot.xacro-warning", text=entry, file=str(path)) for entry in said]
    return UrdfText(text=text, file=f"{path} (expanded)", notices=tuple(notices))


def _list_unknown(given: Mapping[str, str], path: Path, included: Iterable[Path]) -> list[str]:
    """Return a sentence for each argument that neither the xacro file nor those that it includes declare."""
    if not given:
        return []
    files = filter(Path.is_file, (path, *included))
    texts = (file.read_text(encoding="utf-8", errors="replace") for file in files)
    known = dict.fromkeys(_XACRO_ARGUMENT.findall("".join(texts)))
    return [
        f"--xacro {name}: the file has no such argument; "
        + (suggest_names(name, known, otherwise="it has") if known else "it has none")
        for name in given
        if name not in known
    ]


def _use_finder(module: Any, find: Any) -> None:  # noqa: ANN401  xacro has no types
    module._eval_find = module._eval_dict["find"] = find  # noqa: SLF001  as above


def _list_package_folders(name: str, path: Path) -> Iterator[Path]:
    """Yield where the ROS package `name` may be: around a file, and where ROS looks."""
    for parent in path.resolve().parents:
        yield parent
        yield parent / name
    for variable, inner in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            folder = Path(entry).expanduser() / inner
            yield folder
            yield folder / name
            for depth in ("*", "*/*", "*/*/*"):
                yield from sorted(file.parent for file in folder.glob(f"{depth}/package.xml"))


def _explain_failure(xacro: Any, error: Exception, path: Path, lost: list[str]) -> Notice:  # noqa: ANN401  no types
    """Return why xacro failed, in the file that it was reading."""
    file = str((xacro.filestack or [None])[-1] or path)
    if isinstance(error, expat.ExpatError):
        text = f"not well-formed XML: {expat.ErrorString(error.code)}"
        return Notice(code="robot.xacro", text=text, file=file, line=error.lineno, column=error.offset + 1)
    cause: BaseException | None = error
    while cause is not None and type(cause).__name__ != "ArgException":
        cause = getattr(cause, "exc", None)
    if lost:
        text = _explain_package(lost[0])
    elif cause is not None:
        text = f"the argument {cause} has no default; give it with --xacro {cause}:=VALUE"
    else:
        text = f"xacro cannot expand it: {str(error) or type(error).__name__}"
    for macro in (xacro.macrostack or ())[-1:]:
        text += f" (in the macro {macro.body.getAttribute('name')})"
    return Notice(code="robot.xacro", text=text, file=file)


def _explain_package(name: str) -> str:
    return (
        f"$(find {name}): there is no ROS package of this name around the file, nor in ROS_PACKAGE_PATH or "
        "AMENT_PREFIX_PATH; set ROS_PACKAGE_PATH to the folder that the package is in"
    )
