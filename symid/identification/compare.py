"""Estimates compared with each other, or with tables of published values, in the same groups.

Robot, estimate -> `EstimateSide`;  sides, paths of tables -> `Compared`, one for every other. By how many
standard deviations two sets of values differ follows from values with covariance and the matrix T from the
ones to the others -> `ValueComparison`:

    d = T x - y,  V = T C T' + S,  z_k = d_k / sqrt(V_kk),  chi^2 = d' V^-1 d

with x, C ours and y, S the others': their errors are taken as independent of each other.

Supported: deviations that are unknown on one side (the other's alone count), or on both (no test); terms that
groups may hold without naming them, tried one after the other.
Not supported: errors that both sets share.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy
from sympy import Expr

from symid import dynamics
from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.errors import EstimateError, Notice, UsageError
from symid.identification.elastic import ElasticEstimate
from symid.identification.estimators import Estimate
from symid.identification.identified import Identified, build_identified
from symid.identification.judge import POLICY, numerics
from symid.robot import Robot, TableColumns, read_value_table
from symid.serialization import HIDDEN, name_key


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatedValues(FrozenArrays):
    """Values (m,) in SI units with their covariance (m, m), NaN in row and column where it is not known."""

    values: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """Return the standard deviations, NaN where they are not known: (m,)."""
        variances = np.diag(self.covariance)
        deviations: FloatArray = np.sqrt(np.where(variances >= 0.0, variances, np.nan))
        return deviations

    def pick(self, places: Sequence[int]) -> "StatedValues":
        """Return the values of some places."""
        kept = list(places)
        return StatedValues(values=self.values[kept], covariance=self.covariance[np.ix_(kept, kept)])


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquare:
    """The sum of squares of `freedom` differences in deviations, correlations counted.

    `chance` is the probability of at least `value` where the stated deviations are true; `log_size` log det
    V.
    """

    value: float
    freedom: int
    chance: float
    log_size: float

    @property
    def stretch(self) -> float:
        """Return the factor on all deviations with which the value is the expected one."""
        return math.sqrt(self.value / self.freedom)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValueComparison:
    """Two sets of values beside each other, group by group; NaN where something is not known.

    `difference` is ours - theirs, `deviations` z: (m,); `chi_square` over all groups that have a deviation,
    None where V is singular, or there are none; `scale` the factor on all deviations with which the median of
    |z| is that of chance, at least 1.
    """

    ours: StatedValues
    theirs: StatedValues
    difference: FloatArray
    deviations: FloatArray
    chi_square: ChiSquare | None
    scale: float

    @property
    def judged(self) -> int:
        """Return how many groups have a deviation."""
        return int(np.isfinite(self.deviations).sum())

    @property
    def largest(self) -> float:
        """Return the largest |z|, zero where there is none."""
        return float(np.nanmax(np.abs(self.deviations))) if self.judged else 0.0

    def count_within(self, limit: float) -> int:
        """Return how many groups differ by at most `limit` deviations."""
        return int((np.abs(self.deviations) <= limit).sum())

    def list_farthest(self, limit: float = POLICY.printed, most: int | None = 5) -> tuple[int, ...]:
        """Return the numbers of the groups beyond `limit`, the farthest first, at most `most`."""
        order = np.argsort(-np.nan_to_num(np.abs(self.deviations)), kind="stable")
        return tuple(int(k) for k in order if abs(self.deviations[k]) > limit)[:most]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedReading:
    """The effect of a term in a group: z `before` and `after`, and by how much chi-square falls.

    `trial` is the number of the term, `log_ratio` the logarithm of the likelihood ratio with and without it.
    `decisive`: so large a ratio is no chance; `rivals` counts other terms in the same group that are as
    likely.
    """

    before: float
    after: float
    gain: float
    log_ratio: float
    trial: int = field(metadata=HIDDEN)
    decisive: bool = False
    rivals: int | None = field(default=None, metadata=HIDDEN)


def build_stated_values(
    values: Sequence[float], deviations: Sequence[float | None], covariance: Sequence[Sequence[float]] = ()
) -> StatedValues:
    """Return values (m,) in SI units with the covariance (m, m) given, else that of independent errors.

    `deviations` (m,) are None where one is not known, infinite, or so large that its fourth power is.
    """
    largest = np.sqrt(np.finfo(float).max)
    known = np.array([entry is not None and entry < np.sqrt(largest) for entry in deviations], dtype=bool)
    spread = np.where(known, [float(entry or 0.0) for entry in deviations], 0.0)
    given = np.array(covariance, dtype=np.float64) if len(covariance) else np.diag(spread**2)
    matrix = given.reshape(len(values), len(values))
    known &= np.diag(matrix) < largest
    matrix[~known, :] = np.nan
    matrix[:, ~known] = np.nan
    return StatedValues(values=np.array(values, dtype=np.float64), covariance=matrix)


def compute_grouped_values(change: FloatArray, stated: StatedValues) -> StatedValues:
    """Return T x with covariance T C T', T (m, n) `change` and x the n values of `stated`.

    A group that holds a value without a deviation has none.
    """
    unknown = np.isnan(np.diag(stated.covariance))
    covariance = change @ np.where(np.isnan(stated.covariance), 0.0, stated.covariance) @ change.T
    without = (change[:, unknown] != 0.0).any(axis=1)
    covariance[without, :] = np.nan
    covariance[:, without] = np.nan
    return StatedValues(values=change @ stated.values, covariance=covariance)


def compare_values(ours: StatedValues, theirs: StatedValues) -> ValueComparison:
    """Return the differences of two sets of values of the same groups, m each."""
    difference = ours.values - theirs.values
    known = ~(np.isnan(np.diag(ours.covariance)) & np.isnan(np.diag(theirs.covariance)))
    covariance = np.nan_to_num(ours.covariance, nan=0.0) + np.nan_to_num(theirs.covariance, nan=0.0)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A value without any error on both sides has no statistics.
    known &= spread > 0.0
    deviations = np.full(len(difference), np.nan)
    deviations[known] = difference[known] / spread[known]
    middle = float(np.median(np.abs(deviations[known]))) if known.any() else 0.0
    total: ChiSquare | None = None
    if known.any():
        widths = spread[known]
        sizes, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(widths, widths))
        if sizes[0] >= numerics.EXACT * sizes[-1]:
            value, freedom = float(np.sum((axes.T @ deviations[known]) ** 2 / sizes)), len(widths)
            total = ChiSquare(
                value=value,
                freedom=freedom,
                chance=float(scipy.special.chdtrc(float(freedom), value)),
                log_size=float(np.sum(np.log(sizes)) + 2.0 * np.sum(np.log(widths))),
            )
    return ValueComparison(
        ours=ours,
        theirs=theirs,
        difference=freeze(difference),
        deviations=freeze(deviations),
        chi_square=total,
        # Of normal errors half are within the quantile of three quarters.
        scale=max(1.0, middle / float(scipy.special.ndtri(0.75))),
    )


def try_readings(
    change: FloatArray, ours: StatedValues, theirs: StatedValues, trials: Sequence[dynamics.OpenReading]
) -> tuple[TriedReading, ...]:
    """Return the effect of each term that a group may hold on the agreement, the most likely one first.

    Of those that bring their group within what a value may miss (`POLICY.printed` deviations, times scale s),
    the likeliest is taken in, then the next of another group, as long as it is decisive for d ~ N(0, s^2 V):

        log_ratio = (chi^2 without - chi^2 with) / (2 s^2) - ln(det V with / det V without) / 2 > ln(N / a)

    for N trials; the second part counts against terms that widen V. Without the term a ratio of 1 / a has a
    probability of at most a (Markov), the level of an alarm; terms of one group whose ratios differ by less
    are equally likely. The others follow, each as it stands beside those. `change` is T, (m, n), as the
    groups name themselves, for n values of ours and m of theirs.
    """
    scale = compare_values(compute_grouped_values(change, ours), theirs).scale
    near = -math.log(POLICY.alarm)
    least = near + math.log(max(1, len(trials)))
    waiting = list(range(len(trials)))
    found: list[TriedReading] = []
    while waiting:
        now = compare_values(compute_grouped_values(change, ours), theirs)
        tried = []
        for number in waiting:
            entry = trials[number]
            then = compare_values(compute_grouped_values(add_readings(change, [entry]), ours), theirs)
            gain = log_ratio = -math.inf
            first, second = now.chi_square, then.chi_square
            # Chi-squares over different groups cannot be compared.
            if first is not None and second is not None and first.freedom == second.freedom:
                gain = first.value - second.value
                log_ratio = 0.5 * (gain / scale**2 + first.log_size - second.log_size)
            before, after = (float(side.deviations[entry.group]) for side in (now, then))
            tried.append(
                TriedReading(before=before, after=after, gain=gain, log_ratio=log_ratio, trial=number)
            )
        tried.sort(key=lambda entry: -entry.log_ratio)
        given = {trials[reading.trial].group for reading in found}
        explaining = [
            entry
            for entry in tried
            if abs(entry.after) <= POLICY.printed * scale and trials[entry.trial].group not in given
        ]
        if not explaining or explaining[0].log_ratio <= least:
            return (*found, *tried)
        best = explaining[0]
        taken = trials[best.trial]
        alike = [entry for entry in explaining if entry.log_ratio > best.log_ratio - near]
        rivals = sum(trials[entry.trial].group == taken.group for entry in alike) - 1
        found.append(replace(best, decisive=True, rivals=rivals))
        waiting.remove(best.trial)
        change = add_readings(change, [taken])
    return tuple(found)


def add_readings(change: FloatArray, trials: Sequence[dynamics.OpenReading]) -> FloatArray:
    """Return T, (m, n), with terms added."""
    changed = np.array(change)
    for trial in trials:
        changed[trial.group, trial.column] += float(trial.factor)
    return changed


def list_shared_logs(first: Sequence[tuple[str, str]], second: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return the logs of `first` that are also in `second`, both as (path, digest), empty if not known.

    They are compared by content, or by path where that is not known.
    """
    return tuple(
        path
        for path, digest in first
        if any(
            # Logs of several folders may have one name.
            digest == other if digest and other else Path(path).resolve() == Path(place).resolve()
            for place, other in second
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimateSide:
    """An estimate that is compared, and its values in the order of its base parameters.

    `identified` has its values, with the robot; `logs` path and digest of each log, empty where it is not
    known; `notices` warn about its deviations, and say what of it is not compared.
    """

    source: Path
    identified: Identified
    names: tuple[str, ...]
    values: StatedValues
    logs: tuple[tuple[str, str], ...]
    notices: tuple[Notice, ...]


def build_side(robot: Robot, estimate: Estimate | ElasticEstimate, source: Path) -> EstimateSide:
    """Return an estimate of `robot`, from `source`, as a side; an EstimateError where it has no value."""
    found, file = build_identified(robot, estimate, source), str(source)
    if not found.values:
        text = "it has no value of any base parameter; identify again"
        raise EstimateError(Notice(code="compare.no-values", text=text, file=file))
    notices = [
        Notice(code="compare.pattern", text=entry.text, file=file)
        for entry in estimate.notices
        if entry.code == "identify.pattern"
    ]
    values, deviations = ([getattr(entry, name) for entry in found.values] for name in ("value", "std"))
    if not found.covariance and sum(map(math.isfinite, deviations)) > 1:
        text = "no covariance: values are taken as independent, which affects chi-square; identify again"
        notices.append(Notice(code="compare.no-covariance", text=text, file=file))
    if found.changes:
        text = f"since this fit the robot file has changed: {found.changes}; compare fits of one robot"
        notices.append(Notice(code="compare.other-bodies", text=text, file=file))
    if found.springs or found.rotors:
        text = "rotors and springs of elastic joints may differ, for they are not compared; see both reports"
        notices.append(Notice(code="compare.springs", text=text, file=file))
    digests = estimate.settings.get("log_digests")
    known = [*digests] if isinstance(digests, list | tuple) else []
    known += [""] * (len(estimate.sources) - len(known))
    return EstimateSide(
        source=source,
        identified=found,
        names=tuple(entry.name for entry in found.values),
        values=build_stated_values(values, deviations, found.covariance),
        logs=tuple((path, str(digest)) for path, digest in zip(estimate.sources, known, strict=False)),
        notices=tuple(notices),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedGroup:
    """A group of the other side: `text` as it stands there, `read_as` what it was read as, if otherwise."""

    text: str
    unit: str
    line: int
    row: tuple[Expr, ...]
    read_as: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedValue:
    """The values of a group on both sides, in SI units; NaN where something is not known.

    `group` is as the other writes it, `read_as` what it was read as, if otherwise; `line` that of a table, 0
    where there is none; `difference` ours - theirs, `deviations` the same in standard deviations of both
    sides together.
    """

    group: str
    read_as: str
    unit: str
    line: int
    ours: float
    ours_std: float
    theirs: float = field(metadata=name_key("other"))
    theirs_std: float = field(metadata=name_key("other_std"))
    difference: float
    deviations: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherSide:
    """The other side of a comparison, from `source`; `columns` those of a table, None of an estimate.

    `strange` names what our model does not have; `shared` logs that both estimates were fitted to, None where
    that is not known.
    """

    source: Path
    columns: TableColumns | None
    groups: tuple[ComparedGroup, ...]
    values: StatedValues
    strange: tuple[str, ...] = ()
    shared: tuple[str, ...] | None = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """A comparison of one other side with ours, in the `groups` of both, in the other's order.

    `not_ours` are groups of the other's that we have no value for; `absent` our parameters that are in none
    of them, `neither` those that ours has no value for either; `lacking` how many further combinations of
    ours the other does not determine; `readings` terms that groups may hold without naming them, with the
    effect of each.
    """

    other: OtherSide
    groups: tuple[ComparedGroup, ...]
    comparison: ValueComparison
    not_ours: tuple[str, ...]
    absent: tuple[str, ...]
    neither: tuple[str, ...]
    lacking: int
    readings: tuple[tuple[dynamics.OpenReading, TriedReading], ...] = ()

    @property
    def values(self) -> tuple[ComparedValue, ...]:
        """Return the values of both sides, group by group."""
        found = self.comparison
        both = found.ours.values, found.ours.std, found.theirs.values, found.theirs.std
        names = ("ours", "ours_std", "theirs", "theirs_std", "difference", "deviations")
        table = np.column_stack([*both, found.difference, found.deviations]).tolist()
        values = []
        for group, row in zip(self.groups, table, strict=True):
            said = {name: getattr(group, name) for name in ("read_as", "unit", "line")}
            values.append(ComparedValue(group=group.text, **said, **dict(zip(names, row, strict=True))))
        return tuple(values)


def check_files(paths: Sequence[Path], source: Path | None = None) -> None:
    """Refuse files that cannot be read, all at once, and a file beside itself; `source` is that of ours."""
    notices = []
    for path in paths:
        try:
            with path.open("rb"):
                pass
        except OSError as error:
            text = f"cannot be read: {error.strerror or error}"
            notices.append(Notice(code="estimate.format", text=text, file=str(path)))
    if notices:
        raise EstimateError(*notices)
    seen = {} if source is None else {Path(source).resolve(): source}
    for path in paths:
        if path.resolve() in seen:
            text = f"the same file as {seen[path.resolve()]}; give each file once"
            raise UsageError(Notice(code="usage.same-file", text=text, file=str(path)))
        seen[path.resolve()] = path


def is_table(path: Path) -> bool:
    """Return whether a file is no JSON, right or wrong, and so a table."""
    with path.open("rb") as stream:
        return stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n")[:1] not in (b"{", b"[")


def check_comparison_gate(found: Compared, gate: float | None) -> tuple[Notice, ...]:
    """Return what misses the gate, the largest acceptable difference in standard deviations."""
    if gate is None:
        return ()
    comparison, file = found.comparison, str(found.other.source)
    if not comparison.judged:
        text = "no standard deviation is known on either side, so the gate cannot be checked"
        return (Notice(code="compare.gate", text=text, file=file),)
    if comparison.largest <= gate:
        return ()
    (worst,) = comparison.list_farthest(0.0, 1)
    text = f"{found.groups[worst].text} differs by {comparison.largest:.4g} standard deviations, "
    text += f"more than the gate of {gate:g}"
    return (Notice(code="compare.gate", text=text, file=file),)


def compare_with_estimate(ours: EstimateSide, theirs: EstimateSide) -> Compared:
    """Return another estimate of the same robot beside ours, parameter by parameter."""
    found = theirs.identified
    terms = {entry.name: dict(entry.terms) for entry in (*found.base.parameters, *found.base.friction)}
    groups, places, strange = [], [], []
    for place, entry in enumerate(found.values):
        try:
            row = dynamics.express_group(ours.identified.base, terms[entry.name], entry.name)
        except UsageError:
            strange.append(entry.name)
            continue
        groups.append(ComparedGroup(text=entry.name, unit=entry.unit, line=0, row=row))
        places.append(place)
    other = OtherSide(
        source=theirs.source,
        columns=None,
        groups=tuple(groups),
        values=theirs.values.pick(places),
        strange=tuple(strange),
        shared=list_shared_logs(ours.logs, theirs.logs),
        notices=theirs.notices,
    )
    return _compare(ours, other)


def compare_with_table(
    ours: EstimateSide, path: Path, columns: TableColumns, read_as: Mapping[str, str]
) -> Compared:
    """Return a table of values beside ours, in the table's groups.

    `read_as` has groups of the table, by their text without blanks, and what to read them as.
    """
    base, file = ours.identified.base, str(path)

    def read_row(text: str) -> tuple[Expr, ...]:
        terms = dynamics.read_group(text, ours.identified.robot, base)
        return dynamics.express_group(base, terms, repr(text))

    for text in read_as.values():
        read_row(text)
    table = read_value_table(path, columns, lambda text: read_row(read_as.get("".join(text.split()), text)))
    rows = table.rows
    known = {"".join(row.text.split()) for row in rows}
    unknown = [text for text in read_as if text not in known]
    if unknown:
        remedy = "the table has no such group with a value; write it as it stands there"
        texts = (f"--read-as {text!r}: {remedy}" for text in unknown)
        raise UsageError(*(Notice(code="usage.read-as", text=text, file=file) for text in texts))
    try:
        dynamics.check_independent([row.name for row in rows], [repr(row.text) for row in rows])
    except UsageError as error:
        notices = []
        for entry in error.notices:
            # At the last line that a notice names.
            line = max((row.line for row in rows if repr(row.text) in entry.text), default=0)
            notices.append(replace(entry, file=file, line=line))
        raise EstimateError(*notices) from error
    units = {entry.name: entry.unit for entry in ours.identified.values}
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    groups = tuple(
        ComparedGroup(
            text=row.text,
            unit=next((units.get(n, "") for n, share in zip(names, row.name, strict=True) if share), ""),
            line=row.line,
            row=row.name,
            read_as=read_as.get("".join(row.text.split()), ""),
        )
        for row in rows
    )
    deviations, notices = [row.deviation for row in rows], []
    if table.empty:
        text = f"not compared, without a value: {', '.join(name for _, name in table.empty)}; write them in"
        notices.append(Notice(code="compare.empty-value", text=text, file=file, line=table.empty[0][0]))
    without = sum(entry is None for entry in deviations)
    if without:
        text = f"{without} of {len(deviations)} values have no standard deviation, so they count as exact"
        if table.columns.deviation is None:
            text += "; name its column by --deviation"
        elif table.columns.percent:
            text += "; a percentage of zero is no deviation: state its size"
        notices.append(Notice(code="compare.no-deviation", text=text, file=file))
    other = OtherSide(
        source=path,
        columns=table.columns,
        groups=groups,
        values=build_stated_values([row.value for row in rows], deviations),
        notices=tuple(notices),
    )
    return _compare(ours, other, search=True)


def _compare(ours: EstimateSide, other: OtherSide, *, search: bool = False) -> Compared:
    """Return both side by side, in the groups that both have values for; an EstimateError for none."""
    base = ours.identified.base
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    known = [names.index(name) for name in ours.names]
    missing = [k for k in range(len(names)) if k not in known]
    kept = [k for k, group in enumerate(other.groups) if not any(group.row[column] for column in missing)]
    if not kept:
        text = f"it has no group in common with {ours.source}"
        raise EstimateError(Notice(code="compare.nothing-common", text=text, file=str(other.source)))
    groups = tuple(other.groups[k] for k in kept)
    theirs = other.values.pick(kept)
    rows = [[group.row[k] for k in known] for group in groups]
    change = dynamics.evaluate_regrouping(rows, ours.identified.robot)
    absent = [name for k, name in enumerate(names) if not any(group.row[k] for group in other.groups)]
    comparison = compare_values(compute_grouped_values(change, ours.values), theirs)
    readings: list[tuple[dynamics.OpenReading, TriedReading]] = []
    if search:
        # Terms that the groups do not name: of coupled drives, then any. Where a coupled drive explains a
        # group, no other terms are tried on it; of those, only one that explains a group as no other does
        # counts.
        whole = [group.row for group in groups]
        coupled = dynamics.list_coupled_readings(ours.identified.robot, base, whole)
        readings, changed = _try_all(ours, change, theirs, coupled)
        now = compare_values(compute_grouped_values(changed, ours.values), theirs)
        explained = {entry.group for entry, tried in readings if tried.decisive}
        far = [k for k in now.list_farthest(POLICY.printed * now.scale, None) if k not in explained]
        kindred, _ = _try_all(ours, changed, theirs, dynamics.list_kindred_readings(base, whole, far))
        readings += [entry for entry in kindred if entry[1].decisive and not entry[1].rivals]
    return Compared(
        other=other,
        groups=groups,
        comparison=comparison,
        not_ours=tuple(group.text for k, group in enumerate(other.groups) if k not in kept),
        absent=tuple(name for name in absent if name in ours.names),
        neither=tuple(name for name in absent if name not in ours.names),
        lacking=len(names) - len(absent) - len(other.groups),
        readings=tuple(readings),
    )


def _try_all(
    ours: EstimateSide, change: FloatArray, theirs: StatedValues, entries: Sequence[dynamics.OpenReading]
) -> tuple[list[tuple[dynamics.OpenReading, TriedReading]], FloatArray]:
    """Return the effect of each reading, and the matrix with those that are decisive."""
    usable = [entry for entry in entries if entry.name in ours.names]
    trials = [replace(entry, column=ours.names.index(entry.name)) for entry in usable]
    tried = try_readings(change, ours.values, theirs, trials)
    decisive = [trials[entry.trial] for entry in tried if entry.decisive]
    return [(usable[entry.trial], entry) for entry in tried], add_readings(change, decisive)
