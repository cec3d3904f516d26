"""Terms that the model lacks are named where they help on held-out rows; of a whole model none is."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics import FAMILIES
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Decimation, Processing
from tests.unit.identification.rigid.two_link_logs import LIBRARY, record

AUTOMATIC = Processing(automatic=True)
STATED = Processing(filter_cutoff=80.0, drop_first=50, drop_last=50, decimation=Decimation(factor=3))


def identify(seed, friction=None, processing=AUTOMATIC, estimator=None, encoder=1e-5):
    log = record(seed, encoder=encoder, torque=0.05, friction=friction)
    return identify_parameters(LIBRARY, [log], processing, estimator=estimator)


def rise_at_rest(dq):
    """Return what Stribeck friction has beyond Coulomb's."""
    return 0.8 * np.sign(dq) * np.exp(-((dq / 0.15) ** 2))


def differ_by_direction(dq):
    return 0.4 * np.abs(dq) + 0.15 * (dq > 0.0)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_whole_model_misses_nothing(seed):
    for processing in (AUTOMATIC, STATED):
        estimate = identify(seed, processing=processing)
        assert estimate.evidence.missing == ()
        assert "identify.structure" not in {notice.code for notice in estimate.notices}


@pytest.mark.parametrize(
    ("term", "friction"), [("slow motion", rise_at_rest), ("velocity", differ_by_direction)]
)
@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize(
    ("processing", "estimator"), [(AUTOMATIC, None), (AUTOMATIC, "wls"), (STATED, "huber")]
)
def test_friction_that_the_model_lacks_is_named(seed, term, friction, processing, estimator):
    estimate = identify(seed, friction, processing, estimator)
    (missing,) = estimate.evidence.missing
    assert (missing.joint, missing.term) == ("joint2", term)
    assert missing.gain > 30.0
    assert missing.errors > 2.5
    (notice,) = (entry for entry in estimate.notices if entry.code == "identify.structure")
    assert term in notice.text
    assert FAMILIES[term].advice[1:] in notice.text


def test_the_gain_is_in_percent_of_the_squares_that_are_left():
    """Asymmetric friction is nearly all that the model does not explain; more noise, and it is less."""
    gains = []
    for noise in (0.05, 1.0):
        log = record(0, encoder=1e-5, torque=noise, friction=differ_by_direction)
        (missing,) = identify_parameters(LIBRARY, [log], STATED).evidence.missing
        gains.append(missing.gain)
    assert 95.0 < gains[0] <= 100.0
    assert gains[1] < 0.9 * gains[0]


def test_a_term_within_the_noise_is_not_named_and_a_log_that_is_hardly_explained_has_causes():
    assert identify(1, lambda dq: 0.01 * differ_by_direction(dq)).evidence.missing == ()
    log = record(0)
    noise = np.random.default_rng(2).normal(size=log.torque.shape)
    evidence = identify_parameters(LIBRARY, [replace(log, torque=noise)], STATED).evidence
    assert evidence.missing == ()
    assert "nothing to do with this motion" in evidence.cause
