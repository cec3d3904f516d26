"""What a series tells, for the record: on a fine grid, and with friction as the robot file has it.

Input: a robot, a problem. Output: `Judge`: condition number and information of any series of the problem.

The search looks at a coarse grid and at friction with a slope; its figures compare series, these are stated.
"""

from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.excitation.criteria import find_condition, find_information
from symid.excitation.fourier import find_grid
from symid.excitation.observation import Observation, build_columns
from symid.excitation.problem import ExcitationProblem
from symid.robot.description import Robot

__all__ = ["Judge"]

_SAMPLES = 400
"""Per harmonic."""


@final
class Judge:
    """The fine observation matrix of the series of a problem."""

    __slots__ = ("_basis", "_observation", "_space")

    def __init__(self, robot: Robot, problem: ExcitationProblem) -> None:
        """Build the columns of the robot."""
        self._space = problem.space
        samples = _SAMPLES * problem.space.harmonics
        self._basis = find_grid(problem.space, samples, 3)
        self._observation = Observation(build_columns(robot), samples, problem.observation.weights)

    def find_figures(self, unknowns: FloatArray) -> tuple[float, float]:
        """Return condition number and mean logarithm of information at unknowns (n r,)."""
        states = self._space.find_states(np.reshape(unknowns, self._space.shape), self._basis)
        matrix = self._observation.find_matrix(states)
        gram: FloatArray = matrix.T @ matrix / self._observation.samples
        return find_condition(gram), find_information(gram)
