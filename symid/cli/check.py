"""`symid check ROBOT [LOG...]`: is the robot file right, and do the logs fit it."""

from pathlib import Path

import click

from symid.cli.inputs import load_robot, read_logs
from symid.cli.options import cut_options, friction_option, set_option, split_settings, verb
from symid.cli.output import Answer, Console, format_table

__all__ = ["command"]

_CONVENTIONS = {"urdf": "URDF", "origin": "frames by origin"}


@click.command("check")
@click.argument("robot")
@click.argument("logs", nargs=-1, metavar="[LOG]...", type=click.Path(path_type=Path))
@friction_option
@cut_options
@set_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    logs: tuple[Path, ...],
    friction: str | None,
    base_link: str | None,
    tip_link: str | None,
    snap: float | None,
    settings: tuple[str, ...],
) -> Answer:
    """Check a robot file, and logs against it.

    All that is wrong is said at once, each with its file, line and column. Exit code 3 when
    something is wrong; what is only odd is a warning.
    """
    described = load_robot(robot, split_settings(settings), friction, base=base_link, tip=tip_link, snap=snap)
    warnings = described.notices
    convention = _CONVENTIONS.get(described.convention, f"{described.convention} DH")
    joints = f"{described.size} joint{'s'[: described.size != 1]}"
    lines = [f"{described.path}: {described.name}, {joints}, {convention}: no mistakes"]
    result: dict[str, object] = {
        "robot": described.name,
        "file": described.path,
        "convention": described.convention,
        "joints": [
            {"name": joint.name, "kind": joint.kind.value, "friction": joint.friction.kind.value}
            for joint in described.joints
        ],
        "logs": [],
    }
    if logs:
        console.progress(f"reading {len(logs)} log{'s'[: len(logs) > 1]}")
        from symid.data.checks import check_recording, find_second_encoder

        recordings = read_logs(logs, described)
        for recording in recordings:
            warnings += (*recording.notices, *check_recording(recording, described))
        entries = [
            {
                "file": recording.source,
                "samples": len(recording.time),
                "duration": float(recording.time[-1] - recording.time[0]),
                "period": recording.period,
                "has_velocity": recording.velocity is not None,
                "second_encoder": find_second_encoder(recording),
            }
            for recording in recordings
        ]
        result["logs"] = entries
        rows = [tuple(entry.values()) for entry in entries]
        header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
        lines.append(format_table(header, rows, left=(0, 5)))
    return Answer(text="\n".join(lines), result=result, warnings=warnings)
