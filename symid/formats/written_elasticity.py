"""What gives between motor and link, as the `elasticity` table of a robot file.

Input: an elasticity. Output: lines. Catalogue values come out as the stiffness and knees that they stand for.
"""

from collections.abc import Iterator

from symid.formats.written_values import add_comment, write_known, write_number
from symid.robot.elasticity import Elasticity, Knee

__all__ = ["write_elasticity"]


def write_elasticity(elasticity: Elasticity, *, prismatic: bool) -> Iterator[str]:
    """Yield the lines of the table."""
    length, torque = ("m", "N") if prismatic else ("rad", "N m")
    yield from ("", "[joint.elasticity]")
    yield add_comment(f"stiffness = {write_known(elasticity.stiffness)}", f"{torque}/{length}")
    if elasticity.damping:
        yield add_comment(f"damping = {write_number(elasticity.damping)}", f"{torque} s/{length}")
    if elasticity.cubic:
        yield add_comment(f"cubic = {write_number(elasticity.cubic)}", f"{torque}/{length}^3")
    if elasticity.stops:
        yield add_comment("stops = [", f"threshold in {length}, stiffness in {torque}/{length}")
        for stop in elasticity.stops:
            threshold = write_number(stop.threshold)
            yield f"  {{ threshold = {threshold}, stiffness = {write_known(stop.stiffness)} }},"
        yield "]"
    if elasticity.knees:
        yield from _write_knees(elasticity.knees, torque)


def _write_knees(knees: tuple[Knee, ...], torque: str) -> Iterator[str]:
    mirrored = tuple(Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(knees))
    if mirrored == knees:
        yield add_comment("symmetric = true", "each knee stands for one below zero too")
        knees = tuple(knee for knee in knees if knee.threshold > 0)
    yield add_comment("knees = [", f"threshold in {torque}, slope added to one")
    for knee in knees:
        yield f"  {{ threshold = {write_number(knee.threshold)}, slope = {write_number(knee.slope)} }},"
    yield "]"
