"""How an experiment with an elastic robot is run, and what its motors may be told.

Output: `ElasticExperimentOptions`; `MotorReference`.

Supported: clean and noisy experiments ready made; gains, sensors and references of one's own.
Not supported: options that change during a run.
"""

from dataclasses import dataclass, field

from symid.arrays import FloatArray, freeze
from symid.simulation.elastic_sensors import ElasticSensors
from symid.simulation.gains import Gains

__all__ = ["ElasticExperimentOptions", "MotorReference", "build_clean_options", "build_noisy_options"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorReference:
    """What motors are told: `angle`, `speed`, `torque`, each (N, n) at the ticks, joint side, SI units."""

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("angle", "speed", "torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    Args:
        duration: None for the trajectory's own.
        period: of control and log.
        step: longest Runge-Kutta step; fast springs shorten it.
        parts: into which a step is cut where a spring changes its slope.
        gains: of the motors' PD loops; None for those of a shipped robot, else by `bandwidth`.
        bandwidth: of loops with critical damping.
        control_counts: of the motor encoders in the loop, per turn; None for perfect ones.
        sensors: what the log sees.
    """

    duration: float | None = None
    period: float = 1e-3
    step: float = 1e-4
    parts: int = 16
    gains: Gains | None = None
    bandwidth: float = 12.0
    control_counts: float | None = None
    sensors: ElasticSensors = field(default_factory=ElasticSensors)


def build_clean_options() -> ElasticExperimentOptions:
    """Return the options of a clean experiment: 5 kHz, nothing rounded, no noise."""
    return ElasticExperimentOptions(period=2e-4)


def build_noisy_options() -> ElasticExperimentOptions:
    """Return the options of a noisy experiment: 1 kHz, 20 bit encoders, 2 % torque noise."""
    counts = 2.0**20
    sensors = ElasticSensors(motor_counts=counts, link_counts=counts, relative_noise=(0.02,))
    return ElasticExperimentOptions(period=1e-3, control_counts=counts, sensors=sensors)
