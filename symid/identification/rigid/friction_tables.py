"""Tables of friction laws: the columns of all laws at many shape values beside those of the rigid robot.

Library, recordings -> `Motion`; Motion, laws at shape values -> `JointTable`, sums of products by stretches.

Columns and torque are averaged over windows: a linear filter that all pass alike, that reaches no further,
and that needs no sample near standstill, where a joint may stick. Rigid columns are computed along positions
of a lower cut-off than the columns of friction, which bend where the velocity turns.

A joint whose load was measured behind its gear needs no model of the links: its torque is that of the motor
less the load, and its columns X are those of rotors.

Supported: every static law; several recordings; loads measured behind the gears, or computed; payloads.
Not supported: windows of other lengths for other joints.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import regression
from symid.identification.regression import measure_scoring_band
from symid.joint_models import (
    FrictionLaw,
    build_numpy_carrier,
    compute_column_derivatives,
    compute_columns,
    get_law,
)
from symid.logs import Recording, Signals, differentiate, low_pass
from symid.robot import Processing

_BLOCK = 8192
"""Samples whose regressor is in memory."""
_STRETCHES = 10
"""Held out in turn, of all logs together; two a log at least."""
_NODES = (12, 7, 6)
"""Of each shape value, for laws with one, two and three."""
_FINER = (0.0, -1.0 / 3.0, 1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0)
"""Places of the second nodes about the best one, in the first distances."""
_SUPPORTED = 1.5
"""Times the slowest speed that counts: no shape value that is a speed is less."""
_NOISE = 3.0
"""Standard deviations of the velocity's noise below which a row does not count: its sign is not known."""
_BLUR = 3.0
"""Times what a velocity changes in the time of the low-pass, below which a row does not count."""
Inputs = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class TangentLaw(FrictionLaw):
    """A law made linear about shape values: its columns, and their change with each shape value.

        Phi(s + d) c = Phi(s) c + sum_j d_j (sum_k c_k dPhi_k / ds_j)

    `about` are the shape values, `values` the linear ones c.
    """

    about: tuple[float, ...]
    values: tuple[float, ...]

    @classmethod
    def build(cls, law: FrictionLaw, about: Sequence[float], values: Sequence[float]) -> "TangentLaw":
        """Return the law about shape values (s,) and linear values (p,)."""
        about, values = tuple(map(float, about)), tuple(map(float, values))

        def compute(_carrier: object, inputs: Inputs, _shape: object) -> tuple[FloatArray, ...]:
            with np.errstate(over="ignore", under="ignore"):
                own = compute_columns(law, inputs, about)
                slopes = np.einsum("nps,p->ns", compute_column_derivatives(law, inputs, about), values)
            return *own.T, *slopes.T

        parts = {entry.name: getattr(law, entry.name) for entry in fields(FrictionLaw)}
        parts |= {"linear": (*law.linear, *law.shape), "shape": (), "columns": compute}
        return cls(**parts, about=about, values=values)

    def move(self, found: Sequence[float], bounds: Sequence[tuple[float, float]]) -> "TangentLaw":
        """Return the law about the values (p + s,) that a fit found, within `bounds` of its shape values."""
        count = len(self.values)
        steps = zip(self.about, found[count:], bounds, strict=True)
        about = [
            float(np.clip(value + step, max(low, value / _STEP), min(high, value * _STEP)))
            for value, step, (low, high) in steps
        ]
        return TangentLaw.build(get_law(self.name), about, found[:count])


_STEP = 1.5
"""Factor by which a shape value moves at most in a linear step."""


class Node(NamedTuple):
    """A law at shape values; `places` are its columns in the table of its joint."""

    law: FrictionLaw
    shape: tuple[float, ...]
    places: tuple[int, ...]


class JointTable(NamedTuple):
    """Sums of products of one joint.

    `grams` (S, k, k) are of [X D y] in every stretch: y is last, D has the columns of all `nodes`, X `shared`
    columns; `rows` (S,) were counted.
    """

    grams: FloatArray
    shared: int
    rows: NDArray[np.intp]
    nodes: tuple[Node, ...]


def list_shape_nodes(law: FrictionLaw, speeds: FloatArray) -> list[tuple[float, ...]]:
    """Return the nodes of a law's shape values for a motion at `speeds` (N,), rad/s or m/s; one without any.

    Speeds lie between those of the slowest hundredth of the samples and the fastest.
    """
    if not law.shape:
        return [()]
    count = _NODES[len(law.shape) - 1]
    axes = [np.geomspace(*bound_shape(law, k, speeds), count) for k in range(len(law.shape))]
    return [point for point in map(tuple, itertools.product(*axes)) if _is_sensible(law, point)]


