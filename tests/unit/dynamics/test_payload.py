"""What a robot carries, from base values with and without it; noise of a known covariance is put on them."""

import dataclasses

import numpy as np
import pytest

from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.dynamics.payload import (
    PAYLOAD_QUANTITIES,
    BaseValues,
    compute_ball,
    compute_quantities,
    compute_quantity_derivatives,
    estimate_payload,
)
from symid.errors import EstimateError, IdentifiabilityError, UsageError
from symid.robot.description import JointKind
from symid.robot.inertia import compute_standard_parameters, explain_impossible_inertia, move_parameters
from symid.robot.toml_reader import read_robot
from tests.chains import PANDA, PUMA560, TWO_LINK, build_chain, draw_parameters, each_robot, regress
from tests.estimates import fill_robot
from tests.refusals import raises

MASS, CENTRE, INERTIA = 1.5, (0.03, -0.02, 0.09), (0.004, 0.0003, -0.0002, 0.005, 0.0001, 0.003)
TRUE = np.array([MASS, *CENTRE, *INERTIA])


def load_robot(robot, *, link=-1, mass=MASS, com=CENTRE, inertia=INERTIA):
    """Return the robot with the payload at the file's frame of a link."""
    joint = robot.joints[link]
    rotation = np.array([[entry.to_float() for entry in row] for row in joint.frame.rotation])
    origin = np.array([entry.to_float() for entry in joint.frame.translation])
    body = move_parameters(compute_standard_parameters(mass, com, inertia), rotation, origin)
    total = tuple(a + b for a, b in zip(joint.inertial, body, strict=True))
    joints = list(robot.joints)
    joints[link] = dataclasses.replace(joint, inertial=total)
    return dataclasses.replace(robot, joints=tuple(joints))


def read_values(robot, covariance):
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    return BaseValues(names=tuple(values), values=np.array(list(values.values())), covariance=covariance)


def disturb(given, seed):
    rng = np.random.default_rng(seed)
    noise = np.linalg.cholesky(given.covariance) @ rng.standard_normal(len(given.names))
    return dataclasses.replace(given, values=given.values + noise)


def find_information(robot, seed, rows=60, noise=0.02):
    """Return the covariance of base values after torques at random states, friction left out."""
    rng = np.random.default_rng(seed)
    base = derive_base_parameters(robot)
    labels = [entry.label for entry in base.parameters]
    matrix = np.vstack(
        [
            np.column_stack([columns[label] for label in labels])
            for columns in (regress(robot, *rng.uniform(-2, 2, (3, robot.freedom))) for _ in range(rows))
        ]
    )
    return noise**2 * np.linalg.inv(matrix.T @ matrix)


class Arm:
    """A filled robot and what is estimated from base values with and without a payload."""

    def __init__(self, robot, *covariances):
        self.robot, self.base = fill_robot(robot), derive_base_parameters(robot)
        count = len(compute_parameter_values(self.robot, self.base))
        self.covariances = [np.eye(count) * c for c in covariances]

    def read(self, scale=1.0, **payload):
        """Return base values with the payload and without it."""
        loaded, empty = load_robot(self.robot, **payload), self.robot
        pairs = zip((loaded, empty), self.covariances, strict=True)
        return [read_values(robot, scale * covariance) for robot, covariance in pairs]

    def estimate(self, *values, **options):
        return estimate_payload(self.robot, self.base, *(values or self.read()), **options)


@pytest.fixture(scope="module")
def puma():
    arm = Arm(PUMA560, 0.0, 0.0)
    arm.covariances = [find_information(arm.robot, seed) for seed in (1, 2)]
    return arm


def list_values(payload):
    return np.array([np.nan if entry.value is None else entry.value for entry in payload.quantities])


def list_deviations(payload):
    return np.array([np.nan if entry.std is None else entry.std for entry in payload.quantities])


def test_quantities_and_their_rates():
    parameters = draw_parameters(np.random.default_rng(3), 1)[0]
    mass, com = parameters[9], parameters[6:9] / parameters[9]
    quantities = compute_quantities(parameters)
    np.testing.assert_allclose(quantities[:4], [mass, *com])
    np.testing.assert_allclose(
        compute_standard_parameters(mass, com, quantities[4:]), parameters, rtol=1e-13, atol=1e-15
    )
    step = 1e-6
    for k, column in enumerate(compute_quantity_derivatives(parameters).T):
        change = step * np.eye(10)[k]
        difference = compute_quantities(parameters + change) - compute_quantities(parameters - change)
        np.testing.assert_allclose(column, difference / (2 * step), atol=1e-8)
    radius, moment = compute_ball(1000.0 * 4 / 3 * np.pi * 0.1**3)
    assert (radius, moment) == (pytest.approx(0.1), pytest.approx(0.4 * 4.18879 * 0.01, rel=1e-5))


