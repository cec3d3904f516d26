"""The published digits of the EMPS axis, from the recording to plain least squares.

Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019. The published standard
deviations take std(residual), which divides by rows - 1, as the noise of one row.
"""

import numpy as np
import pytest

from symid.logs.reader import read_recording
from symid.logs.signals import decimate, prepare_signals
from symid.robot.description import Decimation, Joint, JointKind, LogMap, LogQuantity, Processing, Robot
from symid.robot.geometry import IDENTITY

PROCESSING = Processing(
    filter_order=4,
    filter_cutoff=100.0,
    filter_torque=False,
    drop_first=49,
    decimation=Decimation(factor=10, order=8, ripple_db=0.05, band=0.8),
)
LOG = LogMap(
    time=LogQuantity(columns=("t",), unit="s"),
    position=LogQuantity(columns=("qm",), unit="m"),
    torque=LogQuantity(columns=("vir",), unit="V", factor=(35.15065188,)),
)
ROBOT = Robot(
    name="emps",
    joints=(Joint(name="axis", kind=JointKind.PRISMATIC, parent=-1, placement=IDENTITY),),
    log=LOG,
    processing=PROCESSING,
)


def build_matrix(recording, *, asymmetric):
    signals = prepare_signals(recording, PROCESSING)
    dq, ddq = signals.dq[:, 0], signals.ddq[:, 0]
    if asymmetric:
        up, down = dq > 0, dq < 0
        columns = [ddq, dq * up, 1.0 * up, dq * down, -1.0 * down]
    else:
        columns = [ddq, dq, np.sign(dq), np.ones_like(dq)]
    rows = decimate(np.column_stack([*columns, signals.tau[:, 0]]), PROCESSING.decimation)
    return rows[:, :-1], rows[:, -1]


def describe(matrix, force, x):
    e = force - matrix @ x
    norm = np.linalg.norm(e)
    return [f"{norm:.4f}", f"{100 * norm / np.linalg.norm(force):.4f}"]


@pytest.fixture(scope="module")
def recordings(shared_data):
    folder = shared_data / "emps"
    return [read_recording(folder / name, ROBOT) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")]


def fit(recording, *, asymmetric):
    matrix, force = build_matrix(recording, asymmetric=asymmetric)
    return matrix, force, np.linalg.lstsq(matrix, force, rcond=None)[0]


def test_symmetric_friction(recordings):
    matrix, force, x = fit(recordings[0], asymmetric=False)
    assert matrix.shape == (2480, 4)
    assert [f"{value:.4f}" for value in x] == ["95.1089", "203.5034", "20.3935", "-3.1648"]
    scatter = np.std(force - matrix @ x, ddof=1)
    stds = scatter * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert f"{scatter:.4f}" == "2.1843"
    assert [f"{value:.4f}" for value in stds] == ["0.1085", "1.1460", "0.1012", "0.0444"]
    assert describe(matrix, force, x) == ["108.7569", "4.0834"]
    assert describe(*build_matrix(recordings[1], asymmetric=False), x) == ["169.4876", "5.9824"]


def test_asymmetric_friction(recordings):
    matrix, force, x = fit(recordings[0], asymmetric=True)
    assert [f"{value:.4f}" for value in x] == ["95.1540", "166.7061", "20.1440", "240.4236", "20.6277"]
    assert describe(matrix, force, x) == ["82.8778", "3.1117"]
    assert describe(*build_matrix(recordings[1], asymmetric=True), x) == ["151.9933", "5.3649"]


def test_the_reader_says_what_it_did(recordings):
    first, second = ([str(notice) for notice in recording.notices] for recording in recordings)
    assert any("torque: 'vir' in V was multiplied by 35.15065188" in text for text in first)
    assert any("columns that were not used: gtau, kp, kv" in text for text in first)
    assert any("pulses_N" in text for text in second)
