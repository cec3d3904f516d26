"""Exact base parameters of a robot, with reasons, and the derivation of its dynamics.

Robot -> `BaseSet`; robot -> `Derivation`, step by step, with operation counts of the generated code; robot ->
`WrittenLesson`, the derivation as a page.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict, Unpack, final

from symid import dynamics, lessons, logs as log_files, report, robot as robots
from symid.api.result import Result
from symid.environment import check_suffix, read_file, write_file
from symid.errors import InputError, Notice, OutputError, UsageError
from symid.identification import regression

if TYPE_CHECKING:
    from symid.api.log import LogLike
    from symid.codegen import RouteCount
    from symid.dynamics import BaseParameter, BaseParameters
    from symid.lessons import AnswerSheet, MarkedAnswer, Step
    from symid.report import Block
    from symid.robot import Robot

_LARGEST_SHEET = 1_000_000
_SHOWN = 48
"""Letters of an answer in a table."""
BaseForm = Literal["torque", "energy", "momentum", "gravity"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BaseSet(Result):
    """The base parameters of a robot; iteration yields their names in Khalil's order.

    Attributes:
        robot: the robot.
        form: "torque", "energy", "momentum" or "gravity" (torques at rest).
        product: names, groupings, reasons, and the exact null space.

    Example:
        >>> import symid
        >>> base = symid.load("two_link").base
        >>> list(base)
        ['ZZR1', 'MXR1', 'MY1', 'ZZ2', 'MX2', 'MY2']
        >>> base["MXR1"].expression
        'MX1 + 0.5*M2'
        >>> round(base.values["MXR1"], 3)
        1.638
    """

    robot: "Robot"
    form: BaseForm
    product: "BaseParameters"

    @property
    def count(self) -> int:
        """Return the number of inertial base parameters, without friction parameters."""
        return self.product.count

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the inertial base parameters, in the order of beta."""
        return tuple(entry.name for entry in self.product.parameters)

    @property
    def friction(self) -> tuple[str, ...]:
        """Return the names of the friction parameters, in the order of f."""
        return tuple(entry.name for entry in self.product.friction)

    @property
    def values(self) -> Mapping[str, float]:
        """Return the values of base and friction parameters in the robot file, SI units, by name."""
        return dynamics.compute_parameter_values(self.robot, self.product)

    def __len__(self) -> int:
        """Return the number of inertial base parameters."""
        return self.count

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the inertial base parameters."""
        return iter(self.names)

    def __getitem__(self, name: str) -> "BaseParameter":
        """Return the base or friction parameter called `name`.

        Raises:
            UsageError: there is no such parameter; the message has the nearest name.
        """
        entries = {entry.name: entry for entry in (*self.product.parameters, *self.product.friction)}
        if name not in entries:
            gone = {entry.name: entry.reason for entry in self.product.eliminated}
            head = self._list_heads().get(name)
            group = f"it is the first of the group {head.name}" if head else ""
            hint = gone.get(name) or group or robots.suggest_names(name, entries, otherwise="there are")
            text = f"{name!r} is not a base parameter of {self.robot.name}: {hint}"
            raise UsageError(Notice(code="usage.unknown-parameter", text=text))
        return entries[name]

    def _list_heads(self) -> "dict[str, BaseParameter]":
        """Return the base parameters by the name of the first standard parameter of their group."""
        entries = (*self.product.parameters, *self.product.friction)
        return {dynamics.write_label(self.robot, entry.label): entry for entry in entries}

    def explain(self, name: str) -> str:
        """Return the grouping of a parameter with its reason, or why it was eliminated.

        Args:
            name: of a base, friction or standard parameter, such as "MXR1" or "YY2".

        Raises:
            UsageError: the robot has no such parameter.
        """
        gone = {entry.name: entry.reason for entry in self.product.eliminated}
        if name in gone:
            return f"{name} was eliminated: {gone[name]}"
        entry = self._list_heads().get(name) or self[name]
        return f"{entry.name} = {entry.expression}: {entry.reason}"

    def summarise(self) -> str:
        """Return robot and count."""
        return f"{self.robot.name}: {self.count} base parameters ({self.form})"

    def blocks(self) -> "tuple[Block, ...]":
        """Return a headline, and every parameter with its grouping and reason."""
        return report.show_base(self.robot, self.product)

    def _tabulate(self) -> "tuple[Block, ...]":
        return report.tabulate_base(self.robot, self.product)

    def to_dict(self) -> dict[str, object]:
        """Return names, expressions, reasons, values and the null space in plain types."""
        return {**report.describe_base(self.robot, self.product), "of": self.form}

    def _repr_latex_(self) -> str:
        """Return names and groupings as formulas for a notebook."""
        return report.write_base_latex(self.robot, self.product)


def derive_base_set(robot: "Robot", form: BaseForm = "torque") -> BaseSet:
    """Derive the base parameters of `robot`; see `BaseSet`.

    Raises:
        UsageError: there is no such form.
    """
    if form not in dynamics.BASE_FORMS:
        text = f"there is no form {form!r}; allowed are {', '.join(dynamics.BASE_FORMS)}"
        raise UsageError(Notice(code="usage.base-form", text=text))
    return BaseSet(robot=robot, form=form, product=dynamics.derive_base_parameters(robot, form=form))


Notation = Literal["symid", "siciliano", "craig", "khalil"]
LessonParameters = Literal["base", "symbols", "bodies"]


class LessonLetters(TypedDict, total=False):
    """Options of a lesson's letters, those of `RobotModel.write_lesson`."""

    notation: Notation
    parameters: LessonParameters | None
    angle: Literal["q", "theta"] | None
    long_sines: bool


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WrittenLesson(Result):
    """A lesson that was written as a page.

    Attributes:
        robot: the robot.
        path: of the page.
        size: in bytes.
        notation: whose letters it has.
        answers: the file with the answers to its exercises, None without exercises.
        sheet: the file in which students type theirs, likewise.
        executed: of a notebook, whether its cells have outputs; None of other files.

    Example:
        >>> import symid
        >>> lesson = symid.load("two_link").write_lesson("lesson.html", notation="siciliano")
        >>> lesson.path.name
        'lesson.html'
        >>> lesson.size < 2_000_000
        True
    """

    robot: "Robot"
    path: Path
    size: int
    notation: Notation
    answers: Path | None = None
    sheet: Path | None = None
    executed: bool | None = None

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on the robot, and that a notebook has no outputs where that is so."""
        if self.executed is not False:
            return super().notices
        text = (
            "its cells were not executed: that needs pip install 'symid[notebook]'; Jupyter executes them too"
        )
        return (*super().notices, Notice(code="lesson.not-executed", text=text, file=str(self.path)))

    def summarise(self) -> str:
        """Return robot, file and size."""
        return f"{self.robot.name}: {self.path}, {self.size / 1e6:.2f} MB"

    def blocks(self) -> "tuple[Block, ...]":
        """Return where the page is."""
        forms = {".tex": "for pdflatex", ".ipynb": "opens in Jupyter"}
        how = forms.get(self.path.suffix.lower(), "opens in any browser")
        lines = [f"lesson: {self.path} ({self.size / 1e6:.2f} MB, one file, {how})"]
        lines += [f"exercises to fill in: {self.sheet}", f"answers: {self.answers}"] if self.answers else []
        return ("\n".join(lines),)

    def to_dict(self) -> dict[str, object]:
        """Return file, size and notation."""
        return {
            "robot": self.robot.name,
            "file": str(self.path),
            "size": self.size,
            "notation": self.notation,
            "exercises": None if self.sheet is None else str(self.sheet),
            "answers": None if self.answers is None else str(self.answers),
        }


def write_lesson(
    robot: "Robot",
    path: str | PathLike[str],
    notation: Notation = "symid",
    parameters: LessonParameters | None = None,
    angle: Literal["q", "theta"] | None = None,
    *,
    long_sines: bool = False,
    exercises: int = 0,
    seed: int = 0,
    log: "LogLike | None" = None,
) -> WrittenLesson:
    """Write the lesson on `robot`; see `RobotModel.write_lesson`."""
    file = Path(fspath(path))
    suffix = check_suffix(file, "a lesson", (".html", ".htm", ".tex", ".ipynb"))
    book = lessons.get_book(notation, angle=angle, long=long_sines)
    if suffix in (".tex", ".ipynb") and (exercises or log is not None):
        given = f"exercises={exercises}: they are" if exercises else "log: its motion is"
        what = f"{given} part of a page; write a .html for that"
        raise UsageError(Notice(code="usage.lesson-option", text=what))
    if suffix == ".tex":
        text = lessons.write_lesson_tex(robot, book, parameters)
        size = len(text.encode())
        return WrittenLesson(robot=robot, path=write_file(file, text), size=size, notation=notation)
    if suffix == ".ipynb":
        made = lessons.write_lesson_notebook(robot, book, parameters, file.resolve().parent)
        return WrittenLesson(
            robot=robot,
            path=write_file(file, made.text),
            size=len(made.text.encode()),
            notation=notation,
            executed=made.executed,
        )
    sheet_file = file.with_suffix(".exercises.txt")
    if exercises and sheet_file.exists() and any(_read_sheet(sheet_file).answers.values()):
        text = "has answers that were typed; move it, or name the page otherwise"
        raise OutputError(Notice(code="output.answers", text=text, file=str(sheet_file)))
    logged = None if log is None else _sample_log(robot, log)
    page = lessons.write_lesson_page(robot, book, parameters, exercises=exercises, seed=seed, logged=logged)
    answers = write_file(file.with_suffix(".answers.txt"), page.answers) if page.answers else None
    sheet = write_file(sheet_file, page.sheet) if page.sheet else None
    return WrittenLesson(
        robot=robot,
        path=write_file(file, page.html),
        size=len(page.html.encode()),
        notation=notation,
        answers=answers,
        sheet=sheet,
    )


_LONGEST_MOTION = 30.0
"""s of a log that a page has."""
_STILL = 1e-3
"""rad or m: what moves by less stands still."""


def _sample_log(robot: "Robot", log: "LogLike") -> "lessons.LoggedMotion":
    """Return the motion of a log, filtered as for an identification.

    Raises:
        LogError: the log cannot be read or used; the message lists all mistakes.
    """
    import numpy as np

    from symid.api.log import adopt_log_map, take_one_log

    described = adopt_log_map(robot, log)
    (recording,) = log_files.read_recordings((take_one_log(log),), described)
    processing = regression.choose_filters(described.processing, [recording]).processing
    signals = log_files.prepare_signals(recording, processing)
    length = min(float(signals.time[-1] - signals.time[0]), _LONGEST_MOTION)
    times = signals.time[0] + np.arange(int(length * lessons.MOTION_RATE) + 1) / lessons.MOTION_RATE
    tables = (signals.q, signals.dq, signals.ddq)
    states = np.stack([[np.interp(times, signals.time, part) for part in table.T] for table in tables])
    still = np.ptp(states[0], axis=1) < _STILL
    states[0, still] = states[0, still].mean(axis=1, keepdims=True)
    states[1:, still] = 0.0
    return lessons.LoggedMotion(name=Path(recording.source).name, states=states.transpose(0, 2, 1))


def _read_sheet(path: Path) -> "AnswerSheet":
    """Return what stands in a sheet of exercises.

    Raises:
        InputError: the file cannot be read, or is no such sheet.
    """
    try:
        text = read_file(path, _LARGEST_SHEET).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise InputError(
            Notice(code="lesson.unreadable", text=f"cannot be read: {reason}", file=str(path))
        ) from error
    return lessons.read_sheet(text, str(path))


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MarkedSheet(Result):
    """Answers to the exercises of a lesson with their marks; accepted where all are right.

    Attributes:
        robot: the robot.
        path: of the sheet.
        answers: each with `number`, `prompt`, what was `typed`, a `mark` ("right", "wrong", "unreadable",
            "empty") and a `note`.

    Example:
        >>> import symid
        >>> from pathlib import Path
        >>> robot = symid.load("two_link")
        >>> sheet = robot.write_lesson("lesson.html", exercises=1).sheet
        >>> filled = Path("ann.txt")
        >>> _ = filled.write_text(sheet.read_text().replace("answer 1 =", "answer 1 = 0"))
        >>> robot.check_answers(filled).answers[0].mark
        'wrong'
    """

    robot: "Robot"
    path: Path
    answers: "tuple[MarkedAnswer, ...]"

    @property
    def count(self) -> int:
        """Return how many answers are right."""
        return sum(entry.mark == "right" for entry in self.answers)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return that not all answers are right, where that is so."""
        if self.count == len(self.answers):
            return ()
        wrong = len(self.answers) - self.count
        text = f"{wrong} of {len(self.answers)} answers {'is' if wrong == 1 else 'are'} not right"
        return (Notice(code="lesson.not-right", text=text, file=str(self.path)),)

    def summarise(self) -> str:
        """Return robot, file and count."""
        return f"{self.robot.name}: {self.path}, {self.count} of {len(self.answers)} right"

    def blocks(self) -> "tuple[Block, ...]":
        """Return a headline, and a row for each answer."""
        rows = [
            (
                entry.number,
                entry.mark,
                entry.typed if len(entry.typed) <= _SHOWN else entry.typed[:_SHOWN] + "...",
                entry.note,
            )
            for entry in self.answers
        ]
        return (self.summarise(), report.Table(("exercise", "mark", "answer", "note"), rows, left=(1, 2, 3)))

    def to_dict(self) -> dict[str, object]:
        """Return the marks in plain types."""
        return {
            "robot": self.robot.name,
            "file": str(self.path),
            "right": self.count,
            "answers": [asdict(entry) for entry in self.answers],
        }


