"""A robot with its values as a file for other programs, in the format that the file's name ends in.

Robot whose file states values, or identified values or friction of one -> a file, and `FileExport`.

Supported: robot files (.toml), URDF, MuJoCo models (.xml, .mjcf), USD text (.usda), C headers (.h), values as
JSON (.json).
Friction alone goes into robot files, by the laws that these have; friction of other joints stays as it is.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from symid import robot as robots
from symid.codegen import build_library_prefix, build_model_card, clean_text, prepare_library
from symid.dynamics import StandardSet, build_grouping, derive_base_parameters
from symid.environment import write_file
from symid.errors import EstimateError, Notice, RobotError, UsageError
from symid.identification import friction as frictions, identified
from symid.identification.elastic import build_rigid_variant
from symid.identification.estimators import FitRecord, check_model
from symid.identification.identified import Identified, JointCost
from symid.identification.judge import POLICY
from symid.identification.rigid import JointScale, compare_fit_scales
from symid.joint_models import FrictionValues, get_friction_law
from symid.options import ExportOptions
from symid.serialization import write_json

KINDS = {
    ".toml": "robot file",
    ".urdf": "URDF",
    ".xml": "MJCF model",
    ".mjcf": "MJCF model",
    ".usda": "USD stage",
    ".h": "C header",
    ".json": "values as JSON",
}
"""Kinds of files, by the end of their name."""

_DIGITS = re.compile(r"-?\d+\.\d{6,}(?:e[-+]?\d+)?")
"""Numbers that the file has with all digits, and a message rounded."""
_SIMULATED = (".xml", ".mjcf", ".usda")


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenFriction:
    """Friction that was written, by joint, with its laws; and why that of other joints stayed."""

    laws: Mapping[str, str]
    values: Mapping[str, FrictionValues]
    kept: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileExport:
    """A file that was written, and the robot as it was written.

    `format` is what the file is, in words; `outcome` how bodies were computed, "stated" where the robot
    file's own were taken, "friction" where only friction was identified; `left_out` what the format cannot
    express; `missing` what was not identified; `standard` the bodies and `costs` what these cost joint by
    joint; `scales` of identified torques against those of the robot file's values; `rewritten` the file of
    which all else was kept, empty where the file is new.
    """

    file: Path
    robot: robots.Robot
    format: str
    outcome: str
    left_out: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    standard: StandardSet | None = None
    costs: tuple[JointCost, ...] = ()
    scales: tuple[JointScale, ...] = ()
    rewritten: str = ""
    friction: WrittenFriction | None = None
    notices: tuple[Notice, ...] = ()


def check_format(path: Path, options: ExportOptions, *, friction: bool = False) -> str:
    """Return the end of the file's name, which says its format; a UsageError where there is no such one.

    `friction` is whether friction alone is written.
    """
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        text = f"{path}: unknown format; give a name that ends in {', '.join(KINDS)}"
        if suffix == ".xacro":
            text = f"{path}: values are not written into xacro, where macros and properties compute them; "
            text += "export a .urdf, which keeps names, frames and shapes, and copy its values by hand"
        raise UsageError(Notice(code="usage.suffix", text=text))
    if suffix != ".h":
        for name, plain in (("precision", "double"), ("name", None)):
            if (value := getattr(options, name)) != plain:
                text = f"--{name} {value} applies to C headers only; leave it out"
                raise UsageError(Notice(code=f"usage.export-{name}", text=text))
    if friction and suffix != ".toml":
        text = f"{path}: friction alone goes into a robot file: export it as one (-o new.toml), then that "
        text += f"file (symid export new.toml -o {path})"
        raise UsageError(Notice(code="usage.suffix", text=text))
    return suffix


def write_stated(robot: robots.Robot, path: Path, options: ExportOptions) -> FileExport:
    """Write the values of the robot file itself; a RobotError where the format needs more than it states."""
    suffix = check_format(path, options)
    base = derive_base_parameters(robot)
    if suffix != ".toml":
        # Refuses symbolic lengths without a value.
        build_grouping(robot, base)
        missing = [joint.name for joint in robot.joints if joint.inertial is None]
        if missing:
            text = f"the links of {', '.join(missing)} have no values; give them in the robot file, or "
            text += "identify them and export the estimate"
            raise RobotError(Notice(code="export.no-values", text=text, file=robot.path))
        reasons = [
            (joint.name, robots.explain_impossible_inertia(joint.inertial or ())) for joint in robot.joints
        ]
        wrong = [f"the link of {name}: {reason}" for name, reason in reasons if reason]
        if wrong and suffix in _SIMULATED:
            text = f"simulators refuse bodies that cannot exist; {'; '.join(wrong)}: correct the robot file, "
            text += "or identify the robot and export the estimate"
            raise RobotError(Notice(code="export.impossible-body", text=text, file=robot.path))
    stated = Identified(robot=robot, base=base, sources=(), values=())
    return _write_file(stated, path, "stated", options, robot.notices)


def write_identified(found: Identified, source: Path, path: Path, options: ExportOptions) -> FileExport:
    """Write the robot with identified values; an EstimateError where bodies or scale are beyond limits."""
    check_format(path, options)
    if found.changes:
        text = f"since the fit the robot file has changed: {found.changes}; a fit is of the robot in its own "
        text += (
            "logs: export it with the robot file that it was made with (-o identified.toml), write new fixed "
        )
        text += "joints into that file and export it without a fit; or identify again with this file"
        raise EstimateError(Notice(code="export.other-bodies", text=text, file=str(source)))
    library, limit = prepare_library(found.robot), options.limit
    most = POLICY.scale if options.ratio is None else options.ratio
    scales = compare_fit_scales(library, found.robot, found.values, found.covariance, found.motion)
    off = ", ".join(f"{entry.joint} {entry.ratio:.3g} times" for entry in scales if entry.is_beyond(most))
    if off:
        text = f"the identified torques differ in scale from the robot file's values ({off}; limit "
        text += f"{most:g}): check unit and side in [log.torque], gears and torque constants, and identify "
        text += "again; where the values of the file are wrong, allow it by --ratio FACTOR (ratio=...)"
        raise EstimateError(Notice(code="export.scale", text=text, file=str(source)))
    # In a format without rotors for simulators, links have the inertia of their rotors, if they can.
    rotorless = _choose_kind(found.robot, path) == "URDF"
    built, costs = identified.build_bodies(found, library, limit, grouped=not rotorless)
    if rotorless and built.standard.reason and (not costs or any(one.percent > one.limit for one in costs)):
        built, costs = identified.build_bodies(found, library, limit)
    over = ", ".join(
        f"{entry.percent:.2g} % of the torque of {entry.joint!r} (limit {entry.limit:.2g} %)"
        for entry in costs
        if entry.percent > entry.limit
    )
    if over:
        text = f"no physical bodies have the identified values, and the nearest differ by {over}: "
        text += f"{built.standard.reason}. Identify with consistent bodies (--estimator consistent) or from "
        text += "logs with more excitation, or allow it by --limit PERCENT (limit=...)"
        raise EstimateError(Notice(code="export.cost", text=text, file=str(source)))
    sources = tuple(Path(entry).name for entry in found.sources)
    before = f"; before: {built.robot.source}" if built.robot.source else ""
    robot = replace(built.robot, source=f"Values identified from {', '.join(sources)}{before}")
    outcome, notices = built.standard.outcome.name.lower(), identified.list_warnings(built, found, source)
    named = replace(found, robot=robot, sources=sources)
    stored = _write_file(named, path, outcome, options, notices, source)
    return replace(stored, missing=found.missing, standard=built.standard, costs=costs, scales=scales)


def refuse_overloads(
    record: FitRecord, robot: robots.Robot, source: Path, ratio: float | None = None
) -> None:
    """Raise EstimateError where the torques of a fit's logs are beyond `ratio` times the joints' limits."""
    most = POLICY.overload if ratio is None else ratio
    limits = {joint.name: joint.limits.torque for joint in robot.axes}
    known = [(name, torque, limits.get(name)) for name, (torque, _) in record.beyond_limit.items()]
    over = [
        f"{name} {torque:.4g}, limit {limit:.4g}"
        for name, torque, limit in known
        if limit is not None and torque > most * limit
    ]
    if over:
        text = f"the torques of its logs are far beyond the limits of the joints ({'; '.join(over)}): check "
        text += "unit and side in [log.torque], gears and torque constants, and identify again; where the "
        text += "limits of the file are wrong, correct them, or allow it by --ratio FACTOR (ratio=...)"
        raise EstimateError(Notice(code="export.limit", text=text, file=str(source)))


def locate_source(robot: robots.Robot) -> Path:
    """Return the URDF or MJCF that a robot was made from; a UsageError where there is none."""
    if robot.made_from is not None:
        return Path(robot.made_from.file)
    text = f"robot {robot.name!r} was not made from a URDF or MJCF, so that there is no file to write in "
    text += "place; give a name (-o FILE)"
    raise UsageError(Notice(code="usage.no-source", text=text, file=robot.path))


def _read_back(
    text: str, suffix: str, source: Path, made: robots.SourceFile | None = None
) -> tuple[Notice, ...]:
    """Return the notices of reading a new file's text, as `made` was; an EstimateError for such values."""
    readers: dict[str, Callable[[str], robots.Robot]] = {
        ".toml": robots.parse_robot,
        ".urdf": robots.parse_xml_robot,
    }
    try:
        if made is not None:
            place = made.file
            return robots.parse_xml_robot(text, place, base=made.base, tip=made.tip, snap=made.snap).notices
        return readers[suffix](text).notices if suffix in readers else ()
    except RobotError as error:
        reasons = "; ".join(notice.text for notice in error.notices)
        text = f"a {KINDS[suffix]} cannot have these values: {reasons}"
        text = f"{text}; identify from logs with more excitation"
        raise EstimateError(Notice(code="export.impossible", text=text, file=str(source))) from error


