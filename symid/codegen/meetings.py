"""Where wrenches on their way down meet joint screws on their way up.

Input: a robot. Output: meetings for the dynamics, which cost different numbers of operations.

Supported: trees.
"""

from symid.dynamics.wrenches import Meeting
from symid.robot.description import Robot

__all__ = ["meet_at_depth", "meet_before_leaves", "meet_in_link"]


def _find_path(robot: Robot, link: int) -> list[int]:
    """Return the links from the base to `link`."""
    path = []
    while link >= 0:
        path.append(link)
        link = robot.joints[link].parent
    return path[::-1]


def meet_in_link(_robot: Robot) -> Meeting:
    """Return the meeting in every link's own frame."""
    return lambda link: link


def meet_before_leaves(robot: Robot) -> Meeting:
    """Return the meeting in a link's own frame, for a link that carries no other in its parent's.

    The screws of many joints come up to a last frame for the sake of one link only.
    """
    parents = {joint.parent for joint in robot.joints}
    places = [
        link if link in parents or joint.parent < 0 else joint.parent
        for link, joint in enumerate(robot.joints)
    ]
    return places.__getitem__


def meet_at_depth(robot: Robot, depth: int) -> Meeting:
    """Return the meeting in the frame that is `depth` joints above the base link, or the link's own."""
    paths = [_find_path(robot, link) for link in range(robot.size)]
    places = [path[min(depth, len(path) - 1)] for path in paths]
    return places.__getitem__
