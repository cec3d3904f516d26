"""What the generated code must reach: times of others divided by its own.

Input: medians by column and function. Output: lines of a table, with pass or fail.

A ratio is the best build of one over the best build of the other, both compiled with the same flags. Ours as
portable C99 is the generated code without vector types, with the C library's sines or its own, whichever is
faster. Where Pinocchio gives a regressor of all parameters, ours gives the base one; kinetic and potential
energy regressors are two functions there and one here, so each is compared with the whole of ours.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["GATES", "Gate", "Verdict", "find_best", "judge"]

Times = Mapping[tuple[str, str], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """A ratio to reach: `above` and `below` the line are columns' first words; `aim` is more than needed."""

    robot: str
    function: str
    least: float | None
    aim: float | None = None
    above: str = "Pinocchio"
    below: str = "C99"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A gate and the ratio found, None where one of the two did not run."""

    gate: Gate
    ratio: float | None

    @property
    def word(self) -> str:
        """Return pass or fail, n/a without a ratio, and for what is only an aim reached or not."""
        if self.ratio is None:
            return "n/a"
        if self.gate.least is None:
            return "reached" if self.ratio >= (self.gate.aim or 0.0) else "not reached"
        return "pass" if self.ratio >= self.gate.least else "FAIL"


# What a gate calls one name may be several columns.
_GROUPS = {"C99": ("scalar", "libm")}
GATES = (
    Gate(robot="panda", function="inverse_dynamics", least=3.2, aim=4.0),
    Gate(robot="ur5", function="inverse_dynamics", least=3.8),
    Gate(robot="solo12", function="inverse_dynamics", least=3.5),
    Gate(robot="panda", function="gravity", least=3.9),
    Gate(robot="panda", function="mass_matrix", least=2.0, aim=2.6),
    Gate(robot="panda", function="coriolis_matrix", least=2.2, aim=3.0),
    Gate(robot="panda", function="forward_dynamics", least=3.2, aim=4.0),
    Gate(robot="panda", function="kinetic_energy_regressor", least=2.3),
    Gate(robot="panda", function="potential_energy_regressor", least=2.8),
    Gate(robot="panda", function="torque_regressor", least=4.5, aim=5.5),
    Gate(robot="panda", function="inverse_dynamics", least=4.6, aim=5.5, below="ours"),
    Gate(robot="panda", function="mass_matrix", least=2.3, below="ours"),
    Gate(robot="panda", function="inverse_dynamics", least=10.0, below="batch"),
    Gate(robot="panda", function="torque_regressor", least=18.0, below="batch"),
    Gate(robot="panda", function="inverse_dynamics", least=None, aim=1.15, above="SX", below="ours"),
    Gate(robot="panda", function="mass_matrix", least=None, aim=1.15, above="SX", below="ours"),
    Gate(robot="panda", function="forward_dynamics", least=None, aim=1.15, above="SX", below="ours"),
    Gate(robot="panda", function="torque_regressor", least=None, aim=1.15, above="SX", below="ours"),
)


def find_best(times: Times, family: str, function: str) -> float | None:
    """Return the least time in the columns of a family."""
    families = _GROUPS.get(family, (family,))
    found = [
        value for (label, name), value in times.items() if name == function and label.split()[0] in families
    ]
    return min(found, default=None)


def judge(robot: str, times: Times) -> Sequence[Verdict]:
    """Return how the gates of a robot went."""
    result = []
    for gate in GATES:
        if gate.robot == robot:
            above, below = (find_best(times, family, gate.function) for family in (gate.above, gate.below))
            ratio = above / below if above is not None and below is not None else None
            result.append(Verdict(gate=gate, ratio=ratio))
    return result
