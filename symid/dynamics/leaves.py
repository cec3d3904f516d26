"""Last links in axes that do not turn with them.

Input: a recursion, parameters. Output: both for the same robot, where a link that carries no other is
described in the axes its frame has at q = 0, and its parameters turn instead.

Such a link has the angular velocity of its parent but for its own joint's rate: products of velocities
are shared, and neither velocities, accelerations, forces nor moments are turned on their way. In a
planar arm, whose acceleration tensors do not change with the axes, this saves most.

Supported: trees; links of revolute joints are changed, others stay.
"""

from dataclasses import replace

from symid.algebra.scalar import Algebra, T
from symid.dynamics.composite import Parameters, gather_body, turn_tensor
from symid.dynamics.kinematics import Recursion, find_motions

__all__ = ["hold_leaves"]


def _turn_parameters(
    algebra: Algebra[T], turn: tuple[T, T], parameters: Parameters[T], link: int
) -> dict[tuple[int, str], T]:
    """Return the parameters of a link in axes turned back by its joint's angle."""
    tensor, (x, y, _), _ = gather_body(algebra, parameters, link)
    (xx, xy, xz), (_, yy, yz), _ = turn_tensor(algebra, turn, tensor)
    c, s = turn
    plus, minus, mul = algebra.add, algebra.sub, algebra.mul
    values = {"XX": xx, "XY": xy, "XZ": xz, "YY": yy, "YZ": yz}
    values |= {"MX": minus(mul(c, x), mul(s, y)), "MY": plus(mul(s, x), mul(c, y))}
    return {(link, name): value for name, value in values.items()}


def hold_leaves(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[Recursion[T], Parameters[T]]:
    """Return the recursion and the parameters with the axes of last links held; links on the base stay."""
    robot, algebra = recursion.robot, recursion.algebra
    parents = {joint.parent for joint in robot.joints}
    frames, turned = list(recursion.frames), dict(parameters)
    for link, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        if link not in parents and joint.parent >= 0 and frame.turn is not None:
            frames[link] = replace(frame, turn=None)
            turned |= _turn_parameters(algebra, frame.turn, parameters, link)
    held = tuple(frames)
    motions = find_motions(robot, algebra, held, recursion.state.velocity)
    return replace(recursion, frames=held, motions=motions), turned
