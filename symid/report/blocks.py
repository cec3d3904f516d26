"""What a result is printed with: paragraphs, tables and figures, for a terminal and for a notebook.

Texts, cells, drawings -> plain text, or HTML that needs nothing else.

Supported: cells of text, numbers, truth values and None, which is an empty cell; figures as SVG, which a
terminal leaves out.
"""

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from symid.environment import locate_resource_folder

_COLOURS = {
    "ink": "currentColor",
    "soft": "#888",
    "rule": "#8885",
    "ground": "transparent",
    "blue": "#2a7fd0",
    "orange": "#d9722e",
    "teal": "#1c9a95",
    "good": "#2e9d5f",
    "poor": "#c84a4a",
}
"""They hold on light and on dark ground."""
_TABLES = """.symid table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .4em 0 }
.symid td, .symid th { padding: .2em .6em; border-bottom: 1px solid #8884 }
.symid td, .symid th { text-align: right; white-space: nowrap }
.symid table td.text, .symid table th.text { text-align: left }
.symid table td.long { white-space: normal }
.symid caption { text-align: left; opacity: .75; white-space: pre-wrap }
.symid p { white-space: pre-wrap; margin: .4em 0 } .symid p.head { font-weight: 600; margin-top: 1em }
.symid.fail { border-left: .3em solid #c84a4a; padding-left: .6em }
.symid figure { margin: .4em 0 } .symid figcaption { opacity: .75 }
.symid svg { max-width: 46em; width: 100%; height: auto }
.symid svg text { fill: currentColor; font-size: 12.5px }
"""
# The names before a rule: at the beginning of a line, and behind commas before its brace.
_SELECTOR = re.compile(r"(?:^|(?<=, ))(?=[\w.]+[^{}]*\{)", re.MULTILINE)
_LONG = 30
"""Letters of a cell that may be broken into lines."""
_HEADING = re.compile(r"== (.*) ==")
_SIZE = re.compile(r'viewBox="0 0 ([0-9.]+) ([0-9.]+)"')


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the names of its columns, its rows, and which columns stand flush left.

    `title` stands right above it, `note` right below.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    left: tuple[int, ...] = (0,)
    title: str = ""
    note: str = ""

    def __str__(self) -> str:
        """Return the table as it stands in a terminal."""
        cells = [self.header, *(tuple(map(_format_cell, row)) for row in self.rows)]
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.header))]
        lines = [
            "  ".join(
                text.ljust(width) if k in self.left else text.rjust(width)
                for k, (text, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in cells
        ]
        rule = "  ".join("-" * width for width in widths)
        title, note = ([text] if text else [] for text in (self.title, self.note))
        return "\n".join((*title, lines[0], rule, *lines[1:], *note))

    def write_html(self) -> str:
        """Return the table as HTML."""
        columns = list(zip(*self.rows, strict=True)) or [()] * len(self.header)
        kinds = [
            (
                ' class="text long"'
                if max(map(len, map(_format_cell, cells)), default=0) > _LONG
                else ' class="text"'
            )
            if k in self.left
            else ""
            for k, cells in enumerate(columns)
        ]
        head = "".join(
            f"<th{kind}>{html.escape(name)}</th>" for name, kind in zip(self.header, kinds, strict=True)
        )
        rows = "".join(
            "<tr>"
            + "".join(
                f"<td{kind}>{html.escape(_format_cell(cell))}</td>"
                for cell, kind in zip(row, kinds, strict=True)
            )
            + "</tr>"
            for row in self.rows
        )
        caption = f"<caption>{html.escape(self.title)}</caption>" if self.title else ""
        note = f"<p>{html.escape(self.note)}</p>" if self.note else ""
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{note}"


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure as an `<svg>` element, and what it shows."""

    svg: str
    caption: str


Block = str | Table | Drawing
"""A part of what a result says; parts stand apart by an empty line."""


def format_table(
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    left: Sequence[int] = (0,),
    title: str = "",
    note: str = "",
) -> Table:
    """Return a table; columns whose number is in `left` are flush left."""
    return Table(tuple(header), tuple(map(tuple, rows)), tuple(left), title, note)


def write_text(blocks: Sequence[Block]) -> str:
    """Return the blocks as plain text, figures left out."""
    return "\n\n".join(str(block) for block in blocks if not isinstance(block, Drawing))


@cache
def _load_style() -> str:
    """Return the style of tables, and of figures as pages have it, for what stands in an element `symid`."""
    rules = (locate_resource_folder("templates") / "report" / "figures.css").read_text(encoding="utf-8")
    for name, colour in _COLOURS.items():
        rules = rules.replace(f"var(--{name})", colour)
    return f"<style>{_TABLES}{_SELECTOR.sub('.symid ', rules)}</style>"


def write_html(blocks: Sequence[Block], *, failed: bool = False) -> str:
    """Return the blocks as HTML for a page of others, such as a notebook.

    Args:
        blocks: in their order.
        failed: whether the result is not acceptable, which a bar at the left then shows.
    """
    parts = []
    for block in blocks:
        match block:
            case Table():
                parts.append(block.write_html())
            case Drawing():
                caption = html.escape(block.caption)
                parts.append(f"<figure>{block.svg}<figcaption>{caption}</figcaption></figure>")
            case _:
                head = _HEADING.fullmatch(block)
                parts.append(
                    f'<p class="head">{html.escape(head[1])}</p>' if head else f"<p>{html.escape(block)}</p>"
                )
    kind = "symid fail" if failed else "symid"
    return f'{_load_style()}<div class="{kind}">{"".join(parts)}</div>'


def write_svg(drawings: Sequence[Drawing]) -> str:
    """Return figures below one another as one SVG file."""
    top, width, parts = 0.0, 0.0, []
    for drawing in drawings:
        size = _SIZE.search(drawing.svg)
        if size is None:
            continue
        across, height = float(size[1]), float(size[2])
        parts.append(
            drawing.svg.replace("<svg ", f'<svg y="{top:g}" width="{across:g}" height="{height:g}" ', 1)
        )
        top, width = top + height, max(width, across)
    head = f'<svg class="symid" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {top:g}">'
    return f"{head}{_load_style()}{''.join(parts)}</svg>\n"


def _format_cell(value: object) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.5g}" if math.isfinite(value) else "-"
    return str(value)
