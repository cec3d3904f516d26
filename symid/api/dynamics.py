"""Exact base parameters of a robot, with reasons, and the derivation of its dynamics.

Robot -> `BaseSet`; robot -> `Derivation`, step by step, with operation counts of the generated code; robot ->
`WrittenLesson`, the derivation as a page.
"""

import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from html import escape
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypedDict, Unpack, final

import numpy as np

from symid import codegen, dynamics, identification, lessons, logs as log_files, report, robot as robots
from symid.api.code import CompiledModel, WrittenCode
from symid.api.log import LogLike, Settings, adopt_log_map, list_pairs, take_one_log
from symid.api.result import Progress, Result, ignore
from symid.codegen import BACKENDS
from symid.environment import check_suffix, read_file, write_file
from symid.errors import InputError, Notice, OutputError, UsageError, shorten_names
from symid.identification import regression
from symid.notation import INERTIAL
from symid.options import GenerateOptions, Precision, Target, check_value, words
from symid.serialization import describe_record

if TYPE_CHECKING:
    import casadi as ca


_LARGEST_SHEET = 1_000_000
_SHOWN, _CELL = 48, 64
"""Letters of an answer, and of a sum, in a table."""
_ALIGNED = r"$$\begin{{aligned}}{}\end{{aligned}}$$"
_OPERATIONS = (
    "Operations of generated functions: products with squares and divisions, sums, sines and cosines.\n"
    "The route with the fewest operations is written; 'most' has products and sums of the worst one."
)
BaseForm = Literal["torque", "energy", "momentum", "gravity"]


