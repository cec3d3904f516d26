"""The compiled plant of elastic robots: built once for all robots, kept in the cache, called without copies.

The source is one file that knows no robot; it calls the robot's functions through their addresses. The
records are plain arrays: n joints with m stops and l knees each; what a joint lacks has a weight or slope of
zero. Springs of other kinds are compiled once for their numbers, and called in the same way.

Supported: libraries in double precision; several processes at once.
Not supported: machines without a compiler (the simulation has a NumPy version for those); anything that
changes during an experiment but the references.
"""

import ctypes
import platform
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import final

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen.cache import CacheEntry, obtain_entry
from symid.codegen.compiler import compile_sources, locate_compiler
from symid.codegen.element_code import build_step
from symid.codegen.library import Library, open_shared
from symid.codegen.printing import print_c
from symid.codegen.source_text import build_library_prefix, write_template
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice
from symid.joint_models import REFERENCE_TEMPERATURE, Elasticity
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


_PLANT_BINARY = "plant.so"
_ELEMENT = "symid_plant_pull"
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
    machine = (platform.system(), platform.machine())

    def load(name: str, text: str) -> tuple[ctypes.CDLL, tuple[Notice, ...]]:
        def make(folder: Path) -> None:
            folder.mkdir()
            (folder / f"{name}.c").write_text(text, encoding="utf-8")
            compile_sources(found, [folder / f"{name}.c"], folder / _PLANT_BINARY)

        key = compute_signature(name, text, found, machine)
        return obtain_entry(
            CacheEntry(
                name=name, key=key, make=make, load=lambda folder: open_shared(folder / _PLANT_BINARY)
            ),
            cache,
        )

    source = locate_resource_folder("templates") / "c/plant.c"
    shared, notices = load("plant", source.read_text(encoding="utf-8"))
    if not springs:
        return CompiledPlant(shared=shared, notices=notices)
    own, more = load("springs", write_springs(springs))
    return CompiledPlant(shared=shared, springs=own, notices=tuple(dict.fromkeys((*notices, *more))))


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