@each_robot(PUMA560, PANDA)
def test_without_noise_the_payload_is_found(robot):
    found = Arm(robot, 1e-6, 1e-6).estimate()
    np.testing.assert_allclose(list_values(found), TRUE, rtol=1e-8, atol=1e-10)
    assert [entry.name for entry in found.quantities] == list(PAYLOAD_QUANTITIES)
    assert (found.joint, found.moved, found.scale) == (robot.joints[-1].name, 0.0, 1.0)
    assert found.chi2 < 1e-12
    assert (found.unexplained, found.friction) == ((), ())


def test_deviations_hold_and_noise_is_used_as_well_as_can_be(puma):
    loaded, empty = puma.read()
    shares, squares = [], []
    for seed in range(300):
        found = puma.estimate(disturb(loaded, seed), disturb(empty, 1000 + seed))
        # Deviations that were made larger where chi^2 was large by chance are taken back.
        shares.append((list_values(found) - TRUE) / (list_deviations(found) / found.scale))
        squares.append(found.chi2)
    shares = np.array(shares)
    assert not np.isnan(shares).any()
    np.testing.assert_allclose(np.mean(shares**2, axis=0), 1.0, atol=0.25)
    assert np.abs(np.mean(np.abs(shares) < 1.96, axis=0) - 0.95).max() < 0.04
    assert np.mean(squares) == pytest.approx(puma.base.count - 10, rel=0.1)


def test_a_body_that_can_exist_comes_out_of_noise(puma):
    (loaded, empty), moved = puma.read(400), []
    for seed in range(40):
        found = puma.estimate(disturb(loaded, seed), disturb(empty, 1000 + seed))
        assert not explain_impossible_inertia(found.standard)
        assert found.standard[9] > 0
        told = [entry for entry in found.quantities if entry.value is not None]
        assert "mass" in [entry.name for entry in told]
        assert found.quantities[0].value == pytest.approx(MASS, abs=5 * found.quantities[0].std)
        moved.append(found.moved)
    assert max(moved) > 0
    assert np.median(moved) < 4


def test_what_noise_hides_is_refused(puma):
    by_name = {entry.name: entry for entry in puma.estimate(*puma.read(2500)).quantities}
    assert by_name["mass"].value == pytest.approx(MASS, rel=1e-6)
    refused = {name: entry for name, entry in by_name.items() if entry.value is None}
    assert set(refused) >= {"Jxx", "Jyy"}
    assert all(entry.std is None for entry in refused.values())
    # With the mass known well, from a balance, and the rest hardly.
    weighed = {entry.name: entry for entry in puma.estimate(*puma.read(1e6), mass=MASS).quantities}
    assert weighed["mass"].std < 1e-5 * MASS
    assert weighed["cx"].value is None
    for reason, unit in ((by_name["Jxx"].reason, " kg m^2"), (weighed["cx"].reason, " m, ")):
        assert "standard deviation" in reason
        assert unit in reason


def test_a_weighed_mass_makes_the_rest_surer(puma):
    free, weighed = puma.estimate(), puma.estimate(mass=MASS)
    assert np.all(list_deviations(weighed) <= list_deviations(free) * (1 + 1e-9))
    np.testing.assert_allclose(list_values(weighed), TRUE, rtol=1e-7, atol=1e-9)


def test_a_planar_arm_tells_what_it_can():
    found = Arm(TWO_LINK, 1e-8, 1e-8).estimate()
    told = {entry.name: entry.value for entry in found.quantities if entry.value is not None}
    assert list(told) == ["mass", "cx", "cy", "Jzz"]
    wanted = [TRUE[PAYLOAD_QUANTITIES.index(name)] for name in told]
    np.testing.assert_allclose(list(told.values()), wanted, rtol=1e-7)
    assert not explain_impossible_inertia(found.standard)
    assert found.moved == pytest.approx(0.0, abs=1e-6)
    reasons = [entry.reason for entry in found.quantities if entry.value is None]
    assert all("not identifiable" in reason and "missing" not in reason for reason in reasons)


