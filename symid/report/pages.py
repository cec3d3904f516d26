"""A result as one self-contained HTML file: what the pages of all results share.

Robot, verdict, blocks, settings -> `Page` -> HTML, with every text escaped. Pages print well, follow the
reader's light or dark setting, suit screen readers, run no scripts and load nothing. The same input gives
the same bytes.

Not supported: more than one robot on a page; interaction.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from symid import __version__
from symid.codegen import Library
from symid.environment import locate_resource_folder, write_file
from symid.errors import Notice, merge_notices
from symid.identification.elastic import ElasticEstimate
from symid.identification.estimators import Estimate, ParameterEstimate
from symid.identification.friction import FrictionIdentification
from symid.logs import Recording
from symid.report.blocks import Block, Table, tabulate, write_elements
from symid.report.verdict import FitVerdict
from symid.robot import Robot

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATE = "page.html.jinja"
WRITTEN_BY = f"Written by symid {__version__}"
_SIGMA = "within 3\N{GREEK SMALL LETTER SIGMA}"


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
        conventions: of signs and sides, for the foot of the page; units: of all numbers, likewise.
    """

    robot: str
    subject: str
    verdict: FitVerdict
    blocks: Sequence[Block]
    settings: Sequence[tuple[str, str]]
    notices: Sequence[str] = ()
    origin: Sequence[str] = (WRITTEN_BY,)
    conventions: str = "friction opposes positive velocity with positive sign"
    units: str = "SI units throughout"


def build_fit_page(
    estimate: Estimate | ElasticEstimate | FrictionIdentification,
    *,
    subject: str,
    verdict: FitVerdict,
    blocks: Sequence[Block],
    settings: Mapping[str, object],
    notices: Sequence[Notice] = (),
    origin: Sequence[str] = (),
    **options: str,
) -> Page:
    """Return the page of an estimate; `settings` and `notices` besides its own, `options` of `Page`."""
    model = {"logs": estimate.sources, "signature of the model": estimate.signature}
    return Page(
        robot=estimate.robot,
        subject=subject,
        verdict=verdict,
        blocks=blocks,
        settings=(*_list_settings({**settings, **model}), *_list_settings(estimate.settings)),
        notices=tuple(map(str, merge_notices((*estimate.notices, *notices), estimate.sources))),
        origin=(WRITTEN_BY, *origin),
        **options,
    )


def _list_settings(value: object, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield every setting of nested tables with its dotted name."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _list_settings(entry, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value))
    else:
        yield prefix, "none" if value is None else str(value)


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


def tabulate_parameters(parameters: Sequence[ParameterEstimate], *, formulas: bool = True) -> Table:
    """Return the table of parameters with the true values where they are known.

    Without `formulas` an expression is the meaning of a parameter in words. Errors are relative to the true
    value, where that is not zero.
    """
    known = any(entry.truth is not None for entry in parameters)

    def explain(entry: ParameterEstimate) -> str:
        if not formulas:
            return "\n" + "; ".join(filter(None, (entry.expression, entry.reason)))
        return f"{'' if entry.expression == entry.name else entry.expression}\n{entry.reason}"

    columns = "name; value=value:.5g; std; relative std=relative; unit"
    columns += f"; truth; error; {_SIGMA}=near" if known else ""
    columns += f"; {'what it groups, and why' if formulas else 'meaning'}=explain"
    title = "Values in SI units, with their standard deviation"
    if known:
        title += f"; {_SIGMA}: the true value lies within three standard deviations"
    return tabulate(
        parameters,
        columns,
        (0, 4, columns.count("; ")),
        f"{title}.",
        std=lambda entry: format_digits(entry.std),
        relative=lambda entry: format_percent(entry.relative_std_percent),
        error=lambda entry: format_error(entry.value, entry.truth),
        near=lambda entry: entry.near_truth if math.isfinite(entry.std) else None,
        explain=explain,
    )


def show_refused(refused: Sequence[tuple[str, str]]) -> tuple[Table, ...]:
    """Return the parameters that cannot be identified, with the reasons; nothing where there are none."""
    title = "Not identifiable from these logs: no value is given for these parameters."
    return (Table(("name", "reason"), refused, (0, 1), title),) if refused else ()


def format_error(value: float, truth: float | None) -> str:
    """Return the error relative to a true value, with its sign; nothing where that is zero or not known."""
    if not truth:
        return ""
    percent = 100.0 * (value - truth) / abs(truth)
    sign = "\N{MINUS SIGN}" if percent < 0.0 else "+"
    return f"{sign}{format_percent(abs(percent))}"


def format_digits(value: float) -> str:
    """Return two digits, more from 100 on, where two would need a power of ten; "-" if it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def format_percent(value: float) -> str:
    """Return the same with its sign of percent."""
    return f"{format_digits(value)} %" if math.isfinite(value) else "-"


def describe_origin(robot: Robot, library: Library, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return in short texts what a report was made from; the same input gives the same texts."""
    return (
        f"robot {robot.name} of {robot.path}",
        *([f"its source: {robot.source}"] if robot.source else []),
        f"functions run as {library.backend}",
        *(
            f"{entry.source}: {entry.time[-1] - entry.time[0]:.6g} s at {1.0 / entry.period:.6g} Hz"
            for entry in recordings
        ),
    )
