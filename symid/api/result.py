"""What all results of the API have in common: they print themselves, and say what speaks against them.

str(result)             as the command line prints it, with warnings and errors
result.to_dict()        as the command line gives it with --json
result.notices          what a reader should know; result.errors why it is not acceptable
in a notebook           tables, texts and figures; `Figures` are also written as SVG or HTML

Arguments that must be of a range or one of a list are checked here, before anything is done.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, final

from symid import report
from symid.errors import Notice, UsageError

if TYPE_CHECKING:
    from symid.report import Block, Drawing

Progress = Callable[[str], None]
"""Called with a short text on what begins now."""


def ignore(text: str) -> None:
    """Say nothing of what begins."""


class Result(ABC):
    """A result of the API, immutable.

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

    @property
    @abstractmethod
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of it."""

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why it is not acceptable, such as a gate that was missed; nothing where it is."""
        return ()

    @property
    def accepted(self) -> bool:
        """Return whether nothing makes it unacceptable."""
        return not self.errors

    @abstractmethod
    def summarise(self) -> str:
        """Return the result in a few words, in one line."""

    @abstractmethod
    def blocks(self) -> "tuple[Block, ...]":
        """Return the paragraphs and tables that it is printed as."""

    @abstractmethod
    def to_dict(self) -> dict[str, object]:
        """Return the result in plain types, as `--json` gives it."""

    def opening(self) -> "tuple[Block, ...]":
        """Return what a notebook shows first, such as a verdict."""
        return ()

    def figures(self) -> "tuple[Block, ...]":
        """Return the figures that a notebook shows behind the tables."""
        return ()

    def __repr__(self) -> str:
        """Return the result in one line."""
        return f"<{type(self).__name__} {self.summarise()}>"

    def tell(self) -> str:
        """Return the result as text, without what a reader should know of it."""
        return report.write_text(self.blocks())

    def __str__(self) -> str:
        """Return the result as the command line prints it: texts and tables, then warnings and errors."""
        said = self._tell_notices()
        return f"{self.tell()}\n\n{said}" if said else self.tell()

    def _tell_notices(self) -> str:
        kinds = [("note" if entry.is_note else "warning", entry) for entry in self.notices]
        return "\n".join(f"{kind}: {entry}" for kind, entry in (*kinds, *(("error", e) for e in self.errors)))

    def _tabulate(self) -> "tuple[Block, ...]":
        """Return what a notebook, which is wider than a terminal, shows in place of `blocks`."""
        return self.blocks()

    def _repr_html_(self) -> str:
        """Return the result for a notebook."""
        said = self._tell_notices()
        blocks = (*self.opening(), *self._tabulate(), *((said,) if said else ()), *self.figures())
        return report.write_html(blocks, failed=not self.accepted)


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

    drawings: "tuple[Drawing, ...]"

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.drawings)

    def __repr__(self) -> str:
        """Return the captions in one line."""
        return f"<Figures {'; '.join(entry.caption for entry in self.drawings)}>"

    def _repr_html_(self) -> str:
        """Return the figures for a notebook."""
        return report.write_html(self.drawings)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the figures below one another to `path`, .svg or .html, and return the path.

        Raises:
            UsageError: the name ends in something else.
            OutputError: the file cannot be written.
        """
        from symid.environment import write_file

        file = Path(fspath(path))
        if file.suffix.lower() == ".svg":
            return write_file(file, report.write_svg(self.drawings))
        if file.suffix.lower() == ".html":
            head = '<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>Figures</title>'
            return write_file(file, f"{head}<body>{report.write_html(self.drawings)}</body></html>\n")
        text = f"{file}: figures are written as .svg or .html"
        raise UsageError(Notice(code="usage.suffix", text=text))


def check_count(name: str, value: int | None, least: int = 0) -> None:
    """Refuse what is no whole number of at least `least`; None, which stands for the default, passes.

    Raises:
        UsageError: it is none.
    """
    if value is None:
        return
    whole = not isinstance(value, bool) and hasattr(value, "__index__")
    if not whole or value < least:
        text = f"{name}={value!r}: expected a whole number of {least} or more"
        raise UsageError(Notice(code="usage.range", text=text))


def check_positive(name: str, value: float | None, *, zero: bool = False) -> None:
    """Refuse what is no positive finite number, or, if `zero`, not zero either; None passes.

    Raises:
        UsageError: it is none.
    """
    if value is None:
        return
    number = hasattr(value, "__float__") and not isinstance(value, bool)
    if not number or not (value >= 0.0 if zero else value > 0.0) or not math.isfinite(value):
        text = f"{name}={value!r}: expected a finite number {'of 0 or more' if zero else 'above 0'}"
        raise UsageError(Notice(code="usage.range", text=text))


def check_choice(name: str, value: str, allowed: Sequence[str]) -> None:
    """Refuse what is not one of `allowed`.

    Raises:
        UsageError: it is none.
    """
    if value not in allowed:
        text = f"{name}={value!r}: expected one of {', '.join(map(repr, allowed))}"
        raise UsageError(Notice(code="usage.range", text=text))
