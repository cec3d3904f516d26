"""Estimates for tests: results of identifications whose values are those of a robot, without any log."""

import dataclasses
from pathlib import Path

import numpy as np

from symid.codegen.functions import build_model_card
from symid.dynamics.base_parameters import derive_base_parameters
from symid.identification.elastic.estimate import ElasticEstimate, SpringEstimate
from symid.identification.estimators.estimate import (
    Estimate,
    Outcome,
    ParameterEstimate,
    Residual,
    list_parameters,
)
from symid.identification.stored import write_fit
from symid.ipopt import Ending
from symid.joint_models import list_value_names
from symid.robot.inertia import compute_standard_parameters
from symid.robot.toml_settings import list_processing
from symid.serialization import write_plain
from tests.chains import draw_parameters

STD = 1e-4


def fill_robot(robot, seed=1):
    """Return a robot with random bodies, rotors and friction wherever it has such parameters."""
    rng = np.random.default_rng(seed)
    bodies = draw_parameters(rng, robot.size)

    def fill_friction(friction):
        count = len(list_value_names(friction))
        values = tuple(map(float, rng.uniform(0.2, 1.0, count)))
        return dataclasses.replace(friction, values=values) if count else friction

    def fill_joint(joint, body):
        rotor = float(rng.uniform(0.1, 0.5)) if joint.drive.has_rotor else None
        drive = dataclasses.replace(joint.drive, rotor_inertia=rotor)
        friction = fill_friction(joint.friction)
        return dataclasses.replace(joint, inertial=tuple(map(float, body)), drive=drive, friction=friction)

    joints = tuple(fill_joint(joint, body) for joint, body in zip(robot.joints, bodies, strict=True))
    couplings = tuple(
        dataclasses.replace(
            entry, rotor_inertia=float(rng.uniform(0.1, 0.5)), friction=fill_friction(entry.friction)
        )
        for entry in robot.couplings
    )
    return dataclasses.replace(robot, joints=joints, couplings=couplings)


def list_residuals(card):
    sizes = {"norm": 1.0, "relative_percent": 1.0, "std": 0.1, "samples": 100, "unit": "N m"}
    return tuple(Residual(joint=joint.name, **sizes) for joint in card.joints)


def build_estimate(robot, *, covariance=None, sources=("log.npz",)) -> Estimate:
    """Return an estimate with the values that `robot` states; `covariance` of all of them, (p, p)."""
    card = build_model_card(robot, derive_base_parameters(robot), ())
    values = np.array([entry.value for entry in (*card.beta, *card.friction)])
    cards = [dataclasses.replace(entry, value=None) for entry in (*card.beta, *card.friction)]
    given = np.diag([STD**2] * len(cards)) if covariance is None else np.asarray(covariance)
    processing = list_processing(robot.processing)
    return Estimate(
        robot=robot.name,
        signature=card.signature,
        rows="torque",
        estimator="ols",
        friction=tuple(joint.friction for joint in card.joints),
        parameters=list_parameters(cards, values, given),
        residual=list_residuals(card),
        condition=10.0,
        outcome=Outcome.SOLVED,
        samples=100,
        sources=sources,
        settings={"processing": make_plain(processing), "fixed": [write_plain(body) for body in robot.fixed]},
        covariance=tuple(tuple(map(float, row)) for row in given),
    )


def build_elastic_estimate(values, spring, *, joints=("joint1",), unit="N m", **changes) -> ElasticEstimate:
    """Return an estimate with parameters `values` by name and the same, true, spring in all joints."""
    residual = Residual(joint="all joints", norm=1.0, relative_percent=0.8, std=0.02, samples=900, unit="J")
    sizes = {"torsion": 0.02, "excited": 0.006, "torque": 11.0, "elasticity": spring, "truth": spring}
    units = {"torque_unit": unit, "position_unit": "m" if unit == "N" else "rad"}
    known = {
        "robot": "arm",
        "signature": "abc",
        "method": "elimination",
        "reason": "the method was asked for",
        "parameters": tuple(
            ParameterEstimate(name=k, value=x, std=0.1, unit="kg") for k, x in values.items()
        ),
        "springs": tuple(SpringEstimate(joint=joint, **sizes, **units) for joint in joints),
        "residual": tuple(dataclasses.replace(residual, joint=joint, unit=unit) for joint in joints),
        "energy": residual,
        "condition": 30.0,
        "outcome": Ending.SOLVED,
        "history": (),
        "trials": (),
        "sources": ("log",),
        "settings": {},
    }
    return ElasticEstimate(**{**known, **changes})


def make_plain(value):
    if isinstance(value, dict):
        return {key: make_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [make_plain(entry) for entry in value]
    return value if value is None or isinstance(value, bool | int | str) else float(value)


def store_estimate(robot, path: Path, **fields) -> Path:
    """Write the estimate of `build_estimate` to a file."""
    return write_fit(build_estimate(robot, **fields), path)


def build_springless_estimate(robot, *, shift=0.0, sources=("log.npz",)) -> ElasticEstimate:
    """Return an estimate of elastic joints without springs: the values of the robot file plus `shift`."""
    card = build_model_card(robot, derive_base_parameters(robot), ())
    cards = (*card.beta, *card.rotors, *card.friction)
    values = {entry.name: entry.value + shift for entry in cards}
    found = build_elastic_estimate(values, None, joints=(), robot=robot.name, signature=card.signature)
    residual = list_residuals(card)
    return dataclasses.replace(
        found,
        parameters=tuple(
            dataclasses.replace(entry, std=STD, unit=stated.unit)
            for entry, stated in zip(found.parameters, cards, strict=True)
        ),
        residual=residual,
        energy=residual[0],
        sources=sources,
        settings={"processing": make_plain(list_processing(robot.processing))},
        covariance=tuple(tuple(map(float, row)) for row in STD**2 * np.eye(len(cards))),
    )


def add_payload(robot, mass, centre, inertia):
    """Return the robot with a body in its last link frame."""
    last = robot.joints[-1]
    pairs = zip(last.inertial, compute_standard_parameters(mass, centre, inertia), strict=True)
    loaded = dataclasses.replace(last, inertial=tuple(a + b for a, b in pairs))
    return dataclasses.replace(robot, joints=(*robot.joints[:-1], loaded))
