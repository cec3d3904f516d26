"""An exciting trajectory, in paragraphs for people and as an object for programs.

Input: `Excitation` and its robot. Output: blocks, dictionaries, the remarks at the head of its file.
"""

from typing import TYPE_CHECKING

from symid.report.blocks import Block, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.excitation.margins import Margin
    from symid.excitation.optimise import Excitation
    from symid.robot.description import Robot

__all__ = ["describe_excitation", "list_remarks", "show_excitation"]


def list_remarks(robot: "Robot", found: "Excitation", seed: int) -> tuple[str, ...]:
    """Return what stands at the head of a trajectory's file."""
    return (
        f"{robot.name}: {found.trajectory.source}, seed {seed}",
        (
            f"condition number of the scaled regressor {found.condition:.4g}, best of random ones "
            f"{found.random_condition:.4g}"
        ),
        f"of every limit at least {1.0 - max(margin.share or 0.0 for margin in found.margins):.1%} is left",
    )


def describe_excitation(robot: "Robot", found: "Excitation", seed: int) -> dict[str, object]:
    """Return the trajectory as `symid excite --json` gives it."""
    harmonics = (found.coefficients.shape[1] - 1) // 2
    return {
        "robot": robot.name,
        "trajectory": found.trajectory.source,
        "duration": found.trajectory.duration,
        "harmonics": harmonics,
        "seed": seed,
        "condition": found.condition,
        "random_condition": found.random_condition,
        "random_median": found.random_median,
        "factor": found.factor,
        "information": found.information,
        "random_information": found.random_information,
        "parameters": list(found.parameters),
        "joints": [
            {
                "name": joint.name,
                "centre": row[0],
                "sines": row[1 : harmonics + 1],
                "cosines": row[harmonics + 1 :],
            }
            for joint, row in zip(robot.axes, found.coefficients.tolist(), strict=True)
        ],
        "limits": [_describe_margin(margin) for margin in found.margins],
        "runs": [
            {
                "start": run.start,
                "condition": run.condition,
                "iterations": run.iterations,
                "status": run.status,
            }
            for run in found.runs
        ],
    }


def _describe_margin(margin: "Margin") -> dict[str, object]:
    return {
        "kind": margin.kind,
        "name": margin.name,
        "value": margin.value,
        "limit": margin.limit,
        "share_percent": None if margin.share is None else 100.0 * margin.share,
        "allowed_percent": 100.0 * margin.allowed,
    }


def show_excitation(found: "Excitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    shared = [margin for margin in found.margins if margin.share is not None]
    kinds = tuple(dict.fromkeys(margin.kind for margin in shared))
    names = tuple(dict.fromkeys(margin.name for margin in shared))
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in shared}
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = (
        f"{found.trajectory.source}, {found.trajectory.duration:g} s\n"
        f"condition number of the regressor with columns of length one: {found.condition:.4g}\n"
        f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
        f"{found.random_median:.4g}; {found.factor:.2f} times smaller than the best\n"
        f"information per parameter (mean logarithm): {found.information:.4g}, most of the random ones "
        f"{found.random_information:.4g}"
    )
    title = "part of each limit that is used, at most:"
    blocks: tuple[Block, ...] = (head, format_table(("joint", *kinds), rows, title=title))
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    if places:
        blocks += (format_table(("place", "least clearance/m"), places),)
    return blocks
