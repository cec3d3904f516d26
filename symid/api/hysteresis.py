"""Hysteresis without a robot: an element from its input and output.

fit(x, y, t)            the element that predicts held-out samples best, with intervals and a verdict
read_columns(path)      input, output and time from a file
load(path)              a fit that was saved
"""

from dataclasses import asdict, replace
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple, final

from numpy.typing import ArrayLike

from symid import codegen, identification, joint_models, logs as log_files, report, robot as robots
from symid.api.code import WrittenCode
from symid.api.log import Part, cut_samples, take_samples
from symid.api.result import Figures, JudgedResult, PagedResult, Progress, SavedResult, ignore
from symid.arrays import FloatArray
from symid.environment import write_file
from symid.errors import LogError, Notice, UsageError
from symid.identification import hysteresis as elements
from symid.notation import UNITS, get_unit_factor
from symid.options import HysteresisOptions, Target
from symid.serialization import describe_record


@final
class Columns(  # noqa: SLOT002 - names and units are beside the tuple, so that it is taken apart as one of three
    NamedTuple("Columns", [("x", FloatArray), ("y", FloatArray), ("t", FloatArray | None)])
):
    """Columns of a recording, (N,) each: a tuple of three.

    Attributes:
        x: input; y: output; t: time in s, or None.
        names, units: of input and output; units are "" where the file states none.
        notices: what was done to read the file.

    Example:
        >>> import symid
        >>> columns = symid.hysteresis.Columns(x=[0.0, 1.0], y=[0.0, 2.0], t=None)
        >>> columns.y
        [0.0, 2.0]
    """

    names: tuple[str, str] = ("input", "output")
    units: tuple[str, str] = ("", "")
    notices: tuple[Notice, ...] = ()


def read_columns(
    path: str | PathLike[str], *, x: str | None = None, y: str | None = None, t: str | None = None
) -> Columns:
    r"""Return input and output of a file in its units, and the time in s.

    Args:
        path: csv, txt, npz, mat or hdf5.
        x: name of the column of the input; `data[1]` is the second column of an array `data`.
        y: of the output, likewise.
        t: of the time, likewise.

    Raises:
        LogError: no such file, or columns that it does not have (all are listed).
        UsageError: no column of the input or the output is named (likewise).

    Example:
        >>> import pathlib, symid
        >>> _ = pathlib.Path("spring.csv").write_text("phi,tau\n0.0,0.0\n0.1,2.0\n")
        >>> symid.hysteresis.read_columns("spring.csv", x="phi", y="tau").y.tolist()
        [0.0, 2.0]
    """
    file = Path(fspath(path))
    raw = log_files.read_raw(file)
    columns, units = dict[str, FloatArray](), dict[str, str]()
    for own, values in raw.columns.items():
        parts = {own: values}
        if values.ndim > 1:
            parts = {f"{own}[{k}]": values[:, k] for k in range(values.shape[1])}
        columns |= parts
        units |= dict.fromkeys(parts, raw.units.get(own, ""))
    mistakes, unnamed = list[Notice](), list[Notice]()
    wanted: list[tuple[str | None, str]] = [(x, "input"), (y, "output"), *([(t, "time")] if t else [])]
    for name, what in wanted:
        if name is None:
            text = f"--{what}: name its column; the file has {', '.join(columns)}"
            unnamed.append(Notice(code="usage.columns", text=text, file=str(file)))
        elif name not in columns:
            hint = robots.suggest_names(name, columns) or f"it has {', '.join(columns)}"
            text = f"there is no column {name!r}; {hint}"
            mistakes.append(Notice(code="log.no-column", text=text, file=str(file), line=raw.line))
    if mistakes:
        raise LogError(*mistakes)
    if x is None or y is None:
        raise UsageError(*unnamed)
    # Times in ms, or us, as the file states them; without a unit they are seconds.
    unit = (units[t] if t else "") or "s"
    try:
        kind, rate = get_unit_factor(unit)
    except KeyError:
        kind, rate = "", 1.0
    if kind != "time":
        text = f"column {t!r} of the time has the unit {unit}, which is none of time; write s, ms or us"
        raise LogError(Notice(code="log.time-unit", text=text, file=str(file), line=raw.line))
    found = Columns(columns[x], columns[y], None if t is None else columns[t] * rate)
    found.names, found.units, found.notices = (x, y), (units[x], units[y]), raw.notices
    return found


