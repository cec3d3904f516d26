"""Templates and the one rule for using them: a context's fields equal the template's variables.

Input: a frozen dataclass of strings, numbers and tuples. Output: text.

Supported: loops and joins. Not supported: logic in templates; an undefined name is an error.
"""

from dataclasses import fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from symid.errors import GenerationError, Notice
from symid.resources import find_resource_folder

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["find_template_bytes", "write_template"]


@cache
def _find_environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(find_resource_folder("templates")),
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701  C and Python, no HTML
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def _find_variables(name: str) -> frozenset[str]:
    from jinja2 import meta

    environment = _find_environment()
    source, _, _ = environment.loader.get_source(environment, name)  # type: ignore[union-attr]  # set above
    return frozenset(meta.find_undeclared_variables(environment.parse(source)))


def write_template(name: str, context: object) -> str:
    """Return the template `name`, for example "c/header.h.jinja", filled with `context`.

    Raises:
        GenerationError: the context's fields and the template's variables are not the same.
    """
    if not is_dataclass(context) or isinstance(context, type):
        message = f"expected a dataclass instance, got {context!r}"
        raise TypeError(message)
    values: dict[str, Any] = {field.name: getattr(context, field.name) for field in fields(context)}
    wanted = _find_variables(name)
    if wanted != values.keys():
        missing, unused = sorted(wanted - values.keys()), sorted(values.keys() - wanted)
        text = f"template {name}: its context lacks {missing} and has {unused} that it does not use"
        raise GenerationError(Notice(code="codegen.template-context", text=text))
    return _find_environment().get_template(name).render(values)


def find_template_bytes(*folders: str) -> tuple[tuple[str, bytes], ...]:
    """Return name and bytes of every template in `folders`, sorted by name."""
    root = find_resource_folder("templates")
    paths = sorted(path for folder in folders for path in (root / folder).glob("*.jinja"))
    return tuple((path.relative_to(root).as_posix(), path.read_bytes()) for path in paths)
