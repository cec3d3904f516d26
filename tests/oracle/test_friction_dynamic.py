"""Friction with a memory against closed forms: break-away, presliding, loops, small motions, limit cycles.

Where a closed form holds in a limit (slow force, stiff bristles), the test goes there and says how near.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.friction_rig import (
    ForceDrive,
    PositionControl,
    Rig,
    RigOptions,
    SpringDrive,
    simulate_friction_rig,
)
from symid.joint_models import (
    advance_memory,
    build_float_carrier,
    build_memory_values,
    get_law,
    is_passive,
    simulate_dynamic_friction,
)
from tests.state_laws import STATES, find_rate, find_torque, give_values, print_values, take_step

NAMES = ("sigma0", "sigma1", "fC", "fS", "vs", "gamma", "fV")
STIFF = 1e5
# The paper's own example: mass 1, sigma1 = sqrt(sigma0), static friction half more than Coulomb.
PAPER = dict(zip(NAMES, (STIFF, math.sqrt(STIFF), 1.0, 1.5, 0.001, 2.0, 0.4), strict=True))


def simulate(values, drive, *, mass=1.0, **options):
    return simulate_friction_rig(Rig(values=values, mass=mass), drive, RigOptions(**options))


@pytest.mark.parametrize("law", ["dahl", "lugre", "lugre+offset"])
def test_the_step_that_all_targets_equal_is_the_solution_of_the_bristle_equation(law):
    p, values = give_values(law), build_memory_values(get_law(law), print_values(law))
    for v, z0 in ((0.003, 0.0), (0.2, -1e-4), (-0.04, 1.5e-4)):
        rate = lambda _t, z, v=v: [find_rate(p, v, z[0])]  # noqa: E731
        after = solve_ivp(rate, (0, 5e-3), [z0], "Radau", rtol=1e-11, atol=1e-16).y[:, -1]
        wanted = pytest.approx((after[0], find_torque(p, v, after)), rel=1e-8, abs=1e-13)
        for torque, (z,) in (
            take_step(p, v, 5e-3, [z0]),
            advance_memory(build_float_carrier(), values, v, 5e-3 * v, [z0]),
        ):
            assert (z, torque) == wanted


@pytest.mark.parametrize(("reach", "period"), [(0.1, 1.0), (1.0, 1e-3), (5.0, 1.0)])
def test_dahls_loop_has_its_height_and_its_area(reach, period):
    # From reversal to reversal F = fC - (fC + Fm) exp(-sigma0 (x + A) / fC), closed for
    # Fm = fC tanh(sigma0 A / fC); the area is 4 fC (A - Fm / sigma0).
    stiffness, level, count = 2e4, 7.0, 10_000
    amplitude = reach * level / stiffness
    height = level * math.tanh(stiffness * amplitude / level)
    way = np.diff(-amplitude * np.cos(2.0 * np.pi * np.arange(count + 1) / count))
    values = build_memory_values(get_law("dahl"), {"sigma0": stiffness, "fC": level, "fV": 0.0})
    torque, _ = simulate_dynamic_friction(values, way * count / period, way, [-height / stiffness])
    travelled = np.cumsum(np.abs(way)).reshape(2, -1)
    rising = level - (level + height) * np.exp(-stiffness * travelled[0] / level)
    np.testing.assert_allclose(torque, np.concatenate([rising, -rising]), atol=1e-10 * level)
    area = float(0.5 * (torque + np.roll(torque, 1)) @ way)
    assert area == pytest.approx(4.0 * level * (amplitude - height / stiffness), rel=1e-6)


RATES = (0.01, 0.1, 1.0, 10.0)


@pytest.fixture(scope="module")
def pushed():
    """Return runs under a force that rises at each of the rates in N/s, until just after break-away."""
    drives = [ForceDrive(force=lambda time, rate=rate: rate * time) for rate in RATES]
    pairs = zip(drives, RATES, strict=True)
    return [simulate(PAPER, drive, duration=1.6 / rate, rate=1000.0 * rate) for drive, rate in pairs]


def test_break_away_is_the_static_level_under_a_slow_force_and_falls_with_its_rate(pushed):
    peaks = [STIFF * float(run.deflection.max()) for run in pushed]
    assert peaks[0] == pytest.approx(1.5, rel=1e-2)
    # The bristles are over their peak: they slip.
    assert all(run.deflection[-1] < run.deflection.max() for run in pushed)
    assert 1.5 > peaks[0] > peaks[1] > peaks[2] > peaks[3] > 1.0


def test_presliding_under_a_slow_force_bends_as_the_logarithm(pushed):
    # dF/dx = sigma0 (1 - F / fS): x = -fS / sigma0 ln(1 - F / fS); what is missing is sigma1 dz/dt.
    gaps = []
    for run in pushed[:3]:
        sticking = (run.force < 1.35) & (run.force > 0.2)
        wanted = -1.5 / STIFF * np.log1p(-run.force[sticking] / 1.5)
        gaps.append(float(np.abs(run.position[sticking] / wanted - 1.0).max()))
    assert gaps[0] < 3e-4
    assert gaps[1] == pytest.approx(10.0 * gaps[0], rel=0.1)
    assert gaps[2] == pytest.approx(100.0 * gaps[0], rel=0.1)


@pytest.mark.parametrize("stiffness", [1e5, 1e6])
def test_stick_slip_has_the_period_and_the_amplitude_of_the_closed_form(stiffness):
    # Sticks until k u = fS, slips on fC: u swings about fC / k, the force comes down to 2 fC - fS.
    spring, speed, mass, coulomb, static = 2.0, 0.01, 1.0, 1.0, 1.5
    values = PAPER | {"sigma0": stiffness, "sigma1": 0.3 * math.sqrt(stiffness), "fV": 0.0}
    omega = math.sqrt(spring / mass)
    jump = (static - coulomb) / spring
    slip = 2.0 / omega * (math.pi - math.atan(jump * omega / speed))
    period = 2.0 * jump / speed + slip
    duration = static / (spring * speed) + 2.5 * period
    drive = SpringDrive(stiffness=spring, speed=speed)
    run = simulate(values, drive, mass=mass, duration=duration, rate=50.0)
    force = run.force
    inner = (force[1:-1] > force[:-2]) & (force[1:-1] >= force[2:]) & (force[1:-1] > 1.3)
    peaks = np.flatnonzero(inner) + 1
    assert len(peaks) == 3
    np.testing.assert_allclose(np.diff(run.time[peaks]), period, rtol=5e-3)
    np.testing.assert_allclose(run.force[peaks], static, rtol=5e-3)
    assert run.force[peaks[0] :].min() == pytest.approx(2.0 * coulomb - static, rel=1e-2)
    assert np.ptp(run.force[peaks[0] :]) == pytest.approx(2.0 * (static - coulomb), rel=1e-2)
    find_balance(run)


def test_a_pulled_mass_slips_steadily_where_friction_does_not_fall():
    values = PAPER | {"sigma1": 300.0, "fS": 1.0}
    run = simulate(values, SpringDrive(stiffness=2.0, speed=0.01), duration=120.0, rate=50.0)
    late = run.time > 90.0
    np.testing.assert_allclose(run.velocity[late], 0.01, rtol=1e-3)
    np.testing.assert_allclose(run.force[late], 1.0 + 0.4 * 0.01, rtol=1e-3)


def find_hunting(static):
    control = PositionControl(proportional=3.0, integral=4.0, derivative=6.0, target=lambda _t: 1.0)
    return simulate(PAPER | {"fS": static}, control, duration=150.0, rate=50.0)


def test_integral_control_hunts_where_static_friction_is_more_and_only_there():
    hunting, calm = find_hunting(1.5), find_hunting(1.0)
    middle, late = (hunting.time > 50) & (hunting.time <= 100), hunting.time > 100
    ranges = [float(np.ptp(hunting.position[part])) for part in (middle, late)]
    assert ranges[0] > 0.02
    assert ranges[1] == pytest.approx(ranges[0], rel=0.05)
    swings = [float(np.abs(calm.position[part] - 1.0).max()) for part in (middle, late)]
    assert swings[1] < 0.6 * swings[0]
    assert swings[1] < 0.1 * ranges[1]
    find_balance(hunting)


def find_balance(run):
    """Check that the energies of a run close."""
    gap = run.energy - run.energy[0] - run.work + run.loss
    assert np.abs(gap).max() < 1e-6 * max(np.abs(run.work).max(), run.energy.max())


@pytest.mark.parametrize("law", ["dahl", "lugre"])
def test_a_driven_mass_moves_as_an_implicit_solver_says_and_the_law_gives_its_friction(law):
    p, printed = give_values(law), print_values(law)

    def force(time):
        return 3.5 * math.sin(2.0 * time) + 2.0 * math.sin(9.0 * time)

    def slope(time, y):
        _, v, z = y
        return [v, force(time) - find_torque(p, v, [z]), find_rate(p, v, z)]

    run = simulate(printed, ForceDrive(force=force), duration=2.0, rate=5000.0, tolerance=1e-11)
    exact = solve_ivp(slope, (0.0, 2.0), np.zeros(3), "Radau", run.time, rtol=1e-8, atol=1e-12).y[0]
    np.testing.assert_allclose(run.position, exact, atol=1e-5 * np.abs(exact).max())
    ways = np.diff(run.position, prepend=0.0)
    torque, z = simulate_dynamic_friction(build_memory_values(get_law(law), printed), run.velocity, ways)
    for found, wanted in ((torque, run.friction), (z[:, 0], run.deflection)):
        np.testing.assert_allclose(found, wanted, atol=2e-3 * np.abs(wanted).max())


def test_a_passive_law_never_gives_energy_back():
    values = dict(zip(NAMES, (1e4, 80.0, 10.0, 15.0, 0.02, 1.7, 40.0), strict=True))
    assert is_passive(build_memory_values(get_law("lugre"), values))
    drive = ForceDrive(
        force=lambda t: 25.0 * math.sin(7.0 * t) * math.sin(1.3 * t) + 3.0 * math.sin(90.0 * t)
    )
    run = simulate(values, drive, mass=1.5, duration=6.0, tolerance=1e-10)
    find_balance(run)
    assert np.diff(run.loss).min() > -1e-9 * run.loss[-1]


@pytest.mark.parametrize("law", STATES)
def test_any_closed_way_costs_energy(law):
    values = build_memory_values(get_law(law), print_values(law))
    generator, time = np.random.default_rng(3), np.arange(3 * 4000 + 1) / 4000
    for _ in range(5):
        weights, phases = generator.normal(size=5), generator.uniform(0, 2 * np.pi, 5)
        waves = np.sin(2 * np.pi * np.outer(time, np.arange(1, 6)) + phases)
        ways = np.diff(1e-3 * waves @ weights)
        torque, _ = simulate_dynamic_friction(values, ways * 4000, ways)
        assert (torque * ways)[-4000:].sum() > 0