@final
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

    robot: "robots.Robot"
    form: BaseForm
    product: "dynamics.BaseParameters"

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

    def __getitem__(self, name: str) -> "dynamics.BaseParameter":
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

    def _list_heads(self) -> "dict[str, dynamics.BaseParameter]":
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

    def _describe_entries(self) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
        """Return base parameters, and those of friction, in plain types."""
        product, values = self.product, self.values
        forms = dynamics.derive_parameter_formulas(self.robot, product)
        found: list[dict[str, object]] = [
            {
                "name": entry.name,
                "expression": entry.expression,
                "reason": entry.reason,
                "unit": dynamics.get_label_unit(self.robot, entry.label),
                "joint": dynamics.get_owner(self.robot, entry.label),
                "value": values.get(entry.name),
                "form": str(forms[entry.name]).replace("**", "^") if entry.name in forms else None,
            }
            for entry in (*product.parameters, *product.friction)
        ]
        return found[: len(product.parameters)], found[len(product.parameters) :]

    def _count_all(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the counts; what was eliminated, with reasons: parameters of one reason together."""
        names: dict[str, list[str]] = {}
        for entry in self.product.eliminated:
            names.setdefault(entry.reason, []).append(entry.name)
        kinds = (*INERTIAL, *dynamics.DRIVE_PARAMETERS)
        whole = self.count + sum(entry.label[1] in kinds for entry in self.product.eliminated)
        head = f"{self.robot.name}: {self.count} base parameter{'s'[: self.count != 1]} of {whole}"
        return head, [(", ".join(group), reason) for reason, group in names.items()]

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return a headline, and every parameter with its grouping and reason."""
        wrap = textwrap.TextWrapper(100, initial_indent="    ", subsequent_indent="    ").fill

        def show(entry: Mapping[str, object]) -> str:
            value = None if entry["value"] is None else f"{entry['value']:.6g}"
            parts = (*dict.fromkeys((entry["name"], entry["expression"])), entry["form"], value)
            text = " = ".join(str(part) for part in parts if part is not None)
            return f"{text}  [{entry['unit']}]\n{wrap(str(entry['reason']))}"

        (head, eliminated), (parameters, friction) = self._count_all(), self._describe_entries()
        gone = [f"{names}\n{wrap(reason)}" for names, reason in eliminated]
        return (
            *(head, *map(show, parameters)),
            *(("friction parameters", *map(show, friction)) if friction else ()),
            *(("eliminated", *gone) if gone else ()),
        )

    def brief(self) -> "tuple[report.Block, ...]":
        """Return the parameters without reasons."""
        (head, eliminated), (parameters, friction) = self._count_all(), self._describe_entries()
        names = {
            "friction": [str(entry["name"]) for entry in friction],
            "eliminated": [name for group, _ in eliminated for name in group.split(", ")],
        }
        lines = [head, *(f"{what}: {shorten_names(part)}" for what, part in names.items() if part)]
        rows = []
        for entry in parameters:
            # Of a long sum the first terms, and how many more there are.
            text = str(entry["form"] or entry["expression"])
            signs = [found.start() for found in re.finditer(r" [+-] ", text)]
            if len(text) > _CELL and signs:
                cut = max((place for place in signs if place <= _CELL), default=signs[0])
                text = f"{text[:cut]} ... ({sum(place >= cut for place in signs)} more)"
            rows.append((entry["name"], text, entry["unit"], entry["value"]))
        header = ("parameter", "groups", "unit", "value")
        known = len(header) - all(row[-1] is None for row in rows)
        return ("\n".join(lines), report.Table(header[:known], [row[:known] for row in rows], (0, 1, 2)))

    def _tabulate(self) -> "tuple[report.Block, ...]":
        (head, eliminated), (parameters, friction) = self._count_all(), self._describe_entries()
        keys = ("name", "expression", "form", "unit", "reason")
        rows = [[entry[key] for key in keys] for entry in (*parameters, *friction)]
        for row, entry in zip(rows, (*parameters, *friction), strict=True):
            row[2] = row[2] or entry["value"]
        header = ("parameter", "groups", "value", "unit", "why")
        gone = [report.Table(("eliminated", "why"), eliminated, left=(0, 1))] if eliminated else []
        return (head, report.Table(header, rows, left=(0, 1, 3, 4)), *gone)

    def _describe(self) -> dict[str, object]:
        parameters, friction = self._describe_entries()
        return {
            "robot": self.robot.name,
            "count": self.count,
            "parameters": parameters,
            "friction": friction,
            "eliminated": [{"name": entry.name, "reason": entry.reason} for entry in self.product.eliminated],
            # Changes of the parameters that nothing shows, exact coefficients as text.
            "null_space": [
                {dynamics.write_label(self.robot, label): str(coefficient) for label, coefficient in change}
                for change in self.product.null_space
            ],
            "of": self.form,
        }

    def _repr_latex_(self) -> str:
        from sympy import Add, Symbol, latex

        lines = []
        for entry in (*self.product.parameters, *self.product.friction):
            letters = {label: Symbol(dynamics.write_label(self.robot, label)) for label, _ in entry.terms}
            names = {symbol: dynamics.write_name_latex(str(symbol)) for symbol in letters.values()}
            total = Add(*(factor * letters[label] for label, factor in entry.terms), evaluate=False)
            group = latex(total, symbol_names=names, order="none")
            lines.append(rf"{dynamics.write_name_latex(entry.name)} &= {group}")
        return _ALIGNED.format(r" \\ ".join(lines))


Notation = Literal["symid", "siciliano", "craig", "khalil"]
LessonParameters = Literal["base", "symbols", "bodies"]


class LessonLetters(TypedDict, total=False):
    """Options of a lesson's letters, those of `RobotModel.write_lesson`."""

    notation: Notation
    parameters: LessonParameters | None
    angle: Literal["q", "theta"] | None
    long_sines: bool
    lang: Literal["en", "de"]
    title: str
    author: str


@final
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

    robot: "robots.Robot"
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
        text = "its cells were not executed: that needs pip install 'symid[notebook]'; Jupyter executes them "
        text += "too"
        return (*super().notices, Notice(code="lesson.not-executed", text=text, file=str(self.path)))

    def summarise(self) -> str:
        """Return robot, file and size."""
        return f"{self.robot.name}: {self.path}, {self.size / 1e6:.2f} MB"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return where the page is."""
        forms = {".tex": "for pdflatex", ".ipynb": "opens in Jupyter"}
        how = forms.get(self.path.suffix.lower(), "opens in any browser")
        lines = [f"lesson: {self.path} ({self.size / 1e6:.2f} MB, one file, {how})"]
        lines += [f"exercises to fill in: {self.sheet}", f"answers: {self.answers}"] if self.answers else []
        return ("\n".join(lines),)

    def _describe(self) -> dict[str, object]:
        return {
            "robot": self.robot.name,
            "file": str(self.path),
            "size": self.size,
            "notation": self.notation,
            "exercises": None if self.sheet is None else str(self.sheet),
            "answers": None if self.answers is None else str(self.answers),
        }


_LONGEST_MOTION = 30.0
"""s of a log that a page has."""
_STILL = 1e-3
"""rad or m: what moves by less is at rest."""


def _sample_log(robot: "robots.Robot", log: LogLike) -> "lessons.LoggedMotion":
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


def _read_sheet(path: Path) -> "lessons.AnswerSheet":
    """Return what stands in a sheet of exercises; an InputError for a file that is none."""
    try:
        text = read_file(path, _LARGEST_SHEET).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise InputError(
            Notice(code="lesson.unreadable", text=f"cannot be read: {reason}", file=str(path))
        ) from error
    return lessons.read_sheet(text, str(path))


def _check_sheets(texts: Mapping[Path, str], *, force: bool) -> None:
    """Raise an OutputError where a sheet, the first of `texts`, has typed answers, or either is another one.

    The page and the document of one name have the same sheet, which is written again.
    """
    sheet = next(iter(texts))
    for file, text in texts.items():
        if not file.exists():
            continue
        if file == sheet and any(_read_sheet(file).answers.values()):
            said = "has answers that were typed; move it, or name the page otherwise"
            raise OutputError(Notice(code="output.answers", text=said, file=str(file)))
        if not force and file.read_bytes() != text.encode():
            said = (
                "exists already, with other exercises; give the page another name, or --force to overwrite it"
            )
            raise OutputError(Notice(code="output.exists", text=said, file=str(file)))


@final
class MarkedSheet(Result):
    """Answers to the exercises of a lesson with their marks; accepted where all are right.

    Attributes:
        robot: the robot.
        path: of the sheet.
        answers: each with `number`, `prompt`, what was `typed`, a `mark` ("right", "wrong", "unreadable",
            "empty") and a `note`.
        language: of notes and text, "en" or "de".

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

    robot: "robots.Robot"
    path: Path
    answers: "tuple[lessons.MarkedAnswer, ...]"
    language: str = "en"

    @property
    def count(self) -> int:
        """Return how many answers are right."""
        return sum(entry.mark == "right" for entry in self.answers)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return that not all answers are right, where that is so."""
        if self.count == len(self.answers):
            return ()
        whole, open_ = len(self.answers), sum(entry.mark == "empty" for entry in self.answers)
        wrong = whole - self.count - open_
        told = [f"{wrong} of {whole} answers {'is' if wrong == 1 else 'are'} not right"] if wrong else []
        told += [f"{open_} of {whole} not answered"] if open_ else []
        text = lessons.load_words(self.language)("; ".join(told))
        return (Notice(code="lesson.not-right", text=text, file=str(self.path)),)

    def summarise(self) -> str:
        """Return robot, file and count."""
        said = f"{self.robot.name}: {self.path}, {self.count} of {len(self.answers)} right"
        return lessons.load_words(self.language)(said)

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return a headline, and a row for each answer."""
        words = lessons.load_words(self.language)
        rows = [
            (
                one.number,
                words("not answered" if one.mark == "empty" else one.mark),
                one.typed[:_SHOWN] + "..." * (len(one.typed) > _SHOWN),
                one.note,
            )
            for one in self.answers
        ]
        head = tuple(map(words, ("exercise", "mark", "answer", "note")))
        return (self.summarise(), report.Table(head, rows, left=(1, 2, 3)))

    def _describe(self) -> dict[str, object]:
        return {
            "robot": self.robot.name,
            "file": str(self.path),
            "right": self.count,
            "answers": [asdict(entry) for entry in self.answers],
        }


@final
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

    robot: "robots.Robot"
    steps: "tuple[lessons.Step, ...]"
    operations: "tuple[codegen.RouteCount, ...]"
    latex: bool = False

    def html(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a page that follows the reader's posture, and return its path.

        `path` ends in .html; the `letters` are the options `notation`, `parameters`, `angle`, `long_sines`,
        `lang`, `title` and `author` of `RobotModel.write_lesson`.

        Raises:
            OutputError: the page cannot be written.
        """
        return self._write(path, ".html", letters)

    def tex(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a document for pdflatex at `path`, .tex; `letters` are those of `html`."""
        return self._write(path, ".tex", letters)

    def ipynb(self, path: str | PathLike[str], **letters: Unpack[LessonLetters]) -> Path:
        """Write the derivation as a notebook at `path`, .ipynb, executed where that is possible, as `html`.

        The `letters` are those of `html`.
        """
        return self._write(path, ".ipynb", letters)

    def _write(self, path: str | PathLike[str], suffix: str, letters: LessonLetters) -> Path:
        check_suffix(Path(path), "such a lesson", (suffix,))
        return RobotDynamics(description=self.robot).write_lesson(path, **letters).path

    def summarise(self) -> str:
        """Return robot and steps."""
        return f"{self.robot.name}: {', '.join(step.title for step in self.steps)}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the steps, and the operations of generated functions."""
        paragraphs = []
        for number, step in enumerate(self.steps, start=1):
            lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
            sides = ((e.left_latex, e.latex) if self.latex else (e.left, e.text) for e in step.formulas)
            lines += [f"     {left} = {right}" for left, right in sides]
            lines += ["", f"   Checked: {step.check}"] if step.check else []
            paragraphs.append("\n".join(lines))
        return (*paragraphs, self._tabulate_operations())

    def _tabulate_operations(self) -> "report.Table":
        """Return the operations of the chosen routes as a table, the worst of the others beside them."""
        most: dict[str, int] = {}
        for entry in self.operations:
            size = entry.operations.mul + entry.operations.add
            most[entry.function] = max(size, most.get(entry.function, 0))
        rows = [
            (one.function, own.mul, own.add, own.trig, most[one.function], one.route)
            for one, own in ((entry, entry.operations) for entry in self.operations if entry.chosen)
        ]
        header = ("function", "mul", "add", "trig", "most", "route")
        return report.Table(header, rows, (0, 5), _OPERATIONS)

    def _describe(self) -> dict[str, object]:
        operations = [describe_record(entry) for entry in self.operations]
        for entry in operations:
            entry.update(entry.pop("operations"))
        steps = [describe_record(step) for step in self.steps]
        return {"robot": self.robot.name, "steps": steps, "operations": operations}

    def _repr_html_(self) -> str:
        parts = []
        for number, step in enumerate(self.steps, start=1):
            parts.append(f"<h4>{number}. {escape(step.title)}</h4><p>{escape(step.sentence)}</p>")
            formulas = (rf"$\displaystyle {entry.left_latex} = {entry.latex}$" for entry in step.formulas)
            parts += [f"<p>{escape(formula)}</p>" for formula in formulas]
            if step.check:
                parts.append(f"<p>Checked: {escape(step.check)}</p>")
        return "".join((*parts, report.write_html((self._tabulate_operations(),))))

    def _repr_latex_(self) -> str:
        lines = []
        for number, step in enumerate(self.steps, start=1):
            lines.append(rf"&\textbf{{{number}. {step.title}}}")
            lines += [rf"{entry.left_latex} &= {entry.latex}" for entry in step.formulas]
        return _ALIGNED.format(r" \\ ".join(lines))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotDynamics:
    """A robot with its dynamics: base parameters, exact expressions, code, compiled functions.

    Attributes:
        description: joints, placements, drives, friction, springs, log map, as read and overridden.
        backend: what computes its functions: "auto" (compiled C, else NumPy), "c", "python" or "casadi".
        progress: called with a short text at each stage; does nothing by default, `print` is a good choice.
    """

    description: "robots.Robot"
    backend: str = "auto"
    progress: Progress = ignore

    @property
    def name(self) -> str:
        """Return the name that the robot file states."""
        return self.description.name

    @property
    def path(self) -> Path:
        """Return the file that the robot was read from."""
        return Path(self.description.path)

    @property
    def joints(self) -> "tuple[robots.Joint, ...]":
        """Return the joints that have a coordinate of their own, in the order of q."""
        return self.description.axes

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on the robot file, such as the parts of a URDF that are not used."""
        return self.description.notices

    @property
    def elastic(self) -> bool:
        """Return whether any joint is elastic."""
        return any(self.description.elastic)

    def __getstate__(self) -> dict[str, object]:
        """Return the state to copy or pickle, without compiled functions, which are loaded again on use."""
        return {name: value for name, value in self.__dict__.items() if name != "library"}

    def __repr__(self) -> str:
        """Return the robot in one line."""
        joints = f"{len(self.joints)} joint{'s'[: len(self.joints) != 1]}{', elastic' * self.elastic}"
        return f"<{type(self).__name__} {self.name}: {joints}, {self.path}>"

    def override(
        self,
        *,
        settings: Settings | None = None,
        friction: str | None = None,
        backend: str | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Return the robot with other settings.

        Args:
            settings: a set of the robot file by its name, or keys under its `log`, `processing` and
                `controller`, with values.
            friction: the friction model of all joints.
            backend: what computes its functions.
            progress: called with a short text at each stage.

        Raises:
            UsageError: a setting cannot be made, or its value does not fit.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link").override(settings={"processing.filter_cutoff": 20})
            >>> robot.description.processing.filter_cutoff
            20.0
        """
        check_value("backend", backend, words(*BACKENDS))
        changed = robots.override_settings(self.description, list_pairs(settings), friction)
        backend, progress = backend or self.backend, progress or self.progress
        return replace(self, description=changed, backend=backend, progress=progress)

    # Base parameters.

    @cached_property
    def base(self) -> BaseSet:
        """Return the base parameters: the smallest set that describes all motions and torques."""
        product = dynamics.derive_base_parameters(self.description)
        return BaseSet(robot=self.description, form="torque", product=product)

    def derive_base(self, form: BaseForm = "torque") -> BaseSet:
        """Return the base parameters of a `form`: "torque", "energy", "momentum", or "gravity" (at rest).

        Raises:
            UsageError: there is no such form.

        Example:
            >>> import symid
            >>> symid.load("two_link").derive_base("gravity").names
            ('MXR1', 'MY1', 'MX2', 'MY2')
        """
        if form == "torque":
            return self.base
        if form not in dynamics.BASE_FORMS:
            text = f"there is no form {form!r}; allowed are {', '.join(dynamics.BASE_FORMS)}"
            raise UsageError(Notice(code="usage.base-form", text=text))
        product = dynamics.derive_base_parameters(self.description, form=form)
        return BaseSet(robot=self.description, form=form, product=product)

    # Derivation, exact functions and code.

    def derivation(self, *, latex: bool = False) -> Derivation:
        """Return the derivation of the dynamics from frames to torques, each step checked, or in `latex`.

        Raises:
            RobotError: a symbolic length has no value.
        """
        self.progress(f"deriving the dynamics of {self.name}")
        steps = lessons.derive_lesson(self.description)
        self.progress("counting the operations of all routes to code")
        counts = codegen.count_route_operations(self.description)
        return Derivation(robot=self.description, steps=steps, operations=counts, latex=latex)

    def write_lesson(
        self,
        path: str | PathLike[str],
        *,
        notation: Notation = "symid",
        parameters: LessonParameters | None = None,
        angle: Literal["q", "theta"] | None = None,
        long_sines: bool = False,
        exercises: int = 0,
        seed: int = 0,
        only_exercises: bool = False,
        log: LogLike | None = None,
        lang: Literal["en", "de"] = "en",
        title: str = "",
        author: str = "",
        force: bool = False,
    ) -> WrittenLesson:
        """Write the derivation as one self-contained page: formulas, their numbers, checks, the arm to move.

        Args:
            path: of the page, `.html`; `.tex` for a document for pdflatex, `.ipynb` for a notebook with live
                SymPy objects, executed where nbclient and ipykernel are there.
            notation: letters of symid, or of Siciliano et al., Craig, or Khalil and Dombre.
            parameters: "base", the file's "symbols", or "bodies" (masses, centres of mass, inertias). None
                takes symbols where the file has them, bodies in the books that use them, else base.
            angle: "q" or "theta" in place of the book's own letter.
            long_sines: write cos(q1 + q2) in place of c12.
            exercises: how many stand at the end of a page or document; a sheet to fill in (`check_answers`
                marks it) and the answers go to text files beside it.
            seed: of the exercises.
            only_exercises: leave the derivation out; the page keeps the arm to move.
            log: a log or its file, whose motion (at most 30 s) the page offers beside drawn ones.
            lang: language of the lesson, English or German ("de").
            title: in place of the robot's name.
            author: below the title.
            force: overwrite a sheet of other exercises that stands beside the page; typed answers never are.

        Raises:
            RobotError: a symbolic length has no value.
            LogError: the log cannot be read or used; the message lists all mistakes.
            OutputError: the page cannot be written; a sheet of other exercises, or of answers, is in the way.
        """
        self.progress(f"deriving the lesson on {self.name}")
        file, robot = Path(fspath(path)), self.description
        suffix = check_suffix(file, "a lesson", (".html", ".htm", ".tex", ".ipynb"))
        book = lessons.get_book(notation, angle=angle, long=long_sines)
        if only_exercises and not exercises:
            what = "only_exercises: say how many exercises"
            raise UsageError(Notice(code="usage.lesson-option", text=what))
        if (suffix == ".ipynb" and exercises) or (suffix in (".tex", ".ipynb") and log is not None):
            part = "log: its motion is" if log is not None else f"exercises={exercises}: they are"
            what = f"{part} part of a page; write a .html for that"
            raise UsageError(Notice(code="usage.lesson-option", text=what))
        answers = sheet = executed = None
        given: dict[str, Any] = {"language": lang, "title": title, "author": author}
        if suffix == ".ipynb":
            folder = file.resolve().parent
            text, executed = lessons.write_lesson_notebook(robot, book, parameters, folder, **given)
        else:
            given |= {"tex": suffix == ".tex", "exercises": exercises, "seed": seed, "alone": only_exercises}
            given |= {"logged": None if log is None else _sample_log(robot, log)}
            page = lessons.write_lesson(robot, book, parameters, **given)
            text = page.text
            if page.sheet:
                sheet, answers = (file.with_suffix(f".{part}.txt") for part in ("exercises", "answers"))
                _check_sheets({sheet: page.sheet, answers: page.answers}, force=force)
                write_file(sheet, page.sheet)
                write_file(answers, page.answers)
        return WrittenLesson(
            robot=robot,
            path=write_file(file, text),
            size=len(text.encode()),
            notation=notation,
            answers=answers,
            sheet=sheet,
            executed=executed,
        )

    def check_answers(
        self, path: str | PathLike[str], *, lang: Literal["en", "de"] | None = None
    ) -> MarkedSheet:
        """Mark the answers typed into the sheet at `path`, which `write_lesson` wrote beside a page.

        Formulas are compared exactly: any form of the right polynomial is right. A number is right to one
        percent. The sheet says with which settings its exercises were drawn, and in which language they are
        marked if `lang` does not.

        Raises:
            InputError: the file is no such sheet, or one of another robot.
        """
        file = Path(fspath(path))
        sheet = _read_sheet(file)
        answers = lessons.mark_sheet(self.description, sheet, str(file), lang or "")
        language = lang or sheet.settings.get("lang", "en")
        return MarkedSheet(robot=self.description, path=file, answers=answers, language=language)

    def sympy(self, name: str, *, standard: bool | Literal["internal"] = False) -> "codegen.SymbolicFunction":
        """Return a function of the catalogue as exact SymPy expressions.

        Args:
            name: of the function, such as "mass_matrix".
            standard: whether it takes the standard parameters pi in place of beta: of each link the ten
                numbers about its frame of the robot file (standard rows: the frame at the row's end; URDF:
                the link's; MJCF: the body's). "internal": pi_internal, about symid's own frames, modified
                Denavit-Hartenberg ones with z along the joint's axis.

        Raises:
            UsageError: the robot has no such function; the message has the nearest names.

        Example:
            >>> import symid
            >>> gravity = symid.load("two_link").sympy("gravity")
            >>> gravity
            gravity(q, beta) -> g
            >>> gravity["g"].shape
            (2, 1)
        """
        self._check_function(name, standard)
        return codegen.derive_symbolic(self.description, name, standard=standard, base=self.base.product)

    def casadi(
        self,
        name: str,
        *,
        standard: bool | Literal["internal"] = False,
        constant: bool = False,
        compiled: bool = False,
    ) -> "ca.Function":
        """Return a function of the catalogue as a CasADi function, with derivatives of any order.

        Vectors are columns; matrices of samples side by side and `map` work as CasADi has them. SI units.

        Args:
            name: of the function, such as "forward_dynamics".
            standard: whether it takes the standard parameters pi in place of beta: of each link the ten
                numbers about its frame of the robot file (standard rows: the frame at the row's end; URDF:
                the link's; MJCF: the body's). "internal": pi_internal, about symid's own frames, modified
                Denavit-Hartenberg ones with z along the joint's axis.
            constant: use the robot file's values of beta, rotors and friction as constants; the parameters h
                of springs stay arguments.
            compiled: of inverse and forward dynamics, call the generated C, for the values and for first
                derivatives; there are no second ones, so Ipopt needs `hessian_approximation`
                "limited-memory", or a Gauss-Newton matrix.

        Raises:
            GenerationError: `compiled`, and no C compiler works.
            RobotError: a symbolic length has no value.
            UsageError: the robot has no such function, or its file lacks a value for a constant.

        Example:
            >>> import symid
            >>> gravity = symid.load("two_link").casadi("gravity", constant=True)
            >>> gravity.size1_in("q")
            2
        """
        self._check_function(name, standard)
        build = codegen.build_compiled_function if compiled else codegen.build_casadi_function
        return build(self.description, name, standard=standard, constant=constant)

    def _check_function(self, name: str, standard: object) -> None:
        """Refuse a function that the catalogue does not have for this robot, with the nearest names."""
        if standard not in (False, True, "internal"):
            text = f"standard: expected True, False or 'internal', got {standard!r}"
            raise UsageError(Notice(code="usage.parameters", text=text))
        if name in codegen.LIMITED:
            # Written on request, or for few coordinates: the error says so.
            codegen.list_robot_specs(self.description, self.base.product, (name,))
            return
        names = [spec.name for spec in codegen.list_robot_specs(self.description, self.base.product)]
        if name not in names:
            hint = robots.suggest_names(name, names, otherwise="there are")
            text = f"function {name!r} is not in the catalogue of {self.name}: {hint}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))

    def compile(self, *, fused: bool = False) -> CompiledModel:
        """Return all functions of the robot as attributes, each compiled by its `backend` where it is called.

        Args:
            fused: let the C compiler make one instruction (FMA) of a product and a sum, which saves about a
                tenth of the time. Last digits then depend on compiler and processor.

        Raises:
            RobotError: a symbolic length has no value.
            GenerationError: there is no compiler and the backend is "c", or it fails.
        """
        robot = self.description
        return CompiledModel(robot, lambda name: self._prepare(robot, names=(name,), fused=fused))

    def write(
        self,
        target: Target,
        folder: str | PathLike[str],
        *,
        functions: Sequence[str] | None = None,
        precision: Precision = "double",
        parameters: Literal["base", "standard", "internal"] = "base",
        constant: bool = False,
        trigonometry: Literal["own", "library"] = "own",
        friction_laws: bool = False,
        force: bool = False,
    ) -> WrittenCode:
        """Write the robot's functions as code that stands alone, and run its self-test.

        Springs with branches (`model` in [joint.elasticity]), backlash or an offset get a folder each in it.
        Where neither the robot nor anything else has changed since the last time, nothing is done.

        Args:
            target: "c", "python" (one module of NumPy), "js" (one of JavaScript), or "casadi" (functions,
                their C, and a loader).
            folder: new, or written by symid earlier; other files in it are not changed.
            functions: the names of those wanted; all by default.
            precision: type of all numbers in C.
            parameters: the functions' arguments: "base" for beta, "standard" for all standard parameters pi
                about the frames of the robot file, "internal" for pi_internal about symid's own frames.
            constant: use the robot file's values as constants.
            trigonometry: sines in C by "own" code for all angles at once, or of the C "library".
            friction_laws: add all static friction laws to the C library.
            force: overwrite files that were edited since.

        Raises:
            RobotError: a symbolic length has no value.
            UsageError: a value is not offered, the robot has no such function, or its file lacks a value that
                is to be constant.
            OutputError: the folder cannot be written, or belongs to something else.
            GenerationError: the code fails its self-test.
        """
        order = GenerateOptions(
            functions=None if functions is None else tuple(functions),
            target=target,
            precision=precision,
            parameters=parameters,
            constant=constant,
            trigonometry=trigonometry,
            friction_laws=friction_laws,
        )
        robot, path, progress = self.description, Path(fspath(folder)), self.progress
        made = codegen.generate_folder(robot, order, path, progress=progress, force=force)
        springs, notices = codegen.generate_springs(robot, order, path, progress=progress, force=force)
        notices = (*self.notices, *made.notices, *notices)
        return WrittenCode.extend(made, robot=robot, springs=springs, notices=notices)

    @cached_property
    def library(self) -> "codegen.Library":
        """Return the functions that identification and simulation run on, from the cache or made now.

        `compile` has the derivatives, the Coriolis matrix and the regressor of Slotine and Li as well.
        """
        return self._prepare(self.description)

    @property
    def context(self) -> "identification.TaskContext":
        """Return compiled functions on demand, and the callback for progress, for long computations."""

        def prepare(description: "robots.Robot") -> "codegen.Library":
            """Return this robot's library, loaded once, where the dynamics are its own."""
            own = codegen.keep_dynamics(description) == codegen.keep_dynamics(self.description)
            return self.library if own else self._prepare(description)

        return identification.TaskContext(prepare=prepare, progress=self.progress)

    @property
    def _prepare(self) -> "Callable[..., codegen.Library]":
        return partial(codegen.prepare_library, progress=self.progress, backend=self.backend)
