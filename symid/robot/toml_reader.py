"""A robot from its TOML file.

A path or a text -> `Robot`, or one `RobotError` with all that is wrong, each with its place. `build_robot`
takes the values of a file from any source; a table of Denavit-Hartenberg rows gives them too.

Supported: TOML 1.0 in UTF-8, lines ending as on any system; the keys of the commented file in the
documentation.
Not supported: files that include others; guesses. A convention, a joint's kind, gravity and units must be
written.
"""

import re
import tomllib
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from symid.errors import Notice, RobotError
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Robot
from symid.robot.exact_values import Symbols, read_linear_form
from symid.robot.geometry import ZERO, Exact
from symid.robot.toml_friction import FRICTION_PARAMETERS
from symid.robot.toml_joints import read_joints
from symid.robot.toml_settings import read_controller, read_log, read_processing
from symid.robot.toml_values import (
    InputReport,
    Section,
    has_list,
    locate_values,
    read_choice,
    read_number,
    read_table,
    read_text,
    read_text_file,
    refuse_unknown_keys,
)

CONVENTIONS = ("modified", "standard", "origin")
_ROBOT_KEYS = (
    "name",
    "description",
    "source",
    "convention",
    "gravity",
    "symbols",
    "joint",
    "coupling",
    "log",
    "processing",
    "controller",
)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Letters of coordinates, functions and parameters would read as something else in a formula.
_LETTERS = (
    *INERTIAL,
    *("IA", "KS", "KR"),
    *dict.fromkeys(name for names in FRICTION_PARAMETERS.values() for name in names),
)
_RESERVED = re.compile(rf"(?:pi|tau|theta|sqrt|atan|[sc]\d+|d{{0,2}}q\d*|(?:{'|'.join(_LETTERS)})R?\d+)")


def build_robot(root: Section, file: str) -> Robot:
    """Return the robot that the values of a whole file describe.

    Args:
        root: the values, with the report that gathers what is wrong.
        file: the path or name of the file.

    Raises:
        RobotError: with a notice for each mistake, in the order of their places.
    """
    refuse_unknown_keys(root, _ROBOT_KEYS)
    convention = _read_convention(root)
    symbols = _read_symbols(root)
    joints, couplings = read_joints(root, convention, symbols)
    _refuse_parameters(root, symbols, couplings)
    gravity = _read_gravity(root, symbols)
    log = read_log(root, joints)
    name = _read_name(root, Path(file).stem)
    texts = {key: read_text(root, key) or "" for key in ("description", "source")}
    processing = read_processing(root)
    controller = read_controller(root, joints)
    if root.report.errors:
        raise RobotError(*root.report.notices())
    _warn_of_unused_symbols(root, symbols)
    return Robot(
        name=name,
        description=texts["description"],
        source=texts["source"],
        convention=convention,
        gravity=gravity,
        symbols=tuple(sorted(symbols.values.items())),
        joints=joints,
        couplings=couplings,
        log=log,
        processing=processing,
        controller=controller,
        path=file,
        notices=root.report.remarks(),
    )


def _read_name(root: Section, stem: str) -> str:
    name = read_text(root, "name")
    if name is not None and not _NAME.fullmatch(name):
        text = (
            f"{root.show('name')} cannot name generated functions; use letters, digits and _, a letter first"
        )
        root.refuse("robot.bad-name", "name", text)
    return name or re.sub(r"\W|^(?=\d)", "_", stem)


def _read_convention(root: Section) -> str:
    if "convention" not in root.values:
        text = (
            'missing, and never guessed; write convention = "modified" (alpha and a belong to the link '
            'before: Craig, Khalil), convention = "standard" (to the joint\'s own link: classic DH) or '
            'convention = "origin" (frames as in URDF)'
        )
        root.refuse_key("robot.missing-key", "convention", text)
    return read_choice(root, "convention", CONVENTIONS) or "modified"


def _read_gravity(root: Section, symbols: Symbols) -> tuple[Exact, Exact, Exact]:
    value = root.values.get("gravity")
    if value is None:
        text = "missing; write gravity = [0, 0, -9.81], the vector in the base frame in m/s^2"
        root.refuse_key("robot.missing-key", "gravity", text)
        return (ZERO, ZERO, ZERO)
    if not has_list(root, "gravity", 3, "numbers in m/s^2"):
        return (ZERO, ZERO, ZERO)
    x, y, z = (read_linear_form(root, "gravity", symbols, "m/s^2", index) or ZERO for index in range(3))
    return (x, y, z)


def _read_symbols(root: Section) -> Symbols:
    table = read_table(root, "symbols")
    if table is None:
        return Symbols({})
    values: dict[str, float] = {}
    for name in table.values:
        if not _NAME.fullmatch(name) or _RESERVED.fullmatch(name):
            text = (
                "cannot name a symbol; use letters, digits and _, and no letter of a coordinate or parameter"
            )
            table.refuse_key("robot.bad-name", name, text)
        values[name] = float(read_number(table, name, "") or 0)
    return Symbols(values)


def _refuse_parameters(root: Section, symbols: Symbols, couplings: Sequence[Coupling]) -> None:
    """Refuse symbols that read as the parameters of coupled drives."""
    taken = {f"{letter}{coupling.name}": coupling.name for coupling in couplings for letter in _LETTERS}
    section = root.inside(symbols.values, "symbols", "symbols")
    for name in symbols.values:
        if name in taken and not _RESERVED.fullmatch(name):
            text = f"cannot name a symbol: it reads as a parameter of the coupling {taken[name]}"
            section.refuse_key("robot.bad-name", name, text)


def _warn_of_unused_symbols(root: Section, symbols: Symbols) -> None:
    section = root.inside(symbols.values, "symbols", "symbols")
    for name in symbols.values:
        if name not in symbols.units:
            section.warn("robot.unused-symbol", name, "nothing in the file uses this symbol")


_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_robot(path: Path) -> Robot:
    """Return the robot that the file at `path` describes.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    return parse_robot(read_text_file(path), str(path))


def parse_robot(text: str, file: str = "robot.toml") -> Robot:
    """Return the robot that `text` describes; messages call the text `file`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    text = text.replace("\r\n", "\n")
    try:
        values = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise RobotError(_explain_syntax(str(error), text, file)) from error
    report = InputReport(locate_values(text, file))
    return build_robot(Section(values=values, path=(), report=report), file)


def _explain_syntax(message: str, text: str, file: str) -> Notice:
    match = _PLACE.search(message)
    if match and match[1]:
        line, column = int(match[1]), int(match[2])
    else:
        line, column = text.count("\n") + 1, len(text) - (text.rfind("\n") + 1) + 1
    reason = _PLACE.sub("", message)
    words = f"not valid TOML: {reason[:1].lower()}{reason[1:]}"
    bare = (
        re.match(r"[A-Za-z]\w*", text.split("\n")[line - 1][column - 1 :])
        if "Invalid value" in reason
        else None
    )
    if bare:
        words += f'; a text or the name of a length stands in quotes: "{bare[0]}"'
    return Notice(code="robot.syntax", text=words, file=file, line=line, column=column)