def _choose_kind(robot: robots.Robot, path: Path) -> str:
    """Return what the file at `path` is to be: in place, what it is."""
    made = robot.made_from
    if made is None or path.resolve() != Path(made.file).resolve():
        return KINDS[path.suffix.lower()]
    return _name_source(made)


def _name_source(made: robots.SourceFile) -> str:
    """Return what a robot was made from, by its content, or by its name where it is gone."""
    file = Path(made.file)
    if file.exists():
        return KINDS[".xml" if robots.is_mjcf(file) else ".urdf"]
    return KINDS.get(file.suffix.lower(), KINDS[".urdf"])


def _write_file(  # noqa: PLR0917 - what is written, where and how
    found: Identified,
    path: Path,
    outcome: str,
    options: ExportOptions,
    notices: Sequence[Notice],
    source: Path | None = None,
) -> FileExport:
    """Write a file, into that which the robot was made from where it is of its kind; see `_read_back`."""
    robot, made, suffix = found.robot, found.robot.made_from, path.suffix.lower()
    kind, told, text = _choose_kind(robot, path), [*notices], ""
    if made is not None and kind == _name_source(made):
        in_place = path.resolve() == Path(made.file).resolve()
        try:
            old, placed, further = place_in_source(robot, made, in_place=in_place)
            new = (robots.rewrite_mjcf if placed.convention == "mjcf" else robots.rewrite_urdf)(old, placed)
        except RobotError as error:
            if in_place:
                raise
            reason = "; ".join(map(str, error.notices))
            said = f"a new {kind}, without meshes, was written: the source of the robot cannot be used"
            told.append(Notice(code="export.new-file", text=f"{said}; correct it: {reason}", file=str(path)))
        else:
            text, told = new.text, [*told, *further]
            for link, carried in new.shared.items():
                said = f"the values of link {link!r} were identified together with those of "
                said += f"{', '.join(carried)}, fixed to it: only the sum is measured; correct the parts you "
                said += "know"
                told.append(Notice(code="export.shared-links", text=said, file=str(path)))
    rewritten = made.file if made is not None and text else ""
    text = text or _write_new(found, suffix, path.parent, outcome, options)
    if source is not None:
        _read_back(text, suffix, source, made if rewritten else None)
    write_file(path, text)
    left_out: tuple[str, ...] = ()
    if kind == "URDF":
        # A file that was kept has its own gravity, and may have been cut at a tilted link.
        left_out = tuple(robots.list_urdf_omissions(robot, gravity=not rewritten))
    elif kind == "MJCF model":
        left_out = tuple(robots.list_mjcf_omissions(robot, rewritten=bool(rewritten)))
    elif kind == "USD stage":
        left_out = tuple(robots.list_usd_omissions(robot))
    if left_out:
        where = "" if rewritten else ", which is in comments"
        texts = _DIGITS.sub(lambda found: f"{float(found[0]):.6g}", "; ".join(left_out))
        said = f"the format cannot express this{where}, so simulators lack it: {texts}; keep the TOML file"
        told.append(Notice(code="export.left-out", text=said, file=str(path)))
    return FileExport(
        file=path,
        robot=robot,
        format=kind,
        outcome=outcome,
        left_out=left_out,
        rewritten=rewritten,
        notices=tuple(told),
    )