def bound_shape(law: FrictionLaw, place: int, speeds: FloatArray) -> tuple[float, float]:
    """Return the least and the largest value that a motion at `speeds` (N,) supports of a shape value."""
    fastest = float(np.max(speeds))
    slowest = max(_SUPPORTED * float(np.min(speeds)), float(np.quantile(speeds, 0.01)), 1e-3 * fastest)
    entry = law.shape[place]
    match entry.unit:
        case "rad/s":
            return (slowest, 0.2 * fastest) if entry.name.startswith("dq") else (slowest, fastest)
        case "s/rad":
            return 0.3 / fastest, 1.0 / slowest
        case "K":
            return 5.0, 100.0
    return max(entry.lower, 0.1), entry.upper


def _is_sensible(law: FrictionLaw, shape: Sequence[float]) -> bool:
    """Return whether shape values are not the exchange of others, or an edge beyond the fall."""
    named = {entry.name: value for entry, value in zip(law.shape, shape, strict=True)}
    if "g2" in named:
        return named["g2"] > 1.5 * named["g3"]
    return "dq0" not in named or named["dq0"] <= named["vs"]


def refine_nodes(law: FrictionLaw, best: Sequence[float], speeds: FloatArray) -> list[tuple[float, ...]]:
    """Return closer nodes about the best of `list_shape_nodes`."""
    axes = []
    for place, value in enumerate(best):
        low, high = bound_shape(law, place, speeds)
        step = np.log(high / low) / (_NODES[len(law.shape) - 1] - 1)
        axes.append(np.unique(np.clip(value * np.exp(step * np.array(_FINER)), low, high)))
    return [point for point in map(tuple, itertools.product(*axes)) if _is_sensible(law, point)]


def gather_inputs(signals: Signals, part: slice | NDArray[np.intp], joint: int) -> dict[str, FloatArray]:
    """Return the inputs (k,) of a joint's laws that are known."""
    q, dq, _, load, warmth = signals.pick_states(part)
    arrays = {"velocity": dq, "position": q, "load": load, "temperature": warmth}
    return {name: values[:, joint] for name, values in arrays.items() if values is not None}


Made = Sequence[tuple[FrictionLaw, tuple[float, ...], tuple[int, ...]]]
"""Laws at shape values, and which of their columns are in a table."""


def _list_columns(wanted: "Wanted", probe: Inputs) -> tuple[tuple[Node, ...], Made]:
    """Return the nodes of a joint, and the columns to make for them: those that agree at `probe` are one."""
    made: list[tuple[FrictionLaw, tuple[float, ...], tuple[int, ...]]] = []
    known: dict[bytes, int] = {}
    nodes = []
    for law, shape in wanted:
        places, new = [], []
        for k, column in enumerate(_evaluate(law, shape, probe)):
            key = np.ascontiguousarray(np.broadcast_to(column, probe["velocity"].shape)).tobytes()
            if key not in known:
                known[key] = len(known)
                new.append(k)
            places.append(known[key])
        if new:
            made.append((law, shape, tuple(new)))
        nodes.append(Node(law, shape, tuple(places)))
    return tuple(nodes), made


