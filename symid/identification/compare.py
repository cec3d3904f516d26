"""An estimate compared with another, or with a table of published values, in the same groups.

Robot, estimate -> `EstimateSide`;  sides, paths of tables -> `Compared`, one for every other.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sympy import Expr

from symid.arrays import FloatArray
from symid.dynamics import (
    OpenReading,
    build_regrouping,
    evaluate_regrouping,
    express_group,
    list_coupled_readings,
    list_kindred_readings,
    read_group,
)
from symid.errors import EstimateError, Notice, UsageError
from symid.identification.elastic import ElasticEstimate
from symid.identification.estimators import Estimate
from symid.identification.identified import Identified, build_identified
from symid.identification.rigid import (
    FAR,
    ReadingTrial,
    StatedValues,
    TriedReading,
    ValueComparison,
    add_readings,
    build_stated_values,
    compare_values,
    compute_grouped_values,
    list_shared_logs,
    try_readings,
)
from symid.robot import Robot, TableColumns, read_value_table
from symid.serialization import name_key


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimateSide:
    """An estimate that is compared, and its values in the order of its base parameters.

    Args:
        source: where it is from.
        identified: its values, with the robot.
        names: of its parameters, with `values`.
        logs: path and digest of each log; an empty digest is not known.
        notices: warnings about its deviations, and what of it is not compared.
    """

    source: Path
    identified: Identified
    names: tuple[str, ...]
    values: StatedValues
    logs: tuple[tuple[str, str], ...]
    notices: tuple[Notice, ...]


def build_side(robot: Robot, estimate: Estimate | ElasticEstimate, source: Path) -> EstimateSide:
    """Return an estimate of `robot` as a side of a comparison; `source` is where it is from.

    Raises:
        EstimateError: it is of another model, or has no value.
    """
    found, file = build_identified(robot, estimate, source), str(source)
    if not found.values:
        text = "it has no value of any base parameter; identify again"
        raise EstimateError(Notice(code="compare.no-values", text=text, file=file))
    notices = [
        Notice(code="compare.pattern", text=entry.text, file=file)
        for entry in estimate.notices
        if entry.code == "identify.pattern"
    ]
    if not found.covariance and sum(math.isfinite(entry.std) for entry in found.values) > 1:
        text = "it has no covariance: its values are taken as independent, which affects chi-square"
        notices.append(Notice(code="compare.no-covariance", text=text, file=file))
    if found.springs or found.rotors:
        text = "base parameters and friction are compared; rotors and springs of elastic joints are not"
        notices.append(Notice(code="compare.springs", text=text, file=file))
    digests = estimate.settings.get("log_digests")
    known = [*digests] if isinstance(digests, list | tuple) else []
    known += [""] * (len(estimate.sources) - len(known))
    return EstimateSide(
        source=source,
        identified=found,
        names=tuple(entry.name for entry in found.values),
        values=build_stated_values(
            [entry.value for entry in found.values], [entry.std for entry in found.values], found.covariance
        ),
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

    Args:
        group: as the other writes it; `read_as` what it was read as, if otherwise.
        unit: of the values; `line` of the group in a table, 0 where there is none.
        ours, theirs: the values; ours_std, theirs_std: their standard deviations.
        difference: ours - theirs; `deviations` the same in standard deviations of both sides together.
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
    """The other side of a comparison.

    Args:
        source: its path; `columns` those of a table, None of an estimate.
        groups: with `values`; `strange` names what our model does not have.
        shared: logs that both estimates were fitted to; None where that is not known.
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
    """A comparison of one other side with ours.

    Args:
        other: the other.
        groups: those of both, in the other's order, with `comparison`.
        not_ours: groups of the other's that we have no value for.
        absent: our parameters that are in no group of the other's; `neither` those that ours has no value
            for either; `lacking` how many further combinations of ours the other does not determine.
        readings: terms that groups may hold without naming them, with the effect of each.
    """

    other: OtherSide
    groups: tuple[ComparedGroup, ...]
    comparison: ValueComparison
    not_ours: tuple[str, ...]
    absent: tuple[str, ...]
    neither: tuple[str, ...]
    lacking: int
    readings: tuple[tuple[OpenReading, TriedReading], ...] = ()

    @property
    def values(self) -> tuple[ComparedValue, ...]:
        """Return the values of both sides, group by group."""
        found = self.comparison
        return tuple(
            ComparedValue(
                group=group.text,
                read_as=group.read_as,
                unit=group.unit,
                line=group.line,
                ours=float(found.ours.values[k]),
                ours_std=float(found.ours.std[k]),
                theirs=float(found.theirs.values[k]),
                theirs_std=float(found.theirs.std[k]),
                difference=float(found.difference[k]),
                deviations=float(found.deviations[k]),
            )
            for k, group in enumerate(self.groups)
        )


def check_files(paths: Sequence[Path], source: Path | None = None) -> None:
    """Refuse files that cannot be read, and a file beside itself.

    `source` is where our estimate is from, if that is no path of this call.

    Raises:
        UsageError: the same file is given twice.
        EstimateError: some are not there; all are named.
    """
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
    seen = {} if source is None else {source.resolve(): source}
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
    text = (
        f"{found.groups[worst].text} differs by {comparison.largest:.4g} standard deviations, "
        f"more than the gate of {gate:g}"
    )
    return (Notice(code="compare.gate", text=text, file=file),)


