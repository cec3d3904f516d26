"""Pages from templates; a context's fields equal the template's variables.

Input: a frozen dataclass of strings, numbers and tuples. Output: HTML, with every text escaped
but those that a template marks as safe.

Supported: loops, joins and plain conditions. Not supported: an undefined name, which is an error.
"""

from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any

from symid.errors import GenerationError, Notice
from symid.resources import find_resource_folder

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from jinja2 import Environment

__all__ = ["find_variables", "write_page"]


@cache
def _find_environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(find_resource_folder("templates") / "report"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def find_variables(name: str) -> frozenset[str]:
    """Return the names that the template `name` and those it builds on want from its context."""
    from jinja2 import meta

    source = (find_resource_folder("templates") / "report" / name).read_text(encoding="utf-8")
    tree = _find_environment().parse(source)
    others = (find_variables(other) for other in meta.find_referenced_templates(tree) if other)
    return frozenset(meta.find_undeclared_variables(tree)).union(*others)


def write_page(name: str, context: "DataclassInstance") -> str:
    """Return the template `name`, for example "identification.html.jinja", filled with `context`.

    Raises:
        GenerationError: the context's fields and the template's variables are not the same.
    """
    values: dict[str, Any] = {field.name: getattr(context, field.name) for field in fields(context)}
    wanted = find_variables(name)
    if wanted != values.keys():
        missing, unused = sorted(wanted - values.keys()), sorted(values.keys() - wanted)
        text = f"template {name}: its context lacks {missing} and has {unused} that it does not use"
        raise GenerationError(Notice(code="report.template-context", text=text))
    return _find_environment().get_template(name).render(values)
