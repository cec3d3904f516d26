"""Elastic joints with branches: the plant against their differential equations, its C against NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from symid import joint_models
from symid.codegen.compiled_models import has_addresses, load_plant_code
from symid.simulation import elastic_plant
from tests.elements import ELEMENTS
from tests.unit.simulation.test_elastic_plant import B, find_bias, find_mass, find_plain_friction, order_run

BENT = joint_models.BoucWen(level=1.5, length=0.004, sharpness=1.4, loop=0.8, skew=0.2)
SOFT = joint_models.Relaxation(stiffness=20.0, time=0.05)
DRY = joint_models.BristleBranch(law="dahl", values=(("Fc", 0.2), ("sigma0", 60.0)))
SPRINGS = (
    joint_models.Elasticity(stiffness=380.0, damping=0.05, branches=(BENT,)),
    joint_models.Elasticity(stiffness=90.0, branches=(SOFT, DRY), offset=0.1),
)


@pytest.fixture(scope="module")
def values(elastic_robot, elastic_library):
    return replace(elastic_plant.get_elastic_values(elastic_robot, elastic_library.card), elasticity=SPRINGS)


def find_rates(x, torque):
    """Return the rates of q, dq, theta, dtheta, then Bouc-Wen's u, the force that relaxes, Dahl's force."""
    q, dq, theta, dtheta = x[:8].reshape(4, 2)
    u, soft, dry = x[8:]
    phi, rate = theta - q, dtheta - dq
    spring = np.array([380.0 * phi[0] + 0.05 * rate[0] + 1.5 * u, 90.0 * phi[1] + soft + dry + 0.1])
    growth = 1.0 + 0.2 * np.sign(rate[0]) if u * rate[0] > 0.0 else -(2.0 * 0.8 - 1.0)
    du = rate[0] / 0.004 * (1.0 - growth * abs(u) ** 1.4)
    dsoft = 20.0 * rate[1] - soft / 0.05
    ddry = 60.0 * rate[1] * (1.0 - dry / 0.2 * np.sign(rate[1]))
    ddq = np.linalg.solve(find_mass(q), spring - find_bias(q, dq))
    spin = (torque - spring - find_plain_friction(theta, dtheta, spring)) / B
    return np.concatenate([dq, ddq, dtheta, spin, [du, dsoft, ddry]])


def test_the_plant_is_the_solution_of_the_differential_equations(elastic_library, values):
    order = order_run(
        ticks=120, substeps=40, play=elastic_plant.build_elements(values).pad([(0.0,) * 2, (0.0,) * 3])
    )
    ran, _, _ = elastic_plant.simulate_plant(
        elastic_library, elastic_plant.build_plant_robot(values), order, elastic_plant.build_elements(values)
    )
    x, worst = np.zeros(11), 0.0
    for tick in range(order.ticks - 1):
        found = solve_ivp(
            lambda _t, y, tick=tick: find_rates(y, ran.torque[tick]),
            (0.0, order.period),
            x,
            rtol=1e-9,
            atol=1e-12,
            max_step=order.period / 40,
        )
        x = found.y[:, -1]
        worst = max(worst, float(np.abs(x[:2] - ran.q[tick + 1]).max()))
    assert np.abs(ran.theta - ran.q).max() > 0.02
    assert worst < 2e-6 * np.abs(ran.q).max()


@pytest.mark.parametrize("kind", sorted(ELEMENTS))
def test_c_and_numpy_are_equal(elastic_library, values, kind):
    if not has_addresses(elastic_library):
        pytest.skip("there is no C compiler")
    # Stiff enough for the arm; forces and lengths of the element as they are.
    springs = (
        replace(ELEMENTS[kind], stiffness=300.0),
        joint_models.Elasticity(stiffness=90.0, branches=(SOFT,)),
    )
    own = replace(values, elasticity=springs)
    plant, elements = elastic_plant.build_plant_robot(own), elastic_plant.Elements(springs)
    phi, play = elastic_plant.compute_rest(plant, np.array([3.0, -1.0]), ("a", "b"), elements)
    order = order_run(ticks=15, theta=phi, play=play)
    fast = load_plant_code(elements.springs).run(elastic_library, plant, order)
    slow = elastic_plant.simulate_in_numpy(elastic_library, plant, order, elements)
    for name in ("q", "dq", "theta", "dtheta", "spring", "torque", "elastic", "work"):
        a, b = getattr(fast, name), getattr(slow, name)
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-10 * (1.0 + np.abs(b).max()))


def test_the_logged_torque_is_that_of_the_element_along_the_torsion(elastic_library, values):
    own = replace(values, elasticity=(SPRINGS[0], joint_models.Elasticity(stiffness=90.0, backlash=0.002)))
    plant, elements = elastic_plant.build_plant_robot(own), elastic_plant.build_elements(own)
    order = order_run(play=elements.pad([(0.0,) * 2] * 2))
    log, _, _ = elastic_plant.simulate_plant(elastic_library, plant, order, elements)
    time = np.arange(order.ticks) * order.period
    phi, rate = log.theta - log.q, log.dtheta - log.dq
    for joint, spring in enumerate(own.elasticity):
        torque = joint_models.run_element(spring, phi[:, joint], time, velocity=rate[:, joint]).output
        assert np.abs(torque - log.spring[:, joint]).max() < 2e-3 * np.abs(torque).max()
    # The spring works into what it stores and loses: never less than it stores.
    stored = joint_models.run_element(replace(own.elasticity[0], damping=0.0), phi[:, 0]).stored
    assert np.all(log.elastic[:, 0] - stored > -1e-4 * log.elastic[-1, 0])


def test_a_spring_at_rest_carries_its_load(values):
    plant, elements = elastic_plant.build_plant_robot(values), elastic_plant.build_elements(values)
    for load in ([12.0, -3.0], [0.0, 0.0], [-0.5, 0.1]):
        phi, play = elastic_plant.compute_rest(plant, np.array(load), ("a", "b"), elements)
        torque = elements.compute(phi, np.zeros(2), 0.0, play)
        np.testing.assert_allclose(torque, load, rtol=1e-9, atol=1e-9)
    plain = joint_models.Elasticity(stiffness=3.0, stops=(joint_models.Stop(threshold=0.1, stiffness=1.0),))
    assert elastic_plant.build_elements(replace(values, elasticity=(plain, plain))) is None


@pytest.mark.parametrize("kind", sorted(ELEMENTS))
def test_no_slope_is_beyond_the_bound(kind):
    element = replace(ELEMENTS[kind], damping=0.0, cubic=0.0)
    path = np.concatenate([np.linspace(a, b, 4001) for a, b in ((0, 1.5), (1.5, -1.2), (-1.2, 0.3))])
    time = np.arange(len(path)) * 1e-9
    # Fast, so that what relaxes has no time to; the speed is held, but where the path turns.
    velocity = np.sign(np.diff(path, prepend=-1.0)) * 5.0
    run = joint_models.run_element(element, path, time, velocity=velocity)
    way = np.diff(path)
    held = (way != 0.0) & (velocity[1:] == velocity[:-1])
    slopes = np.diff(run.output)[held] / way[held]
    bound = joint_models.find_most_slope(element)
    assert slopes.max() <= bound * (1.0 + 1e-3)
    # Of LuGre damping hides the bristles at this speed.
    assert kind == "lugre" or bound < 40.0 * slopes.max()