def compare_with_estimate(ours: EstimateSide, theirs: EstimateSide) -> Compared:
    """Return another estimate of the same robot beside ours, parameter by parameter.

    Raises:
        EstimateError: they have no parameter in common.
    """
    found = theirs.identified
    terms = {entry.name: dict(entry.terms) for entry in (*found.base.parameters, *found.base.friction)}
    groups, places, strange = [], [], []
    for place, entry in enumerate(found.values):
        try:
            row = express_group(ours.identified.base, terms[entry.name], entry.name)
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

    Raises:
        UsageError: a column is missing; a reading is no sum of ours, or of no group of the table.
        EstimateError: with all that is wrong with the table.
    """
    base = ours.identified.base
    file = str(path)

    def read_row(text: str) -> tuple[Expr, ...]:
        return express_group(base, read_group(text, ours.identified.robot, base), repr(text))

    for text in read_as.values():
        read_row(text)
    table = read_value_table(path, columns, lambda text: read_row(read_as.get("".join(text.split()), text)))
    rows = table.rows
    known = {"".join(row.text.split()) for row in rows}
    unknown = [text for text in read_as if text not in known]
    if unknown:
        remedy = "the table has no such group with a value; write it as it stands there"
        code = "usage.read-as"
        texts = (f"--read-as {text!r}: {remedy}" for text in unknown)
        raise UsageError(*(Notice(code=code, text=text, file=file) for text in texts))
    try:
        build_regrouping(base, [row.name for row in rows], [repr(row.text) for row in rows])
    except UsageError as error:
        # At the last line that a notice names.
        lines = [
            max((row.line for row in rows if repr(row.text) in notice.text), default=0)
            for notice in error.notices
        ]
        located = zip(error.notices, lines, strict=True)
        raise EstimateError(*(replace(entry, file=file, line=line) for entry, line in located)) from error
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
    deviations = [row.deviation for row in rows]
    other = OtherSide(
        source=path,
        columns=table.columns,
        groups=groups,
        values=build_stated_values([row.value for row in rows], deviations),
        notices=_describe_table(file, table.columns, table.empty, deviations),
    )
    return _compare(ours, other, search=True)


def _describe_table(
    file: str, columns: TableColumns, empty: Sequence[tuple[int, str]], deviations: Sequence[float | None]
) -> tuple[Notice, ...]:
    notices = []
    if empty:
        text = f"left out, because they have no value: {', '.join(name for _, name in empty)}"
        notices.append(Notice(code="compare.empty-value", text=text, file=file, line=empty[0][0]))
    without = sum(entry is None for entry in deviations)
    if without:
        text = f"{without} of {len(deviations)} values have no standard deviation; only ours is used for them"
        if columns.deviation is None:
            text += "; --deviation names the column"
        elif columns.percent:
            text += "; a percentage of zero is no deviation"
        notices.append(Notice(code="compare.no-deviation", text=text, file=file))
    return tuple(notices)


def _compare(ours: EstimateSide, other: OtherSide, *, search: bool = False) -> Compared:
    """Return both side by side, in the groups that both have values for.

    Raises:
        EstimateError: there is none.
    """
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
    change = evaluate_regrouping([[group.row[k] for k in known] for group in groups], ours.identified.robot)
    absent = [name for k, name in enumerate(names) if not any(group.row[k] for group in other.groups)]
    return Compared(
        other=other,
        groups=groups,
        comparison=compare_values(compute_grouped_values(change, ours.values), theirs),
        not_ours=tuple(group.text for k, group in enumerate(other.groups) if k not in kept),
        absent=tuple(name for name in absent if name in ours.names),
        neither=tuple(name for name in absent if name not in ours.names),
        lacking=len(names) - len(absent) - len(other.groups),
        readings=_try_readings(ours, [group.row for group in groups], change, theirs) if search else (),
    )


def _try_readings(
    ours: EstimateSide, rows: Sequence[tuple[Expr, ...]], change: FloatArray, theirs: StatedValues
) -> tuple[tuple[OpenReading, TriedReading], ...]:
    """Return the effect of terms that the groups do not name: of coupled drives, then any.

    Where a coupled drive explains a group, no other terms are tried on it; of those, only one that explains a
    group as no other term does is returned.
    """
    found = ours.identified
    coupled, changed = _try_all(ours, change, theirs, list_coupled_readings(found.robot, found.base, rows))
    now = compare_values(compute_grouped_values(changed, ours.values), theirs)
    explained = {entry.group for entry, tried in coupled if tried.decisive}
    far = [k for k in now.list_farthest(FAR * now.scale, len(rows)) if k not in explained]
    kindred, _ = _try_all(ours, changed, theirs, list_kindred_readings(found.base, rows, far))
    return (*coupled, *(entry for entry in kindred if entry[1].decisive and not entry[1].rivals))


def _try_all(
    ours: EstimateSide, change: FloatArray, theirs: StatedValues, entries: Sequence[OpenReading]
) -> tuple[list[tuple[OpenReading, TriedReading]], FloatArray]:
    """Return the effect of each reading, and the matrix with those that are decisive."""
    usable = [entry for entry in entries if entry.name in ours.names]
    trials = [
        ReadingTrial(group=entry.group, column=ours.names.index(entry.name), factor=float(entry.factor))
        for entry in usable
    ]
    tried = try_readings(change, ours.values, theirs, trials)
    decisive = [trials[entry.trial] for entry in tried if entry.decisive]
    return [(usable[entry.trial], entry) for entry in tried], add_readings(change, decisive)
