"""What simulations and fits run for long, compiled once, kept in the cache, called without copies.

    plant     of elastic robots: one file that knows no robot calls the robot's functions by their addresses.
              Records are plain arrays: n joints with m stops and l knees each; what a joint lacks has a
              weight or slope of zero. Springs of other kinds are compiled for their numbers.
    branch    of an element along a recording: its step, as C of CasADi, in one loop over the samples, for
              all numbers of a structure; the bytes of CasADi's virtual machine, sooner.

Supported: libraries in double precision; several processes at once; branches on machines without a compiler,
or without a place for what it makes: there the virtual machine steps.
Not supported: the plant without a compiler (the simulation has a NumPy version for that); anything that
changes during an experiment but the references; derivatives of branches.
"""

import ctypes
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen.cache import CacheEntry, obtain_entry
from symid.codegen.compiler import Compiler, compile_sources, locate_compiler
from symid.codegen.element_code import build_step
from symid.codegen.library import Library, open_shared
from symid.codegen.printing import print_c
from symid.codegen.source_text import build_library_prefix, write_template
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice, OutputError
from symid.joint_models import (
    REFERENCE_TEMPERATURE,
    BranchPath,
    Elasticity,
    SteppedBranch,
    build_branch_step,
    build_float_carrier,
    run_branch,
    strip_branch,
)
from symid.serialization import compute_signature


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantRobot(FrozenArrays):
    """Numbers of an elastic robot, SI units.

    Args:
        beta: (p,). friction: (pf,). rotor: (n,) kg m^2 or kg.
        stiffness: k0 (n,). cubic: k3 (n,). damping: D (n,).
        radius: r_i (n, m), rad or m. weight: k_i (n, m), N m/rad or N/m.
        knee: R_j (n, l), N m or N, never 0. slope: s_j (n, l).
    """

    beta: FloatArray
    friction: FloatArray
    rotor: FloatArray
    stiffness: FloatArray
    cubic: FloatArray
    damping: FloatArray
    radius: FloatArray
    weight: FloatArray
    knee: FloatArray
    slope: FloatArray

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.rotor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantExperiment(FrozenArrays):
    """An experiment: references of the motors at every tick, and where the robot starts, at rest.

        tau = clamp(Kp (angle - theta) + Kd (speed - dtheta) + torque, limit),   held until the next tick

    Args:
        angle, speed, torque: (N, n) references of the motors, joint side.
        stiffness: Kp (n,). damping: Kd (n,). limit: (n,), infinite for none.
        step: (n,) of the encoders in the loop, 0 for perfect ones.
        period: of a tick, s. substeps: Runge-Kutta steps a tick. parts: pieces of a step in which a spring
            bends.
        q, theta: (n,) at the start. play: P_i (n, m) there, or the states of springs of other kinds.
    """

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    limit: FloatArray
    step: FloatArray
    period: float
    substeps: int
    parts: int
    q: FloatArray
    theta: FloatArray
    play: FloatArray

    @property
    def ticks(self) -> int:
        """Return the number of ticks N."""
        return len(self.angle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantLog:
    """The truth at every tick, (N, n) each; the last four in J since the start.

    Args:
        q, dq, theta, dtheta: link and motor, joint side. spring: tau_J. torque: held from each tick to the
            next; the last one does nothing.
        work: of the motors. friction: lost in it. elastic: int S(v) dphi, stored and lost.
        damped: int D dphi^2 dt.
        ticks: number of valid ones; fewer than N where the state was no longer finite.

    The arrays are made read-only in place.
    """

    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    spring: FloatArray
    torque: FloatArray
    work: FloatArray
    friction: FloatArray
    elastic: FloatArray
    damped: FloatArray
    ticks: int

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for field in fields(self):
            if field.name != "ticks":
                getattr(self, field.name).setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidPlantRobot(FrozenArrays):
    """Numbers of a rigid robot, SI units; lines of friction have rows of standstill, ahead and back.

    Args:
        beta: (p,). friction: (pf,). viscous, level: (3, n), zero in the first row.
        curved, varying, bristled: (n,) 1 where friction is a curve, depends on position or load, has a state.
        owner, stiffness, element: (m,) coordinate, N m/rad or N/m, and kind of each deflection.
    """

    beta: FloatArray
    friction: FloatArray
    viscous: FloatArray
    level: FloatArray
    curved: FloatArray
    varying: FloatArray
    bristled: FloatArray
    owner: FloatArray
    stiffness: FloatArray
    element: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidExperiment(FrozenArrays):
    """An experiment: references at every tick, and where the robot and its controller start.

        tau = clamp(torque + Kp (position - q_m) + Kd (speed - v), limit),   held until the next tick
        v += blend (v_m - v),   v_m = difference of q_m, or dq where it is sensed

    Args:
        position, speed, torque: (N, n) references, and a torque that is added.
        stiffness: Kp (n,). damping: Kd (n,). limit: (n,), infinite for none.
        step: (n,) of the encoders, 0 for perfect ones. reach: (n,) largest distance from the reference.
        period: of a tick, s. substeps: Runge-Kutta steps a tick. blend: of the velocity's low-pass.
        sensed: whether velocities come from a sensor. controlled: whether their error shortens all steps.
        q, dq: (n,) at the start. measured, velocity: (n,) what the controller knows from the tick before.
    """

    position: FloatArray
    speed: FloatArray
    torque: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    limit: FloatArray
    step: FloatArray
    reach: FloatArray
    period: float
    substeps: int
    blend: float
    sensed: bool
    q: FloatArray
    dq: FloatArray
    measured: FloatArray
    velocity: FloatArray
    controlled: bool = False


RIGID_ENDS = ("well", "away", "chatter", "steep", "unsettled")
"""Why an experiment ended: at its end, far from the reference, by endless stops, by friction too steep, by no
answer to which joints rest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidLog(FrozenArrays):
    """The truth at every tick; the arrays have as many rows as were simulated.

    Args:
        q, dq, torque: (N, n); a torque holds from its tick to the next, the last one does nothing.
        z: (N, m) deflections. work, lost: (N,) J since the start.
        end: one of `RIGID_ENDS`. events: how often a joint came to rest or turned.
    """

    q: FloatArray
    dq: FloatArray
    torque: FloatArray
    z: FloatArray
    work: FloatArray
    lost: FloatArray
    end: str
    events: int


_PLANT_FILES = ("plant_calls.h", "elastic_plant.c", "rigid_plant.c")
_ELEMENT = "symid_plant_pull"
_BRANCH = "symid_branch"
_READS = {"q": 1, "load": 2, "temperature": 4}
_TABLES = ("rotor", "stiffness", "cubic", "damping", "radius", "weight", "knee", "slope")
_REFERENCES = ("angle", "speed", "torque", "stiffness", "damping", "limit", "step")
RIGID_FUNCTIONS = ("forward_dynamics", "mass_matrix", "bias")
"""That a rigid robot's plant calls, beside those of friction."""
_RIGID_TABLES = (
    *("viscous", "level", "curved", "varying", "bristled"),
    *("owner", "stiffness", "element"),
)
_RIGID_REFERENCES = ("position", "speed", "torque", "stiffness", "damping", "limit", "step", "reach")
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


def _pack(*values: ctypes.c_double | int | FloatArray | None) -> ctypes.Structure:
    """Return a record of C: numbers, sizes and addresses (integers), pointers to arrays that live on."""
    plain = [
        value.ctypes.data if isinstance(value, np.ndarray) else getattr(value, "value", value) or 0
        for value in values
    ]
    kinds = [ctypes.c_double if isinstance(value, ctypes.c_double) else ctypes.c_size_t for value in values]
    names = [(f"field{number}", kind) for number, kind in enumerate(kinds)]
    record: type[ctypes.Structure] = type("Record", (ctypes.Structure,), {"_fields_": names})
    return record(*plain)


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledPlant:
    """The loaded code; `notices` name its folder if that is not the user's cache.

    `springs`: the function of springs that no table holds, and what it computes torques of; None for tables.
    """

    shared: ctypes.CDLL
    springs: ctypes.CDLL | None = None
    notices: tuple[Notice, ...] = ()

    def run(self, library: Library, robot: PlantRobot, order: PlantExperiment) -> PlantLog:
        """Return what happens to the robot, whose functions `library` has; see `PlantExperiment`.

        Raises:
            GenerationError: the library is none of compiled functions in double precision.
        """
        shape, warm = (order.ticks, robot.size), np.full(robot.size, REFERENCE_TEMPERATURE)
        arrays = {name: np.zeros(shape) for name in _LOGGED}
        size = ctypes.c_size_t
        sizes = (size(robot.size), size(order.play.shape[1]))
        self.shared.symid_plant_scratch.restype = self.shared.symid_plant_run.restype = size
        memory = np.zeros(self.shared.symid_plant_scratch(*sizes))
        start = np.concatenate([order.q, np.zeros(robot.size), order.theta, np.zeros(robot.size)])
        plant = _pack(
            robot.size,
            order.play.shape[1],
            robot.knee.shape[1],
            None if self.springs is None else _get_address(self.springs, _ELEMENT),
            _get_function_address(library, "forward_dynamics"),
            *_list_friction(library, robot.friction, warm),
            robot.beta,
            *(getattr(robot, name) for name in _TABLES),
        )
        references = (getattr(order, name) for name in _REFERENCES)
        experiment = _pack(
            order.ticks, order.substeps, order.parts, ctypes.c_double(order.period), *references
        )
        answer = _pack(*arrays.values())
        inputs = tuple(ctypes.c_void_p(array.ctypes.data) for array in (start, order.play, memory))
        ticks = self.shared.symid_plant_run(
            ctypes.byref(plant), ctypes.byref(experiment), *inputs, ctypes.byref(answer)
        )
        return PlantLog(**arrays, ticks=int(ticks))

    def run_rigid(self, library: Library, robot: RigidPlantRobot, order: RigidExperiment) -> RigidLog:
        """Return what happens to a rigid robot, whose functions `library` has; see `RigidExperiment`.

        Raises:
            GenerationError: the library is none of compiled functions in double precision.
        """
        (ticks, size), bends = order.position.shape, len(robot.owner)
        warm, end = np.full(size, REFERENCE_TEMPERATURE), np.zeros(2)
        widths = (size, size, size, bends, 1, 1)
        arrays = [np.zeros((ticks, width)) for width in widths]
        self.shared.symid_rigid_scratch.restype = self.shared.symid_rigid_run.restype = ctypes.c_size_t
        memory = np.zeros(self.shared.symid_rigid_scratch(*map(ctypes.c_size_t, (size, bends))))
        start = np.concatenate([order.q, order.dq, np.sign(order.dq), order.measured, order.velocity])
        flags = (int(bool(part.any())) for part in (robot.curved, robot.varying))
        functions = (_get_function_address(library, name) for name in RIGID_FUNCTIONS)
        friction = _list_friction(library, robot.friction, warm, bends=bends > 0)
        tables = (getattr(robot, name) for name in _RIGID_TABLES)
        plant = _pack(size, bends, *flags, int(order.controlled), *functions, *friction, robot.beta, *tables)
        references = (getattr(order, name) for name in _RIGID_REFERENCES)
        sizes, times = (ticks, order.substeps, int(order.sensed)), (order.period, order.blend)
        records = (plant, _pack(*sizes, *map(ctypes.c_double, times), *references), _pack(*arrays, end))
        robot_given, order_given, answer = map(ctypes.byref, records)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (start, memory))
        count = int(self.shared.symid_rigid_run(robot_given, order_given, *pointers, answer))
        q, dq, torque, z, work, lost = (array[:count] for array in arrays)
        return RigidLog(
            q=q,
            dq=dq,
            torque=torque,
            z=z,
            work=work[:, 0],
            lost=lost[:, 0],
            end=RIGID_ENDS[int(end[0])],
            events=int(end[1]),
        )


