"""Where each key and value of a TOML text stands.

Input: a text that `tomllib` accepts. Output: `Places`, a place (line and column from one, raw text)
for every key path; a path is made of names and, within arrays, indices: ("joint", 0, "alpha").

Supported: all of TOML 1.0: tables, arrays of tables and their sub-tables, dotted and quoted
keys, inline tables, arrays over several lines, every kind of string, comments.
Not supported: texts that are not TOML; nothing is validated here.
"""

import re
import tomllib
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["KeyPath", "Place", "Places", "find_places"]

KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r'[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|\'[^\']*\'')
# A string of several lines may end in up to two quotes of its own.
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"""(?:"{0,2})|\'\'\'.*?\'\'\'(?:\'{0,2})|"(?:[^"\\]|\\.)*"|\'[^\']*\'', re.DOTALL
)
_BARE_VALUE = re.compile(r"[^,\]}#\n]+")


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file, and the text that stands there."""

    file: str
    line: int
    column: int
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """The places of keys and values by key path; `whole` is the place of the text itself."""

    keys: Mapping[KeyPath, Place]
    values: Mapping[KeyPath, Place]
    whole: Place

    def find_key(self, path: KeyPath) -> Place:
        """Return where the key at `path` stands, or else the nearest table around it."""
        return self.keys[path] if path in self.keys else self.find_value(path[:-1])

    def find_value(self, path: KeyPath) -> Place:
        """Return where the value at `path` stands, or else the nearest table around it."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path, self.whole)


def find_places(text: str, file: str = "") -> Places:
    """Return the places of all keys and values in the TOML `text`.

    Args:
        text: valid TOML whose lines end in a line feed alone.
        file: the name that the places carry.
    """
    scanner = _Scanner(text, file)
    scanner.scan_document()
    return Places(keys=scanner.keys, values=scanner.values, whole=Place(file, 1, 1))


class _Scanner:
    """A cursor in the text, and the places found so far."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.position = 0
        self.keys: dict[KeyPath, Place] = {}
        self.values: dict[KeyPath, Place] = {}
        self._line_ends = [match.start() for match in re.finditer(r"\n", text)]
        self._tables: dict[KeyPath, int] = {}

    def scan_document(self) -> None:
        prefix: KeyPath = ()
        self._skip(_BLANK)
        while self.position < len(self.text):
            if self.text[self.position] == "[":
                prefix = self._scan_header()
            else:
                self._scan_pair(prefix)
            self._skip(_BLANK)

    def _scan_header(self) -> KeyPath:
        """Return the path that the keys below `[a.b]` or `[[a.b]]` belong to."""
        start = self.position
        brackets = 2 if self.text.startswith("[[", start) else 1
        self.position += brackets
        names = self._scan_key()
        self.position += brackets
        path: KeyPath = ()
        for number, (name, place) in enumerate(names, start=1):
            path = (*path, name)
            self.keys.setdefault(path, place)
            self.values.setdefault(path, place)
            if number == len(names) and brackets == 2:
                self._tables[path] = self._tables.get(path, 0) + 1
            if path in self._tables:
                path = (*path, self._tables[path] - 1)
        self.keys[path] = names[-1][1]
        # A header says more on a table than a sub-table's header before it.
        self.values[path] = self._place(start, self.position)
        return path

    def _scan_pair(self, prefix: KeyPath) -> None:
        names = self._scan_key()
        self.position += 1
        path = prefix
        for name, place in names:
            path = (*path, name)
            self.keys.setdefault(path, place)
            self.values.setdefault(path, place)
        self._skip(_SPACE)
        self._scan_value(path)

    def _scan_key(self) -> list[tuple[str, Place]]:
        """Return the parts of a dotted key, with the cursor behind it and its white space."""
        names = []
        while True:
            self._skip(_SPACE)
            start = self.position
            self._skip(_KEY)
            raw = self.text[start : self.position]
            name = tomllib.loads(f"key = {raw}")["key"] if raw[0] in "\"'" else raw
            names.append((name, self._place(start, self.position)))
            self._skip(_SPACE)
            if self.text[self.position] != ".":
                return names
            self.position += 1

    def _scan_value(self, path: KeyPath) -> None:
        start = self.position
        match self.text[start]:
            case "[":
                self._scan_array(path)
            case "{":
                self._scan_inline_table(path)
            case '"' | "'":
                self._skip(_STRING)
            case _:
                self._skip(_BARE_VALUE)
                self.position = start + len(self.text[start : self.position].rstrip())
        self.values[path] = self._place(start, self.position)

    def _scan_array(self, path: KeyPath) -> None:
        index = 0
        self.position += 1
        self._skip(_BLANK)
        while self.text[self.position] != "]":
            self._scan_value((*path, index))
            index += 1
            self._skip(_BLANK)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANK)
        self.position += 1

    def _scan_inline_table(self, path: KeyPath) -> None:
        self.position += 1
        self._skip(_BLANK)
        while self.text[self.position] != "}":
            self._scan_pair(path)
            self._skip(_BLANK)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANK)
        self.position += 1

    def _skip(self, pattern: re.Pattern[str]) -> None:
        match = pattern.match(self.text, self.position)
        if match:
            self.position = match.end()

    def _place(self, start: int, end: int) -> Place:
        line = bisect_left(self._line_ends, start)
        before = self._line_ends[line - 1] if line else -1
        return Place(self.file, line + 1, start - before, self.text[start:end])
