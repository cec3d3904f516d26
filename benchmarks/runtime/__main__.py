"""How fast the generated C is: against Pinocchio's C++ and against CasADi's code of Pinocchio's algorithms.

    python benchmarks/runtime [--robot NAME ...] [--compiler NAME ...] [--quick] [--json] [--python]

All contenders are compiled with -O3 -march=native -DNDEBUG by clang and by gcc, evaluate the same 1000 random
states of the same robot in doubles, and are compared with each other before they are timed. Columns:

    Pinocchio     its C++ headers, compiled here
    SX            Pinocchio traced over CasADi's SX and printed as C by CasADi, with the bodies as arguments;
                  its torque regressor is that of base parameters
    SX-constant   the same with the bodies as numbers
    ours          the generated C as it comes, one sample a call, base parameters as arguments
    scalar        the same without vector types: plain C99
    libm          generated with the C library's sines, plain C99 too
    batch         ours, 128 samples a call, time of one of them: the results stay in the cache, as those of
                  the others do
    batch-1000    ours, 1000 samples a call, to as many places in memory

Needed besides symid: a C and a C++ compiler (clang makes the fastest Pinocchio), `pip install pin
example-robot-data`; valgrind for the instruction counts. What is missing is said and left out. Programs are
kept in build/runtime; Pinocchio takes minutes to compile, once.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from builds import FUNCTIONS, Workshop, find_folder, hold_folder
from checks import build_references, find_difference
from contenders import Contender, count_instructions, read_result, time_contenders
from from_python import measure_from_python
from gates import judge
from tables import format_figures, format_ratios, format_verdicts
from tools import Compiler, NotInstalledError, find_compilers, find_count_machine

from robots import LARGE, ROBOTS, Case, build_case
from symid.errors import SymidError

TOLERANCE = 1e-9
_OURS = {"ours", "scalar", "libm", "batch", "batch-1000"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is asked for."""

    robots: Sequence[str]
    compilers: Sequence[Compiler]
    count_machine: str | None
    rounds: int
    milliseconds: float
    workshop: Workshop


def say(text: str) -> None:
    """Print to the error stream: what is not the result."""
    print(text, file=sys.stderr, flush=True)


def read_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="python benchmarks/runtime", description=__doc__.split("\n", maxsplit=1)[0]
    )
    parser.add_argument(
        "--robot",
        action="append",
        metavar="NAME",
        help=f"of {', '.join(ROBOTS)}; or chain12, tree50 and the like; may be repeated",
    )
    parser.add_argument(
        "--compiler", action="append", metavar="NAME", help="clang, gcc, clang-19, ...; may be repeated"
    )
    parser.add_argument("--rounds", type=int, metavar="N", help="processes a figure, 15 unless told")
    parser.add_argument("--quick", action="store_true", help="Panda, 5 rounds, no instruction counts")
    parser.add_argument("--json", action="store_true", help="one object in place of tables")
    parser.add_argument(
        "--python", action="store_true", help="calls from Python in place of the C++ programs"
    )
    return parser.parse_args()


def _list_names(family: str) -> Mapping[str, tuple[str, ...]]:
    """Return under which names a program of this family has the functions."""
    names = {function: (function,) for function in FUNCTIONS}
    match family:
        case "Pinocchio":
            both = {name: (name, f"{name}:world") for name in ("mass_matrix", "forward_dynamics")}
            return {**names, **both}
        case "SX":
            return {
                **{name: names[name] for name in FUNCTIONS[:7]},
                "torque_regressor": ("torque_regressor:base",),
            }
        case "SX-constant":
            return {name: (f"{name}:constant",) for name in FUNCTIONS[:5]}
        case "batch" | "batch-1000":
            return {name: (f"{name}:{family}",) for name in FUNCTIONS}
    return names


def build_contenders(plan: Plan, case: Case, compiler: Compiler, machine: str) -> list[Contender]:
    """Return what one compiler makes of all that takes part; what it cannot make is said and left out."""
    shop = plan.workshop
    result: list[Contender] = []
    folder, large = shop.write_case(case), case.robot.size >= LARGE

    def add(families: Sequence[str], program: Path, states: str) -> None:
        environment = {"MODEL": str(folder / "model.txt")}
        result.extend(
            Contender(
                family=family,
                compiler=compiler.name,
                program=program,
                states=folder / states,
                names={
                    name: entries
                    for name, entries in _list_names(family).items()
                    if not large or name != FUNCTIONS[-1]
                },
                environment=environment,
            )
            for family in families
        )

    try:
        add(["Pinocchio"], shop.build_pinocchio(compiler, machine), "states_pinocchio.bin")
    except NotInstalledError as error:
        say(str(error))
    try:
        if not large:
            traced = shop.write_traced(plan.compilers[0], case)
            add(["SX", "SX-constant"], shop.build_traced(compiler, machine, traced), "states_pinocchio.bin")
    except NotInstalledError as error:
        say(str(error))
    own = shop.write_ours(case, "own")
    add(["ours", "batch", "batch-1000"], shop.build_ours(compiler, machine, own), "states_ours.bin")
    if large:
        return result
    library = shop.write_ours(case, "library")
    add(["scalar"], shop.build_ours(compiler, machine, own, scalar=True), "states_ours.bin")
    add(["libm"], shop.build_ours(compiler, machine, library, scalar=True), "states_ours.bin")
    return result


