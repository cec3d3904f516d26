"""What all results of the API have in common: printing, JSON, notebooks, warnings and errors.

str(result)             as the command line prints it with -v, with the most important warnings, and errors
result.verdict          of fits, validations and pages: what it is worth, first in all that is printed
result.to_dict()        as the command line gives it with --json
result.notices          warnings and notes; result.errors why it is not acceptable
in a notebook           tables, texts and figures; `Figures` are also written as SVG or HTML
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, ClassVar, Self, dataclass_transform, final

from symid import report
from symid.environment import write_file
from symid.errors import Notice, UsageError, list_notice_lines
from symid.serialization import describe_record

Progress = Callable[[str], None]
"""Called with a short text at each stage."""


def ignore(text: str) -> None:
    """Report no progress."""


@dataclass_transform(eq_default=False, kw_only_default=True, frozen_default=True)
class Result(ABC):
    """A result of the API, immutable: each kind is a frozen dataclass with keywords alone.

    Example:
        >>> import symid
        >>> base = symid.load("two_link").base
        >>> base
        <BaseSet two_link: 6 base parameters (torque)>
        >>> str(base).splitlines()[0]
        'two_link: 6 base parameters of 20'
        >>> base.to_dict()["count"]
        6
    """

    def __init_subclass__(cls) -> None:
        """Make the kind of result a dataclass."""
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True, eq=False, repr=False)(cls)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes: those of its robot, then those of its product."""
        parts = (getattr(self, "robot", None), getattr(self, "product", None))
        return tuple(notice for part in parts for notice in getattr(part, "notices", ()))

    @property
    def sources(self) -> tuple[str, ...]:
        """Return the logs of the result, empty where there are none: a notice on all of them is one line."""
        return ()

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why it is not acceptable, such as a missed gate; empty if it is."""
        return ()

    @property
    def accepted(self) -> bool:
        """Return whether there are no errors."""
        return not self.errors

    @abstractmethod
    def summarise(self) -> str:
        """Return a summary in one line."""

    @abstractmethod
    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the paragraphs and tables of the printed form."""

    @abstractmethod
    def _describe(self) -> dict[str, object]:
        """Return the result in plain types, without a verdict."""

    def to_dict(self) -> dict[str, object]:
        """Return the result in plain types, as `--json` prints it; a verdict stands first."""
        return self._describe()

    def opening(self) -> "tuple[report.Block, ...]":
        """Return what stands before all other blocks, such as a verdict."""
        return ()

    def figures(self) -> "tuple[report.Block, ...]":
        """Return the figures shown after the tables in a notebook."""
        return ()

    def __repr__(self) -> str:
        """Return the result in one line."""
        return f"<{type(self).__name__} {self.summarise()}>"

    def brief(self) -> "tuple[report.Block, ...]":
        """Return the blocks that the command line prints without -v, the longest of them cut."""
        return self.blocks()

    def to_text(self) -> str:
        """Return texts and tables, without warnings and errors."""
        return report.write_text((*self.opening(), *self.blocks()))

    def __str__(self) -> str:
        """Return texts and tables, then the most important warnings, notes and errors."""
        return "\n\n".join(filter(None, (self.to_text(), self._list_notices())))

    def _list_notices(self) -> str:
        told = list_notice_lines(self.notices, self.sources, "`.notices` holds all")
        return "\n".join(f"{kind}: {text}" for kind, text in (*told, *(("error", e) for e in self.errors)))

    def _tabulate(self) -> "tuple[report.Block, ...]":
        """Return the blocks for a notebook, which is wider than a terminal."""
        return self.blocks()

    def _repr_html_(self) -> str:
        notices = filter(None, (self._list_notices(),))
        blocks = (*self.opening(), *self._tabulate(), *notices, *self.figures())
        return report.write_html(blocks, failed=not self.accepted)


class RecordResult(Result):
    """A result that is the record of what was found, its fields and properties, with what is added to it."""

    @classmethod
    def extend(cls, record: Any, **added: object) -> Self:  # noqa: ANN401  the dataclass that the class inherits
        """Return the result with the fields of a record, and those that are `added` to it or replace them."""
        return cls(**{entry.name: getattr(record, entry.name) for entry in fields(record)} | added)

    @property
    def product(self) -> Self:
        """Return the record, which is the result itself."""
        return self


