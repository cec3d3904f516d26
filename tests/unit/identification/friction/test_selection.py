"""The choice of a law: blocks, what was held back, the rule of one standard error, the verdict."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError, UsageError
from symid.identification.friction import selection as selection_module
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.extraction import extract_joint, prepare_joint_logs
from symid.identification.friction.joint_fit import (
    FrictionRows,
    FrictionSamples,
    build_reduction,
    compute_velocity_map,
)
from symid.identification.friction.problem import VariableProjectionOptions
from symid.identification.friction.selection import CANDIDATE_LAWS, assign_blocks, select_law
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_columns
from symid.robot import Decimation
from tests.recovery.closed_form import build_two_link
from tests.refusals import raises
from tests.unit.identification.friction.cosine_rigs import RAW, record

LIBRARY = build_two_link()
FEW = ("coulomb-viscous", "coulomb-viscous-offset", "stribeck+offset", "cubic+offset")


def build_samples(law, **options):
    logs = prepare_joint_logs(LIBRARY, [record(0.15, law=law), record(1.0, law=law, seed=1)], RAW)
    return extract_joint(logs, 0, **options).samples


def build_rows(*counts):
    run = np.repeat(np.arange(len(counts)), counts)
    zero = np.zeros(len(run))
    return FrictionRows(time=zero, velocity=zero, torque=zero, extra=zero[:, None], run=run)


def test_blocks_are_contiguous_and_cut_every_recording_that_is_long_enough():
    number = assign_blocks(build_rows(100, 60))
    for part in (number[:100], number[100:]):
        assert sorted(set(part.tolist())) == [0, 1, 2, 3, 4]
        assert np.all(np.diff(part) >= 0)
    assert np.all(np.bincount(number[:100]) == 20)
    # Too short a recording is always fitted.
    assert np.all(assign_blocks(build_rows(100, 14))[100:] == -1)
    with raises(IdentifiabilityError, "friction.too-few-rows"):
        assign_blocks(build_rows(14, 9))


@pytest.mark.parametrize("truth", ["coulomb-viscous-offset", "stribeck+offset"])
def test_the_true_law_is_taken(truth):
    selection, _ = select_law(build_samples(truth), FEW)
    assert selection.chosen == truth
    assert selection.blocks == 5
    assert {trial.law for trial in selection.trials} == set(FEW)
    held = [trial.held_percent for trial in selection.trials]
    assert held == sorted(held)
    taken = next(trial for trial in selection.trials if trial.law == truth)
    assert taken.held_rms == pytest.approx(0.05, rel=0.1)
    assert taken.held_percent > taken.fitted_percent
    assert taken.behind <= 1.0
    assert truth in selection.verdict
    richer = next(trial for trial in selection.trials if trial.law == "stribeck+offset")
    told = [text in selection.verdict for text in ("squared error", "RMS")]
    if truth == "stribeck+offset":
        assert (taken.ratio < 0.6, told) == (True, [True, True])
    else:
        assert (taken.ratio, "vs" in richer.reason) == (1.0, True)


def test_a_law_whose_fall_lies_below_the_slowest_row_is_not_taken():
    processing = replace(RAW, standstill=0.1)
    recordings = [record(0.15, noise=0.02), record(1.0, noise=0.02, seed=1)]
    logs = prepare_joint_logs(LIBRARY, recordings, processing)
    selection, _ = select_law(extract_joint(logs, 0).samples, FEW)
    best = selection.trials[0]
    assert (best.law, best.reason) == ("stribeck+offset", "not identifiable: fS, vs")
    assert selection.chosen != "stribeck+offset"
    assert "stribeck+offset" not in selection.verdict
    assert "identifiable" in selection.verdict


def test_a_law_is_taken_only_where_a_fit_of_full_effort_tells_it(monkeypatch):
    full = []

    def fit(samples, law, *, options):
        estimate = fit_friction(samples, law, options=options)
        if law.name != "stribeck+offset" or options.variable_projection != VariableProjectionOptions():
            return estimate
        full.append(law.name)
        return replace(estimate, refused=(("vs", "two optima"),))

    monkeypatch.setattr(selection_module, "fit_friction", fit)
    selection, _ = select_law(build_samples("stribeck+offset"), FEW)
    assert full == ["stribeck+offset"]
    assert selection.chosen != "stribeck+offset"
    assert next(trial for trial in selection.trials if trial.law == full[0]).reason.endswith(": vs")


def test_a_law_that_cannot_be_fitted_says_why():
    samples = build_samples("coulomb-viscous-offset", beta=np.zeros(6))
    names = ("joint", "time", "velocity", "torque", "extra")
    without = FrictionSamples(**{name: getattr(samples, name) for name in names})
    selection, _ = select_law(without, ("coulomb-viscous", "load-dependent"))
    assert selection.chosen == "coulomb-viscous"
    assert selection.trials[-1].law == "load-dependent"
    assert "load" in selection.trials[-1].reason
    assert selection.trials[-1].held_percent is None
    with raises(IdentifiabilityError, "friction.no-law"):
        select_law(without, ("load-dependent",))
    # Names are checked.
    assert all(get_law(name).name for name in CANDIDATE_LAWS)
    with pytest.raises(UsageError, match="stribeck"):
        select_law(samples, ("stribek",))


def test_the_map_shows_friction_against_velocity():
    samples = build_samples("coulomb-viscous-offset")
    rows = samples.build_rows()
    known = 1.1 * rows.velocity + 1.8 * np.sign(rows.velocity) + 0.25
    other = np.linalg.lstsq(rows.extra, rows.torque - known, rcond=None)[0]
    found = compute_velocity_map(samples, other)
    assert len(found.velocity) == 40
    assert np.all(np.diff(found.velocity) > 0.0)
    assert found.count.sum() == np.sum(rows.velocity != 0.0)
    expected = 1.1 * found.velocity + 1.8 * np.sign(found.velocity) + 0.25
    slow = np.abs(found.velocity) < 0.01
    assert np.allclose(found.torque[~slow], expected[~slow], atol=0.02)
    assert len(found.cloud_velocity) == len(found.cloud_torque) == 600


def draw_long_samples(law, physical, *, one_sided=False, seed=9):
    """Samples of 120 s at 500 Hz, decimated by 10, with two columns beside friction."""
    count, rng = 60_000, np.random.default_rng(seed)
    time = np.arange(count) * 2e-3
    phase = 2.0 * np.pi * time * (0.2 + 0.0005 * time)
    velocity, ddq = np.sin(phase) * np.sin(0.31 * time), np.gradient(np.sin(phase), 2e-3)
    if one_sided:
        velocity = np.abs(velocity) + 0.01
    linear, shape = law.from_physical(physical)
    extra = np.column_stack([ddq, np.cos(time)])
    friction = compute_columns(law, {"velocity": velocity}, shape) @ linear
    return FrictionSamples(
        joint="1",
        time=time,
        velocity=velocity,
        torque=friction + extra @ [0.1, 2.0] + 0.05 * rng.normal(size=count),
        extra=extra,
        extra_names=("J", "a"),
        reduce=build_reduction([count], Decimation(factor=10)),
    )


LINEAR, RISE, KINKS = "coulomb-viscous-offset", "stribeck+offset", "improved-stribeck"
SEVERAL = (LINEAR, RISE, "lorentzian+offset", "power-law+offset", "tustin+offset")


@pytest.mark.parametrize(
    ("truth", "physical", "laws"),
    [
        (LINEAR, (1.0, 0.8, 0.1), SEVERAL),
        (RISE, (1.0, 1.5, 0.1, 0.8, 0.1), SEVERAL),
        ("lorentzian+offset", (1.0, 1.8, 0.05, 0.8, 0.1), SEVERAL),
        # Laws with kinks are searched in the rows where they may be chosen.
        (KINKS, get_law(KINKS).to_physical((0.8, 1.0, 0.8, 0.1), (0.4, 0.2)), (LINEAR, RISE, KINKS)),
    ],
)
def test_a_choice_from_sketches_is_that_from_all_rows(truth, physical, laws, monkeypatch):
    law = get_law(truth)
    samples = draw_long_samples(law, physical)
    sketched, final = select_law(samples, laws)
    monkeypatch.setattr(selection_module, "_LEAST_SKETCHED", np.inf)
    exact, _ = select_law(samples, laws)
    assert sketched.chosen == exact.chosen == truth
    by_law = {trial.law: trial for trial in exact.trials}
    if truth == KINKS:
        one, other = next(trial for trial in sketched.trials if trial.law == truth), by_law[truth]
        for name in ("held_rms", "fitted_percent", "aicc"):
            assert getattr(one, name) == getattr(other, name), name
    else:
        assert sketched.verdict == exact.verdict
        for trial in sketched.trials:
            other = by_law[trial.law]
            assert trial.reason == other.reason
            assert trial.held_rms == pytest.approx(other.held_rms, rel=1e-6)
            assert trial.fitted_percent == pytest.approx(other.fitted_percent, rel=1e-9)
    if law.shape:
        assert final == fit_friction(samples, law)


def test_parts_without_a_column_beside_friction_are_sketched():
    samples = draw_long_samples(get_law(RISE), (1.0, 1.5, 0.1, 0.8, 0.1))
    # The second column is zero in the first fifth, and twice there.
    late = samples.time > 26.0
    extra = np.column_stack([samples.extra[:, 0], samples.extra[:, 1] * late, samples.extra[:, 1] * late])
    samples = replace(samples, extra=extra, extra_names=("J", "a", "b"))
    assert select_law(samples, (LINEAR, RISE))[0].chosen == RISE
