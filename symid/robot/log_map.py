"""How the logs of a robot read, and how they are processed.

Input: numbers and names, checked by the readers. Output: `LogMap` and `Processing`, parts of `Robot`.

Supported: a column per joint or an array for all joints, units of the closed table.
"""

from dataclasses import dataclass, field

__all__ = ["Decimation", "LogMap", "LogQuantity", "Processing"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogQuantity:
    """Where a quantity stands in a log.

    `columns`: one name per joint, or one name of an array with a column per joint.
    `unit`: of the logged numbers *after* multiplication by `factor` is not applied: the unit is
    that of the raw column; `factor` (one per joint or one for all) turns raw SI into the quantity,
    for example N/V for a motor command in volt. `side` is "joint" or "motor": where the quantity,
    after `factor`, was measured; what is meant on the motor side is converted with the gear ratios, or
    with the transmission matrix where the map has one. `offset` (rad or m, one per joint or one for all)
    is added to a position last, on the joint side.
    """

    columns: tuple[str, ...]
    unit: str
    factor: tuple[float, ...] = (1.0,)
    side: str = "joint"
    offset: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMap:
    """Which column of a log is what. A quantity that is None is looked up under its own name.

    `transmission` is the matrix T (n, n) of motors that move more than one joint: angles of the motors =
    T (angles of the joints), and so torques of the joints = T' (torques of the motors). None: gear ratios.
    `preset` names the program that wrote the log, whose columns stand in for quantities that are None.
    `reference`, `reference_velocity` are what the controller was asked to follow, `feedforward` the torque
    that it added to its own.
    """

    time: LogQuantity | None = None
    position: LogQuantity | None = None
    velocity: LogQuantity | None = None
    torque: LogQuantity | None = None
    motor_position: LogQuantity | None = None
    link_position: LogQuantity | None = None
    reference: LogQuantity | None = None
    reference_velocity: LogQuantity | None = None
    feedforward: LogQuantity | None = None
    transmission: tuple[tuple[float, ...], ...] | None = None
    preset: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decimation:
    """Zero-phase Chebyshev I low-pass and one sample in `factor`, applied alike to all columns.

    `band` is the pass band's edge as a fraction of the new Nyquist frequency.
    """

    factor: int = 1
    order: int = 8
    ripple_db: float = 0.05
    band: float = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Processing:
    """From a recording to states: zero-phase Butterworth, central differences, cut ends, decimation.

    `filter_cutoff` in Hz, None for no filter; `filter_torque` whether the torque passes it too;
    `drop_first`, `drop_last` samples cut off after differentiation; `standstill` the speed (rad/s or
    m/s) below which a joint's rows are left out, because dry friction there is not a function of
    velocity; `noise_freedom` what |e|^2 of m rows is divided by to get the variance of the noise, k
    parameters fitted: "band" m b - k, b the part of the band that decimation lets pass (rows behind a
    filter are not independent), "parameters" m - k, "one" m - 1, as some publications do;
    `automatic` that a cut-off and a decimation that are not stated follow from the sample rate.
    """

    filter_order: int = 4
    filter_cutoff: float | None = None
    filter_torque: bool = False
    drop_first: int = 0
    drop_last: int = 0
    standstill: float = 0.0
    noise_freedom: str = "band"
    automatic: bool = False
    decimation: Decimation = field(default_factory=Decimation)
