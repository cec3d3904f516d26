"""Tables of friction laws: the columns of all laws at many shape values beside those of the rigid robot.

Library, recordings -> `Motion`; Motion, laws at shape values -> `JointTable`, sums of products by stretches.

Columns and torque are averaged over windows: a linear filter that all pass alike, that reaches no further,
and that needs no sample near standstill, where a joint may stick. Rigid columns are computed along positions
of a lower cut-off than the columns of friction, which bend where the velocity turns. A joint whose load was
measured behind its gear needs no model of the links: its columns X are those of rotors. Stretches are left
out in turn; each is scored in parts of two periods of the scoring band or more.

Not supported: windows of other lengths for other joints.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import regression
from symid.identification.judge import POLICY, numerics
from symid.joint_models import FrictionLaw, compute_columns, compute_law_sensitivities, get_law
from symid.logs import Recording, Signals
from symid.robot import Processing

_NODES = 12
"""Of the shape value of a law with one; with more of them a law has fewer of each."""
_WINDOW = 0.25
"""Of the period of the scoring band: length of a window. More of the band is noise."""
_SHARP = 10.0
"""Times the scoring band: cut-off of the rigid columns."""
Inputs = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class TangentLaw(FrictionLaw):
    """A law made linear about shape values: its columns, and their change with each shape value.

        Phi(s + d) c = Phi(s) c + sum_j d_j (sum_k c_k dPhi_k / ds_j)

    `about` are the shape values, `values` the linear ones c of the law `bent`; `steps` the logarithms of the
    factors that led to the former, none at first.
    """

    bent: FrictionLaw
    about: tuple[float, ...]
    values: tuple[float, ...]
    steps: tuple[float, ...] = ()

    @classmethod
    def build(cls, law: FrictionLaw, about: Sequence[float], values: Sequence[float]) -> "TangentLaw":
        """Return the law about shape values (s,) and linear values (p,)."""
        about, values = tuple(map(float, about)), tuple(map(float, values))

        def compute(_carrier: object, inputs: Inputs, _shape: object) -> tuple[FloatArray, ...]:
            with np.errstate(over="ignore", under="ignore"):
                return tuple(compute_law_sensitivities(law, inputs, values, about).T)

        parts = {entry.name: getattr(law, entry.name) for entry in fields(FrictionLaw)}
        parts |= {"linear": (*law.linear, *law.shape), "shape": (), "columns": compute}
        return cls(**parts, bent=law, about=about, values=values)

    def move(self, found: Sequence[float], speeds: FloatArray) -> "TangentLaw":
        """Return the law about the values (p + s,) that a fit found.

        A step leads no further than to the next node and twice as far as the last one; half as far where it
        turns back.
        """
        count, about, steps = len(self.values), [], []
        for place, (value, change) in enumerate(zip(self.about, found[count:], strict=True)):
            low, high = bound_shape(self.bent, place, speeds)
            reach = math.log(high / low) / (_count_nodes(self.bent) - 1)
            step = math.log(min(max(value + change, low), high) / value)
            if self.steps:
                last = self.steps[place]
                growth = 2.0 * max(abs(last), POLICY.relevance)
                reach = 0.5 * abs(last) if step * last < 0.0 else min(reach, growth)
            steps.append(min(max(step, -reach), reach))
            about.append(value * math.exp(steps[-1]))
        return replace(TangentLaw.build(self.bent, about, found[:count]), steps=tuple(steps))


class Node(NamedTuple):
    """A law at shape values; `places` are its columns in the table of its joint."""

    law: FrictionLaw
    shape: tuple[float, ...]
    places: tuple[int, ...]


class JointTable(NamedTuple):
    """Sums of products of one joint.

    `grams` (b, k, k) are of [X D y] in every part: y is last, D has the columns of all `nodes`, X `shared`
    columns; `fold` (b,) is the stretch that a part is left out with, `rows` (b,) were counted.
    """

    grams: FloatArray
    fold: NDArray[np.intp]
    shared: int
    rows: NDArray[np.intp]
    nodes: tuple[Node, ...]


def _count_nodes(law: FrictionLaw) -> int:
    """Return how many nodes each shape value has."""
    return int(np.round(_NODES ** (2.0 / (1.0 + len(law.shape)))))


def list_shape_nodes(law: FrictionLaw, speeds: FloatArray) -> list[tuple[float, ...]]:
    """Return the nodes of a law's shape values for a motion at `speeds` (N,), rad/s or m/s; one without any.

    Speeds lie between those of the slowest hundredth of the samples and the fastest.
    """
    count, names = _count_nodes(law), [entry.name for entry in law.shape]
    axes = [np.geomspace(*bound_shape(law, k, speeds), count) for k in range(len(law.shape))]
    points = list(itertools.product(*axes))
    # None that is the exchange of another, or an edge beyond the fall.
    if "g2" in names:
        points = [point for point in points if point[names.index("g2")] > point[names.index("g3")]]
    if "dq0" in names:
        points = [point for point in points if point[names.index("dq0")] <= point[names.index("vs")]]
    return points


def bound_shape(law: FrictionLaw, place: int, speeds: FloatArray) -> tuple[float, float]:
    """Return the least and the largest value that a motion at `speeds` (N,) supports of a shape value."""
    fastest = float(np.max(speeds))
    slowest = max(float(np.quantile(speeds, 0.01)), 1e-3 * fastest)
    entry = law.shape[place]
    match entry.unit:
        case "rad/s":
            return (slowest, 0.2 * fastest) if entry.name.startswith("dq") else (slowest, fastest)
        case "s/rad":
            return 0.3 / fastest, 1.0 / slowest
        case "K":
            return 5.0, 100.0
    return max(entry.lower, 0.1), entry.upper


def gather_inputs(signals: Signals, part: slice | NDArray[np.intp], joint: int) -> dict[str, FloatArray]:
    """Return the inputs (k,) of a joint's laws that are known."""
    q, dq, _, load, warmth = signals.pick_states(part)
    arrays = {"velocity": dq, "position": q, "load": load, "temperature": warmth}
    return {name: values[:, joint] for name, values in arrays.items() if values is not None}


