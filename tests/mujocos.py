"""MuJoCo as an oracle: torques of a model that it read, in the order of a robot's joints; texts of models."""

import numpy as np
import pytest

from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.urdf_reader import DEFAULT_SNAP

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")

RIGID = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def find_mujoco_torques(model: mujoco.MjModel, names, state: np.ndarray, *, dry: bool = False) -> np.ndarray:
    """Return MuJoCo's torques (n,) of the joints `names` in a state (3, n).

    Dry friction is a constraint there, whose force is the stated one as soon as the joint moves fast enough;
    limits, contacts and what holds followers are constraints too, and never count here.
    """
    if dry:
        bits = mujoco.mjtDisableBit
        model.opt.disableflags |= bits.mjDSBL_EQUALITY | bits.mjDSBL_LIMIT | bits.mjDSBL_CONTACT
    else:
        model.opt.disableflags |= RIGID
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in names]
    for k, joint in enumerate(joints):
        data.qpos[joint.qposadr[0]] = state[0, k]
        data.qvel[joint.dofadr[0]] = state[1, k]
        data.qacc[joint.dofadr[0]] = state[2, k]
    mujoco.mj_inverse(model, data)
    return np.array([data.qfrc_inverse[joint.dofadr[0]] for joint in joints])


def build_model(worldbody, tail="", head=""):
    return f"<mujoco>{head}<worldbody>{worldbody}</worldbody>{tail}</mujoco>"


def parse_mjcf(text, file="robot.xml", *, base=None, tip=None, snap=DEFAULT_SNAP):
    """Return symid's robot of a model; messages call the text `file`."""
    return parse_xml_robot(text, file, base=base, tip=tip, snap=snap)
