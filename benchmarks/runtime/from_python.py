"""Calls from Python: regressors of many samples into one array, and inverse dynamics of one sample.

Input: the robot panda. Output: milliseconds and microseconds of processor time, medians of rounds in
which all take turns.
"""

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from robots import Case, build_case, import_pinocchio
from symid.arrays import FloatArray
from symid.codegen.cache import prepare_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.library import load_library
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import write_sources

__all__ = ["measure_from_python"]

SAMPLES = 10_000
CALLS = 2_000
_PIN, _BATCH, _MODULE = "pin, loop", "Library.evaluate", "NumPy module"
_OUT = "the same, out="
_RNEA, _BOUND = "pin.rnea", "Library.bind"
# The least of: loop / evaluate into old and into new arrays, loop / module; the most of: bind / rnea.
_OUT_GATE, _BATCH_GATE, _MODULE_GATE, _CALL_GATE = 30.0, 12.0, 2.0, 1.4
_TOLERANCE = 1e-9

Action = Callable[[], object]


def _clock(actions: Mapping[str, Action], rounds: int) -> dict[str, float]:
    """Return the median seconds of the processor for each action."""
    found: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(rounds + 1):
        for name, action in actions.items():
            start = time.process_time()
            action()
            # The first round loads and allocates what is late, and does not count.
            if turn:
                found[name].append(time.process_time() - start)
    return {name: statistics.median(values) for name, values in found.items()}


def _write_module(case: Case, folder: Path) -> Path:
    functions = build_functions(case.robot, names=("torque_regressor",))
    write_sources(generate_python_module(functions), folder)
    return folder


def _list_batches(case: Case, states: FloatArray, folder: Path) -> dict[str, Callable[[], FloatArray]]:
    """Return what makes the base regressors of all samples, (SAMPLES, n, b), by name."""
    pin, model, order, columns = import_pinocchio(), case.model, list(case.order), list(case.columns)
    if order != sorted(order):
        text = "a chain keeps the order of its joints"
        raise ValueError(text)
    data, (q, dq, ddq) = model.createData(), states
    library = prepare_library(case.robot)
    module = load_library(_write_module(case, folder / "module"))
    kept = library.evaluate("torque_regressor", q, dq, ddq)

    def loop() -> FloatArray:
        result = np.empty((len(q), case.robot.size, len(columns)))
        for k in range(len(q)):
            result[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])[:, columns]
        return result

    return {
        _PIN: loop,
        _BATCH: lambda: library.evaluate("torque_regressor", q, dq, ddq)[0],
        _OUT: lambda: library.evaluate("torque_regressor", q, dq, ddq, out=kept)[0],
        _MODULE: lambda: module.evaluate("torque_regressor", q, dq, ddq)[0],
    }


def _list_calls(case: Case, states: FloatArray) -> dict[str, Callable[[], FloatArray]]:
    """Return what computes the torque of one sample again and again, by name."""
    pin, model, beta = import_pinocchio(), case.model, case.beta
    data, (q, dq, ddq) = model.createData(), states[:, 0].copy()
    rnea, bound = pin.rnea, prepare_library(case.robot).bind("inverse_dynamics")

    def call_pinocchio() -> FloatArray:
        for _ in range(CALLS):
            tau = rnea(model, data, q, dq, ddq)
        return np.asarray(tau)

    def call_bound() -> FloatArray:
        for _ in range(CALLS):
            (tau,) = bound(q, dq, ddq, beta)
        return np.asarray(tau)

    return {_RNEA: call_pinocchio, _BOUND: call_bound}


def _compare(actions: Mapping[str, Callable[[], FloatArray]]) -> None:
    reference, *others = (action() for action in actions.values())
    for name, found in zip(list(actions)[1:], others, strict=True):
        difference = float(np.abs(found - reference).max() / np.abs(reference).max())
        if found.shape != reference.shape or not difference <= _TOLERANCE:
            text = f"{name} differs by {difference:.1e}; nothing timed"
            raise SystemExit(text)


def _say(text: str, ratio: float, *, gate: float, least: bool = True) -> str:
    passed = ratio >= gate if least else ratio <= gate
    return (
        f"{text}: {ratio:.2f}, {'at least' if least else 'at most'} {gate:g}: {'pass' if passed else 'FAIL'}"
    )


def measure_from_python(*, quick: bool, show: bool) -> dict[str, object]:
    """Return the times, printed if `show`.

    Raises:
        NotInstalledError: Pinocchio is not installed.
    """
    case = build_case("panda")
    states = np.random.default_rng(2).uniform(-1.5, 1.5, (3, SAMPLES, case.robot.size))
    rounds = 5 if quick else 15
    with tempfile.TemporaryDirectory() as folder:
        batches, calls = _list_batches(case, states, Path(folder)), _list_calls(case, states)
        _compare(batches)
        _compare(calls)
        batch_times = _clock(batches, rounds)
        call_times = {name: value / CALLS for name, value in _clock(calls, 3 * rounds).items()}
    ratios = {
        "batch": batch_times[_PIN] / batch_times[_BATCH],
        "out": batch_times[_PIN] / batch_times[_OUT],
        "module": batch_times[_PIN] / batch_times[_MODULE],
        "call": call_times[_BOUND] / call_times[_RNEA],
    }
    if show:
        print(f"panda, base torque regressors of {SAMPLES} samples in one array, ms")
        print("\n".join(f"  {name:18}{1e3 * value:9.2f}" for name, value in batch_times.items()))
        print("panda, inverse dynamics, one call, us")
        print("\n".join(f"  {name:18}{1e6 * value:9.3f}" for name, value in call_times.items()))
        print(_say("pin loop / Library.evaluate", ratios["batch"], gate=_BATCH_GATE))
        print(_say("pin loop / Library.evaluate, out=", ratios["out"], gate=_OUT_GATE))
        print(_say("pin loop / NumPy module", ratios["module"], gate=_MODULE_GATE))
        print(_say("Library.bind / pin.rnea", ratios["call"], gate=_CALL_GATE, least=False))
    return {"robot": "panda", "batch_seconds": batch_times, "call_seconds": call_times, "ratios": ratios}
