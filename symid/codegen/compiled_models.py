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
from collections.abc import Callable
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


_ELEMENT = "symid_plant_pull"
_BRANCH = "symid_branch"
_READS = {"q": 1, "load": 2, "temperature": 4}
_SIZES = ("n", "m", "l")
_TABLES = ("rotor", "stiffness", "cubic", "damping", "radius", "weight", "knee", "slope")
_REFERENCES = ("angle", "speed", "torque", "stiffness", "damping", "limit", "step")
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


class _RobotStruct(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_size_t) for name in _SIZES),
        *((name, ctypes.c_void_p) for name in ("element", "forward", "friction")),
        ("reads", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("temperature", "beta", "f", *_TABLES)),
    )


class _ExperimentStruct(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_size_t) for name in ("ticks", "substeps", "parts")),
        ("period", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in _REFERENCES),
    )


class _LogStruct(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in _LOGGED)


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
        plant = _RobotStruct(
            **dict(zip(_SIZES, (*sizes, robot.knee.shape[1]), strict=True)),
            element=None if self.springs is None else _get_address(self.springs, _ELEMENT),
            forward=_get_function_address(library, "forward_dynamics"),
            friction=_get_function_address(library, "friction") if robot.friction.size else None,
            reads=sum(_READS[name] for name in library.card.friction_inputs),
            temperature=warm.ctypes.data,
            beta=robot.beta.ctypes.data,
            f=robot.friction.ctypes.data,
            **_get_pointers(robot, _TABLES),
        )
        experiment = _ExperimentStruct(
            ticks=order.ticks,
            substeps=order.substeps,
            parts=order.parts,
            period=order.period,
            **_get_pointers(order, _REFERENCES),
        )
        answer = _LogStruct(**{name: array.ctypes.data for name, array in arrays.items()})
        inputs = tuple(ctypes.c_void_p(array.ctypes.data) for array in (start, order.play, memory))
        ticks = self.shared.symid_plant_run(
            ctypes.byref(plant), ctypes.byref(experiment), *inputs, ctypes.byref(answer)
        )
        return PlantLog(**arrays, ticks=int(ticks))


def has_addresses(library: Library) -> bool:
    """Return whether the library's functions are compiled, in double precision; CasADi's C counts as well."""
    return library.engine.addresses is not None


def _get_function_address(library: Library, name: str) -> int:
    shared = library.engine.addresses
    if shared is None:
        text = f"the library of {library.card.robot!r} has no compiled functions in double precision"
        raise GenerationError(Notice(code="codegen.no-address", text=text))
    return _get_address(shared, f"{build_library_prefix(library.card.robot)}_{name}")


def _get_address(shared: ctypes.CDLL, name: str) -> int:
    return int(ctypes.cast(getattr(shared, name), ctypes.c_void_p).value or 0)


def _get_pointers(record: PlantRobot | PlantExperiment, names: tuple[str, ...]) -> dict[str, int]:
    return {name: getattr(record, name).ctypes.data for name in names}


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
    source = locate_resource_folder("templates") / "c/plant.c"
    shared, notices = _obtain_code("plant", source.read_text(encoding="utf-8"), found, cache)
    if not springs:
        return CompiledPlant(shared=shared, notices=notices)
    own, more = _obtain_code("springs", write_springs(springs), found, cache)
    return CompiledPlant(shared=shared, springs=own, notices=tuple(dict.fromkeys((*notices, *more))))


def _obtain_code(
    name: str, text: str, compiler: Compiler, cache: Path | None
) -> tuple[ctypes.CDLL, tuple[Notice, ...]]:
    """Return the library of one file of C, from the cache or made now, and notices."""
    binary = f"{name}.so"

    def make(folder: Path) -> None:
        folder.mkdir()
        (folder / f"{name}.c").write_text(text, encoding="utf-8")
        compile_sources(compiler, [folder / f"{name}.c"], folder / binary)

    key = compute_signature(name, text, compiler, (platform.system(), platform.machine()))
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
    """Return the states (N, n) of a branch after every sample of a path, from those before it (n,)."""
    call = _load_branch(strip_branch(branch))
    if call is None:
        return run_branch(branch, path, states)
    position, way, velocity, period = path
    motions = np.ascontiguousarray(np.vstack([position, way, velocity, period]), dtype=np.float64)
    numbers = np.array(list(branch.list_values().values()), dtype=np.float64)
    # The code writes as many states as the branch has, whatever it is given.
    size = len(branch.start(build_float_carrier(), 0.0, 0.0))
    before = np.array(np.broadcast_to(states, size), dtype=np.float64)
    after = np.empty((motions.shape[1], len(before)))
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
        shared, _ = _obtain_code("branch", write_branch(plain), compiler, None)
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