def check_contenders(case: Case, contenders: Sequence[Contender]) -> float:
    """Return the largest relative difference from Pinocchio's Python module, which is below 1e-9.

    Raises:
        SystemExit: one is larger: then nothing is worth timing.
    """
    references, worst = build_references(case), 0.0
    for contender in contenders:
        for function, names in contender.names.items():
            for name in names:
                ours, base = contender.family in _OURS, name.endswith(":base")
                found = read_result(contender, name)
                difference = find_difference(
                    case, function, found, references[function], ours=ours, base=base
                )
                if not difference <= TOLERANCE:
                    text = f"{name} of {contender.label} differs by {difference:.1e}; nothing timed"
                    sys.exit(f"{case.robot.name}: {text}")
                worst = max(worst, difference)
    return worst


def count_all(plan: Plan, case: Case) -> dict[tuple[str, str], float]:
    """Return the instructions of a call by column and function, with the first compiler."""
    if plan.count_machine is None:
        return {}
    counts = {}
    for contender in build_contenders(plan, case, plan.compilers[0], plan.count_machine):
        say(f"{case.robot.name}: counting the instructions of {contender.label}")
        for function, value in count_instructions(contender, FUNCTIONS).items():
            counts[contender.label, function] = value
    return counts


def measure(plan: Plan, name: str, *, show: bool) -> dict[str, object]:
    """Return the figures of a robot, printed if `show`."""
    case = build_case(name)
    contenders = [c for compiler in plan.compilers for c in build_contenders(plan, case, compiler, "native")]
    difference = check_contenders(case, contenders)
    times = time_contenders(
        contenders,
        FUNCTIONS,
        rounds=plan.rounds,
        milliseconds=plan.milliseconds,
        progress=lambda text: say(f"{name}: {text}"),
    )
    counts = count_all(plan, case)
    verdicts = judge(name, times)
    if show:
        compilers = [compiler.name for compiler in plan.compilers]
        size, count = case.robot.size, case.base.count
        print(f"\n{name}: {size} joints, {count} base parameters; all agree to {difference:.0e}")
        print(
            f"\n{format_figures('ns a call', times)}\n\n{format_ratios('ratio of times', times, compilers)}"
        )
        if counts:
            print(f"\n{format_figures('instructions', counts)}")
            print(f"\n{format_ratios('ratio of instructions', counts, compilers[:1])}")
        if verdicts:
            print(f"\n{format_verdicts(verdicts)}", flush=True)
    return {
        "robot": name,
        "difference": difference,
        "nanoseconds": _nest(times),
        "instructions": _nest(counts),
        "gates": [
            {"function": v.gate.function, "above": v.gate.above, "below": v.gate.below, "least": v.gate.least}
            | {"aim": v.gate.aim, "ratio": v.ratio, "verdict": v.word}
            for v in verdicts
        ],
    }


def _nest(figures: Mapping[tuple[str, str], float]) -> dict[str, dict[str, float]]:
    result: dict[str, dict[str, float]] = {}
    for (label, function), value in figures.items():
        result.setdefault(label, {})[function] = value
    return result


def build_plan(arguments: argparse.Namespace) -> Plan:
    """Return what is asked for, as far as the machine has the tools."""
    compilers, missing = find_compilers(arguments.compiler or ("clang", "gcc"))
    count_machine = None
    if not arguments.quick:
        try:
            count_machine = find_count_machine()
        except NotInstalledError as error:
            missing.append(str(error))
    for text in missing:
        say(text)
    if not compilers:
        sys.exit(2)
    if count_machine not in {None, "native"}:
        say(f"valgrind knows no AVX-512: instructions are those of builds with -march={count_machine}")
    plan = Plan(
        robots=arguments.robot or (("panda",) if arguments.quick else ROBOTS),
        compilers=compilers,
        count_machine=count_machine,
        rounds=arguments.rounds or 15,
        milliseconds=20.0,
        workshop=Workshop(folder=find_folder()),
    )
    return replace(plan, rounds=arguments.rounds or 5, milliseconds=10.0) if arguments.quick else plan


def main() -> None:
    """Measure and print."""
    arguments = read_arguments()
    result: list[dict[str, object]] = []
    if arguments.python:
        try:
            result.append(measure_from_python(quick=arguments.quick, show=not arguments.json))
        except NotInstalledError as error:
            say(str(error))
    else:
        plan = build_plan(arguments)
        with hold_folder(plan.workshop.folder):
            for name in plan.robots:
                try:
                    result.append(measure(plan, name, show=not arguments.json))
                except (NotInstalledError, SymidError) as error:
                    say(f"{name} is left out: {error}")
    if arguments.json:
        print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
