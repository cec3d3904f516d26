"""What URDF and MJCF files share: numbers, names, comments, and what both have no words for.

Input: a robot, or a part of it. Output: texts of XML; the plain part of a friction model; sentences for
comments and warnings.

Supported: every robot. Both formats know damping and dry friction that are the same in both directions; of
other models that part is found, and the rest is told in words.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.robot.description import Coupling, FrictionKind, FrictionValues, Joint, Robot
from symid.robot.elasticity import Elasticity

__all__ = [
    "PlainFriction",
    "describe_coupling",
    "find_plain_friction",
    "list_elastic_omissions",
    "list_friction_omissions",
    "write_comments",
    "write_decimal",
    "write_decimals",
    "write_quoted",
]

_UNFIT = re.compile(r"[\x00-\x1f\ufffe\uffff]")
# Parameters that make up the plain part, one name or one for each direction.
_DAMPING, _DRY = ("Fv", "Fvp", "Fvn"), ("Fc", "Fcp", "Fcn")
_PLAIN = frozenset({FrictionKind.NONE, FrictionKind.VISCOUS_COULOMB})


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainFriction:
    """Friction damping dq + dry sign(dq): N m s/rad and N m, or N s/m and N."""

    damping: float
    dry: float


def write_quoted(name: str) -> str:
    """Return a name as the value of an attribute, in quotes."""
    return quoteattr(_UNFIT.sub(" ", name))


def write_comments(texts: Sequence[str]) -> list[str]:
    """Return comments, one a text."""
    return [f"  <!-- {escape(_UNFIT.sub(' ', text)).replace('--', '- -')} -->" for text in texts]


def write_decimal(value: float) -> str:
    """Return a number with all digits of a double."""
    return repr(float(value) + 0.0)


def write_decimals(values: Sequence[float]) -> str:
    """Return numbers with blanks between them."""
    return " ".join(write_decimal(value) for value in values)


def find_plain_friction(friction: FrictionValues) -> PlainFriction | None:
    """Return the part of a friction model that is damping and dry friction; None where nothing is known.

    Of a model that tells directions apart it is their mean.
    """
    if friction.kind is FrictionKind.NONE or friction.values is None:
        return None
    named = dict(zip(FRICTION_PARAMETERS[friction.kind], friction.values, strict=True))
    damping, dry = ([named[name] for name in names if name in named] or [0.0] for names in (_DAMPING, _DRY))
    return PlainFriction(damping=sum(damping) / len(damping), dry=sum(dry) / len(dry))


def list_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    """Yield what of a friction model is more than damping and dry friction, with all its values."""
    if friction.kind is not FrictionKind.NONE and friction.values is None:
        yield f"{owner}: friction of unknown size ({friction.kind.value})"
    elif friction.kind not in _PLAIN:
        names = [", ".join(FRICTION_PARAMETERS[friction.kind])]
        text = (
            f"{owner}: friction model {friction.kind.value}, values {write_decimals(friction.values or ())}"
        )
        if friction.shape:
            text += f", shape {write_decimals(friction.shape)}"
            names.append(", ".join(key.name for key in FRICTION_SHAPES[friction.kind]))
        text += f" ({'; '.join(names)})"
        yield f"{text}; only its damping and dry friction, alike in both directions, are written"
    if friction.smoothing:
        yield f"{owner}: dry friction changes its sign over {friction.smoothing}"


def list_elastic_omissions(joint: Joint) -> Iterator[str]:
    """Yield the spring between motor and link of an elastic joint."""
    if joint.elasticity is not None:
        yield f"joint {joint.name}: elastic, {_describe(joint.elasticity)}; it is written as rigid"


def _describe(elasticity: Elasticity) -> str:
    parts = [str(elasticity.stiffness)]
    parts += [f"damping {elasticity.damping}"] if elasticity.damping else []
    parts += [f"cubic {elasticity.cubic}"] if elasticity.cubic else []
    parts += [f"stop of {stop.stiffness} to {stop.threshold}" for stop in elasticity.stops]
    parts += [f"knee of {knee.slope} at {knee.threshold}" for knee in elasticity.knees]
    return ", ".join(parts)


def describe_coupling(robot: Robot, coupling: Coupling) -> str:
    """Return which joints a drive turns with, and what it holds."""
    names = ", ".join(f"{float(factor):g} {robot.joints[index].name}" for index, factor in coupling.terms)
    text = f"a drive coupled to several joints, {coupling.name}: {names}"
    if coupling.rotor_inertia is not None:
        text += f", rotor inertia {coupling.rotor_inertia}"
    if coupling.friction.values:
        values = write_decimals(coupling.friction.values)
        text += f", friction {values} ({', '.join(FRICTION_PARAMETERS[coupling.friction.kind])})"
    return text