Wanted = Sequence[tuple[FrictionLaw, tuple[float, ...]]]
Made = Sequence[tuple[FrictionLaw, tuple[float, ...], list[int]]]
"""Laws at shape values, and which of their columns are in a table."""


def _list_columns(wanted: Wanted, inputs: Inputs) -> tuple[tuple[Node, ...], Made]:
    """Return the nodes of a joint, and the columns to make: those that agree at 1024 samples are one."""
    places = np.linspace(0, len(inputs["velocity"]) - 1, 1024).astype(int)
    probe = {name: values[places] for name, values in inputs.items()}
    made, nodes, known = [], [], dict[bytes, int]()
    for law, shape in wanted:
        keys, new = [column.tobytes() for column in _evaluate(law, shape, probe).T], []
        for k, key in enumerate(keys):
            if key not in known:
                known[key] = len(known)
                new.append(k)
        made.append((law, shape, new))
        nodes.append(Node(law, shape, tuple(known[key] for key in keys)))
    return tuple(nodes), made


def _make_columns(
    made: Made, inputs: Inputs, reduce: Callable[[FloatArray], FloatArray]
) -> Iterator[FloatArray]:
    """Yield columns at inputs (N,) behind a linear operator, law by law."""
    return (reduce(_evaluate(law, shape, inputs)[:, new]) for law, shape, new in made if new)


def _evaluate(law: FrictionLaw, shape: Sequence[float], inputs: Inputs) -> FloatArray:
    with np.errstate(over="ignore", under="ignore"):
        return compute_columns(law, inputs, shape)


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


def prepare_motion(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rotors: Sequence[regression.Rotor] = (),
) -> Motion:
    """Return the filtered motion, with torques of motors less loads where these were measured."""
    measured = regression.list_measured_joints(recordings)
    rate, band = 1.0 / recordings[0].period, regression.measure_scoring_band(recordings)
    smooth = min(_SHARP * band, 0.4 * rate)
    sharp = max(smooth, min(regression.balance_cutoff(recordings), 0.4 * rate))

    def filter_states(cutoff: float) -> tuple[Signals, ...]:
        settings, found = replace(processing, filter_cutoff=cutoff, standstill=None, automatic=False), []
        for entry in recordings:
            signals = regression.prepare_states(library, regression.subtract_loads(entry, measured), settings)
            payload = regression.compute_payload_torque(library, signals, entry)
            if payload is not None and any(measured):
                # The sensor bears the payload, whose torque was subtracted a second time.
                signals = replace(signals, tau=signals.tau + np.where(np.array(measured), payload, 0.0))
            found.append(signals)
        return tuple(found)

    # Deviations by which the sign of a velocity is known.
    sure = float(scipy.special.ndtri(1.0 - POLICY.alarm))
    signals, slowest = filter_states(sharp), np.zeros(library.card.size)
    for recording, entry in zip(recordings, signals, strict=True):
        floors = np.array([one.floor for one in regression.measure_bands(recording)])
        # The velocity's noise follows from the floor of the position's spectrum.
        noise = 2.0 * np.pi * floors * np.sqrt(sharp**3 / 3.0)
        # What the low-pass makes of a velocity that turns, or stops.
        blur = np.sqrt(np.mean(entry.ddq**2, axis=0)) / (2.0 * np.pi * sharp)
        slowest = np.maximum(slowest, sure * np.maximum(noise, blur))
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