def _evaluate(law: FrictionLaw, shape: Sequence[float], inputs: Inputs) -> tuple[FloatArray, ...]:
    with np.errstate(over="ignore", under="ignore"):
        return law.columns(build_numpy_carrier(), inputs, [np.float64(value) for value in shape])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Recordings as filtered states.

    Args:
        smooth: for the rigid columns, at a cut-off that keeps noise out of accelerations.
        signals: for the columns of friction, at a cut-off that keeps velocities sharp.
        width: samples of a window; reach: samples about one that does not count that do not count either.
        slowest: (n,) speeds that count; extra: columns of coupled drives.
        measured: (n,) joints whose `tau` is that of the motor less the load; rotors: of coupled drives.
        payloads: (p,) base parameters that known payloads add, one a recording; None without.
    """

    library: Library
    smooth: tuple[Signals, ...]
    signals: tuple[Signals, ...]
    width: int
    reach: int
    slowest: FloatArray
    extra: NDArray[np.intp]
    measured: tuple[bool, ...]
    rotors: tuple[regression.Rotor, ...]
    payloads: tuple[FloatArray | None, ...]

    def share_columns(self, run: int, part: slice) -> FloatArray:
        """Return X (k, n, p)."""
        q, dq, ddq, *_ = self.smooth[run].pick_states(part)
        (rigid,) = self.library.evaluate("torque_regressor", q, dq, ddq)
        columns = [rigid]
        if len(self.extra):
            (friction,) = self.library.evaluate("friction_regressor", dq)
            columns.append(friction[:, :, self.extra])
        if any(self.measured):
            own = np.array(self.measured)[:, None]
            columns[0] = np.where(own, 0.0, rigid)
            columns.append(np.where(own, regression.compute_rotor_columns(ddq, self.rotors), 0.0))
        return np.concatenate(columns, axis=2)

    def speeds(self, joint: int) -> FloatArray:
        """Return the speeds of a joint at all samples that count."""
        found = np.abs(np.concatenate([entry.dq[:, joint] for entry in self.signals]))
        return np.asarray(found[found >= self.slowest[joint]])


_WINDOW = 0.25
"""Of the period of the scoring band: length of a window. More of the band is noise."""
_SHARP = 10.0
"""Times the scoring band: cut-off of the rigid columns."""


def balance_cutoff(recordings: Sequence[Recording]) -> float:
    """Return the cut-off in Hz at which noise and blur of the velocities are equal, the mean of joints.

    Columns of friction bend where the velocity turns, and want a sharp velocity; noise in the accelerations
    is taken out by the decimation, as their columns are linear in it.
    """
    found = []
    for recording in recordings:
        smooth = low_pass(recording.position, period=recording.period, cutoff=_TURNS, order=2)
        bend = differentiate(differentiate(smooth, recording.period), recording.period)
        turning = np.sqrt(np.mean(bend**2, axis=0))
        for band, rate in zip(regression.measure_bands(recording), turning.tolist(), strict=False):
            if band.clean > 0.0:
                power = _BLUR * rate * np.sqrt(3.0) / (_NOISE * (2.0 * np.pi) ** 2 * max(band.floor, 1e-300))
                found.append(power**0.4)
    return float(np.median(found)) if found else 0.0


_TURNS = 10.0
"""Hz, within which joints turn."""


def prepare_motion(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rotors: Sequence[regression.Rotor] = (),
) -> Motion:
    """Return the filtered motion, with torques of motors less loads where these were measured.

    The velocity's noise follows from the floor of the position's spectrum.
    """
    measured = regression.list_measured_joints(recordings)
    rate, band = 1.0 / recordings[0].period, measure_scoring_band(recordings)
    smooth, sharp = (min(cutoff, 0.4 * rate) for cutoff in (_SHARP * band, balance_cutoff(recordings)))
    sharp = max(smooth, sharp)

    def filter_states(cutoff: float) -> tuple[Signals, ...]:
        settings = replace(processing, filter_cutoff=cutoff, standstill=None, automatic=False)
        found = []
        for entry in recordings:
            signals = regression.prepare_states(library, regression.subtract_loads(entry, measured), settings)
            payload = regression.compute_payload_torque(library, signals, entry)
            if payload is not None and any(measured):
                # The sensor bears the payload, whose torque was subtracted a second time.
                tau = signals.tau + np.where(np.array(measured), payload, 0.0)
                signals = replace(signals, tau=tau)
            found.append(signals)
        return tuple(found)

    signals, slowest = filter_states(sharp), np.zeros(library.card.size)
    for recording, entry in zip(recordings, signals, strict=True):
        floors = np.array([one.floor for one in regression.measure_bands(recording)])
        noise = 2.0 * np.pi * floors * np.sqrt(sharp**3 / 3.0)
        # What the low-pass makes of a velocity that turns, or stops.
        blur = np.sqrt(np.mean(entry.ddq**2, axis=0)) / (2.0 * np.pi * sharp)
        slowest = np.maximum(slowest, np.maximum(_NOISE * noise, _BLUR * blur))
    own = {joint.name for joint in library.card.joints}
    extra = [k for k, entry in enumerate(library.card.friction) if entry.joint not in own]
    return Motion(
        library=library,
        smooth=filter_states(smooth),
        signals=signals,
        width=max(1, round(_WINDOW * rate / band)),
        reach=round(rate / smooth),
        slowest=slowest,
        extra=np.array(extra, dtype=np.intp),
        measured=measured,
        rotors=tuple(rotors),
        payloads=tuple(regression.get_payload(library, entry) for entry in recordings),
    )


Wanted = Sequence[tuple[FrictionLaw, tuple[float, ...]]]


def tabulate_laws(motion: Motion, wanted: Sequence[Wanted]) -> list[JointTable]:
    """Return the sums of products of all joints, each with all its nodes `wanted`."""
    tables = []
    for joint, nodes in enumerate(wanted):
        places = np.linspace(0, len(motion.signals[0].time) - 1, 64).astype(int)
        tables.append(_list_columns(nodes, gather_inputs(motion.signals[0], places, joint)))
    each = max(2, -(-_STRETCHES // len(motion.signals)))
    grams: list[list[FloatArray]] = [[] for _ in wanted]
    counts: list[list[int]] = [[] for _ in wanted]
    shared = 0
    for run, signals in enumerate(motion.signals):
        width, reach, count = motion.width, motion.reach, len(signals.time)
        windows = np.array_split(np.arange(count // width), each)
        # Windows without a slow sample, nor one within reach of them.
        starts = width * np.arange(count // width)
        low, high = np.maximum(starts - reach, 0), np.minimum(starts + width + reach, count)
        slow = [
            np.concatenate([[0], np.cumsum(np.abs(signals.dq[:, j]) <= motion.slowest[j])])
            for j in range(len(wanted))
        ]
        kept = [column[high] == column[low] for column in slow]
        for part in windows:
            whole = [np.zeros(())] * len(wanted)
            for block in np.array_split(part, max(1, len(part) * width // _BLOCK)):
                if not len(block):
                    continue
                span = slice(int(block[0]) * width, (int(block[-1]) + 1) * width)
                rigid = _average(motion.share_columns(run, span), width)
                shared = rigid.shape[2]
                for joint, (_, made) in enumerate(tables):
                    rows, inputs = kept[joint][block], gather_inputs(signals, span, joint)
                    columns = np.zeros((len(inputs["velocity"]), sum(len(new) for *_, new in made)))
                    place = 0
                    for law, shape, new in made:
                        found = _evaluate(law, shape, inputs)
                        for k in new:
                            columns[:, place] = found[k]
                            place += 1
                    own = _average(columns, width)
                    torque = _average(signals.tau[span, joint], width)
                    table = np.column_stack([rigid[rows, joint], own[rows], torque[rows]])
                    whole[joint] = whole[joint] + table.T @ table
            for joint in range(len(wanted)):
                grams[joint].append(whole[joint])
                counts[joint].append(int(kept[joint][part].sum()))
    return [
        JointTable(np.stack(gram), shared, np.array(count, dtype=np.intp), nodes)
        for gram, count, (nodes, _) in zip(grams, counts, tables, strict=True)
    ]


def _average(values: FloatArray, width: int) -> FloatArray:
    """Return the means of `values` (k, ...) over windows."""
    return np.asarray(values.reshape(len(values) // width, width, *values.shape[1:]).mean(axis=1))


def load_joints(motion: Motion, shared: FloatArray) -> Motion:
    """Return the motion with the loads that links, payloads and rotors make, where none were measured."""
    if all(motion.measured):
        return motion
    beta = shared[: len(motion.library.card.beta)]
    found = []
    for smooth, sharp, payload in zip(motion.smooth, motion.signals, motion.payloads, strict=True):
        computed = regression.evaluate_torques(
            motion.library, smooth, beta if payload is None else beta + payload
        )
        found.append(replace(sharp, load=regression.fill_load(sharp.load, computed, motion.measured)))
    return replace(motion, signals=tuple(found))


def measure_gain(
    motion: Motion, joint: int, law: FrictionLaw, shape: tuple[float, ...]
) -> regression.LoadGain | None:
    """Return the factor on a measured load that a joint's windows choose beside a law and rotors."""
    load = replace(
        get_law("load-dependent"), linear=(), columns=lambda _carrier, inputs, _shape: (inputs["load"],)
    )
    wanted: list[Wanted] = [
        [(law, shape), (load, ())] if k == joint else [] for k in range(len(motion.measured))
    ]
    grams = tabulate_laws(motion, wanted)[joint]
    node, other = grams.nodes
    shared = np.arange(grams.shared)
    shared = shared[grams.grams.sum(axis=0)[shared, shared] > 0.0]
    places = [*shared, *(grams.shared + k for k in (*node.places, *other.places)), -1]
    return regression.measure_load_gain(grams.grams[:, places][:, :, places])
