"""Hysteresis without a robot: an element from its input and output.

fit(x, y, t)            the element that predicts held-out samples best, with intervals and a verdict
read_columns(path)      input, output and time from a file
load(path)              a fit that was saved
"""

from dataclasses import asdict
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple, final

from numpy.typing import ArrayLike

from symid import codegen, identification, joint_models, logs as log_files, report, robot as robots
from symid.api.code import WrittenCode
from symid.api.log import take_samples
from symid.api.result import Figures, JudgedResult, PagedResult, Progress, SavedResult, ignore
from symid.arrays import FloatArray
from symid.errors import LogError, Notice
from symid.identification import hysteresis as elements
from symid.options import HysteresisOptions, Target
from symid.serialization import describe_record


class Columns(NamedTuple):
    """Columns of a recording, (N,) each.

    Attributes:
        x: input; y: output; t: time in s, or None.

    Example:
        >>> import symid
        >>> columns = symid.hysteresis.Columns(x=[0.0, 1.0], y=[0.0, 2.0], t=None)
        >>> columns.y
        [0.0, 2.0]
    """

    x: FloatArray
    y: FloatArray
    t: FloatArray | None


def read_columns(path: str | PathLike[str], *, x: str, y: str, t: str | None = None) -> Columns:
    r"""Return input, output and time of a file, in the units of the file.

    Args:
        path: csv, txt, npz, mat or hdf5.
        x: name of the column of the input; `data[1]` is the second column of an array `data`.
        y: of the output, likewise.
        t: of the time, likewise.

    Raises:
        LogError: no such file, or columns that it does not have (all are listed).

    Example:
        >>> import pathlib, symid
        >>> _ = pathlib.Path("spring.csv").write_text("phi,tau\n0.0,0.0\n0.1,2.0\n")
        >>> symid.hysteresis.read_columns("spring.csv", x="phi", y="tau").y.tolist()
        [0.0, 2.0]
    """
    file = Path(fspath(path))
    raw = log_files.read_raw(file)
    columns: dict[str, FloatArray] = {}
    for name, values in raw.columns.items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
    mistakes = []
    for name in (x, y, *([] if t is None else [t])):
        if name not in columns:
            hint = robots.suggest_names(name, columns) or f"it has {', '.join(columns)}"
            text = f"there is no column {name!r}; {hint}"
            mistakes.append(Notice(code="log.no-column", text=text, file=str(file), line=raw.line))
    if mistakes:
        raise LogError(*mistakes)
    return Columns(columns[x], columns[y], None if t is None else columns[t])


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
        return f"{record.model}: {record.candidates[0].count} parameters, {record.held_out:.3g} % left"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return parameters, models that were tried, inverse and passivity."""
        return report.result_pages.show_element(self.record)

    def _describe(self) -> dict[str, object]:
        return report.result_pages.describe_element(self.record)

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

    def validate(self, x: ArrayLike, y: ArrayLike, t: ArrayLike | None = None) -> "ElementValidation":
        """Return what the element predicts of another recording, `x`, `y` and `t` as of `fit`."""
        given, time = take_samples(x, t)
        trial = elements.validate_element(self.record, given, take_samples(y, None)[0], time)
        return ElementValidation(record=self.record, trial=trial)

    def _save(self, file: Path) -> Path:
        return identification.write_fit(self.record, file, verdict=describe_record(self.verdict))

    def plot(self, ax: object = None) -> Figures:
        """Return figures: loops, time, residuals, energy of cycles, branches; in axes `ax` of matplotlib."""
        return Figures(drawings=report.result_pages.draw_element(self.record)).draw(ax)

    def _write_page(self, file: Path) -> Path:
        return report.result_pages.write_element_page(file, self.record, source=self.source)

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
        left = f"{record.held_out:.3g} % of the output is left, held out."
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
        return f"{self.record.model}: {self.trial.error:.3g} % left of {self.trial.samples} samples"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the figures in a sentence."""
        trial = self.trial
        text = f"{trial.samples} samples, mean error {trial.shift:.3g} in the unit of the output."
        if trial.inverse is not None:
            text += f"\nInverse: misses the input by {trial.inverse:.3g} % of it."
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
    source: str = "",
) -> ElementFit:
    """Return the element that predicts held-out samples best, with as few parameters as that takes.

    Args:
        x: (N,) input, such as a torsion in rad.
        y: (N,) output, such as a torque in N m.
        t: (N,) time in s, increasing, at even steps or not; without it no model that depends on the speed
            is tried.
        model: auto, or one of prandtl-ishlinskii, modified-prandtl-ishlinskii, nonlinear-stops,
            krasnoselskii-pokrovskii, bouc-wen, dahl, lugre, maxwell-slip.
        passive: True for elements from which no motion gets work.
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
    record = elements.fit_hysteresis(given, take_samples(y, None)[0], time, options)
    return ElementFit(record=record, source=source)


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
