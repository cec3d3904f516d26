"""What simulations and fits run for long, compiled once, kept in the cache, called without copies.

    plant     of elastic robots: one file that knows no robot calls the robot's functions by their addresses.
              Records are plain arrays: n joints with m stops and l knees each; what a joint lacks has a
              weight or slope of zero. Springs of other kinds are compiled for their numbers.
    function  of a robot as an external one of CasADi: the generated C, with a Jacobian that calls the
              generated C of its derivatives: `casadi.external` finds NAME and jac_NAME in one library.
              Derivatives by parameters are regressors: dtau/dbeta = Y, dddq/dbeta = -M^-1 Y.
    branch    of an element along a recording: its step, as C of CasADi, in one loop over the samples, for
              all numbers of a structure; the bytes of CasADi's virtual machine, sooner.

Supported: libraries in double precision; several processes at once; branches without a compiler, or without
a place for what it makes: there the virtual machine steps.
Not supported: the plant without a compiler; what changes during an experiment, but for the references;
derivatives of branches.
"""

import ctypes
import logging
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np

from symid import joint_models
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen.cache import CacheEntry, compute_library_key, obtain_entry
from symid.codegen.compiler import Compiler, compile_sources, locate_compiler
from symid.codegen.element_code import build_step
from symid.codegen.functions import Standard
from symid.codegen.library import Library, open_shared
from symid.codegen.printing import print_c
from symid.codegen.source_folder import write_sources
from symid.codegen.source_text import BANNER, build_library_prefix, write_template
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice, OutputError, UsageError
from symid.robot import Robot
from symid.serialization import compute_signature

if TYPE_CHECKING:
    import casadi as ca

    from symid.codegen.casadi_functions import Functions

_LOG = logging.getLogger(__name__)
RIGID_ENDS = ("well", "away", "chatter", "steep", "not-converged")
"""Why an experiment ended: at its end, far from the reference, by endless stops, by friction too steep, by no
answer to which joints rest."""
COMPILED = ("inverse_dynamics", "forward_dynamics")
"""Functions that `build_compiled_function` offers: those with a generated derivative."""
_ELEMENT = "symid_plant_pull"
_BRANCH = "symid_branch"
_READS = {"q": 1, "load": 2, "temperature": 4}
_Records = Sequence[ctypes.Structure]
_Tables = tuple[FloatArray, ...]
RIGID_FUNCTIONS = ("forward_dynamics", "mass_matrix", "bias")
"""That a rigid robot's plant calls, beside those of friction."""


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
class PlantLog(FrozenArrays):
    """The truth at every tick, (N, n) each; the last four in J since the start.

    Args:
        q, dq, theta, dtheta: link and motor, joint side. spring: tau_J. torque: held from each tick to the
            next; the last one does nothing.
        work: of the motors. friction: lost in it. elastic: int S(v) dphi, stored and lost.
        damped: int D dphi^2 dt.
        ticks: number of valid ones; fewer than N where the state was no longer finite.
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
        """Return what happens to the robot; a GenerationError where `library` is not compiled in doubles."""
        # The records of C have the fields of ours, in their order.
        ticks, n, springs = order.ticks, robot.size, self.springs
        warm = np.full(n, joint_models.REFERENCE_TEMPERATURE)
        arrays = {field.name: np.zeros((ticks, n)) for field in fields(PlantLog)[:-1]}
        start = np.concatenate([order.q, np.zeros(n), order.theta, np.zeros(n)])
        plant = _pack(
            n,
            order.play.shape[1],
            robot.knee.shape[1],
            None if springs is None else ctypes.cast(springs[_ELEMENT], ctypes.c_void_p).value,
            _get_function_address(library, "forward_dynamics"),
            *_list_friction(library, robot.friction, warm),
            robot.beta,
            *(getattr(robot, field.name) for field in fields(robot)[2:]),
        )
        references = (getattr(order, field.name) for field in fields(order)[:7])
        experiment = _pack(ticks, order.substeps, order.parts, ctypes.c_double(order.period), *references)
        records, sizes = (plant, experiment, _pack(*arrays.values())), (n, order.play.shape[1])
        return PlantLog(**arrays, ticks=self._call("plant", records, sizes, start, order.play))

    def _call(self, kind: str, records: _Records, sizes: Sequence[int], *states: FloatArray) -> int:
        """Return how many ticks a plant ran; records of the robot and the order, and of the answer."""
        scratch, run = (getattr(self.shared, f"symid_{kind}_{end}") for end in ("scratch", "run"))
        scratch.restype = run.restype = ctypes.c_size_t
        memory = np.zeros(scratch(*map(ctypes.c_size_t, sizes)))
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (*states, memory))
        robot, order, answer = map(ctypes.byref, records)
        return int(run(robot, order, *pointers, answer))

    def run_rigid(
        self,
        library: Library,
        parameters: tuple[FloatArray, FloatArray],
        tables: _Tables,
        order: RigidExperiment,
    ) -> RigidLog:
        """Return what happens to a rigid robot, whose functions `library` has; see `RigidExperiment`.

        Args:
            library: its functions.
            parameters: beta (p,) and those of friction (pf,), SI units.
            tables: of friction, in the order of the record in C. Lines with rows of standstill, ahead and
                back: viscous and level (3, n), zero in the first row. (n,) 1 where friction is a curve, where
                it depends on position or load, where it has a state. Of each deflection (m,) its coordinate,
                its stiffness in N m/rad or N/m, and 1 where it is an element.
            order: the experiment.

        Raises:
            GenerationError: the library is none of compiled functions in double precision.
        """
        (beta, values), (ticks, size), bends = parameters, order.position.shape, len(tables[-1])
        warm, end = np.full(size, joint_models.REFERENCE_TEMPERATURE), np.zeros(2)
        shapes = (*[(ticks, size)] * 3, (ticks, bends), (ticks,), (ticks,))
        named = zip(fields(RigidLog), shapes, strict=False)
        arrays = {field.name: np.zeros(shape) for field, shape in named}
        start = np.concatenate([order.q, order.dq, np.sign(order.dq), order.measured, order.velocity])
        flags = (int(bool(part.any())) for part in tables[2:4])
        functions = (_get_function_address(library, name) for name in RIGID_FUNCTIONS)
        friction = _list_friction(library, values, warm, bends=bends > 0)
        plant = _pack(size, bends, *flags, int(order.controlled), *functions, *friction, beta, *tables)
        references = (getattr(order, field.name) for field in fields(order)[:8])
        sizes, times = (ticks, order.substeps, int(order.sensed)), (order.period, order.blend)
        experiment = _pack(*sizes, *map(ctypes.c_double, times), *references)
        records = (plant, experiment, _pack(*arrays.values(), end))
        count = self._call("rigid", records, (size, bends), start)
        kept = {name: array[:count] for name, array in arrays.items()}
        return RigidLog(**kept, end=RIGID_ENDS[int(end[0])], events=int(end[1]))


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
    symbol = getattr(shared, f"{build_library_prefix(library.card.robot)}_{name}")
    return ctypes.cast(symbol, ctypes.c_void_p).value or 0


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
    springs: tuple[joint_models.Elasticity, ...] = (),
    kind: str = "elastic",
    *,
    compiler: str | None = None,
    cache: Path | None = None,
) -> CompiledPlant | None:
    """Return the compiled plant, from the cache or made now; None on a machine without a C compiler.

    Args:
        kind: of robots, "elastic" or "rigid".
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
    names = ("plant_calls.h", f"{kind}_plant.c")
    files = {name: (folder / name).read_text(encoding="utf-8") for name in names}
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


