"""A result as one HTML file that needs nothing else: what the pages of all results share.

Robot, verdict, blocks, settings -> `Page` -> HTML, with every text escaped. Pages print well, have a light
and a dark ground, and can be read aloud; they run no scripts and load nothing. The same input gives the same
bytes.

Not supported: more than one robot on a page; interaction: figures are drawn once.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from symid import __version__
from symid.codegen import Library
from symid.environment import locate_resource_folder, write_file
from symid.errors import Notice
from symid.identification.estimators import ParameterEstimate
from symid.logs import Recording
from symid.report.blocks import Block, Table, write_elements
from symid.report.verdict import FitVerdict
from symid.robot import Robot

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATE = "page.html.jinja"


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """The context of the template: its fields are the template's variables.

    Args:
        robot: its name, or whose results are shown.
        subject: of the page, in a few words.
        verdict: stands first.
        blocks: headings, paragraphs, tables and figures in their order.
        settings: name and value of all that was used.
        notices: what else a reader should know, each once.
        origin: what the page was made from, in short texts.
        conventions: of signs and sides, for the foot of the page.
    """

    robot: str
    subject: str
    verdict: FitVerdict
    blocks: Sequence[Block]
    settings: Sequence[tuple[str, str]]
    notices: Sequence[str] = ()
    origin: Sequence[str] = ()
    conventions: str = "friction opposes positive velocity with positive sign"


def write_page(path: Path, page: Page) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, render_page(page))


def render_page(page: Page) -> str:
    """Return the page as HTML."""
    values = {field.name: getattr(page, field.name) for field in fields(page)}
    return build_environment().get_template(TEMPLATE).render(values)


@cache
def build_environment() -> "Environment":
    """Return the environment of the template, which refuses names that a page does not have."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(locate_resource_folder("templates") / "report"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    # Every text of a block is escaped there; figures are SVG of our own.
    environment.filters["elements"] = lambda blocks: Markup(write_elements(blocks))  # noqa: S704
    return environment


def list_notices(notices: Iterable[Notice]) -> tuple[str, ...]:
    """Return the texts of notices, each once."""
    return tuple(dict.fromkeys(map(str, notices)))


def list_origin(texts: Sequence[str] = ()) -> tuple[str, ...]:
    """Return what wrote a page, then what it was made from."""
    return (f"Written by symid {__version__}", *texts)


def tabulate_parameters(
    parameters: Sequence[ParameterEstimate], last: str = "what it groups, and why"
) -> Table:
    """Return the table of parameters, beside the truth where it is known; `last` names its last column.

    Errors are relative to the true value, where that is not zero.
    """
    known = any(entry.truth is not None for entry in parameters)
    rows: list[list[object]] = []
    for entry in parameters:
        relative = entry.relative_std_percent
        row: list[object] = [
            entry.name,
            f"{entry.value:.5g}",
            format_digits(entry.std),
            f"{format_digits(relative)} %" if math.isfinite(relative) else math.inf,
            entry.unit,
        ]
        if known:
            near = entry.near_truth if math.isfinite(entry.std) else None
            row += [entry.truth, format_error(entry.value, entry.truth), near]
        # A formula, and words below it.
        formula = "" if entry.expression == entry.name else entry.expression
        rows.append([*row, f"{formula}\n{entry.reason}"])
    true = ("truth", "error", "within 3\N{GREEK SMALL LETTER SIGMA}") if known else ()
    header = ("name", "value", "std", "relative std", "unit", *true, last)
    title = "Values in SI units, with their standard deviation"
    if known:
        title += "; within 3\N{GREEK SMALL LETTER SIGMA}: the stated true value lies within three of them"
    return Table(header, rows, (0, 4, len(header) - 1), f"{title}.")


def show_refused(refused: Sequence[tuple[str, str]]) -> tuple[Block, ...]:
    """Return the parameters that the logs cannot tell, with the reasons; nothing where there are none."""
    text = "These logs cannot tell the following parameters, so no value is given."
    return ("== Refused ==", text, Table(("name", "reason"), refused, (0, 1))) if refused else ()


def format_error(value: float, truth: float | None) -> str:
    """Return the error relative to a true value, with its sign; nothing where that is zero or not known."""
    if not truth:
        return ""
    percent = 100.0 * (value - truth) / abs(truth)
    sign = "\N{MINUS SIGN}" if percent < 0.0 else "+"
    return f"{sign}{format_digits(abs(percent))} %"


def format_digits(value: float) -> str:
    """Return two digits, more from 100 on, where two would need a power of ten; "-" if it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def list_settings(value: object, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield every setting of nested tables with its dotted name."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from list_settings(entry, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value))
    else:
        yield prefix, "none" if value is None else str(value)


def describe_origin(robot: Robot, library: Library, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return in short texts what a report was made from; the same input gives the same texts."""
    texts = [f"robot {robot.name} of {robot.path}"]
    if robot.source:
        texts.append(f"its source: {robot.source}")
    texts.append(f"functions run as {library.backend}")
    texts += [
        f"{entry.source}: {entry.time[-1] - entry.time[0]:.6g} s at {1.0 / entry.period:.6g} Hz"
        for entry in recordings
    ]
    return tuple(texts)
