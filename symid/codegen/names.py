"""Names that a robot file states, made fit for code: identifiers, file names, comments, prose.

Input: any text. Output: text that ends no comment, no string and no line.
"""

import re

__all__ = ["clean_text", "find_prefix"]

# In this order: a backslash becomes what could close a comment. `??` starts a trigraph, `$` and `@`
# start a substitution in pkg-config and CMake files, a backquote ends code in Markdown.
_REPLACED = (
    ("\\", "/"),
    ("*/", "* /"),
    ("/*", "/ *"),
    ('"', "'"),
    ("`", "'"),
    ("??", "? ?"),
    ("$", "S"),
    ("@", "a"),
)


def find_prefix(robot: str) -> str:
    """Return the name of a robot's library: `symid_` and the robot's name as an identifier."""
    return "symid_" + re.sub(r"\W", "_", robot, flags=re.ASCII).lower()


def clean_text(text: str) -> str:
    """Return `text` on one line, free of what would end or open a comment, a string or a substitution."""
    flat = "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
    for found, replacement in _REPLACED:
        flat = flat.replace(found, replacement)
    return flat
