"""Logs with a known payload: its torque is taken off the measured one, so that the equations are the robot's.

Input: signals of a recording, the library. Output: signals without the payload.

    tau - Y(q, dq, ddq) dbeta,   dbeta what the payload adds to the base parameters

Supported: rows of all kinds, whose right sides are made of tau.
Not supported: simulated robots, which would have to carry it.
"""

from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording, Signals
from symid.errors import LogError, Notice
from symid.rows.row_parts import evaluate_torques

__all__ = ["find_load_torque", "take_load_off"]


def take_load_off(library: Library, signals: Signals, recording: Recording) -> Signals:
    """Return the signals without the torque (N, n) of a known payload; as they are where there is none.

    Raises:
        LogError: the payload was stated for another model.
    """
    load = find_load_torque(library, signals, recording)
    return signals if load is None else replace(signals, tau=signals.tau - load)


def find_load_torque(library: Library, signals: Signals, recording: Recording) -> FloatArray | None:
    """Return the torque (N, n) of a known payload in N m or N, None without one; see `take_load_off`."""
    if recording.run is None or not recording.run.load:
        return None
    load = np.array(recording.run.load)
    if len(load) != len(library.card.beta):
        text = (
            f"the payload changes {len(load)} base parameters, the model has {len(library.card.beta)}: read "
            "the run with the robot that is identified"
        )
        raise LogError(Notice(code="log.payload-model", text=text, file=recording.source))
    # A payload has no friction.
    return evaluate_torques(library, signals, np.append(load, np.zeros(len(library.card.friction))))
