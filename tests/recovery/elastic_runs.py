"""Short experiments with the elastic arm that recovery tests share."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import symid
from symid.api.fit import build_dynamics_fit
from symid.codegen.cache import prepare_library
from symid.excitation.trajectories import build_ta, scale_trajectory
from symid.identification import prepare_elastic_methods
from symid.identification.elastic.identify import prepare_methods
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import build_elastic_problem, prepare_elastic_signals
from symid.robot.toml_reader import read_robot
from symid.simulation.experiment import build_clean_options, build_noisy_options, simulate_elastic

STOPS = ((0.002, 0.005, 0.010), (0.003, 0.008, 0.016))
KNEES = ((-3.0, 3.0), (-1.2, 1.2))
PLACED = ElasticOptions(thresholds=STOPS, knee_torques=KNEES, tolerance=1e-6)


def prepare_arm(robots_folder, *, knees=True, springs=None):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    found = [joint.elasticity for joint in robot.joints] if springs is None else springs
    found = [spring if knees else replace(spring, knees=()) for spring in found]
    joints = [replace(joint, elasticity=spring) for joint, spring in zip(robot.joints, found, strict=True)]
    robot = replace(robot, joints=tuple(joints))
    return robot, prepare_library(robot)


def run_arm(robot, library, motion=None, *, scale=10.0, duration=8.0, noisy=False, seed=0, **changes):
    """Return a run along the trajectory Ta, faster by a scale, or another motion."""
    options = replace(build_noisy_options() if noisy else build_clean_options(), duration=duration, **changes)
    motion = motion or scale_trajectory(build_ta(), scale)
    return simulate_elastic(robot, library, motion, options, np.random.default_rng(seed))


def find_truth(library):
    card = library.card
    return np.array([entry.value for entry in (*card.beta, *card.rotors, *card.friction)])


def find_error(chi, truth):
    known = np.abs(truth) > 1e-9
    return float(np.max(np.abs(chi - truth)[known] / np.abs(truth)[known]))


def build(library, recordings, options):
    return build_elastic_problem(
        library, [prepare_elastic_signals(part, options) for part in recordings], options
    )


_prepared = {}


def prepare_once(key, prepare):
    """Return what identifies by a method; the last logs keep their equations and fits."""
    if key not in _prepared:
        _prepared[key] = prepare()
        while len(_prepared) > 6:
            del _prepared[next(iter(_prepared))]
    return _prepared[key]


def identify_elastic(library, recordings, options=None, *, method="automatic", echo=None):
    """Return the estimate by a method."""
    options = options or ElasticOptions()
    key = (library, *recordings, repr((options, echo)))
    return prepare_once(key, lambda: prepare_methods(library, recordings, options, echo=echo))(method)


def identify_by(robot, logs, method, *, friction=None, options=None, **given):
    """Return what `robot.identify` gives, by any method of the automatic choice."""
    order = replace(options or symid.IdentifyOptions(), **given)
    logs = [logs] if isinstance(logs, symid.Log) else logs

    def prepare():
        described, recordings = robot._gather(logs, (), friction, None)
        named = friction is not None
        return prepare_elastic_methods(described, recordings, order, robot.context, named=named)

    known = order.known.read_text() if isinstance(order.known, Path) else order.known
    # Known dynamics that are no file show less than what they are.
    key = (
        (robot, *logs, friction, repr(order), known) if known is None or isinstance(known, str) else object()
    )
    return build_dynamics_fit(prepare_once(key, prepare)(method), robot)
