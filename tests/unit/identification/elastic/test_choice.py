"""The choice among methods, on rows made for it."""

import numpy as np
import pytest

from symid.identification.elastic.elimination import BandRows
from symid.identification.elastic.methods import FOLDS, MethodCandidate, assign_folds, choose_candidate

TRUTH = np.array([2.0, -1.0])


@pytest.fixture
def rows():
    rng = np.random.default_rng(3)
    design = rng.normal(size=(4000, 2))
    return BandRows(
        design=design,
        torque=design @ TRUTH + 0.5 * rng.normal(size=4000),
        group=np.repeat([0, 1], 2000),
        time=np.tile(np.arange(2000) / 2000.0, 2),
        slide=np.zeros(4000, dtype=np.intp),
    )


def fixed(chi, spread):
    return MethodCandidate(lambda _: np.array(chi), spread)


def test_a_biased_method_is_not_taken_and_among_equals_the_surest_is(rows):
    """However sure the biased one says it is."""
    scatter = np.array([0.5, 0.5])
    best, errors, close = choose_candidate([fixed([2.2, -1.0], 1e-6), fixed(TRUTH, 0.1)], rows, scatter)
    assert (best, close) == (1, 1)
    assert errors[1] == pytest.approx(1.0, abs=0.1)
    assert errors[0] - errors[1] == pytest.approx(0.04 / 0.25, rel=0.3)
    best, _, close = choose_candidate([fixed(TRUTH, 0.1), fixed(TRUTH + 1e-3, 0.01)], rows, scatter)
    assert (best, close) == (1, 2)


def test_every_fold_leaves_out_two_blocks_of_eight():
    folds = assign_folds(np.arange(800) / 800.0)
    assert [int(np.sum(folds == fold)) for fold in range(FOLDS)] == [200] * FOLDS
    assert np.array_equal(folds[:400], folds[400:])


def test_each_fold_is_predicted_without_it(rows):
    asked = []

    def refit(fold):
        asked.append(fold)
        kept = assign_folds(rows.time) != fold
        return np.linalg.lstsq(rows.design[kept], rows.torque[kept], rcond=None)[0]

    choose_candidate([MethodCandidate(refit, 0.0)], rows, np.array([0.5, 0.5]))
    assert asked == list(range(FOLDS))
