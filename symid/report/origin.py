"""What a report was made from, in short texts: the same input gives the same texts."""

from collections.abc import Sequence

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.robot.description import Robot

__all__ = ["describe_origin"]


def describe_origin(robot: Robot, library: Library, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return in short texts what a report was made from; the same input gives the same texts."""
    texts = [f"robot {robot.name} of {robot.path}"]
    if robot.source:
        texts.append(f"its source: {robot.source}")
    texts.append(f"functions run as {library.backend}")
    texts += [
        f"{entry.source}: {entry.time[-1] - entry.time[0]:.6g} s at {1.0 / entry.period:.6g} Hz"
        for entry in recordings
    ]
    return tuple(texts)