def tabulate_laws(motion: Motion, wanted: Sequence[Wanted]) -> list[JointTable]:
    """Return the sums of products of all joints, each with all its nodes `wanted`."""
    probes = [gather_inputs(motion.signals[0], slice(None), joint) for joint in range(len(wanted))]
    tables = list(map(_list_columns, wanted, probes))
    each = max(2, math.ceil(POLICY.folds / len(motion.signals)))
    grams: list[list[FloatArray]] = [[] for _ in wanted]
    counts: list[list[int]] = [[] for _ in wanted]
    fold, shared = list[int](), 0
    for run, signals in enumerate(motion.signals):
        width, reach, count = motion.width, motion.reach, len(signals.time)
        windows = np.arange(count // width)
        # Windows without a slow sample, nor one within reach of them.
        low, high = np.maximum(width * windows - reach, 0), np.minimum(width * windows + width + reach, count)
        slow = np.pad(np.cumsum(np.abs(signals.dq) <= motion.slowest, axis=0), ((1, 0), (0, 0)))
        kept = slow[high] == slow[low]
        parts = int(np.clip(_WINDOW * len(windows) / (each * POLICY.periods), 1, POLICY.parts))
        for place, part in enumerate(np.array_split(windows, each * parts)):
            fold.append(run * each + place // parts)
            whole = [np.zeros(())] * len(wanted)
            for block in np.array_split(part, max(1, len(part) * width // numerics.BLOCK)):
                if not len(block):
                    continue
                span = slice(int(block[0]) * width, (int(block[-1]) + 1) * width)
                rigid = _average(motion.share_columns(run, span), width)
                shared = rigid.shape[2]
                for joint, (_, made) in enumerate(tables):
                    inputs, reduce = gather_inputs(signals, span, joint), partial(_average, width=width)
                    columns = [*_make_columns(made, inputs, reduce), reduce(signals.tau[span, joint])]
                    table = np.column_stack([rigid[:, joint], *columns])[kept[block, joint]]
                    whole[joint] = whole[joint] + table.T @ table
            for joint in range(len(wanted)):
                grams[joint].append(whole[joint])
                counts[joint].append(int(kept[part, joint].sum()))
    return [
        JointTable(np.stack(gram), np.array(fold), shared, np.array(count, dtype=np.intp), nodes)
        for gram, count, (nodes, _) in zip(grams, counts, tables, strict=True)
    ]


def tabulate_rows(  # noqa: PLR0917 - what a joint's rows are made of
    wanted: Wanted,
    inputs: Inputs,
    reduce: Callable[[FloatArray], FloatArray],
    shared: FloatArray,
    torque: FloatArray,
    parts: Sequence[NDArray[np.intp]],
    fold: NDArray[np.intp],
) -> JointTable:
    """Return the sums of products of one joint's rows, with all its nodes `wanted`.

    `inputs` of the laws are (N,) each; `reduce` leads from (N, c) to (M, c), as many rows as the `shared`
    columns beside friction and the `torque` have; `parts` are left out with the stretches `fold` (b,).
    """
    nodes, made = _list_columns(wanted, inputs)
    table = np.column_stack([shared, *_make_columns(made, inputs, reduce), torque])
    grams = np.stack([table[part].T @ table[part] for part in parts])
    rows = np.array([len(part) for part in parts], dtype=np.intp)
    return JointTable(grams, fold, shared.shape[1], rows, nodes)


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
        own = beta if payload is None else beta + payload
        computed = regression.evaluate_torques(motion.library, smooth, own)
        found.append(replace(sharp, load=regression.fill_load(sharp.load, computed, motion.measured)))
    return replace(motion, signals=tuple(found))


def measure_gain(
    motion: Motion, joint: int, law: FrictionLaw, shape: tuple[float, ...]
) -> regression.LoadGain | None:
    """Return the factor on a measured load that a joint's windows choose beside a law and rotors."""
    load = get_law("load-dependent")
    load = replace(load, linear=load.linear[:1], columns=lambda _carrier, inputs, _shape: (inputs["load"],))
    wanted: list[Wanted] = [[] for _ in motion.measured]
    wanted[joint] = [(law, shape), (load, ())]
    table = tabulate_laws(motion, wanted)[joint]
    shared = np.flatnonzero(np.diag(table.grams.sum(axis=0))[: table.shared] > 0.0)
    places = [*shared, *(table.shared + k for node in table.nodes for k in node.places), -1]
    return regression.measure_load_gain(table.grams[:, places][:, :, places])