def place_in_source(
    robot: robots.Robot, made: robots.SourceFile, *, in_place: bool
) -> tuple[str, robots.Robot, list[Notice]]:
    """Return the text of the URDF or MJCF `made`, and its robot with the values of `robot`, made from it."""
    source = robots.read_urdf_text(Path(made.file), keep_ends=True, arguments=dict(made.xacro))
    before = robots.parse_xml_robot(source.text, source.file, base=made.base, tip=made.tip, snap=made.snap)
    if in_place and source.file != made.file:
        told = "this is a xacro file, a program that writes a URDF; give a name that ends in .urdf (-o FILE)"
        raise RobotError(Notice(code="export.xacro", text=told, file=made.file))
    mistakes = identified.list_frame_differences(robot, before)
    if mistakes:
        told = f"its joints are others than when {robot.name!r} was made from it: {'; '.join(mistakes)}"
        raise RobotError(Notice(code="export.source-changed", text=told, file=made.file))
    notices = []
    if before.made_from is not None and before.made_from.sha256 != made.sha256:
        told = "the file is not as it was when the robot was made from it (an export in place changes it, "
        told += "too); its joints are the same"
        notices.append(Notice(code="export.source-edited", text=told, file=made.file))
    trios = zip(robot.joints, before.joints, identified.list_turns(robot, before), strict=True)
    joints = tuple(
        replace(
            old,
            inertial=new.inertial if np.array_equal(turn, np.eye(4)) else identified.move_link(new, turn),
            friction=new.friction,
            drive=new.drive,
            spring=new.spring,
        )
        for new, old, turn in trios
    )
    # URDFs have no coupled drives; what an MJCF model has otherwise is refused as it is written.
    couplings = robot.couplings if before.convention == "mjcf" else before.couplings
    return source.text, replace(before, joints=joints, couplings=couplings), notices


