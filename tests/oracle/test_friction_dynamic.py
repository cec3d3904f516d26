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
from symid.joint_models import dynamic_friction
from symid.joint_models.carriers import build_float_carrier
from tests.state_laws import find_rate, find_torque, give_values, take_step

DAHL, LUGRE = dynamic_friction.get_dynamic_law("dahl"), dynamic_friction.get_dynamic_law("lugre")
FLOATS = build_float_carrier()
STIFF = 1e5
# The paper's own example: mass 1, sigma1 = sqrt(sigma0), static friction half more than Coulomb.
PAPER = (STIFF, math.sqrt(STIFF), 1.0, 1.5, 0.001, 2.0, 0.4)


def simulate(values, drive, *, law=LUGRE, mass=1.0, **options):
    return simulate_friction_rig(Rig(law=law, values=values, mass=mass), drive, RigOptions(**options))


def find_loop(law, values, amplitude, *, period, count, cycles=3):
    """Return position and torque over the last of some cycles of a sine."""
    phase = 2.0 * np.pi * np.arange(cycles * count + 1) / count
    position = amplitude * np.sin(phase)
    step = period / count
    run = dynamic_friction.simulate_dynamic_friction(
        law, values, dynamic_friction.build_held_path(np.diff(position) / step, step)
    )
    return position[-count - 1 :], run.torque[-count - 1 :]


@pytest.mark.parametrize("velocity", [-0.4, -0.002, 1e-4, 0.03])
def test_the_step_is_the_integral_of_the_rate(velocity):
    values = (1e4, 80.0, 10.0, 15.0, 0.02, 1.7, 4.0)
    for law, own in ((LUGRE, values), (DAHL, values[:1] + values[2:3])):

        def rate(_t, z, law=law, own=own):
            return [dynamic_friction.compute_bristle_rate(FLOATS, law, velocity, float(z[0]), own)]

        solved = solve_ivp(rate, (0.0, 0.05), [2e-4], method="Radau", rtol=1e-11, atol=1e-16)
        after, _ = dynamic_friction.compute_bristle_step(FLOATS, law, (velocity, 0.05), 2e-4, own)
        assert after == pytest.approx(solved.y[0, -1], rel=1e-8)


@pytest.mark.parametrize("law", ["dahl", "lugre", "lugre+offset"])
def test_the_step_that_all_targets_equal_is_the_solution_of_the_bristle_equation(law):
    p = give_values(law)
    for v, z0 in ((0.003, 0.0), (0.2, -1e-4), (-0.04, 1.5e-4)):
        rate = lambda _t, z, v=v: [find_rate(p, v, z[0])]  # noqa: E731
        after = solve_ivp(rate, (0, 5e-3), [z0], "Radau", rtol=1e-11, atol=1e-16).y[:, -1]
        torque, (z,) = take_step(p, v, 5e-3, [z0])
        assert (z, torque) == pytest.approx((after[0], find_torque(p, v, after)), rel=1e-8, abs=1e-13)


@pytest.mark.parametrize("velocity", [-1.0, -0.02, 1e-3, 0.2])
def test_steady_motion_is_the_static_law(velocity):
    stiffness, damping, coulomb, static, speed, exponent, viscous = values = (2e4, 90.0, 10.0, 15, 0.02, 2, 4)
    state = 0.0
    for _ in range(40):
        state, torque = dynamic_friction.compute_bristle_step(FLOATS, LUGRE, (velocity, 10.0), state, values)
    fall = math.exp(-((abs(velocity) / speed) ** exponent))
    law = math.copysign(coulomb + (static - coulomb) * fall, velocity) + viscous * velocity
    assert torque == pytest.approx(law, rel=1e-12)
    assert dynamic_friction.compute_steady_torque(FLOATS, LUGRE, velocity, values) == pytest.approx(
        law, rel=1e-14
    )
    assert state == pytest.approx((law - viscous * velocity) / stiffness, rel=1e-12)
    assert damping > 0


@pytest.mark.parametrize(("reach", "period"), [(0.1, 1.0), (1.0, 1e-3), (5.0, 1.0)])
def test_dahls_loop_has_its_height_and_its_area(reach, period):
    # From reversal to reversal F = fC - (fC + Fm) exp(-sigma0 (x + A) / fC), closed for
    # Fm = fC tanh(sigma0 A / fC); the area is 4 fC (A - Fm / sigma0).
    stiffness, level = values = (2e4, 7.0)
    amplitude = reach * level / stiffness
    cycles = math.ceil(5.0 / reach) + 1
    position, torque = find_loop(DAHL, values, amplitude, period=period, count=10_000, cycles=cycles)
    height = level * math.tanh(stiffness * amplitude / level)
    assert np.abs(torque).max() == pytest.approx(height, rel=1e-6)
    area = float(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(position)))
    assert area == pytest.approx(4.0 * level * (amplitude - height / stiffness), rel=1e-6)
    middle, reach = len(position) // 2, len(position) // 8
    falling = slice(middle - reach, middle + reach)
    assert np.diff(position[falling]).mean() <= 0
    down = -level + (level + height) * np.exp(-stiffness * (amplitude - position[falling]) / level)
    np.testing.assert_allclose(torque[falling], down, atol=1e-5 * level)