def write_springs(springs: tuple[joint_models.Elasticity, ...]) -> str:
    """Return the C of a function that computes the torque of any of these springs, without damping."""
    helpers: list[str] = []
    joints = []
    for spring in springs:
        program = build_step(replace(spring, damping=0.0), rated=True)
        body = print_c(program, "double")
        helpers += [helper for helper in body.helpers if helper not in helpers]
        joints.append({"lines": body.statements, "size": program.spec.inputs[1].size})
    return write_template("element/springs.c.jinja", {"helpers": helpers, "joints": joints, "name": _ELEMENT})


def run_compiled_branch(
    branch: joint_models.SteppedBranch, path: joint_models.BranchPath, states: FloatArray
) -> FloatArray:
    """Return states (n), force and energy of a branch after every sample of a path, (N, n + 2)."""
    call = _load_branch(joint_models.strip_branch(branch))
    if call is None:
        return joint_models.run_branch(branch, path, states)
    position, way, velocity, period = path
    motions = np.ascontiguousarray(np.vstack([position, way, velocity, period]), dtype=np.float64)
    numbers = np.array(list(branch.list_values().values()), dtype=np.float64)
    # The code writes as many states as the branch has, whatever it is given.
    size = len(branch.start(joint_models.build_float_carrier(), 0.0, 0.0))
    before = np.array(np.broadcast_to(states, size), dtype=np.float64)
    after = np.empty((motions.shape[1], size + 2))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (motions, numbers, before, after))
    call(ctypes.c_size_t(len(after)), *pointers)
    return after


@lru_cache(maxsize=64)
def _load_branch(plain: joint_models.SteppedBranch) -> Callable[..., None] | None:
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


