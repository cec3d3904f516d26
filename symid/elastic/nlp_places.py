"""Where stops and knees of the one-shot problem stand best, and how its residuals depend on it.

NlpSetting, NlpCost, x -> slopes of the residuals by the places -> setting and x a step nearer to the optimum.

    [dx; dr] = -H^-1 g,  H = sum J'J / sigma^2,  g = sum J'r / sigma^2,  J by unknowns x and places r

The step of Gauss and Newton is halved until the cost falls; no place moves past its neighbour, and no knee
near zero torque.

Supported: stops that have a weight, knees of springs that are not odd; where the data place them.
Not supported: places that were given: they stay, and count as known.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.nlp_cost import NlpCost
from symid.elastic.nlp_covariance import find_equations
from symid.elastic.nlp_setting import NlpSetting
from symid.elastic.spring_weights import LEAST_KNEE

__all__ = ["NlpPlace", "find_place_slopes", "list_places", "move_places"]

REST = 1e-9
"""Of the linear spring: weights below it are zero."""
_SHIFT = 1e-4
"""Of the place of a stop or knee, for derivatives by it."""
_STEP = 0.4
"""Of the gap to its neighbour that a place may move at once."""
_FRACTIONS = (1.0, 0.5, 0.25, 0.125)


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpPlace:
    """A stop, or a knee, of a joint: the index of its threshold among those of the joint."""

    joint: int
    knee: bool
    index: int


def list_places(setting: NlpSetting, cost: NlpCost, x: FloatArray) -> tuple[NlpPlace, ...]:
    """Return the stops and knees that the data place."""
    places = []
    for joint, spring in enumerate(cost.layout.springs):
        if setting.stops_move:
            least = REST * setting.stiffness[joint]
            busy = np.flatnonzero(x[spring.weights][1:] > least)
            places += [NlpPlace(joint=joint, knee=False, index=int(stop)) for stop in busy]
        if setting.knees_move:
            numbers = range(len(spring.knees))
            places += [NlpPlace(joint=joint, knee=True, index=number) for number in numbers]
    return tuple(places)


def find_place_slopes(
    setting: NlpSetting, cost: NlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals (M_b,) of every block by each place."""
    before = cost.find_state(x).residuals
    slopes = []
    for place in places:
        at = _find_position(setting, place)
        step = _SHIFT * abs(at)
        shifted = _shift(setting, [place], np.array([step]))
        moved = _rebuild(cost, shifted).find_state(x).residuals
        slopes.append([(after - now) / step for after, now in zip(moved, before, strict=True)])
    return slopes


def move_places(setting: NlpSetting, cost: NlpCost, x: FloatArray) -> tuple[NlpSetting, FloatArray]:
    """Return setting and unknowns a step nearer to the optimum of unknowns and places together.

    Args:
        setting: where stops and knees stand.
        cost: of that setting.
        x: (x,) its optimum with these places.
    """
    places = list_places(setting, cost, x)
    if not places:
        return setting, x
    equations = find_equations(cost, x, find_place_slopes(setting, cost, x, places))
    step = equations.find_step()
    value = cost.find_value(cost.find_state(x))
    lower, upper = _find_limits(setting, cost, x, places)
    for fraction in _FRACTIONS:
        move = np.clip(fraction * step[len(x) :], lower, upper)
        moved = _shift(setting, places, move)
        trial = _rebuild(cost, moved)
        start = np.clip(x + fraction * step[: len(x)], trial.layout.lower, trial.layout.upper)
        if trial.find_value(trial.find_state(start)) < value:
            return moved, start
    return setting, x


def _find_position(setting: NlpSetting, place: NlpPlace) -> float:
    if place.knee:
        return (setting.knees or ())[place.joint][place.index]
    return float(setting.thresholds[place.joint][place.index])


def _shift(setting: NlpSetting, places: Sequence[NlpPlace], moves: FloatArray) -> NlpSetting:
    """Return the setting with each of the places moved."""
    thresholds = [grid.copy() for grid in setting.thresholds]
    knees = [list(entries) for entries in setting.knees or ()]
    for place, move in zip(places, moves, strict=True):
        if place.knee:
            knees[place.joint][place.index] += float(move)
        else:
            thresholds[place.joint][place.index] += move
    return setting.move(thresholds, None if setting.knees is None else tuple(map(tuple, knees)))


def _rebuild(cost: NlpCost, setting: NlpSetting) -> NlpCost:
    return replace(cost, recordings=setting.recordings, layout=setting.lay_out(()))


def _find_limits(
    setting: NlpSetting, cost: NlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> tuple[FloatArray, FloatArray]:
    """Return how far each place may move down and up."""
    limits: dict[NlpPlace, tuple[float, float]] = {}
    for joint, spring in enumerate(cost.layout.springs):
        bases = [part.bases[joint] for part in setting.recordings]
        reach = max(float(np.abs(basis[:, 0]).max()) for basis in bases)
        torque = np.concatenate([basis @ x[spring.weights] for basis in bases])
        stops = [float(value) for value in setting.thresholds[joint]]
        for index, (down, up) in enumerate(_list_room(stops, 0.0, reach)):
            limits[NlpPlace(joint=joint, knee=False, index=index)] = (down, up)
        for side in (-1.0, 1.0):
            order = [index for index, knee in enumerate(spring.knees) if knee * side > 0.0]
            if side < 0.0:
                order.reverse()
            edge = max(0.0, float(np.max(side * torque)))
            room = _list_room([abs(spring.knees[index]) for index in order], LEAST_KNEE * edge, edge)
            for index, (down, up) in zip(order, room, strict=True):
                ends = (down, up) if side > 0.0 else (-up, -down)
                limits[NlpPlace(joint=joint, knee=True, index=index)] = ends
    found = np.array([limits[place] for place in places])
    return found[:, 0], found[:, 1]


def _list_room(places: Sequence[float], least: float, edge: float) -> Iterator[tuple[float, float]]:
    """Yield how far each of the increasing places may move down and up between `least` and `edge`."""
    ends = [min([least, *places[:1]]), *places, max([edge, *places[-1:]])]
    for before, place, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True):
        yield -_STEP * (place - before), _STEP * (after - place)