def check_answers(robot: "Robot", path: str | PathLike[str]) -> MarkedSheet:
    """Mark a sheet of exercises; see `RobotModel.check_answers`."""
    file = Path(fspath(path))
    return MarkedSheet(
        robot=robot, path=file, answers=lessons.mark_sheet(robot, _read_sheet(file), str(file))
    )


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Derivation(Result):
    """The derivation of a robot's dynamics.

    Attributes:
        robot: the robot.
        steps: each with a title, a sentence, formulas in text and LaTeX, and the checks.
        operations: of every function and every route to it; `chosen` marks the route that is generated.
        latex: print formulas in LaTeX.

    Example:
        >>> import symid
        >>> lesson = symid.load("emps").derivation()
        >>> [step.title for step in lesson.steps][3:]
        ['Base parameters', 'Inertia matrix', 'Coriolis matrix', 'Gravity', 'Torques', 'Friction']
    """

    robot: "Robot"
    steps: "tuple[Step, ...]"
    operations: "tuple[RouteCount, ...]"
    latex: bool = False

    def html(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a page that follows the reader's posture, and return its path.

        `path` ends in .html; the `letters` are the options `notation`, `parameters`, `angle` and
        `long_sines` of `RobotModel.write_lesson`.

        Raises:
            OutputError: the page cannot be written.
        """
        return self._write(path, ".html", letters)

    def tex(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a document for pdflatex, and return its path.

        `path` ends in .tex; `letters` are those of `html`.
        """
        return self._write(path, ".tex", letters)

    def ipynb(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a notebook, executed where that is possible, and return its path.

        `path` ends in .ipynb; `letters` are those of `html`.
        """
        return self._write(path, ".ipynb", letters)

    def _write(self, path: str | PathLike[str], suffix: str, letters: LessonLetters) -> Path:

        check_suffix(Path(fspath(path)), "such a lesson", (suffix,))
        return write_lesson(self.robot, path, **letters).path

    def summarise(self) -> str:
        """Return robot and steps."""
        return f"{self.robot.name}: {', '.join(step.title for step in self.steps)}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return the steps, and the operations of generated functions."""
        return report.show_derivation(self.steps, self.operations, latex=self.latex)

    def to_dict(self) -> dict[str, object]:
        """Return steps and operations of all routes in plain types."""
        return report.describe_derivation(self.robot.name, self.steps, self.operations)

    def _repr_html_(self) -> str:
        """Return the derivation for a notebook, with formulas."""
        return report.write_derivation_html(self.steps, self.operations)

    def _repr_latex_(self) -> str:
        """Return the formulas of all steps."""
        return report.write_derivation_latex(self.steps)
