"""Covariance and Cramer-Rao bound: printed values of the protocols, textbook cases, dependent columns."""

import numpy as np
import pytest

from symid.identification.friction.joint_fit import (
    compute_cramer_rao,
    compute_criteria,
    compute_sensitivities,
    compute_uncertainty,
)
from symid.joint_models.friction_catalogue import get_law
from tests.frictions import NOISE_S2, TABLE_1, TABLE_3, build_cosines, draw_s1, draw_s2, draw_samples


@pytest.mark.parametrize(
    ("count", "peak", "printed"),
    [
        (500, 0.1, (0.46, 0.12, 0.0010, 5.0)),
        (500, 0.5, (0.094, 0.223, 0.0012, 0.254)),
        (1000, 0.3, (0.057, 0.087, 0.0005, 0.249)),
    ],
)
def test_the_bound_of_protocol_s1_is_the_printed_one(count, peak, printed):
    samples, law = draw_s1(count=count, peak=peak)
    bound = compute_cramer_rao(samples, law, TABLE_1, float(np.sqrt(251.0 / count)))
    np.testing.assert_allclose(bound, printed, rtol=0.1)


@pytest.mark.parametrize(
    ("joint", "printed"),
    [
        (1, (0.039, 0.21, 0.0004, 0.069, 0.022, 0.0001)),
        (2, (0.17, 1.68, 0.0005, 0.32, 0.11, 0.0001)),
        (3, (0.07, 1.22, 0.0007, 0.13, 0.045, 0.0001)),
    ],
)
def test_the_bound_of_protocol_s2_is_the_printed_one(joint, printed):
    samples, law = draw_s2(joint)
    bound = compute_cramer_rao(samples, law, TABLE_3[joint], NOISE_S2[joint])
    # Printed with one or two digits.
    np.testing.assert_allclose(bound[[0, 1, 3, 4]], np.array(printed)[[0, 1, 3, 4]], rtol=0.05)
    np.testing.assert_allclose(bound[[2, 5]], np.array(printed)[[2, 5]], atol=6e-5)


def test_a_linear_law_has_the_textbook_covariance():
    law = get_law("coulomb-viscous")
    samples = draw_samples(law, (10.0, 20.0), build_cosines(0.5), noise=1.0)
    design = compute_sensitivities(samples, law, (20.0, 10.0), ())
    told = compute_uncertainty(design, law, 4.0, ())
    np.testing.assert_allclose(told.covariance, 4.0 * np.linalg.inv(design.T @ design), rtol=1e-10)
    assert told.rank == 2


def test_a_known_shape_value_makes_the_others_surer():
    samples, law = draw_s1()
    design = compute_sensitivities(samples, law, *law.from_physical(TABLE_1))
    free, known = (compute_uncertainty(design, law, 1.0, [fixed]).physical for fixed in (False, True))
    assert known[2] == 0.0
    assert np.all(known[[0, 1, 3]] < free[[0, 1, 3]])


def test_what_cannot_be_told_has_no_deviation():
    law = get_law("stribeck+offset")
    samples = draw_samples(law, (*TABLE_1, 1.0), np.abs(build_cosines(0.5)), noise=1.0)
    found = compute_cramer_rao(samples, law, (*TABLE_1, 1.0), 1.0)
    bound = {entry.name: size for entry, size in zip(law.physical, found, strict=True)}
    assert np.isinf([bound["fC"], bound["fS"], bound["offset"]]).all()
    assert np.isfinite([bound["vs"], bound["fV"]]).all()


def test_information_criteria_are_those_of_the_books():
    # M = 10, J = 5, three unknowns and the variance: k = 4.
    aicc, bic = compute_criteria(5.0, 10, 3)
    assert aicc == pytest.approx(10 * np.log(0.5) + 8 + 40 / 5)
    assert bic == pytest.approx(10 * np.log(0.5) + 4 * np.log(10))
    assert compute_criteria(5.0, 5, 3)[0] == np.inf
    assert compute_criteria(0.0, 10, 3, floor=1e-10) == compute_criteria(1e-10, 10, 3)
