"""The result of an identification of friction: joint by joint, as a JSON file, as robot files have it.

Fits, choices, tests -> FrictionIdentification <-> file; JointFriction -> FrictionValues, or why there are
none.

Robot files name what friction has beyond its Coulomb level, as the columns of the laws do:

    Fe = fS - fC,    offset = fP where friction has no zone about standstill

Supported: format 1, SI units; a number that is not finite is written as null and read as infinite; export
of all laws whose columns are those of a model of robot files.
Not supported: export of laws of load or position, of an offset beside a model that has none, of refused
values.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from symid.errors import EstimateError, Notice, UsageError
from symid.identification.estimators import Residual
from symid.identification.friction.estimate import FrictionEstimate
from symid.identification.friction.poses import PoseTest
from symid.identification.friction.samples import VelocityMap
from symid.identification.friction.selection import LawSelection
from symid.identification.rigid import write_file
from symid.joint_models import FrictionLaw, get_law
from symid.robot import (
    FRICTION_PARAMETERS,
    FRICTION_SHAPES,
    CurvedFriction,
    FrictionKind,
    FrictionValues,
    Robot,
    ShapeKey,
    override_robot,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_FORMAT = "symid friction result"
_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class JointFriction:
    """Friction of one joint.

    Args:
        estimate: the law's parameters, how sure they are, and how they were found.
        formula: of the law, in words; `smoothing` v0 in rad/s or m/s of its sign, 0 for the sign.
        unit: of the torque; velocity_unit: of the velocity.
        rigid: how the rigid part of the torque was treated.
        residual: what the law leaves unexplained of the logs it was fitted to.
        selection: how the law was chosen; None where it was named.
        poses: whether friction depends on the pose; None where one pose was recorded.
        velocity_map: friction torque against velocity, as measured.
        sources: the logs in which the joint moves.
    """

    estimate: FrictionEstimate
    formula: str
    smoothing: float
    unit: str
    velocity_unit: str
    rigid: str
    residual: Residual
    selection: LawSelection | None
    poses: PoseTest | None
    velocity_map: VelocityMap
    sources: tuple[str, ...]

    @property
    def joint(self) -> str:
        """Return the joint's name."""
        return self.estimate.joint

    def __repr__(self) -> str:
        """Return joint, law and parameters in one line."""
        values = ", ".join(map(str, self.estimate.parameters))
        return f"<JointFriction {self.joint}: {self.estimate.law}; {values}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionIdentification:
    """Friction of all joints that move.

    Args:
        robot: its name; signature: of its model.
        model: the law asked for, or "auto"; estimator: how laws were fitted.
        joints: those whose friction shows.
        refused: the others, with the reason.
        sources: the logs; settings: processing, log map and options, after overrides.
        notices: what a reader should know.
    """

    robot: str
    signature: str
    model: str
    estimator: str
    joints: tuple[JointFriction, ...]
    refused: tuple[tuple[str, str], ...]
    sources: tuple[str, ...]
    settings: Mapping[str, object]
    notices: tuple[Notice, ...]


