"""What a result is printed with: paragraphs, tables and figures, for a terminal, a notebook and a page.

Texts, cells, drawings -> plain text without figures, or self-contained HTML.

Supported: cells of text, numbers, booleans and None, which is an empty cell; figures as SVG;
"== heading ==", "=== heading below it ===", and formulas, which begin with four blanks.
"""

import html
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from itertools import chain, count, groupby, zip_longest
from typing import Any

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
    "wrong": "#c84a4a",
}
"""They hold on light and on dark ground."""
# The names before a rule: at the beginning of a line, and behind commas before its brace.
_SELECTOR = re.compile(r"(?:^|(?<=, ))(?=[\w.]+[^{}]*\{)", re.MULTILINE)
_NOTE_WIDTH = 110
_LOW = 8
"""Lines of a part that is cut below which it has no empty ones."""
_LONG = 24
"""Letters of a cell that may be broken into lines."""
_HEADING = re.compile(r"(={2,3}) (.*) \1")
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# A value that `format_pair` wrote: no name is one.
_PAIR = re.compile(
    "[(]?[0-9.e+\N{MINUS SIGN}]+( \N{PLUS-MINUS SIGN} [0-9.]+)?([)]\N{MULTIPLICATION SIGN}10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?"
)
_PLAIN = str.maketrans(
    dict(zip("⁻⁰¹²³⁴⁵⁶⁷⁸⁹\N{MINUS SIGN}\N{PLUS-MINUS SIGN}", (*"-0123456789-", "+-"), strict=True))
)
_ONE_DIGIT = 3.0
_MOST_DECIMALS = 6
_SIZE = re.compile(r'viewBox="0 0 ([0-9.]+) ([0-9.]+)"')


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the names of its columns, its rows, and which columns stand flush left.

    `title` stands right above it, `note` right below; HTML shows the row `picked` in bold. There a cell of
    two lines is a formula, or nothing, and its explanation. A terminal shows cells longer than `fold` letters
    on several lines, never a part of them; 0 for one line. Where not all rows have room, those with the
    largest numbers in the column `worst` stay, None for the first ones.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[object]]
    left: Sequence[int] = (0,)
    title: str = ""
    note: str = ""
    picked: int | None = None
    fold: int = 0
    worst: int | None = None

    def __str__(self) -> str:
        """Return the table as it stands in a terminal."""
        cells, fold = [self.header], self.fold
        wrap = textwrap.TextWrapper(fold, break_long_words=False, break_on_hyphens=False).wrap
        for texts in ([_write_plain(_format_cell(cell)) for cell in row] for row in self.rows):
            # A long cell has several lines.
            is_long = fold and any(len(text) > fold for text in texts)
            parts = [wrap(text) if is_long else [text] for text in texts]
            cells += [list(line) for line in zip_longest(*parts, fillvalue="")]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = []
        for row in cells:
            pairs = enumerate(zip(row, widths, strict=True))
            padded = (text.ljust(n) if k in self.left else text.rjust(n) for k, (text, n) in pairs)
            lines.append("  ".join(padded).rstrip())
        rule = "  ".join("-" * width for width in widths)
        title = [self.title] if self.title else []
        note = [textwrap.fill(line, width=_NOTE_WIDTH) for line in self.note.splitlines()]
        return "\n".join((*title, lines[0], rule, *lines[1:], *note))

    def write_html(self) -> str:
        """Return the table as HTML; the first cell of a row is its heading."""
        kinds = ["text" if k in self.left else "" for k in range(len(self.header))]
        for k in self.left:
            if any(len(_format_cell(row[k])) > _LONG for row in self.rows):
                kinds[k] = "text long"
        head = "".join(
            _write_tag('th scope="col"', kind, html.escape(name))
            for name, kind in zip(self.header, kinds, strict=True)
        )
        rows = []
        for number, row in enumerate(self.rows):
            inner = ""
            for k, (cell, kind) in enumerate(zip(row, kinds, strict=True)):
                formula, line_break, words = _format_cell(cell).partition("\n")
                text = html.escape(formula)
                if line_break:
                    text = f"{f'<code>{text}</code>' if text else ''}<span>{html.escape(words)}</span>"
                # "no" stands out.
                names = f"{kind} no".strip() if _to_plain(cell) is False else kind
                inner += _write_tag("td" if k else 'th scope="row"', names, text)
            rows.append(_write_tag("tr", "picked" * (number == self.picked), inner))
        caption = f"<caption>{html.escape(self.title)}</caption>" if self.title else ""
        note = f"<p>{html.escape(self.note)}</p>" if self.note else ""
        return (
            '<div class="scroll" tabindex="0" role="group" aria-label="Table">\n'
            f"<table>{caption}<thead><tr>{head}</tr></thead>"
            f"<tbody>{''.join(rows)}</tbody></table>\n</div>{note}"
        )


