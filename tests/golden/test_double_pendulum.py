"""Double pendulum of the DFKI: its zero, and its recordings read as they are."""

import numpy as np
import pytest

import symid

BASE = ("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2", "IA2")


def test_it_hangs_down_at_zero():
    library = symid.load("double_pendulum", backend="python").library
    # Point masses of 0.5 and 0.6 kg on the x axes at 0.2 and 0.25 m: MXR1 = 1.1 * 0.2, MX2 = 0.6 * 0.25.
    values = dict.fromkeys(BASE, 0.0) | {"MXR1": 0.22, "MX2": 0.15}
    beta = np.array([values[name] for name in BASE])
    for q1, q2 in ((0.0, 0.0), (0.7, -0.4), (np.pi, 0.3)):
        torque = library.evaluate("gravity", np.array([[q1, q2]]), beta)[0][0]
        outer = 9.81 * 0.15 * np.sin(q1 + q2)
        np.testing.assert_allclose(torque, [9.81 * 0.22 * np.sin(q1) + outer, outer], atol=1e-12)


@pytest.mark.parametrize("run", [1, 2, 3, 4])
def test_its_recordings_are_read_as_they_are(shared_data, run):
    path = shared_data / "double_pendulum" / f"run_{run}.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    (log,) = symid.load("double_pendulum").check(path).logs
    recording = log.recording
    for name, column in (("position", "pos_meas"), ("velocity", "vel_meas"), ("torque", "tau_meas")):
        stated = np.column_stack([table[f"{column}{joint}"] for joint in (1, 2)])
        np.testing.assert_allclose(getattr(recording, name).std(axis=0), stated.std(axis=0), rtol=0.02)