def write_friction_result(result: FrictionIdentification, path: Path) -> Path:
    """Write the result to `path` as JSON and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    data = {"format": _FORMAT, "version": _VERSION, **asdict(result)}
    text = json.dumps(_write_plain(data), indent=1, allow_nan=False, ensure_ascii=False)
    return write_file(path, text + "\n")


def read_friction_result(path: Path) -> FrictionIdentification:
    """Return the result stored at `path`.

    Raises:
        EstimateError: there is no such file, or it holds something else.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refuse(path, f"cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise _refuse(path, f"not JSON: {error}") from error
    if not isinstance(data, dict) or data.get("format") != _FORMAT:
        raise _refuse(path, "this is JSON, but no friction of a robot written by symid")
    if data.get("version") != _VERSION:
        raise _refuse(path, f"version {data.get('version')!r} of the format; this symid reads {_VERSION}")
    try:
        body = {key: value for key, value in data.items() if key not in {"format", "version"}}
        result = cast("FrictionIdentification", _read(FrictionIdentification, body, "result"))
        mistakes = [text for joint in result.joints for text in _list_mistakes(joint)]
    except UsageError as error:
        raise _refuse(path, "; ".join(entry.text for entry in error.notices)) from error
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
        raise _refuse(path, str(error)) from error
    if not result.joints:
        mistakes.append("result.joints is empty")
    if mistakes:
        raise EstimateError(*(_build_notice(path, text) for text in mistakes))
    return result


def is_friction_result(path: Path) -> bool:
    """Return whether `path` holds friction of a robot, whatever else may be wrong with it."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("format") == _FORMAT


def _list_mistakes(joint: JointFriction) -> list[str]:
    """Return where arrays of a joint do not fit its law or each other.

    Raises:
        UsageError: there is no law of this name.
    """
    estimate, seen = joint.estimate, joint.velocity_map
    law = get_law(estimate.law, smoothing=joint.smoothing)
    size = len(law.linear) + len(law.shape) + len(estimate.other)
    lengths = [
        ("estimate.linear", len(estimate.linear), len(law.linear)),
        ("estimate.shape", len(estimate.shape), len(law.shape)),
        ("estimate.covariance", len(estimate.covariance), size),
        *((f"estimate.covariance, row {k}", len(row), size) for k, row in enumerate(estimate.covariance)),
        *(
            (f"velocity_map.{name}", len(getattr(seen, name)), len(seen.velocity))
            for name in ("torque", "spread", "count")
        ),
        ("velocity_map.cloud_torque", len(seen.cloud_torque), len(seen.cloud_velocity)),
    ]
    for entry in () if joint.poses is None else joint.poses.parameters:
        many = len(joint.poses.poses) if joint.poses is not None else 0
        lengths += [(f"poses, values of {entry.name}", len(entry.values), many)]
        lengths += [(f"poses, stds of {entry.name}", len(entry.stds), many)]
        lengths += [(f"poses, freedom of {entry.name}", len(entry.freedom) or many, many)]
    mistakes = [
        f"joint {joint.joint!r}: {name} has {length} entries, not {wanted}"
        for name, length, wanted in lengths
        if length != wanted
    ]
    if not len(seen.cloud_velocity):
        mistakes.append(f"joint {joint.joint!r}: velocity_map.cloud_velocity is empty")
    numbers = (*estimate.linear, *estimate.shape, *seen.cloud_velocity, *seen.cloud_torque)
    if not all(map(math.isfinite, numbers)):
        mistakes.append(f"joint {joint.joint!r}: values of the law or of measured rows are not numbers")
    chosen = joint.selection and joint.selection.chosen
    if joint.selection and chosen not in {trial.law for trial in joint.selection.trials}:
        mistakes.append(f"joint {joint.joint!r}: selection.chosen {chosen!r} is none of the laws tried")
    return mistakes


def _refuse(path: Path, text: str) -> EstimateError:
    return EstimateError(_build_notice(path, text))


def _build_notice(path: Path, text: str) -> Notice:
    return Notice(code="estimate.format", text=text, file=str(path))


def _write_plain(value: object) -> object:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Enum():
            return value.name
        case np.ndarray():
            return [_write_plain(entry) for entry in value.tolist()]
        case Mapping():
            return {str(key): _write_plain(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_write_plain(entry) for entry in value]
    return value


def _read(kind: type, value: object, where: str) -> object:
    """Return `value`, as JSON has it, as the type `kind` of a product; `where` it stands, for messages."""
    if is_dataclass(kind):
        return _read_record(kind, value, where)
    arguments, origin = get_args(kind), get_origin(kind)
    if origin in {Union, UnionType}:
        if NoneType in arguments:
            inner = next(entry for entry in arguments if entry is not NoneType)
            return None if value is None else _read(inner, value, where)
        return _expect(value, arguments, where)
    if origin is tuple:
        return _read_tuple(arguments, _expect_list(value, where), where)
    if origin is np.ndarray:
        return np.array(
            [_read(float, entry, where) for entry in _expect_list(value, where)], dtype=np.float64
        )
    if origin is not None and issubclass(origin, Mapping):
        return _expect(value, (dict,), where)
    if issubclass(kind, Enum):
        return kind[str(_expect(value, (str,), where))]
    if kind is float:
        return math.inf if value is None else float(cast("float", _expect(value, (int, float), where)))
    return _expect(value, (kind,), where)


def _expect(value: object, kinds: tuple[type, ...], where: str) -> object:
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        names = " or ".join(kind.__name__ for kind in kinds)
        message = f"{where}: expected {names}, got {value!r:.60}"
        raise TypeError(message)
    return value


def _expect_list(value: object, where: str) -> list[object]:
    return cast("list[object]", _expect(value, (list,), where))


def _read_tuple(arguments: tuple[object, ...], entries: list[object], where: str) -> tuple[object, ...]:
    if arguments[-1] is Ellipsis:
        return tuple(_read(cast("type", arguments[0]), entry, where) for entry in entries)
    if len(entries) != len(arguments):
        message = f"{where}: expected {len(arguments)} entries, got {len(entries)}"
        raise ValueError(message)
    pairs = zip(arguments, entries, strict=True)
    return tuple(_read(cast("type", kind), entry, where) for kind, entry in pairs)


def _read_record(kind: type, value: object, where: str) -> object:
    table = cast("dict[str, object]", _expect(value, (dict,), where))
    hints = get_type_hints(kind)
    known = fields(cast("type[DataclassInstance]", kind))
    needed = {entry.name for entry in known if entry.default is MISSING and entry.default_factory is MISSING}
    wrong = [f"{name} is missing" for name in sorted(needed - table.keys())]
    wrong += [f"{name} is unknown" for name in sorted(table.keys() - {entry.name for entry in known})]
    if wrong:
        message = f"{where}: {', '.join(wrong)}"
        raise ValueError(message)
    return kind(**{name: _read(hints[name], entry, f"{where}.{name}") for name, entry in table.items()})


_EXPONENT = r"(?:-(?P<gamma>exponent|[\d.e-]+))?"
_NAMES = {"Fs": "Fe", "Fv2": "Fvq", "Fv3": "Fvc"}
_WITHOUT_ZONE = {"Fs": "Fe", "Fp": "offset"}
_TUSTIN = "1"
_GAUSSIAN = "2"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Family:
    """Laws that a model can say: a pattern of their names, the model, that with an offset, other names."""

    pattern: str
    kind: FrictionKind | CurvedFriction
    with_offset: FrictionKind | CurvedFriction | None = None
    names: Mapping[str, str]
    gamma: str = _GAUSSIAN
    has_sign: bool = True


_FAMILIES = (
    _Family(
        pattern=r"coulomb(?:-viscous)?",
        kind=FrictionKind.VISCOUS_COULOMB,
        with_offset=FrictionKind.VISCOUS_COULOMB_OFFSET,
        names={},
    ),
    _Family(pattern=r"coulomb-viscous-offset", kind=FrictionKind.VISCOUS_COULOMB_OFFSET, names={}),
    _Family(pattern=r"asymmetric", kind=FrictionKind.ASYMMETRIC, names={}),
    _Family(
        pattern=r"tustin",
        kind=CurvedFriction.STRIBECK,
        with_offset=CurvedFriction.STRIBECK_OFFSET,
        names=_NAMES,
        gamma=_TUSTIN,
    ),
    _Family(
        pattern=rf"stribeck{_EXPONENT}",
        kind=CurvedFriction.STRIBECK,
        with_offset=CurvedFriction.STRIBECK_OFFSET,
        names=_NAMES,
    ),
    _Family(
        pattern=rf"improved-stribeck-h3{_EXPONENT}",
        kind=CurvedFriction.STRIBECK_OFFSET,
        names=_WITHOUT_ZONE,
    ),
    _Family(
        pattern=rf"improved-stribeck{_EXPONENT}",
        kind=CurvedFriction.IMPROVED_STRIBECK,
        names=_NAMES,
        has_sign=False,
    ),
    _Family(
        pattern=rf"asymmetric-stribeck{_EXPONENT}", kind=CurvedFriction.ASYMMETRIC_STRIBECK, names=_NAMES
    ),
    _Family(pattern=r"cubic|polynomial-(?:2|3|2,3|3,2)", kind=CurvedFriction.CUBIC, names=_NAMES),
    _Family(pattern=rf"stribeck{_EXPONENT}\+cubic", kind=CurvedFriction.STRIBECK_CUBIC, names=_NAMES),
    _Family(pattern=r"power-law", kind=CurvedFriction.POWER_LAW, names={}),
    _Family(pattern=r"makkar", kind=CurvedFriction.MAKKAR, names={}, has_sign=False),
)


def describe_obstacle(joint: JointFriction) -> str:
    """Return why no robot file can have the joint's friction as it was identified; empty where one can."""
    estimate = joint.estimate
    law = get_law(estimate.law, smoothing=joint.smoothing)
    physical = {entry.name for entry in law.physical}
    refused = [(name, reason) for name, reason in estimate.refused if name in physical]
    if refused:
        return "; ".join(f"{name} was refused: {reason}" for name, reason in refused)
    found = _get_family(law.name)
    if found is None:
        return f"robot files have no model of the law {law.name!r}{_explain(law)}"
    _, kind, gamma = found
    shape = _name_shape(law, estimate.shape, gamma)
    wrong = [
        f"{key.name} = {shape[key.name]:g}, and robot files take what is {key.allowed}"
        for key in FRICTION_SHAPES.get(kind, ())
        if shape[key.name] not in key.allowed
    ]
    return "; ".join(wrong)


def build_robot_friction(joint: JointFriction) -> FrictionValues:
    """Return the friction of a robot file whose torque is that of the identified law.

    Raises:
        ValueError: there is none; see `describe_obstacle`.
    """
    law = get_law(joint.estimate.law, smoothing=joint.smoothing)
    found = _get_family(law.name)
    if found is None or describe_obstacle(joint):
        raise ValueError(describe_obstacle(joint))
    family, kind, gamma = found
    values = {
        family.names.get(entry.name, entry.name): value
        for entry, value in zip(law.linear, joint.estimate.linear, strict=True)
    }
    shape = _name_shape(law, joint.estimate.shape, gamma)
    keys: Sequence[ShapeKey] = FRICTION_SHAPES.get(kind, ())
    return FrictionValues(
        kind=kind,
        values=tuple(values.get(name, 0.0) for name in FRICTION_PARAMETERS[kind]),
        # Without a sign there is nothing to smooth, and robot files refuse it.
        smoothing=joint.smoothing if family.has_sign else 0.0,
        shape=tuple(shape[key.name] for key in keys),
    )


def _get_family(name: str) -> tuple[_Family, FrictionKind | CurvedFriction, str] | None:
    """Return the family of a law, the model, and the exponent that the law's name fixes."""
    plain = name.removesuffix("+offset")
    for family in _FAMILIES:
        match = re.fullmatch(family.pattern, plain)
        if match is None:
            continue
        kind = family.kind if plain == name else family.with_offset
        gamma = match.groupdict().get("gamma") or family.gamma
        return None if kind is None else (family, kind, gamma)
    return None


def _name_shape(law: FrictionLaw, values: Sequence[float], gamma: str) -> dict[str, float]:
    shape = {entry.name: value for entry, value in zip(law.shape, values, strict=True)}
    return shape if "gamma" in shape or gamma == "exponent" else {**shape, "gamma": float(gamma)}


def _explain(law: FrictionLaw) -> str:
    further = [name for name in law.inputs if name != "velocity"]
    if further:
        return f": it reads the {' and the '.join(further)} besides the velocity"
    plain = law.name.removesuffix("+offset")
    if plain != law.name and _get_family(plain) is not None:
        return f"; they have {plain!r}, without an offset"
    return ""


def set_identified_friction(robot: Robot, found: FrictionIdentification) -> Robot:
    """Return the robot with the friction model that the identification gave to all joints, if it did."""
    kinds = found.settings.get("friction")
    asked = set(kinds) if isinstance(kinds, Sequence) else set()
    own = {joint.friction.kind.value for joint in robot.axes}
    if len(asked) != 1 or asked == own or not asked <= {kind.value for kind in FrictionKind}:
        return robot
    return override_robot(robot, (), asked.pop())
