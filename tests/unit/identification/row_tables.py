"""Rows of equations whose numbers a test chooses."""

import numpy as np

from symid.identification.regression.equations import Rows


def make_rows(matrix, values, group=None, **fields):
    """Return torque rows of joints `group` (m,) with parameters a, b, c, ...; `fields` of `Rows` besides."""
    count, width = matrix.shape
    group = np.zeros(count, dtype=int) if group is None else group
    joints = int(group.max()) + 1
    usual = {
        "kind": "torque",
        "time": np.arange(count),
        "velocity": np.ones(count),
        "names": tuple("abcdefghijklmnopqrstuvwxyz"[:width]),
        "units": ("1",) * width,
        "group_names": tuple(f"joint{k + 1}" for k in range(joints)),
        "group_units": ("N m",) * joints,
        "velocity_units": ("rad/s",) * joints,
        "independent": 1.0,
        "run": np.zeros(count),
        "weight": np.ones(count),
    }
    return Rows(matrix=matrix, values=values, group=group, **(usual | fields))
