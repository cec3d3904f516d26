"""What all rounds of the hysteresis-plus-friction problem share: rows, and where stops and knees stand.

ElasticProblem, NlpOptions, start -> NlpSetting -> NlpLayout.

Supported: places of a start, given ones, and grids, whose knees follow the torque that the springs reach.
Not supported: joints without a spring.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.elastic.fit import ElasticFit
from symid.elastic.nlp_layout import NlpLayout, SpringGrid, build_layout
from symid.elastic.nlp_options import NlpOptions
from symid.elastic.nlp_rows import NlpRecording, build_nlp_recording, move_stops
from symid.elastic.nlp_starts import list_weights
from symid.elastic.problem import ElasticProblem
from symid.elastic.spring_weights import hold_knees
from symid.robot.elasticity import Elasticity

__all__ = ["NlpSetting", "prepare_setting"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpSetting:
    """What all rounds share.

    Args:
        problem, options: of the run.
        recordings: their rows, for these thresholds.
        thresholds: (m,) of each joint's stops, rad or m.
        knees: signed torques of each joint, N m or N; None where they lie on a grid over the torque.
        stiffness: (n,) of the linear springs that bound the weights.
    """

    problem: ElasticProblem
    options: NlpOptions
    recordings: tuple[NlpRecording, ...]
    thresholds: tuple[FloatArray, ...]
    knees: tuple[tuple[float, ...], ...] | None
    stiffness: FloatArray

    @property
    def stops_move(self) -> bool:
        """Return whether the data place the stops: not those that are given, or on a grid with the knees."""
        options = self.problem.options
        return options.refine and options.thresholds is None and self.knees is not None

    @property
    def knees_move(self) -> bool:
        """Return whether the data place the knees; those of odd springs stand in pairs, and stay."""
        return self.stops_move and self.problem.options.knee_torques is None and not self.options.odd

    def lay_out(self, springs: Sequence[Elasticity]) -> NlpLayout:
        """Return the unknowns, with knees for what `springs` reach."""
        knees = self.knees if self.knees is not None else _place_knees(self, springs)
        grids = []
        for joint, thresholds in enumerate(self.thresholds):
            grid = SpringGrid(
                thresholds=thresholds,
                knees=knees[joint],
                stiffness=float(self.stiffness[joint]),
                reach=max(float(np.abs(part.bases[joint][:, 0]).max()) for part in self.recordings),
            )
            grids.append(grid)
        return build_layout(self.problem.library.card, grids, self.options)

    def move(
        self, thresholds: Sequence[FloatArray], knees: tuple[tuple[float, ...], ...] | None
    ) -> "NlpSetting":
        """Return the setting with stops and knees elsewhere; rows are made anew where stops moved."""
        moves = [
            {int(place): float(new[place]) for place in np.flatnonzero(new != old)}
            for old, new in zip(self.thresholds, thresholds, strict=True)
        ]
        if not any(moves):
            return replace(self, knees=knees)
        grids = tuple(map(freeze, thresholds))
        if "filtered" in self.options.rows:
            recordings = _build_recordings(self.problem, grids, self.options)
        else:
            recordings = tuple(
                move_stops(recording, self.problem, number, moves)
                for number, recording in enumerate(self.recordings)
            )
        return replace(self, knees=knees, thresholds=grids, recordings=recordings)


def prepare_setting(problem: ElasticProblem, options: NlpOptions, begin: ElasticFit) -> NlpSetting:
    """Return the setting of the first round; stops and knees are those of `begin` where it has some."""
    springs = begin.elasticity
    placed = any(spring.stops or spring.knees for spring in springs)
    thresholds = problem.thresholds
    knees = problem.options.knee_torques
    if placed:
        thresholds = tuple(freeze([stop.threshold for stop in spring.stops]) for spring in springs)
        knees = tuple(tuple(knee.threshold for knee in spring.knees) for spring in springs)
    whole = np.array([spring.initial_stiffness or 0.0 for spring in springs])
    return NlpSetting(
        problem=problem,
        options=options,
        recordings=_build_recordings(problem, thresholds, options),
        thresholds=thresholds,
        knees=knees,
        stiffness=np.maximum(whole, 1e-6 * max(float(whole.max()), 1e-6)),
    )


def _build_recordings(
    problem: ElasticProblem, thresholds: Sequence[FloatArray], options: NlpOptions
) -> tuple[NlpRecording, ...]:
    numbers = range(len(problem.signals))
    return tuple(build_nlp_recording(problem, number, thresholds, options.rows) for number in numbers)


def _place_knees(setting: NlpSetting, springs: Sequence[Elasticity]) -> tuple[tuple[float, ...], ...]:
    """Return knees at (j - 1/2) / l of the greatest torque before the knees, on each side, none near zero."""
    count = setting.problem.options.knees
    places = (np.arange(count) + 0.5) / max(count, 1)
    result = []
    for joint, spring in enumerate(springs):
        weights = list_weights(spring, setting.thresholds[joint])
        torque = np.concatenate([part.bases[joint] @ weights for part in setting.recordings])
        low, high = max(0.0, -float(torque.min())), max(0.0, float(torque.max()))
        if setting.options.odd:
            low = high = max(low, high)
        below = hold_knees(-places * low if low else np.zeros(0), low)
        above = hold_knees(places * high if high else np.zeros(0), high)
        result.append(tuple(float(knee) for knee in (*below[::-1], *above)))
    return tuple(result)
