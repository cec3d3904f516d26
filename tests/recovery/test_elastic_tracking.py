"""A controller that knows the springs makes the links follow; one that takes the joints as rigid does not."""

from dataclasses import replace

import numpy as np

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.excitation.trajectories import build_tc
from symid.identification.elastic.estimate import MethodFit
from symid.identification.elastic.validation import (
    RIGID,
    compute_elastic_reference,
    simulate_tracking,
    widen_springs,
)
from symid.joint_models.hysteresis import Elasticity
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from symid.robot.toml_reader import read_robot
from symid.simulation.experiment import build_clean_options, build_noisy_options
from tests.refusals import raises

_DURATION = 4.0


def believe(library):
    """Return a model that is the truth."""
    parts = {"beta": library.card.beta, "rotor": library.card.rotors, "friction": library.card.friction}
    values = {name: np.array([entry.value for entry in part]) for name, part in parts.items()}
    return MethodFit(method="truth", **values, elasticity=library.card.elasticity)


def test_with_the_true_springs_the_links_follow_a_thousand_times_better(arm):
    robot, library = arm
    truth = believe(library)
    linear = replace(truth, elasticity=tuple(Elasticity(stiffness=k) for k in (500.0, 130.0)))
    options = replace(build_clean_options(), duration=_DURATION)
    runs = simulate_tracking(robot, library, {"true": truth, "linear": linear}, build_tc(), options)
    assert [run.name for run in runs] == [RIGID, "true", "linear"]
    rigid, true, straight = (run.rms for run in runs)
    assert np.all(true < 1e-3 * rigid)
    assert np.all(true < straight)
    assert np.all(straight < 0.5 * rigid)


def test_more_stops_and_knees_without_effect_change_nothing(arm):
    _, library = arm
    springs = library.card.elasticity
    counts = ((5, 2, 3), (3, 1, 1))
    wide = widen_springs(springs, counts)
    assert [len(spring.stops) for spring in wide] == [5, 3]
    assert wide[1] == springs[1]
    phi = 0.03 * np.sin(np.linspace(0.0, 9.0, 500)) * np.linspace(0.0, 1.0, 500)
    for before, after in zip(springs, wide, strict=True):
        found = compute_hysteresis_torque(after, phi)
        np.testing.assert_allclose(found, compute_hysteresis_torque(before, phi), rtol=0, atol=1e-12)
    plain = Elasticity(stiffness=100.0)
    few, options = replace(believe(library), elasticity=(plain, plain)), build_noisy_options()
    runs, alone = (
        simulate_tracking(*arm, {"few": few} | more, build_tc(), replace(options, duration=0.5))
        for more in ({"many": believe(library)}, {})
    )
    np.testing.assert_allclose(runs[1].error, alone[1].error, rtol=0, atol=1e-12)


def test_springs_of_another_size_or_rigid_robots_are_refused(arm, robots_folder):
    _, library = arm
    time = np.arange(0.0, 0.1, 1e-3)
    plain = tuple(Elasticity(stiffness=100.0) for _ in range(2))
    fit = replace(believe(library), elasticity=plain)
    with raises(UsageError, "usage.spring-layout", match="shoulder"):
        compute_elastic_reference(library, fit, build_tc(), time)
    rigid = prepare_library(read_robot(robots_folder / "two_link.toml"))
    with raises(UsageError, "usage.no-feed-forward", match="elastic_inverse_dynamics"):
        compute_elastic_reference(rigid, fit, build_tc(), time)
