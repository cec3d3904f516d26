"""A result as one self-contained HTML file: what the pages of all results share.

Robot, verdict, blocks, settings -> `Page` -> HTML, with every text escaped. Pages print well, follow the
reader's light or dark setting, suit screen readers and load nothing; the one script gives figures over time a
cursor and a zoom, and pages are complete without it. The same input gives the same bytes.

Not supported: more than one robot on a page.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symid import __version__
from symid.codegen import Library
from symid.environment import locate_resource_folder, write_file
from symid.errors import Notice, merge_notices
from symid.identification.elastic import ElasticEstimate
from symid.identification.estimators import SIGNIFICANT, Estimate, ParameterEstimate, Residual
from symid.identification.friction import FrictionIdentification
from symid.logs import Recording
from symid.report.blocks import (
    Block,
    Drawing,
    Table,
    format_digits,
    format_pair,
    format_percent,
    split_sections,
    write_elements,
    write_unit,
)
from symid.report.figures import Mark, build_mark_figure
from symid.report.verdict import FitVerdict
from symid.robot import Robot

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATE = "page.html.jinja"
WRITTEN_BY = f"Written by symid {__version__}"
UNTESTED = (
    "No log was held out: the model was not tested on another motion. Validate it on one (--validation)."
)
_SIGMA = "within 3\N{GREEK SMALL LETTER SIGMA}"
_OWN_ANCHORS = ("verdict", "notices", "settings")
"""Of sections that every page has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """The context of the template: its fields are the template's variables.

    Args:
        robot: its name, or whose results are shown.
        subject: of the page, in a few words.
        verdict: stands first.
        numbers: the few that matter, each with what it is.
        lead: the figure beside them.
        next_step: the command that a reader would type next, and why.
        blocks: headings, paragraphs, tables and figures in their order.
        more: the same for those who look closer: its sections are folded, but printed.
        settings: name and value of all that was used.
        notices: what else a reader should know, each once.
        origin: what the page was made from, in short texts.
        title: of the page, in place of robot and subject; author, date: as they are printed below it.
        second: the figure below the first, such as the robot.
        headline: a sentence in place of the verdict's, whose reasons stand below.
        conventions: of signs and sides, for the foot of the page; units: of all numbers, likewise.
    """

    robot: str
    subject: str
    verdict: FitVerdict
    blocks: Sequence[Block]
    settings: Sequence[tuple[str, str]]
    numbers: Sequence[tuple[str, str]] = ()
    lead: Drawing | None = None
    next_step: tuple[str, str] | None = None
    more: Sequence[Block] = ()
    notices: Sequence[str] = ()
    origin: Sequence[str] = (WRITTEN_BY,)
    title: str = ""
    author: str = ""
    date: str = ""
    second: Drawing | None = None
    headline: str = ""
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
    headline: str = "",
    **options: Any,  # noqa: ANN401  fields of the record
) -> Page:
    """Return the page of an estimate; `settings` and `notices` besides its own, `options` of `Page`.

    The `headline` is by default the first reason of the verdict; why a fit is wrong comes before its numbers.
    """
    if verdict.level == "wrong" or not headline:
        headline = verdict.headline if verdict.level == "wrong" else next(iter(verdict.reasons), "")
    model = {"logs": estimate.sources, "signature of the model": estimate.signature}
    return Page(
        robot=estimate.robot,
        subject=subject,
        verdict=verdict,
        # One sentence: what limits the level stands below it.
        headline=headline,
        blocks=blocks,
        settings=(*_list_settings({**settings, **model}), *_list_settings(estimate.settings)),
        notices=tuple(map(str, merge_notices((*estimate.notices, *notices), estimate.sources))),
        origin=(WRITTEN_BY, *origin),
        **options,
    )


def _list_settings(value: object, prefix: str = "") -> Iterator[tuple[str, str]]:
    match value:
        case Mapping():
            for key, entry in value.items():
                yield from _list_settings(entry, f"{prefix}.{key}" if prefix else str(key))
        case list() | tuple():
            yield prefix, ", ".join(map(str, value))
        case _:
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
    shown = split_sections(page.blocks, _OWN_ANCHORS)
    taken = (*_OWN_ANCHORS, *(section.anchor for section in shown))
    folded = split_sections(page.more, taken)
    blocks = (page.lead, *page.blocks, *page.more)
    live = any(isinstance(block, Drawing) and block.live for block in blocks)
    return build_environment().get_template(TEMPLATE).render(values, shown=shown, folded=folded, live=live)


