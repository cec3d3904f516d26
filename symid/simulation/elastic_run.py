"""What a simulated experiment with an elastic robot leaves: the truth, its energies, and a log of it.

Output: `ElasticRun`; `observe` gives other logs of the same truth, with other sensors or other noise.

    sum int tau_i dtheta_i = change of (T + V + 1/2 sum B_i dtheta_i^2) + sum int F_i dtheta_i + tau_Ji dphi_i

Supported: link and motor encoders, motor torque. Not supported: logs without link encoders.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.plant_orders import freeze_fields
from symid.data.recording import Recording
from symid.errors import Notice
from symid.simulation.elastic_sensors import ElasticSensors, add_motor_noise, check_sensors, find_readings
from symid.simulation.elastic_values import ElasticValues

__all__ = ["ElasticRun", "observe"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticRun:
    """A recording and the truth behind it; position of links q, of motors theta, both joint side.

    Args:
        recording: what a log of this run holds; `position` is that of the links.
        time: (N,) s.
        q, dq, theta, dtheta: (N, n) true. desired: (N, n) reference of the links.
        torque: (N, n) of the motors, held from each sample to the next; the last one did nothing.
        joint_torque: tau_J (N, n).
        kinetic, potential: (N,) J, of the links. spin: (N,) J, of the rotors.
        work, friction, spring: (N, n) J since the start: of the motors, lost in their friction, into the
            springs (int tau_J dphi, stored and lost together).
        turn: (n,) of an encoder with one count: 2 pi rad or 1 m.
        values: of all parameters. backend: "c" or "python". notices: how the run came about.
    """

    recording: Recording
    time: FloatArray
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    desired: FloatArray
    torque: FloatArray
    joint_torque: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    spin: FloatArray
    work: FloatArray
    friction: FloatArray
    spring: FloatArray
    turn: FloatArray
    values: ElasticValues
    backend: str
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        freeze_fields(self)

    @property
    def phi(self) -> FloatArray:
        """Return the true torsion (N, n), rad or m."""
        return self.theta - self.q

    @property
    def gap(self) -> FloatArray:
        """Return the work that no energy and no loss accounts for, (N,) J since the start."""
        energy = self.kinetic + self.potential + self.spin
        losses = (self.friction + self.spring).sum(axis=1)
        gap: FloatArray = self.work.sum(axis=1) - (energy - energy[0]) - losses
        return gap

    @property
    def energy_gap(self) -> float:
        """Return the largest |gap| in J."""
        return float(np.abs(self.gap).max())

    @property
    def relative_gap(self) -> float:
        """Return the largest |gap|, relative to the most work done."""
        most = float(np.abs(self.work.sum(axis=1)).max())
        return self.energy_gap / max(most, float(np.finfo(np.float64).tiny))

    def find_window_gap(self, window: float) -> float:
        """Return the largest |gap| in J over windows of so many seconds, wherever they begin."""
        samples = max(1, round(window / self.recording.period))
        gap = self.gap
        return float(np.abs(gap[samples:] - gap[:-samples]).max()) if samples < len(gap) else self.energy_gap


def observe(run: ElasticRun, sensors: ElasticSensors, rng: np.random.Generator) -> Recording:
    """Return another log of the same truth: a study of noise needs one simulation only.

    What the control loop saw stays as it was; sensors that would change the motion want a run of their own.

    Raises:
        UsageError: sensors that cannot be.
    """
    check_sensors(sensors, run.q.shape[1])

    def read(
        position: FloatArray, late: float, offset: tuple[float, ...], counts: float | None
    ) -> FloatArray:
        step = np.zeros_like(run.turn) if counts is None else run.turn / counts
        return find_readings(run.time, position, delay=max(late, 0.0), offset=offset, step=step)

    return Recording(
        time=run.time,
        position=read(run.q, sensors.delay, sensors.link_offset, sensors.link_counts),
        motor_position=read(run.theta, -sensors.delay, sensors.motor_offset, sensors.motor_counts),
        torque=add_motor_noise(run.torque, sensors, rng),
        source=run.recording.source,
        notices=run.notices,
    )