def _write_tag(tag: str, names: str, inner: str) -> str:
    classes = f' class="{names}"' if names else ""
    return f"<{tag}{classes}>{inner}</{tag.partition(' ')[0]}>"


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure as an `<svg>` element, what it shows, and the values in it where others can draw them."""

    svg: str
    caption: str
    data: object = field(default=None, compare=False, repr=False)

    @property
    def live(self) -> bool:
        """Return whether a page's script gives it a cursor and a zoom."""
        return " data-frame=" in self.svg


Block = str | Table | Drawing
"""A part of what a result says; parts stand apart by an empty line."""


def write_text(blocks: Sequence[Block]) -> str:
    """Return the blocks as plain text, figures left out."""
    return "\n\n".join(str(block) for block in blocks if not isinstance(block, Drawing))


def shorten_text(blocks: Sequence[Block], most: int) -> str:
    """Return the blocks as plain text of `most` lines, the longest of them cut to the same length.

    What is cut says how many lines more it has; a table without room for a row says only that. Lines that are
    left go to the first table that was cut.
    """
    shown = [block for block in blocks if not isinstance(block, Drawing)]
    parts = [str(block).splitlines() for block in shown]
    room = most - len(parts) + 1
    if sum(map(len, parts)) <= room:
        return write_text(blocks)
    for level in range(most, 2, -1):
        cut = [_cut_part(block, lines, level) for block, lines in zip(shown, parts, strict=True)]
        left = room - sum(map(len, cut))
        if left >= 0:
            tables = (k for k, block in enumerate(shown) if isinstance(block, Table))
            first = next((k for k in tables if cut[k] != parts[k]), None)
            if first is not None:
                cut[first] = _cut_part(shown[first], parts[first], len(cut[first]) + left)
            break
    else:
        text = write_text(blocks)
        cut = [_cut_part(text, text.splitlines(), most)]
    return "\n\n".join("\n".join(lines) for lines in cut)


def _cut_part(block: Block, lines: list[str], most: int) -> list[str]:
    """Return `most` lines of a block, the last of which says how many more it has."""
    if len(lines) <= most:
        return lines
    full = list(filter(None, lines)) if most < _LOW else lines
    kept, which = full[: most - 1], ""
    if isinstance(block, Table):
        head = len(block.title.splitlines()) + 2
        if len(kept) <= head:
            kept = []
        elif block.worst is not None and not block.fold:
            sizes = [_measure(row[block.worst]) for row in block.rows]
            ranks = sorted(range(len(sizes)), key=sizes.__getitem__, reverse=True)[: len(kept) - head]
            kept = [*full[:head], *(full[head + k] for k in sorted(ranks))]
            which = f" of less {block.header[block.worst]}"
    return [*kept, f"... {len(full) - len(kept)} more lines{which}"]


def _measure(cell: object) -> float:
    """Return the number of a cell, of no number the least."""
    try:
        return float(str(cell))
    except ValueError:
        return -math.inf


@cache
def _load_style() -> str:
    """Return the style of tables, and of figures as pages have it, for what stands in an element `symid`."""
    folder = locate_resource_folder("templates") / "report"
    tables, rules = ((folder / f"{name}.css").read_text(encoding="utf-8") for name in ("tables", "figures"))
    for name, colour in _COLOURS.items():
        rules = rules.replace(f"var(--{name})", colour)
    return f"<style>{tables}{_SELECTOR.sub('.symid ', rules)}</style>"


def write_html(blocks: Sequence[Block], *, failed: bool = False) -> str:
    """Return the blocks as HTML for a page of others, such as a notebook.

    Args:
        blocks: in their order.
        failed: whether the result is not acceptable, which a bar at the left then shows.
    """
    kind = "symid fail" if failed else "symid"
    # JupyterLab drops styles of a notebook that it does not trust, but not those of elements.
    body = write_elements(blocks).replace('class="text', 'style="text-align: left" class="text')
    return f'{_load_style()}<div class="{kind}">{body}</div>'


def write_elements(blocks: Iterable[Block]) -> str:
    """Return the blocks as elements of HTML, without their style; figures in a row stand side by side."""
    parts = []
    for drawn, group in groupby(blocks, key=lambda block: isinstance(block, Drawing)):
        elements = [_write_element(block) for block in group]
        several = drawn and len(elements) > 1
        parts += [f'<div class="figures">{"".join(elements)}</div>'] if several else elements
    return "\n".join(parts)


@dataclass(frozen=True, slots=True)
class PageSection:
    """A part of a page: its heading, its address within the page, and its blocks as HTML."""

    title: str
    anchor: str
    body: str


