"""Short experiments with the elastic arm that recovery tests share."""

from dataclasses import replace

import numpy as np

from symid.codegen.cache import prepare_library
from symid.excitation.trajectories import build_ta, scale_trajectory
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import build_elastic_problem, prepare_elastic_signals
from symid.robot.toml_reader import read_robot
from symid.simulation.elastic_experiment import build_clean_options, build_noisy_options, simulate_elastic

STOPS = ((0.002, 0.005, 0.010), (0.003, 0.008, 0.016))
KNEES = ((-3.0, 3.0), (-1.2, 1.2))
PLACED = ElasticOptions(thresholds=STOPS, knee_torques=KNEES, tolerance=1e-6)


def prepare_arm(robots_folder, *, knees=True, springs=None):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    if not knees:
        joints = tuple(
            replace(joint, elasticity=replace(joint.elasticity, knees=())) for joint in robot.joints
        )
        robot = replace(robot, joints=joints)
    if springs is not None:
        joints = tuple(
            replace(joint, elasticity=spring) for joint, spring in zip(robot.joints, springs, strict=True)
        )
        robot = replace(robot, joints=joints)
    return robot, prepare_library(robot)


def run_arm(robot, library, *, scale=10.0, duration=8.0, noisy=False, seed=0, **changes):
    options = replace(build_noisy_options() if noisy else build_clean_options(), duration=duration, **changes)
    return simulate_elastic(
        robot, library, scale_trajectory(build_ta(), scale), options, np.random.default_rng(seed)
    )


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