class DrawnResult(Result):
    """A result with figures, which notebooks show below its tables."""

    @abstractmethod
    def _draw(self) -> "tuple[report.Drawing, ...]":
        """Return its figures."""

    def figures(self) -> "tuple[report.Block, ...]":
        """Return what `plot` draws, for a notebook."""
        return self._draw()

    def plot(self, ax: object = None) -> "Figures":
        """Return its figures; `.save(path)` writes SVG or HTML, `ax` are axes of matplotlib to use."""
        return Figures(drawings=self._draw()).draw(ax)


class PagedResult(Result):
    """A result that can be written as a page."""

    @abstractmethod
    def _build_page(self) -> "report.Page":
        """Return the page."""

    def report(self, path: str | PathLike[str], *, title: str = "", author: str = "", date: str = "") -> Path:
        """Write a self-contained HTML page to `path`, and return the path.

        Args:
            path: of the page.
            title: of the page, in place of robot and subject.
            author: below the title.
            date: beside the author.

        Raises:
            OutputError: the page cannot be written.
        """
        page = replace(self._build_page(), title=title, author=author, date=date)
        return report.write_page(Path(fspath(path)), page)


class SavedResult(Result):
    """A result that can be written as JSON, which one of the functions `load_*` reads back."""

    @abstractmethod
    def _save(self, file: Path) -> Path:
        """Write the file and return its path."""

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the result to `path` as JSON, and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        return self._save(Path(fspath(path)))


class JudgedResult(Result):
    """A result with a verdict, which stands first in all that it prints; a wrong one is an error."""

    _tried: ClassVar[bool] = False
    """Whether the verdict is on held-out data."""

    @property
    @abstractmethod
    def verdict(self) -> "report.FitVerdict":
        """Return what the result is worth."""

    def _name_file(self) -> str:
        """Return the file that notices on the verdict are about; empty for none."""
        return ""

    def _list_doubts(self) -> tuple[Notice, ...]:
        return report.list_verdict_notices(self.verdict, self._name_file(), tried=self._tried)

    def _list_remarks(self) -> tuple[Notice, ...]:
        """Return the warnings and notes besides the verdict."""
        return super().notices

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes; first that the verdict is doubtful."""
        doubts = () if self.verdict.level == "wrong" else self._list_doubts()
        return (*doubts, *self._list_remarks())

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return the error of a wrong verdict; empty for all others."""
        return self._list_doubts() if self.verdict.level == "wrong" else ()

    def opening(self) -> "tuple[report.Block, ...]":
        """Return the verdict, with its cause and its remedy where there are any."""
        return (report.show_verdict(self.verdict),)

    def _tabulate(self) -> "tuple[report.Block, ...]":
        """Return the details of the verdict, then all blocks."""
        details = "\n".join(self.verdict.details)
        return (*([details] if details else []), *self.blocks())

    def to_dict(self) -> dict[str, object]:
        """Return the verdict, then all else, in plain types."""
        return {"verdict": describe_record(self.verdict), **self._describe()}


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Figures:
    """Figures, each an SVG with a caption.

    Attributes:
        drawings: each with its `svg` and its `caption`.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> figures = fit.validate(robot.simulate("tc", duration=5.0, seed=2).log).plot()
        >>> len(figures), figures.save("torques.svg").name
        (2, 'torques.svg')
    """

    drawings: "tuple[report.Drawing, ...]"

    def __len__(self) -> int:
        """Return the number of figures."""
        return len(self.drawings)

    def __repr__(self) -> str:
        """Return the captions in one line."""
        return f"<Figures {'; '.join(entry.caption for entry in self.drawings)}>"

    def _repr_html_(self) -> str:
        return report.write_html(self.drawings)

    def draw(self, ax: object) -> "Figures":
        """Draw the figures into axes of matplotlib, one into each, and return them; None for no axes.

        Args:
            ax: axes, or several, as `matplotlib.pyplot.subplots` returns them; further figures are left out.

        Raises:
            UsageError: other axes; the message says what to install.
        """
        if ax is not None:
            report.drawings.draw_into(ax, self.drawings)
        return self

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the figures below one another to `path`, .svg or .html, and return the path.

        Raises:
            UsageError: the suffix is another one.
            OutputError: the file cannot be written.
        """
        file = Path(fspath(path))
        if file.suffix.lower() == ".svg":
            return write_file(file, report.write_svg(self.drawings))
        if file.suffix.lower() == ".html":
            return write_file(file, report.write_figures(self.drawings))
        text = f"{file}: figures are written as .svg or .html"
        raise UsageError(Notice(code="usage.suffix", text=text))