def has_addresses(library: Library, names: Sequence[str] = ()) -> bool:
    """Return whether the library's functions are compiled, in double precision; CasADi's C counts as well.

    `names` are those that must have an address: a folder that an older symid wrote has fewer.
    """
    shared, prefix = library.engine.addresses, build_library_prefix(library.card.robot)
    return shared is not None and all(hasattr(shared, f"{prefix}_{name}") for name in names)


def _get_function_address(library: Library, name: str) -> int:
    shared = library.engine.addresses
    if shared is None:
        text = f"the library of {library.card.robot!r} has no compiled functions in double precision"
        raise GenerationError(Notice(code="codegen.no-address", text=text))
    return _get_address(shared, f"{build_library_prefix(library.card.robot)}_{name}")


def _get_address(shared: ctypes.CDLL, name: str) -> int:
    return int(ctypes.cast(getattr(shared, name), ctypes.c_void_p).value or 0)


def _list_friction(
    library: Library, values: FloatArray, warm: FloatArray, *, bends: bool = False
) -> tuple[int | FloatArray | None, ...]:
    """Return how the plants call the robot's friction, with values (p,) at temperatures `warm` (n,)."""
    return (
        _get_function_address(library, "friction") if values.size else None,
        _get_function_address(library, "friction_step") if bends else None,
        sum(_READS[name] for name in library.card.friction_inputs),
        warm,
        values,
    )


