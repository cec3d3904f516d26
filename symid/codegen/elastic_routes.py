"""Routes to the functions of elastic joints: springs forwards and backwards, torque of the motors.

Input: a workspace. Output: elements of the output ports.

The torque of the motors follows from the motion of the links (Spong 1987), with the spring turned round:

    tau_J = inverse dynamics,  phi = H^-1[tau_J],  theta = q + phi,  tau_m = IA ddtheta + F(dtheta) + tau_J

Rates of phi are c times those of tau_J, c the slope of phi against tau_J in the direction in which it goes;
it is constant between kinks. Rates of tau_J come from differentiating the recursion twice along the motion.

Supported: stops, knees; friction of the motors.
Not supported: damping, cubic springs, coupled drives; the catalogue has no such function for these robots.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from symid.codegen.differentiation import find_rates
from symid.codegen.instructions import Op
from symid.codegen.outputs import lay_coordinates
from symid.codegen.plain_routes import build_friction
from symid.codegen.springs import build_spring_terms
from symid.codegen.value_algebra import ValueAlgebra
from symid.codegen.workspace import Build, Elements, Workspace
from symid.joint.hysteresis import SpringTerms, find_inverse_step, find_outer, find_step, invert_spring
from symid.robot.elasticity import Elasticity

__all__ = ["build_feed_forward", "build_hysteresis_inverse_step", "build_hysteresis_step"]


def _list_springs(workspace: Workspace) -> list[SpringTerms[int]]:
    """Return the springs of all coordinates."""
    found: list[Elasticity] = [joint.elasticity for joint in workspace.robot.axes if joint.elasticity]
    return build_spring_terms(found, workspace.inputs["h"])


def _split(springs: Sequence[SpringTerms[int]], plays: Sequence[int]) -> list[Sequence[int]]:
    """Return the plays of each coordinate."""
    starts = [0]
    for spring in springs:
        starts.append(starts[-1] + len(spring.stops))
    return [plays[start:end] for start, end in itertools.pairwise(starts)]


def _lay(workspace: Workspace, *ports: Sequence[int], plays: Sequence[Sequence[int]]) -> tuple[Elements, ...]:
    """Return values per coordinate and, where there are stops, the plays after the step."""
    after = tuple(play for own in plays for play in own)
    vectors = tuple(lay_coordinates(workspace, port) for port in ports)
    return (*vectors, after) if after else vectors


def build_hysteresis_step(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torques after a step of the torsions, and the plays."""
    springs = _list_springs(workspace)
    memories = _split(springs, workspace.inputs.get("P", ()))
    parts = zip(springs, workspace.inputs["phi"], memories, strict=True)
    steps = [find_step(workspace.algebra, spring, phi, memory) for spring, phi, memory in parts]
    return _lay(workspace, [torque for torque, _ in steps], plays=[after for _, after in steps])


def build_hysteresis_inverse_step(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torsions after a step of the torques, and the plays of the inverse."""
    springs, algebra = _list_springs(workspace), workspace.algebra
    memories = _split(springs, workspace.inputs.get("Q", ()))
    parts = zip(springs, workspace.inputs["tau_J"], memories, strict=True)
    steps = [
        find_inverse_step(algebra, invert_spring(algebra, spring), torque, memory)
        for spring, torque, memory in parts
    ]
    return _lay(workspace, [torsion for torsion, _ in steps], plays=[after for _, after in steps])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Torsion:
    """A torsion with its rates, and the plays of the inverse after the step."""

    value: int
    rate: int
    second: int
    plays: tuple[int, ...]


def _twist(
    algebra: ValueAlgebra, spring: SpringTerms[int], torques: tuple[int, int, int], memory: Sequence[int]
) -> _Torsion:
    """Return the torsion of a spring whose torque and its two rates are known."""
    table, zero = algebra.table, algebra.zero
    torque, rate, second = torques
    inverse = invert_spring(algebra, spring)
    plays, above, below = inverse
    value, after = find_inverse_step(algebra, inverse, torque, memory)
    before, outer = find_outer(algebra, torque, above, below), algebra.one
    beyond = [(slope, table.apply(Op.LESS, threshold, torque)) for threshold, slope in above]
    beyond += [(slope, table.apply(Op.LESS, torque, threshold)) for threshold, slope in below]
    for slope, active in beyond:
        outer = algebra.add(outer, algebra.mul(slope, active))
    total = plays.weights[0]
    rising, falling = table.apply(Op.LESS, zero, rate), table.apply(Op.LESS, rate, zero)
    for weight, threshold, play in zip(plays.weights[1:], plays.thresholds, memory, strict=True):
        # A play at its edge moves with the torque only while that goes on beyond the edge.
        up = table.apply(Op.LESS_EQUAL, play, algebra.sub(before, threshold))
        down = table.apply(Op.LESS_EQUAL, algebra.add(before, threshold), play)
        moves = algebra.add(algebra.mul(up, rising), algebra.mul(down, falling))
        total = algebra.add(total, algebra.mul(weight, moves))
    compliance = algebra.mul(total, outer)
    return _Torsion(
        value=value, rate=algebra.mul(compliance, rate), second=algebra.mul(compliance, second), plays=after
    )


def _find_torque_rates(workspace: Workspace, torques: Build) -> list[tuple[int, int, int]]:
    """Return the joint torques and their first two derivatives by time."""
    inputs, table = workspace.inputs, workspace.table
    names = ("q", "dq", "ddq", "dddq", "ddddq")
    seeds: dict[int, int] = {}
    for name, rate in itertools.pairwise(names):
        seeds |= dict(zip(inputs[name], inputs[rate], strict=True))
    (values,) = workspace.recall(torques)
    rates = find_rates(table, values, seeds)
    return list(zip(values, rates, find_rates(table, rates, seeds), strict=True))


def build_feed_forward(torques: Build) -> Build:
    """Return the route to the torques of the motors that takes those of the links from another route."""

    def build(workspace: Workspace) -> tuple[Elements, ...]:
        algebra, inputs = workspace.algebra, workspace.inputs
        springs = _list_springs(workspace)
        rates = _find_torque_rates(workspace, torques)
        parts = zip(springs, rates, _split(springs, inputs.get("Q", ())), strict=True)
        torsions = [_twist(algebra, spring, torque, memory) for spring, torque, memory in parts]
        theta = [algebra.add(q, torsion.value) for q, torsion in zip(inputs["q"], torsions, strict=True)]
        dtheta = [algebra.add(dq, torsion.rate) for dq, torsion in zip(inputs["dq"], torsions, strict=True)]
        moved = replace(workspace, inputs={**inputs, "dq": tuple(dtheta)}, built={})
        (friction,) = build_friction(moved)
        motors = []
        for k, torsion in enumerate(torsions):
            acceleration = algebra.add(inputs["ddq"][k], torsion.second)
            inertial = algebra.mul(inputs["IA"][k], acceleration)
            motors.append(algebra.add(algebra.add(inertial, friction[k]), rates[k][0]))
        return _lay(workspace, motors, theta, dtheta, plays=[torsion.plays for torsion in torsions])

    return build