@final
class ElementFit(JudgedResult, PagedResult, SavedResult):
    """An element that was identified from its input and output; printed with its verdict first.

    Attributes:
        record: all that was found: model, parameters with deviations, candidates.
        source: what it was fitted to, for the page.

    Example:
        >>> import numpy as np, symid
        >>> t = np.arange(1500) / 100.0
        >>> x = 0.01 * (0.4 + 0.6 * np.sin(0.3 * t)) * np.sin(2.0 * t)
        >>> y = 400.0 * x + 3.0 * np.sin(3.0 * x / 0.01)
        >>> fit = symid.hysteresis.fit(x, y, t, model="prandtl-ishlinskii")
        >>> fit.record.model, fit["k0"].deviation > 0.0
        ('prandtl-ishlinskii', True)
    """

    record: "elements.HysteresisRecord"
    source: str = ""

    @property
    def verdict(self) -> "report.FitVerdict":
        """Return what the element is worth."""
        return report.result_pages.judge_element(self.record)

    @property
    def element(self) -> "joint_models.Elasticity":
        """Return the element, which `symid.joint_models` runs."""
        return self.record.elasticity

    def __getitem__(self, name: str) -> "elements.ElementParameter":
        """Return a parameter by name, with its `value` and its `deviation`."""
        found = {entry.name: entry for entry in self.record.parameters}
        if name not in found:
            message = f"{name!r} is no parameter of this element; it has {', '.join(found)}"
            raise KeyError(message)
        return found[name]

    def summarise(self) -> str:
        """Return model, number of parameters and held-out error."""
        record = self.record
        return f"{record.model}: {record.candidates[0].count} parameters, residual {record.held_out:.3g} %"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return parameters, models that were tried, inverse and passivity."""
        return report.result_pages.show_element(self.record)

    def _describe(self) -> dict[str, object]:
        return {**describe_record(self.record), "inverse": elements.describe_inversion(self.record) or None}

    def predict(self, x: ArrayLike, t: ArrayLike | None = None, *, start: str | None = None) -> FloatArray:
        """Return the output (N,) for an input `x` (N,), at times `t` (N,) in s where it needs them.

        `start` is what the element remembers at the first sample: `zero` (at rest at input zero, gone to the
        sample), `fresh` (at rest there), `below` or `above` (come there from that side); None: as in the
        recording of the fit.

        Raises:
            UsageError: no time where the element needs it, or an unknown start.
        """
        return elements.predict_element(self.record, *take_samples(x, t), start=start)

    def invert(self, y: ArrayLike, t: ArrayLike | None = None, *, beyond: bool = False) -> FloatArray:
        """Return the input (N,) that gives an output `y` (N,), at times `t` (N,) in s where it needs them.

        With `beyond` inputs may leave those of the fit by more than half their range.

        Raises:
            UsageError: the element has no inverse, and why; or inputs go too far.
        """
        return elements.invert_fit(self.record, *take_samples(y, t), beyond=beyond)

    def validate(
        self, x: ArrayLike, y: ArrayLike, t: ArrayLike | None = None, *, test: Part | None = None
    ) -> "ElementValidation":
        """Return what the element predicts of another recording, `x`, `y` and `t` as of `fit`.

        `test` is the part that is predicted, such as "60%:" or (10.0, 30.0) in s.

        Raises:
            UsageError: no recording, or a part that is none of it.
        """
        given, time = take_samples(x, t)
        columns = cut_samples(test, "--test", given, take_samples(y, None)[0], time)
        trial = elements.validate_element(self.record, *columns)
        return ElementValidation(record=self.record, trial=trial)

    def insert(self, robot: str | PathLike[str], joint: str, *, units: tuple[str, str] | None = None) -> Path:
        """Write the element into a robot file, as the spring of a joint, and return the file's path.

        Input and output become torsion and torque in SI units; all else in the file stays as it is.

        Args:
            robot: file in TOML, with a table [[joint]] for each joint.
            joint: name of one.
            units: of input and output, such as ("deg", "N m"); None for those of the recording.

        Raises:
            UsageError: units that are not known, or not those of such a joint; no such joint.
            RobotError: no such file, or a joint that cannot have such a spring.
            OutputError: the file cannot be written.
        """
        path = Path(fspath(robot))
        found = robots.read_robot(path)
        named = {one.name: one for one in found.joints}
        if joint not in named:
            text = f"there is no joint {joint!r}; {robots.suggest_names(joint, named) or ', '.join(named)}"
            raise UsageError(Notice(code="usage.element-joint", text=text, file=str(path)))
        wanted = ("length", "force") if named[joint].prismatic else ("angle", "torque")
        factors, mistakes = [], list[Notice]()
        for unit, dimension, what in zip(
            units or self.record.units, wanted, ("input", "output"), strict=True
        ):
            known = UNITS.get(unit, ("", 1.0))
            if known[0] != dimension:
                said = f"is in {unit!r}" if unit else "has no unit"
                text = f"the {what} {said}, and joint {joint!r} needs a unit of {dimension}: state it "
                text += "(--units)"
                mistakes.append(Notice(code="usage.element-unit", text=text))
            else:
                factors.append(known[1])
        if mistakes:
            raise UsageError(*mistakes)
        text = path.read_text(encoding="utf-8")
        new = robots.place_elasticity(text, found, joint, self.element, (factors[0], factors[1]))
        after = robots.parse_robot(new, str(path))
        pairs = zip(found.joints, after.joints, strict=False)
        joints = tuple(replace(one, elasticity=old.elasticity) for old, one in pairs)
        if new == text or replace(after, joints=joints, notices=()) != replace(found, notices=()):
            text = f"joint {joint!r} has no table [[joint]] of its own; write the spring there by hand"
            raise UsageError(Notice(code="usage.element-joint", text=text, file=str(path)))
        return write_file(path, new)

    def _save(self, file: Path) -> Path:
        return identification.write_fit(self.record, file, verdict=describe_record(self.verdict))

    def plot(self, ax: object = None) -> Figures:
        """Return figures: loops, time, residuals, energy of cycles, branches; in axes `ax` of matplotlib."""
        return Figures(drawings=report.result_pages.draw_element(self.record)).draw(ax)

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_element_page(self.record, source=self.source)

    def write(
        self,
        target: Target,
        folder: str | PathLike[str],
        *,
        name: str = "element",
        precision: str = "double",
        force: bool = False,
        progress: Progress = ignore,
    ) -> WrittenCode:
        """Write the element, and its inverse where there is one, as code that needs no symid.

        Args:
            target: c, python or casadi.
            folder: new, empty, or one that symid wrote.
            name: of files and functions, after `symid_`.
            precision: double or float, of C.
            force: overwrite files that were edited.
            progress: called with what begins.

        Raises:
            OutputError: the folder cannot be written, or holds what symid did not write.
            GenerationError: the code fails its self-test.
        """
        record = self.record
        low, high = record.span
        form = f"{record.model}, {record.form}" if record.form else record.model
        left = f"held-out residual {record.held_out:.3g} % of the output."
        facts = (
            f"{form}, fitted to {record.samples} samples: {left}",
            f"The input went from {low:.6g} to {high:.6g}; beyond it the element extrapolates.",
        )
        order = codegen.ElementCode(
            name=name,
            target=target,
            precision=precision,
            reach=max(abs(low), abs(high)),
            period=float(record.trace.time[-1]) / max(1, record.samples - 1),
            facts=facts,
        )
        path, element = Path(fspath(folder)), record.elasticity
        made = codegen.generate_element(element, order, path, progress=progress, force=force)
        return WrittenCode.extend(made, robot=None)


@final
class ElementValidation(JudgedResult):
    """What an element predicts of a recording that it was not fitted to.

    Attributes:
        record: of the fit.
        trial: error in percent, shift, share of samples beyond the input of the fit.

    Example:
        >>> import numpy as np, symid
        >>> t = np.arange(1500) / 100.0
        >>> x = 0.01 * (0.4 + 0.6 * np.sin(0.3 * t)) * np.sin(2.0 * t)
        >>> y = 400.0 * x + 3.0 * np.sin(3.0 * x / 0.01)
        >>> symid.hysteresis.fit(x, y, t, model="dahl").validate(x, y, t).verdict.level
        'good'
    """

    record: "elements.HysteresisRecord"
    trial: "elements.HysteresisTrial"
    _tried = True

    @property
    def verdict(self) -> "report.FitVerdict":
        """Return what the prediction is worth."""
        return report.result_pages.judge_element_trial(self.trial)

    def summarise(self) -> str:
        """Return the error."""
        return f"{self.record.model}: residual {self.trial.error:.3g} % over {self.trial.samples} samples"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the figures in a sentence."""
        trial = self.trial
        text = f"{trial.samples} samples, mean error {trial.shift:.3g} in the unit of the output."
        if trial.inverse is not None:
            text += f"\nInverse: error {trial.inverse:.3g} % of the input."
        return (text,)

    def _describe(self) -> dict[str, object]:
        return asdict(self.trial)