def test_a_payload_at_another_link_in_the_frame_of_the_file(robots_folder):
    arm = Arm(read_robot(robots_folder / "wam7.toml"), 1e-8, 1e-8)
    name = arm.robot.joints[3].name
    found = arm.estimate(*arm.read(link=3), joint=name)
    assert found.joint == name
    np.testing.assert_allclose(list_values(found), TRUE, rtol=1e-7, atol=1e-9)


def test_parameters_that_are_missing_are_named_as_the_reason(puma):
    def keep(given, names):
        kept = [index for index, name in enumerate(given.names) if name in names]
        return BaseValues(
            names=tuple(given.names[index] for index in kept),
            values=given.values[kept],
            covariance=given.covariance[np.ix_(kept, kept)],
        )

    loaded, empty = puma.read()
    found = puma.estimate(keep(loaded, set(loaded.names) - {"XZ6", "YZ6"}), empty)
    by_name = {entry.name: entry for entry in found.quantities}
    assert by_name["Jzz"].value == pytest.approx(INERTIA[5], rel=1e-6)
    assert "missing" in by_name["Jxz"].reason
    with raises(IdentifiabilityError, "payload.mass-not-identifiable") as caught:
        puma.estimate(keep(loaded, ["XY6", "XZ6"]), empty)
    assert "base parameters" in caught.value.notices[0].text
    with raises(EstimateError, "payload.nothing-shared"):
        puma.estimate(keep(loaded, ["XY6"]), keep(empty, ["XZ6"]))


def test_no_payload_is_refused(puma):
    same = [read_values(puma.robot, covariance) for covariance in puma.covariances]
    swapped = same[0], read_values(load_robot(puma.robot), puma.covariances[1])
    for values in (same, swapped):
        with raises(IdentifiabilityError, "payload.none"):
            puma.estimate(*values)


def test_a_joint_about_the_vertical_shows_no_mass():
    arm = Arm(build_chain([(0.0, 0, 0, "q")]), 1e-8, 1e-8)
    assert arm.robot.joints[0].kind is JointKind.REVOLUTE
    with raises(IdentifiabilityError, "payload.mass-not-identifiable"):
        arm.estimate()
    told = [entry.name for entry in arm.estimate(mass=MASS).quantities if entry.value is not None]
    assert told == ["mass"]


def test_what_the_payload_does_not_explain_is_listed(robots_folder):
    arm = Arm(read_robot(robots_folder / "two_link.toml"), 1e-6, 1e-6)
    loaded, empty = arm.read()
    changed = np.array(loaded.values)
    changed[loaded.names.index("Fc1")] += 0.5
    changed[loaded.names.index("MY1")] += 0.05
    found = arm.estimate(dataclasses.replace(loaded, values=changed), empty)
    assert [change.name for change in found.friction] == ["Fc1"]
    assert found.friction[0].deviations == pytest.approx(0.5 / np.sqrt(2e-6))
    assert found.friction[0].after - found.friction[0].before == pytest.approx(0.5)
    assert "MY1" in [change.name for change in found.unexplained]
    assert found.scale == pytest.approx(np.sqrt(found.chi2 / found.freedom))
    assert found.scale > 5


def test_values_that_no_body_has_end_in_an_error_or_a_body_near_them(puma, monkeypatch):
    values = puma.read(inertia=(-0.05, 0.0, 0.0, -0.05, 0.0, -0.05))
    found = puma.estimate(*values)
    assert found.moved > 10
    assert not explain_impossible_inertia(found.standard)
    monkeypatch.setattr("symid.dynamics.nearest_bodies._LIMIT", 0)
    with raises(IdentifiabilityError, "payload.no-body"):
        puma.estimate(*values)


def test_calls_that_cannot_be_answered(puma):
    with raises(UsageError, "usage.payload-joint"):
        puma.estimate(joint="wrist")
    with raises(UsageError, "usage.payload-mass"):
        puma.estimate(mass=-1.0)
    loaded, empty = puma.read()
    with raises(EstimateError, "payload.no-deviations"):
        puma.estimate(loaded, dataclasses.replace(empty, covariance=np.full_like(empty.covariance, np.nan)))
