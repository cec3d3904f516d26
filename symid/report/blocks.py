"""What a result is told in: paragraphs, tables and figures, for a terminal and for a notebook.

Input: texts, cells, drawings. Output: plain text, or HTML that needs nothing else.

Supported: cells of text, numbers, truth values and None, which is an empty cell; figures as SVG, which a
terminal leaves out.
"""

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Block", "Drawing", "Table", "format_table", "write_html", "write_svg", "write_text"]

_STYLE = (
    "<style>.symid table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.4em 0}"
    ".symid td,.symid th{padding:.2em .6em;border-bottom:1px solid #8884;text-align:right;white-space:nowrap}"
    ".symid .text{text-align:left;white-space:normal}.symid caption{text-align:left;opacity:.75}"
    ".symid p{white-space:pre-wrap;margin:.4em 0}.symid svg{max-width:46em;width:100%;height:auto}"
    ".symid .fail{border-left:.3em solid #b83a3a;padding-left:.6em}"
    ".symid svg text{fill:currentColor;font-size:12.5px}.symid .grid{stroke:#8886;stroke-width:.7}"
    ".symid .axis{stroke:#888;fill:none}.symid .line{fill:none;stroke-width:1.3;stroke-linejoin:round}"
    ".symid .measured{stroke:#2a6fbb;stroke-width:2.6;opacity:.55}.symid .residual{stroke:#2a6fbb}"
    ".symid .predicted,.symid .final{stroke:#d9722e}.symid .link{stroke:#1c8a86}"
    ".symid .initial{stroke:#888}.symid .bar{fill:#2a6fbb;opacity:.55}.symid .other{stroke:#2a6fbb}"
    ".symid .chosen{stroke:#d9722e}.symid .mark{fill:#fff;stroke-width:1.4}</style>"
)
"""Colours that hold on light and dark ground; the names are those of `symid.report.lines`."""
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
        cells = [self.header, *(tuple(map(_show, row)) for row in self.rows)]
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
        kinds = [' class="text"' if k in self.left else "" for k in range(len(self.header))]
        head = "".join(
            f"<th{kind}>{html.escape(name)}</th>" for name, kind in zip(self.header, kinds, strict=True)
        )
        rows = "".join(
            "<tr>"
            + "".join(
                f"<td{kind}>{html.escape(_show(cell))}</td>" for cell, kind in zip(row, kinds, strict=True)
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
                parts.append(f"<p>{html.escape(block)}</p>")
    kind = "symid fail" if failed else "symid"
    return f'{_STYLE}<div class="{kind}">{"".join(parts)}</div>'


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
    return f"{head}{_STYLE}{''.join(parts)}</svg>\n"


def _show(value: object) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.5g}" if math.isfinite(value) else "-"
    return str(value)