def write_branch(plain: joint_models.SteppedBranch) -> str:
    """Return the C of a structure's loop."""
    import casadi

    step = joint_models.build_branch_step(plain)
    generator = casadi.CodeGenerator("step")
    generator.add(step)
    return write_template(
        "element/branch.c.jinja", {"step": generator.dump(), "size": step.size1_out(0), "name": _BRANCH}
    )


def write_external(functions: "Functions", name: str) -> str:
    """Return the C file that makes the generated C of `name` an external function of CasADi.

    `functions` holds it, its derivatives and, where parameters are arguments, the torque regressor.
    """
    known = {spec.name: spec for spec in functions.card.functions}
    spec, prefix = known[name], build_library_prefix(functions.card.robot)
    blocks = known[f"{spec.name}_derivatives"].outputs
    # Where the blocks of the Jacobian stand, one an input; forward dynamics has the acceleration before.
    *starts, work = accumulate((port.size for port in blocks), initial=0)
    places, forward = [f"w + {start}" for start in starts], len(blocks) > 3
    given, regressors = [f"take(arg[{k}])" for k in range(len(spec.inputs))], []
    (output,) = spec.outputs
    for port in spec.inputs[3:]:
        # By the parameters: the regressor, of forward dynamics at the acceleration that was found.
        values, room = f"w + {work}", output.size * port.size
        work += (1 + forward) * room
        block = {"columns": port.size, "rows": values, "target": f"w + {work - room}"}
        call = ", ".join((*given[:2], places[0] if forward else given[2], values))
        regressors.append({"call": call, "inverses": places[3:], **block})

    def describe(label: str, rows: int, columns: int) -> dict[str, str]:
        return {"name": f'"{label}"', "pattern": f"{{ {rows}, {columns}, 1 }}"}

    inputs = [describe(port.name, port.size, 1) for port in spec.inputs]
    outputs = [describe(f"jac_{output.name}_{port.name}", output.size, port.size) for port in spec.inputs]
    value = describe(output.name, output.size, 1)
    also = describe(f"out_{output.name}", output.size, 1)
    return write_template(
        "casadi/external.c.jinja",
        {"banner": BANNER, "prefix": prefix},
        name=name,
        functions=[
            {"name": name, "inputs": inputs, "outputs": [value]},
            {"name": f"jac_{name}", "inputs": [*inputs, also], "outputs": outputs},
        ],
        inputs=", ".join(given),
        size=output.size,
        derivatives=", ".join((*given, *places)),
        matrices=places[1:] if forward else places,
        regressors=regressors,
        longest=max(port.size for port in spec.inputs),
        work=max(work, output.size),
    )


def build_compiled_function(
    robot: Robot, name: str, *, standard: Standard = False, constant: bool = False, cache: Path | None = None
) -> "ca.Function":
    """Return a function of `COMPILED` as an external one of CasADi that calls the generated C.

    Its first derivatives are the generated C of the derivatives; it has no second ones. The library is taken
    from the cache, or made now; what was wrong with the cache is logged. Other arguments and errors are those
    of `build_functions`.

    Raises:
        GenerationError: there is no C compiler, or it fails.
        OutputError: the folder `cache` cannot be written.
        UsageError: the function has no generated derivative.
    """
    if name not in COMPILED:
        text = f"compiled: function {name!r} has no generated derivative; there are {', '.join(COMPILED)}"
        raise UsageError(Notice(code="usage.not-compiled", text=text))
    compiler = locate_compiler(native=True)
    if compiler is None:
        text = "compiled: no C compiler answers (cc, gcc, clang); without one, take the function as it is"
        raise GenerationError(Notice(code="codegen.no-compiler", text=text))
    # Imported here: simulations need neither CasADi nor SymPy.
    import casadi as ca

    from symid.codegen.c_library import generate_c_library
    from symid.codegen.casadi_functions import build_functions

    names = (name, f"{name}_derivatives", *(() if constant else ("torque_regressor",)))
    options = (standard, constant)

    def make(folder: Path) -> None:
        functions = build_functions(robot, names=names, standard=standard, constant=constant)
        prefix = build_library_prefix(functions.card.robot)
        paths = write_sources(generate_c_library(functions), folder)
        glue = folder / f"{prefix}_external.c"
        glue.write_text(write_external(functions, name), encoding="utf-8")
        sources = [path for path in paths if path.match(f"{prefix}_*.c")]
        compile_sources(compiler, [*sources, glue], folder / f"{name}.so", straight=True)

    entry = CacheEntry(
        name=f"external-{name}",
        key=compute_signature(compute_library_key(robot, names, compiler), options, platform.machine()),
        make=make,
        load=lambda folder: ca.external(name, str(folder / f"{name}.so")),
    )
    found, notices = obtain_entry(entry, cache)
    for notice in notices:
        _LOG.warning("%s", notice)
    return found
