"""Options of generated code, names of robot files made safe for code, and templates.

Supported: loops and joins in templates. Not supported: logic in templates; an undefined name is an error.
"""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice, UsageError

if TYPE_CHECKING:
    from jinja2 import Environment

BACKENDS = ("auto", "c", "python", "casadi")
"""What can compute a robot's functions; "auto" is C, or NumPy where there is no compiler."""


def check_choice(key: str, value: str, allowed: Sequence[str]) -> None:
    """Raise UsageError, code `usage.KEY`, where `value` is not one of those allowed."""
    if value not in allowed:
        text = f"{key}: expected one of {', '.join(allowed)}, got {value!r}"
        raise UsageError(Notice(code=f"usage.{key}", text=text))


# In this order: a backslash becomes what could close a comment. `??` starts a trigraph, `$` and `@`
# start a substitution in pkg-config and CMake files, a backquote ends code in Markdown.
_REPLACED_TEXT = {"\\": "/", "*/": "* /", "/*": "/ *", '"': "'", "`": "'", "??": "? ?", "$": "S", "@": "a"}


def build_library_prefix(robot: str) -> str:
    """Return the name of a robot's library: `symid_` and the robot's name as an identifier."""
    return "symid_" + re.sub(r"\W", "_", robot, flags=re.ASCII).lower()


def clean_text(text: str) -> str:
    """Return `text` on one line, free of what would end or open a comment, a string or a substitution."""
    flat = "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
    for found, replacement in _REPLACED_TEXT.items():
        flat = flat.replace(found, replacement)
    return flat


@cache
def _get_environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(locate_resource_folder("templates")),
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701  C and Python, no HTML
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def _list_variables(name: str) -> frozenset[str]:
    from jinja2 import meta

    environment = _get_environment()
    source, _, _ = environment.loader.get_source(environment, name)  # type: ignore[union-attr]  # set above
    return frozenset(meta.find_undeclared_variables(environment.parse(source)))


def write_template(template: str, facts: Mapping[str, object], /, **values: object) -> str:
    """Return a template, such as "c/header.h.jinja", filled with `facts`, which any template may use.

    `values` are those of its own variables; they go before facts of the same names.

    Raises:
        GenerationError: a variable of the template is missing, or one of `values` is not used.
    """
    wanted = _list_variables(template)
    missing, unused = sorted(wanted - facts.keys() - values.keys()), sorted(values.keys() - wanted)
    if missing or unused:
        text = f"template {template}: its context lacks {missing} and has {unused} that it does not use"
        raise GenerationError(Notice(code="codegen.template-context", text=text))
    return _get_environment().get_template(template).render({**facts, **values})


def read_template_bytes(*folders: str) -> tuple[tuple[str, bytes], ...]:
    """Return name and bytes of every template in `folders`, sorted by name."""
    root = locate_resource_folder("templates")
    paths = sorted(path for folder in folders for path in (root / folder).glob("*.jinja"))
    return tuple((path.relative_to(root).as_posix(), path.read_bytes()) for path in paths)