def split_sections(blocks: Sequence[Block], taken: Iterable[str] = ()) -> tuple[PageSection, ...]:
    """Return the sections that headings `== heading ==` begin; blocks before the first one have no title.

    Anchors are the headings in small letters, with a number where two are alike or one is `taken`.
    """
    found: list[tuple[str, list[Block]]] = [("", [])]
    for block in blocks:
        heading = _HEADING.fullmatch(block) if isinstance(block, str) else None
        if heading and heading[1] == "==":
            found.append((heading[2], []))
        else:
            found[-1][1].append(block)
    used, sections = set(taken), []
    for title, inner in (part for part in found if any(part)):
        plain = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "begin"
        names = chain([plain], (f"{plain}-{k}" for k in count(2)))
        anchor = next(name for name in names if name not in used)
        used.add(anchor)
        sections.append(PageSection(title, anchor, write_elements(inner)))
    return tuple(sections)


def _write_element(block: Block) -> str:
    match block:
        case Table():
            return block.write_html()
        case Drawing():
            return f"<figure>{block.svg}<figcaption>{html.escape(block.caption)}</figcaption></figure>"
    heading = _HEADING.fullmatch(block)
    if heading:
        level = len(heading[1])
        return f"<h{level}>{html.escape(heading[2])}</h{level}>"
    text = html.escape(block)
    return f"<p><code>{text.strip()}</code></p>" if block.startswith("    ") else f"<p>{text}</p>"


def write_svg(drawings: Sequence[Drawing]) -> str:
    """Return figures below one another as one SVG file."""
    top, width, parts = 0.0, 0.0, []
    for svg, size in ((drawing.svg, _SIZE.search(drawing.svg)) for drawing in drawings):
        across, height = map(float, size.groups()) if size else (0.0, 0.0)
        parts.append(svg.replace("<svg ", f'<svg y="{top:g}" width="{across:g}" height="{height:g}" ', 1))
        top, width = top + height, max(width, across)
    head = f'<svg class="symid" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {top:g}">'
    return f"{head}{_load_style()}{''.join(parts)}</svg>\n"


def _to_plain(value: Any) -> Any:  # noqa: ANN401  any value
    return value.tolist() if hasattr(value, "tolist") else value


def describe_outcome(outcome: Enum) -> dict[str, str]:
    """Return the name of an outcome, and what it says."""
    return {"name": outcome.name.lower(), "text": outcome.value}


def _format_cell(value: object) -> str:
    match _to_plain(value):
        case None:
            return ""
        case bool() as answer:
            return "yes" if answer else "no"
        case float() as number:
            return f"{number:.5g}" if math.isfinite(number) else "-"
    return str(value)


def _write_plain(text: str) -> str:
    """Return what `format_pair` wrote as a terminal of any encoding shows it; other texts as they are."""
    is_pair = _PAIR.fullmatch(text) is not None
    return text.replace("\N{MULTIPLICATION SIGN}10", "e").translate(_PLAIN) if is_pair else text


def format_digits(value: float) -> str:
    """Return two digits, more from 100 on, where two would need a power of ten; "-" if it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def format_pair(value: float, std: float) -> str:
    """Return a value with its deviation in matching digits: two of the deviation, one from 30 on.

    Without a finite deviation the value has five digits; "-" if it is not finite itself.
    """
    if not math.isfinite(value):
        return "-"
    if not math.isfinite(std) or std <= 0.0:
        return write_minus(f"{value:.5g}")
    return format_in_digits((value, std), std, " \N{PLUS-MINUS SIGN} ")


def format_in_digits(values: Sequence[float], std: float, between: str) -> str:
    """Return values in the digits that one of this deviation has."""
    place = math.floor(math.log10(std))
    # Two digits of 10 to 29, one of 30 to 99: the deviation of a deviation is no better.
    decimals = 1 - place if std / 10.0**place < _ONE_DIGIT else -place
    size = math.floor(math.log10(max(*map(abs, values), std)))
    power = size if decimals > _MOST_DECIMALS or size > _MOST_DECIMALS else 0
    scale, decimals = 10.0**power, decimals + power
    shown = (f"{round(value / scale, decimals):.{max(decimals, 0)}f}" for value in values)
    text = between.join(one if float(one) else one.removeprefix("-") for one in shown)
    text = f"({text})\N{MULTIPLICATION SIGN}10{str(power).translate(SUPERSCRIPT)}" if power else text
    return write_minus(text)


def write_minus(text: str) -> str:
    """Return a number with the sign of minus in place of the hyphen."""
    return text.replace("-", "\N{MINUS SIGN}")


def write_unit(unit: str) -> str:
    """Return a unit as it is printed: its powers raised, on one line."""
    raised = re.sub(r"\^(-?\d+)", lambda match: match[1].translate(SUPERSCRIPT), unit)
    return raised.replace(" ", "\N{NO-BREAK SPACE}")


def format_percent(value: float) -> str:
    """Return the same with its sign of percent."""
    return f"{format_digits(value)} %" if math.isfinite(value) else "-"