def test_a_mass_on_bristles_swings_as_a_damped_oscillator():
    stiffness, damping, *_, viscous = values = (1e5, 30.0, 1.0, 1.5, 0.001, 2.0, 0.4)
    speed = 1e-7
    options = {"duration": 0.1, "rate": 5000.0, "velocity": speed, "tolerance": 1e-12}
    run = simulate(values, ForceDrive(force=lambda _t: 0.0), mass=2.0, **options)
    decay = (damping + viscous) / 4.0
    omega = math.sqrt(stiffness / 2.0 - decay**2)
    wanted = speed / omega * np.exp(-decay * run.time) * np.sin(omega * run.time)
    # What slips is a part z / (g / sigma0) of the way, 3e-5 here, and adds up.
    np.testing.assert_allclose(run.position, wanted, rtol=0, atol=2e-4 * np.abs(wanted).max())


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
    values = (stiffness, 0.3 * math.sqrt(stiffness), coulomb, static, 0.001, 2.0, 0.0)
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
    values = (STIFF, 300.0, 1.0, 1.0, 0.001, 2.0, 0.4)
    run = simulate(values, SpringDrive(stiffness=2.0, speed=0.01), duration=120.0, rate=50.0)
    late = run.time > 90.0
    np.testing.assert_allclose(run.velocity[late], 0.01, rtol=1e-3)
    np.testing.assert_allclose(run.force[late], 1.0 + 0.4 * 0.01, rtol=1e-3)


def find_hunting(static):
    values = (*PAPER[:3], static, *PAPER[4:])
    control = PositionControl(proportional=3.0, integral=4.0, derivative=6.0, target=lambda _t: 1.0)
    return simulate(values, control, duration=150.0, rate=50.0)


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


def test_a_driven_mass_moves_as_an_implicit_solver_says():
    stiffness, damping, coulomb, static, speed, exponent, viscous = values = (1e4, 50, 1, 1.5, 0.01, 2, 0.4)

    def force(time):
        return 1.4 * math.sin(2.0 * time) + 0.8 * math.sin(9.0 * time)

    def slope(time, y):
        _, v, z = y
        level = coulomb + (static - coulomb) * math.exp(-((abs(v) / speed) ** exponent))
        rate = v - stiffness * abs(v) / level * z
        return [v, force(time) - stiffness * z - damping * rate - viscous * v, rate]

    run = simulate(values, ForceDrive(force=force), duration=2.0, rate=100.0, tolerance=1e-11)
    exact = solve_ivp(slope, (0.0, 2.0), np.zeros(3), "Radau", run.time, rtol=1e-8, atol=1e-12).y[0]
    np.testing.assert_allclose(run.position, exact, atol=1e-5 * np.abs(exact).max())


def test_storage_and_loss_of_a_held_step_make_up_the_work():
    # Dahl from straight bristles: F = fC (1 - exp(-sigma0 x / fC)), whose integral is the work.
    stiffness, level = values = (2e4, 7.0)
    options = {"duration": 0.4, "rate": 1000.0, "velocity": 1e-3}
    drive = SpringDrive(stiffness=1e9, damping=1e5, speed=1e-3)
    run = simulate(values, drive, law=DAHL, mass=1e-3, **options)
    work = level * (4e-4 + level / stiffness * math.expm1(-stiffness * 4e-4 / level))
    assert run.loss[-1] + 0.5 * stiffness * run.deflection[-1] ** 2 == pytest.approx(work, rel=1e-3)
    find_balance(run)


def test_a_passive_law_never_gives_energy_back():
    values = (1e4, 80.0, 10.0, 15.0, 0.02, 1.7, 40.0)
    assert dynamic_friction.is_passive(LUGRE, values)
    drive = ForceDrive(
        force=lambda t: 25.0 * math.sin(7.0 * t) * math.sin(1.3 * t) + 3.0 * math.sin(90.0 * t)
    )
    run = simulate(values, drive, mass=1.5, duration=6.0, tolerance=1e-10)
    find_balance(run)
    assert np.diff(run.loss).min() > -1e-9 * run.loss[-1]


@pytest.mark.parametrize("law", [DAHL, LUGRE], ids=["dahl", "lugre"])
def test_any_closed_way_costs_energy(law):
    values = (1e4, 10.0) if law is DAHL else (1e4, 20.0, 10.0, 15.0, 0.02, 2.0, 10.0)
    generator = np.random.default_rng(3)
    for _ in range(10):
        weights, phases = generator.normal(size=5), generator.uniform(0, 2 * np.pi, 5)
        time = np.arange(3 * 4000 + 1) / 4000
        position = 1e-3 * sum(
            w * np.sin(2 * np.pi * (k + 1) * time + p)
            for k, (w, p) in enumerate(zip(weights, phases, strict=True))
        )
        run = dynamic_friction.simulate_dynamic_friction(
            law, values, dynamic_friction.build_held_path(np.diff(position) * 4000, 1 / 4000)
        )
        work = run.torque * np.diff(position)
        assert work[-4000:].sum() > 0
