"""How the joints of a URDF hang together, and the part of them that is asked for.

Input: links and joints of the file, the names of a base and a tip link. Output: `UrdfTree`: the joints that
belong to the robot, parents before children, and the links that were cut off.

Supported: one tree; the part of it beyond a base link; the chain up to a tip link.
Not supported: closed loops, several trees.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from symid.formats.section import find_nearest
from symid.formats.urdf_joints import UrdfJoint
from symid.formats.urdf_links import UrdfLink
from symid.formats.urdf_values import Reading, list_words

__all__ = ["UrdfTree", "read_tree"]

_LOOP = "closed loops are not supported; leave one of the joints out, and give its torque as a load"


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfTree:
    """The joints of a robot, parents before children: a joint's children follow it at once.

    `root` is the link at the base, `before` the joints from the file's own root to it, `cut` the links that
    do not belong to the robot.
    """

    root: str
    before: tuple[UrdfJoint, ...]
    joints: tuple[UrdfJoint, ...]
    cut: tuple[str, ...]


def read_tree(
    reading: Reading,
    links: Mapping[str, UrdfLink],
    joints: Sequence[UrdfJoint],
    base: str | None,
    tip: str | None,
) -> UrdfTree | None:
    """Return the tree, or the part of it from `base` to `tip`; None where there is none."""
    # A joint that cannot be read leaves its links apart; that is not worth a second message.
    root_element = reading.document.root
    whole_file = len(joints) == len(list(root_element.find_all("joint")))
    whole_file &= len(links) == len(list(root_element.find_all("link")))
    above = _find_parents(reading, joints)
    root = _find_root(reading, links, joints, above) if whole_file else None
    known = [_check_name(reading, links, name, option) for name, option in ((base, "base"), (tip, "tip"))]
    if root is None or not all(known):
        return None
    below: dict[str, list[UrdfJoint]] = {}
    for joint in above.values():
        below.setdefault(joint.parent, []).append(joint)
    whole = [joint.child for joint in _walk(root, below)]
    if not _check_reach(reading, joints, {root, *whole}):
        return None
    start = base or root
    chosen = list(_walk(start, below))
    if tip is not None:
        path = _find_path(above, start, tip)
        if path is None:
            text = f"the link '{tip}' does not hang on the link '{start}'; the base comes first, then the tip"
            reading.refuse("robot.bad-cut", text, links[tip].element)
            return None
        chosen = _keep_chain(chosen, path, start)
    kept = {start, *(joint.child for joint in chosen)}
    cut = tuple(name for name in links if name not in kept)
    tree = UrdfTree(
        root=start, before=tuple(_find_path(above, root, start) or ()), joints=tuple(chosen), cut=cut
    )
    _check_types(reading, tree)
    _say_cut(reading, links, tree)
    return tree


def _check_name(reading: Reading, links: Mapping[str, UrdfLink], name: str | None, option: str) -> bool:
    if name is None or name in links:
        return True
    hint = find_nearest(name, links) or f"the links are {list_words(links, most=12)}"
    text = f"there is no link '{name}' to be the {option}; {hint}"
    reading.refuse("robot.bad-cut", text, reading.document.root)
    return False


def _find_parents(reading: Reading, joints: Sequence[UrdfJoint]) -> dict[str, UrdfJoint]:
    """Return the joint before each link; a second one closes a loop."""
    above: dict[str, UrdfJoint] = {}
    for joint in joints:
        if joint.child in above:
            other = above[joint.child]
            line = reading.document.find_place(other.element).line
            text = (
                f"joint '{joint.name}': its child link '{joint.child}' is the child of joint '{other.name}' "
                f"(line {line}) already; {_LOOP}"
            )
            reading.refuse("robot.closed-loop", text, joint.element)
            continue
        above[joint.child] = joint
    for element in reading.document.root.find_all("loop_joint"):
        name = element.attributes.get("name", "")
        reading.refuse("robot.closed-loop", f"loop_joint '{name}': {_LOOP}", element)
    return above


def _find_root(
    reading: Reading,
    links: Mapping[str, UrdfLink],
    joints: Sequence[UrdfJoint],
    above: Mapping[str, UrdfJoint],
) -> str | None:
    robot = reading.document.root
    if not joints:
        if not robot.find("joint"):
            prefixed = next((child.tag for child in robot.children if child.tag.endswith(":joint")), "")
            found = f"; <{prefixed}> is another tag: write <joint>" if prefixed else ""
            text = f"no <joint> in the file, and a robot needs one that moves{found}"
            reading.refuse("robot.no-joints", text, robot)
        return None
    roots = [name for name in links if name not in above]
    if not roots:
        text = f"every link is the child of a joint, so no link is the base; {_LOOP}"
        reading.refuse("robot.closed-loop", text, joints[0].element)
        return None
    for name in roots[1:]:
        text = (
            f"link '{name}' is the child of no joint, and neither is '{roots[0]}'; a robot has one base: "
            "join them with a fixed joint, or remove one"
        )
        reading.refuse("robot.several-roots", text, links[name].element)
    return roots[0] if len(roots) == 1 else None


def _walk(start: str, below: Mapping[str, list[UrdfJoint]]) -> Iterator[UrdfJoint]:
    """Return the joints beyond a link, each followed by those beyond it."""
    waiting = list(reversed(below.get(start, [])))
    while waiting:
        joint = waiting.pop()
        yield joint
        waiting += reversed(below.get(joint.child, []))


def _check_reach(reading: Reading, joints: Sequence[UrdfJoint], reached: set[str]) -> bool:
    lost = [joint for joint in joints if joint.child not in reached]
    if lost:
        names = list_words(f"'{joint.name}'" for joint in lost)
        text = f"joint '{lost[0].name}': no way leads here from the base: {names} form a ring; {_LOOP}"
        reading.refuse("robot.closed-loop", text, lost[0].element)
    return not lost


def _find_path(above: Mapping[str, UrdfJoint], start: str, end: str) -> list[UrdfJoint] | None:
    """Return the joints from link `start` to link `end`, None where it does not hang on it."""
    path: list[UrdfJoint] = []
    while end != start:
        if end not in above:
            return None
        path.append(above[end])
        end = above[end].parent
    return path[::-1]


def _keep_chain(joints: Sequence[UrdfJoint], path: Sequence[UrdfJoint], start: str) -> list[UrdfJoint]:
    """Return the joints of the path, and what is fixed to its links before the last one."""
    names = {joint.name for joint in path}
    links = {start, *(joint.child for joint in path)}
    last = path[-1].child if path else start
    kept = []
    for joint in joints:
        if joint.name in names:
            kept.append(joint)
        elif joint.type == "fixed" and joint.parent in links and joint.parent != last:
            kept.append(joint)
            links.add(joint.child)
    return kept


def _check_types(reading: Reading, tree: UrdfTree) -> None:
    for joint in tree.joints:
        if joint.moves or joint.type == "fixed":
            continue
        what = "a floating base" if joint.type == "floating" else f"a {joint.type} joint"
        text = (
            f"joint '{joint.name}': {what} is not supported; make it fixed, or start behind it with "
            f"--base {joint.child}"
        )
        reading.refuse("robot.joint-type", text, joint.element, "type")
    if tree.joints and not any(joint.moves for joint in tree.joints) and not reading.report.errors:
        text = "every joint is fixed, and a robot needs one that moves"
        reading.refuse("robot.no-joints", text, reading.document.root)
    if not tree.joints and not reading.report.errors:
        text = f"no joint stands beyond the link '{tree.root}', and a robot needs one that moves"
        reading.refuse("robot.no-joints", text, reading.document.root)


def _say_cut(reading: Reading, links: Mapping[str, UrdfLink], tree: UrdfTree) -> None:
    if tree.cut:
        mass = sum(links[name].mass for name in tree.cut)
        text = (
            f"outside of what was asked for, and not in the model: the links {list_words(tree.cut, most=12)} "
            f"({mass:.6g} kg in all)"
        )
        reading.warn("robot.cut-off", text, links[tree.cut[0]].element)