def fit(
    x: ArrayLike,
    y: ArrayLike,
    t: ArrayLike | None = None,
    *,
    model: str = "auto",
    passive: bool | None = None,
    train: Part | None = None,
    names: tuple[str, str] = ("input", "output"),
    units: tuple[str, str] = ("", ""),
    source: str = "",
) -> ElementFit:
    """Return the element that predicts held-out samples best, with as few parameters as that takes.

    Args:
        x: (N,) input, such as a torsion in rad.
        y: (N,) output, such as a torque in N m.
        t: (N,) time in s, increasing, at even steps or not; without it no model that depends on the speed
            is tried.
        model: auto, or one of prandtl-ishlinskii, modified-prandtl-ishlinskii, nonlinear-stops,
            krasnoselskii-pokrovskii, sided, bouc-wen, dahl, lugre, maxwell-slip.
        passive: True for elements from which no motion gets work.
        train: part that is fitted, such as "0:60%" or (0.0, 20.0) in s.
        names: of input and output, for tables and axes.
        units: of input and output, such as ("deg", "N m").
        source: what it is fitted to, for the page.

    Raises:
        UsageError: no recording, an unknown model, or no passive element of that model.

    Example:
        >>> import numpy as np, symid
        >>> t = np.arange(1500) / 100.0
        >>> x = 0.01 * (0.4 + 0.6 * np.sin(0.3 * t)) * np.sin(2.0 * t)
        >>> y = 400.0 * x + 3.0 * np.sin(3.0 * x / 0.01)
        >>> symid.hysteresis.fit(x, y, t, model="dahl")["k0"].value > 0.0
        True
    """
    options = HysteresisOptions(model=model, passive=passive)
    given, time = take_samples(x, t)
    given, output, time = cut_samples(train, "--train", given, take_samples(y, None)[0], time)
    record = elements.fit_hysteresis(given, output, time, options)
    return ElementFit(record=replace(record, names=names, units=units), source=source)


def load(path: str | PathLike[str]) -> ElementFit:
    """Return a fit that `ElementFit.save` or `symid hysteresis` wrote to `path`.

    Raises:
        EstimateError: there is no such file, or it holds something else; it names all mistakes.

    Example:
        >>> import numpy as np, symid
        >>> t = np.arange(1500) / 100.0
        >>> x = 0.01 * (0.4 + 0.6 * np.sin(0.3 * t)) * np.sin(2.0 * t)
        >>> fit = symid.hysteresis.fit(x, 400.0 * x + 3.0 * np.sin(300.0 * x), t, model="dahl")
        >>> symid.hysteresis.load(fit.save("dahl.json")).record.model
        'dahl'
    """
    return ElementFit(record=identification.read_element(Path(fspath(path))), source=Path(fspath(path)).name)


def is_saved(path: str | PathLike[str]) -> bool:
    """Return whether `path` holds a fit of an element, with mistakes or without.

    Example:
        >>> import symid
        >>> symid.hysteresis.is_saved("no_such_file.json")
        False
    """
    return identification.is_kind(Path(fspath(path)), "element")
