"""The energy theorem on a clean simulated run of the shipped arm: work = gain of energy + losses."""

import numpy as np

from tests.recovery.rigid_runs import run_fourier


def test_work_is_energy_and_losses_to_a_millionth(two_link, two_link_library):
    library = two_link_library
    run = run_fourier(two_link, library, 0, duration=20.0, periods=2)

    # A held torque does the work tau (q' - q) in every step, whatever the motion within it.
    steps = run.torque[:-1] * np.diff(run.q, axis=0)
    work = steps.sum()
    beta = np.array([parameter.value for parameter in library.card.beta])
    kinetic, potential = library.evaluate("energy", run.q, run.dq, beta)
    energy = (kinetic + potential)[:, 0]
    done = np.abs(steps).sum()
    assert abs(work - (energy[-1] - energy[0]) - run.dissipation[-1]) < 1e-6 * done

    # The losses, anew: friction of the model times velocity, by the trapezoidal rule.
    friction = np.array([parameter.value for parameter in library.card.friction])
    (torque,) = library.evaluate("friction", run.dq, friction)
    losses = np.trapezoid((torque * run.dq).sum(axis=1), run.recording.time)
    assert abs(losses - run.dissipation[-1]) < 1e-3 * run.dissipation[-1]
    assert run.events > 0