def load_plant_code(
    springs: tuple[Elasticity, ...] = (), *, compiler: str | None = None, cache: Path | None = None
) -> CompiledPlant | None:
    """Return the compiled plant, from the cache or made now; None on a machine without a C compiler.

    Args:
        springs: of all joints where one of them fits no table of stops and knees; none where all do.
        compiler: command of the C compiler; None for the first of cc, gcc, clang.
        cache: folder to keep it in; None for the user's, or a temporary one with a notice.

    Raises:
        GenerationError: the compiler fails, or what it made cannot be loaded.
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    found = locate_compiler(compiler)
    if found is None:
        return None
    folder = locate_resource_folder("templates") / "c"
    files = {name: (folder / name).read_text(encoding="utf-8") for name in _PLANT_FILES}
    shared, notices = _obtain_code("plant", files, found, cache)
    if not springs:
        return CompiledPlant(shared=shared, notices=notices)
    own, more = _obtain_code("springs", {"springs.c": write_springs(springs)}, found, cache)
    return CompiledPlant(shared=shared, springs=own, notices=tuple(dict.fromkeys((*notices, *more))))


def _obtain_code(
    name: str, files: Mapping[str, str], compiler: Compiler, cache: Path | None
) -> tuple[ctypes.CDLL, tuple[Notice, ...]]:
    """Return the library of some files of C, from the cache or made now, and notices."""
    binary = f"{name}.so"

    def make(folder: Path) -> None:
        folder.mkdir()
        for path, text in files.items():
            (folder / path).write_text(text, encoding="utf-8")
        sources = [folder / path for path in files if path.endswith(".c")]
        compile_sources(compiler, sources, folder / binary)

    key = compute_signature(name, files, compiler, (platform.system(), platform.machine()))
    entry = CacheEntry(name=name, key=key, make=make, load=lambda folder: open_shared(folder / binary))
    return obtain_entry(entry, cache)


def write_springs(springs: tuple[Elasticity, ...]) -> str:
    """Return the C of a function that computes the torque of any of these springs, without damping."""
    helpers: list[str] = []
    joints = []
    for spring in springs:
        program = build_step(replace(spring, damping=0.0), rated=True)
        body = print_c(program, "double")
        helpers += [helper for helper in body.helpers if helper not in helpers]
        joints.append({"lines": body.statements, "size": program.spec.inputs[1].size})
    return write_template("element/springs.c.jinja", {"helpers": helpers, "joints": joints, "name": _ELEMENT})


def run_compiled_branch(branch: SteppedBranch, path: BranchPath, states: FloatArray) -> FloatArray:
    """Return states (n), force and energy of a branch after every sample of a path, (N, n + 2)."""
    call = _load_branch(strip_branch(branch))
    if call is None:
        return run_branch(branch, path, states)
    position, way, velocity, period = path
    motions = np.ascontiguousarray(np.vstack([position, way, velocity, period]), dtype=np.float64)
    numbers = np.array(list(branch.list_values().values()), dtype=np.float64)
    # The code writes as many states as the branch has, whatever it is given.
    size = len(branch.start(build_float_carrier(), 0.0, 0.0))
    before = np.array(np.broadcast_to(states, size), dtype=np.float64)
    after = np.empty((motions.shape[1], size + 2))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (motions, numbers, before, after))
    call(ctypes.c_size_t(len(after)), *pointers)
    return after


@lru_cache(maxsize=64)
def _load_branch(plain: SteppedBranch) -> Callable[..., None] | None:
    """Return the compiled loop of a structure; None where this machine makes none."""
    compiler = locate_compiler()
    if compiler is None:
        return None
    try:
        shared, _ = _obtain_code("branch", {"branch.c": write_branch(plain)}, compiler, None)
    except (GenerationError, OutputError):
        # Nothing is lost but time.
        return None
    found: Callable[..., None] = getattr(shared, _BRANCH)
    return found


def write_branch(plain: SteppedBranch) -> str:
    """Return the C of a structure's loop."""
    import casadi

    step = build_branch_step(plain)
    generator = casadi.CodeGenerator("step")
    generator.add(step)
    return write_template(
        "element/branch.c.jinja", {"step": generator.dump(), "size": step.size1_out(0), "name": _BRANCH}
    )