def write_figures(drawings: Sequence[Drawing]) -> str:
    """Return figures as one self-contained page without anything else."""
    body = "".join(write_elements([drawing]) for drawing in drawings)
    live = any(drawing.live for drawing in drawings)
    return build_environment().get_template("figures.html.jinja").render(body=body, live=live)


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
    environment.filters["markup"] = Markup
    return environment


def tabulate_parameters(
    parameters: Sequence[ParameterEstimate], *, formulas: bool = True, simulated: bool = False
) -> Table:
    """Return the table of parameters; beside them the values of the robot file, true ones if `simulated`.

    Without `formulas` a column has the meaning of a parameter in words. Errors are relative to the true
    value, where that is not zero; a value within two deviations of zero has no relative deviation.
    """
    known = any(entry.truth is not None for entry in parameters)
    beside = ("truth", "error", _SIGMA) if simulated else ("robot file",)
    header = ["name", "value ± std", "unit", "uncertainty", *(beside if known else ())]
    rows = list[list[object]]()
    for entry in parameters:
        certain = math.isfinite(entry.std)
        relative = f"> {100.0 / SIGNIFICANT:.0f} %" if certain else "-"
        if certain and entry.significant:
            relative = format_percent(entry.relative_std_percent)
        row = [entry.name, format_pair(entry.value, entry.std), write_unit(entry.unit), relative]
        near = (format_error(entry.value, entry.truth), entry.near_truth if certain else None)
        true = (entry.truth, *(near if simulated else ()))
        meaning = "\n" + "; ".join(filter(None, (entry.expression, entry.reason)))
        rows.append([*row, *(true if known else ()), *(() if formulas else (meaning,))])
    told = f"; {_SIGMA}: the true value lies within three of them" if known and simulated else ""
    header += [] if formulas else ["meaning"]
    left = (0, 2) if formulas else (0, 2, len(header) - 1)
    return Table(header, rows, left, f"With standard deviations{told}.")


def tabulate_residual(residual: Sequence[Residual], title: str) -> Table:
    """Return the residual of every joint, the worst in bold."""
    rows = [
        (e.joint, format_percent(e.relative_percent), format_digits(e.std), write_unit(e.unit))
        for e in residual
    ]
    worst = max(range(len(rows)), key=lambda k: residual[k].relative_percent) if len(rows) > 1 else None
    return Table(("joint", "residual", "RMS", "unit"), rows, (0, 3), title, picked=worst)


def count_significant(parameters: Sequence[ParameterEstimate]) -> tuple[str, str]:
    """Return how many parameters are significant, of how many, and what that is."""
    count = sum(entry.significant for entry in parameters)
    return f"{count} of {len(parameters)}", f"parameters significant (> {SIGNIFICANT:g} std)"


def show_groupings(parameters: Sequence[ParameterEstimate]) -> tuple[Block, ...]:
    """Return what each parameter groups, and why, and which group nothing."""
    rows, alone = [], dict[str, list[str]]()
    for entry in parameters:
        if entry.expression == entry.name:
            alone.setdefault(entry.reason, []).append(entry.name)
        else:
            rows.append((entry.name, f"{entry.expression}\n{entry.reason}"))
    table = Table(("name", "group of standard parameters, and why"), rows, (0, 1))
    texts = [f"{reason[:1].upper()}{reason[1:]}: {', '.join(names)}." for reason, names in alone.items()]
    return (*([table] if rows else []), *(["\n".join(texts)] if texts else []))


def draw_certainty(parameters: Sequence[ParameterEstimate]) -> tuple[Drawing, ...]:
    """Return the figure of how significant each parameter is; nothing where no deviation is known."""
    marks = [
        Mark(entry.name, abs(entry.value) / entry.std, chosen=not entry.significant)
        for entry in parameters
        if 0.0 < entry.std < math.inf and entry.value
    ]
    if not marks:
        return ()
    caption = f"Which parameters are significant? {sum(not mark.chosen for mark in marks)} of {len(marks)} "
    caption += f"are larger than {SIGNIFICANT:g} standard deviations, the dashed line."
    return (build_mark_figure(caption, "size, in standard deviations", marks, dense=True, limit=SIGNIFICANT),)


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