def _write_new(found: Identified, suffix: str, folder: Path, outcome: str, options: ExportOptions) -> str:
    robot, whence = found.robot, f"values identified from {', '.join(found.sources)}"
    comment = f"{robot.name} with {whence if found.sources else 'the values of its robot file'}."
    match suffix:
        case ".toml":
            return robots.write_robot(robot, comment=comment, folder=folder)
        case ".h":
            comments, values = (clean_text(comment),), _build_values(found)
            return robots.write_c_values(
                values, comments=comments, precision=options.precision, name=options.name
            )
        case ".json":
            values, sources = _build_values(found), found.sources
            data = robots.build_json_values(robot, values, outcome=outcome, sources=sources)
            return write_json(data) + "\n"
    write = {".urdf": robots.write_urdf, ".usda": robots.write_usd}.get(suffix, robots.write_mjcf)
    return write(robot, comments=(comment,))


def _build_values(found: Identified) -> robots.RobotValues:
    card = build_model_card(found.robot, found.base, ())
    known = {entry.name: entry for entry in found.values}
    titles = {
        "beta": ("Base parameters of links and drives", card.beta),
        "f": ("Friction parameters", card.friction),
        "IA": ("Rotor inertias of elastic joints, on the joints' side", card.rotors),
        "h": ("Parameters of the springs of elastic joints", card.springs),
    }
    vectors = []
    for name, (title, cards) in titles.items():
        rows = []
        for entry in cards:
            own = known.get(entry.name)
            # A joint whose friction is known in part has none in robot files; here it has that part.
            value = own.value if entry.value is None and own is not None else entry.value
            rows.append(
                robots.ValueRow(
                    name=clean_text(entry.name),
                    value=value,
                    unit=entry.unit,
                    expression=clean_text(entry.expression),
                    identified=own.value if own is not None else None,
                    # Some methods give no deviations.
                    std=own.std if own is not None and 0.0 < own.std < math.inf else None,
                )
            )
        vectors.append(robots.ValueVector(name=name, title=title, rows=tuple(rows)))
    prefix = build_library_prefix(card.robot)
    return robots.RobotValues(
        robot=card.robot, prefix=prefix, signature=card.signature, vectors=tuple(vectors)
    )


