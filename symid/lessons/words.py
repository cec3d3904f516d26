"""The language of a lesson: every fixed sentence in English, or as one table has it in another language.

Text in English -> text in the language, by `templates/lesson/LANGUAGE.toml`: pairs of sentences, in which
{0}, {1} stand for what differs from robot to robot. Such a part is translated too where the table has it.

Supported: English and German. Not supported: texts of robot files, comments of code.
"""

import re
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from typing import TypeAlias

from symid.environment import locate_resource_folder

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
    # The longest first: what has fewer parts that differ is meant.
    forms = sorted((text for text in pairs if "{0}" in text), key=len, reverse=True)
    patterns = [(re.compile(_write_pattern(text), re.DOTALL), pairs[text]) for text in forms]

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


def _write_pattern(text: str) -> str:
    """Return a pattern for all texts of a form with {0}, {1}; only behind a sign at the end are lists."""
    pieces = re.split(r"\{(\d)\}", text)
    seen: set[str] = set()
    pattern = ""
    for k, piece in enumerate(pieces):
        if k % 2 == 0:
            pattern += re.escape(piece)
        else:
            ends = k == len(pieces) - 2 and not pieces[-1] and pieces[k - 1].endswith((": ", ". "))
            any_text = ".+?" if ends else "(?:(?!; |: ).)+?"
            pattern += f"(?P=part{piece})" if piece in seen else f"(?P<part{piece}>{any_text})"
            seen.add(piece)
    return pattern