def write_friction(
    robot: robots.Robot, found: frictions.FrictionIdentification, source: Path, path: Path
) -> FileExport:
    """Write the robot file with the friction that was identified, or EstimateError where it is of another.

    Friction that robot files have no model for stays as it is, with a notice.
    """
    check_format(path, ExportOptions(), friction=True)
    variant = frictions.set_identified_friction(build_rigid_variant(robot), found)
    check_model(found, build_model_card(variant, derive_base_parameters(variant), ()), str(source))
    logs = ", ".join(Path(entry).name for entry in found.sources)
    before = f"; before: {robot.source}" if robot.source else ""
    written, reasons = dict[str, FrictionValues](), dict(found.refused)
    for entry in found.joints:
        friction = frictions.build_robot_friction(entry)
        if isinstance(friction, str):
            reasons[entry.joint] = friction
        else:
            written[entry.joint] = friction
    kept = {joint.name: reasons[joint.name] for joint in robot.axes if joint.name in reasons}
    joints = (replace(joint, friction=written.get(joint.name, joint.friction)) for joint in robot.joints)
    changed = replace(robot, joints=tuple(joints), source=f"Friction identified from {logs}{before}")
    comment = f"{robot.name} with friction identified from {logs}."
    text = robots.write_robot(changed, comment=comment, folder=path.parent)
    notices = [replace(notice, file=str(path)) for notice in _read_back(text, ".toml", source)]
    write_file(path, text)
    for name, reason in kept.items():
        text = f"joint {name!r} keeps the friction of the robot file, not measured: {reason}; log more motion"
        notices.append(Notice(code="export.friction-kept", text=text, file=str(source)))
    for joint in robot.axes:
        law = get_friction_law(joint.friction)
        if joint.name in written and law is not None and law.memory:
            names = ", ".join(entry.name for entry in law.memory)
            text = f"joint {joint.name!r}: {written[joint.name].law} friction, as identified, replaces "
            text += f"{law.name} and its {names}; to keep them, identify the whole robot"
            notices.append(Notice(code="export.friction-replaced", text=text))
    if any(robot.elastic):
        text = "friction was identified with rigid joints and includes the losses of springs; the file has "
        text += "the springs as well, so these losses count twice; identify the whole robot to separate them"
        notices.append(Notice(code="export.friction-springs", text=text, file=str(source)))
    laws = {entry.joint: entry.estimate.law for entry in found.joints}
    return FileExport(
        file=path,
        robot=changed,
        format=KINDS[".toml"],
        outcome="friction",
        friction=WrittenFriction(laws=laws, values=written, kept=kept),
        notices=tuple(notices),
    )
