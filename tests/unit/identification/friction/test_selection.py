"""The choice of a law: parts, what was held out, laws that are not identifiable, the verdict."""

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
    cut_parts,
)
from symid.identification.friction.selection import CANDIDATE_LAWS, select_law
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


def test_parts_are_contiguous_and_every_recording_is_cut_into_stretches():
    parts, fold = cut_parts(build_rows(120, 60))
    assert np.array_equal(np.concatenate(parts), np.arange(180))
    assert [len(part) for part in parts] == [10] * 12 + [5] * 12
    assert fold.tolist() == np.repeat(np.arange(6), 4).tolist()
    # One recording has all six stretches, many have two each.
    assert len(cut_parts(build_rows(100))[0]) == 24
    assert cut_parts(build_rows(*[20] * 5))[1].max() == 9
    with raises(IdentifiabilityError, "friction.too-few-rows"):
        cut_parts(build_rows(14, 9))


@pytest.mark.parametrize("truth", ["coulomb-viscous-offset", "stribeck+offset"])
def test_the_true_law_is_taken(truth):
    selection, _ = select_law(build_samples(truth), FEW)
    assert selection.chosen == truth
    assert selection.blocks == 24
    assert {trial.law for trial in selection.trials} == set(FEW)
    held = [trial.held_percent for trial in selection.trials]
    assert held == sorted(held)
    taken = next(trial for trial in selection.trials if trial.law == truth)
    assert taken.held_rms == pytest.approx(0.05, rel=0.1)
    assert taken.held_percent > taken.fitted_percent
    assert taken.behind <= 1.0
    assert selection.verdict.startswith(
        f"{truth} has a held-out residual of {taken.held_percent:.3g} % of the torque"
    )
    assert f"({taken.held_rms:.3g} N m RMS)" in selection.verdict
    if truth == "stribeck+offset":
        assert taken.ratio < 0.6
        assert "coulomb-viscous-offset has" in selection.verdict
    else:
        assert taken.ratio == 1.0


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
        if law.name != "stribeck+offset":
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
    rows = samples.rows
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
        (KINKS, get_law(KINKS).to_physical((0.8, 1.0, 0.8, 0.1), (0.4, 0.2)), (LINEAR, RISE, KINKS)),
    ],
)
def test_laws_are_fitted_about_as_well_as_by_a_full_search(truth, physical, laws):
    samples = draw_long_samples(get_law(truth), physical)
    found, final = select_law(samples, laws)
    assert found.chosen == truth
    assert final == fit_friction(samples, get_law(truth))
    for trial in found.trials:
        full = fit_friction(samples, get_law(trial.law))
        least = 100.0 * np.sqrt(full.objective) / np.linalg.norm(samples.rows.torque)
        assert trial.fitted_percent == pytest.approx(least, rel=0.01), trial.law
        if trial.law == LINEAR:
            assert trial.aicc == pytest.approx(full.aicc, rel=1e-9)


def test_a_column_beside_friction_may_vanish_in_a_part():
    samples = draw_long_samples(get_law(RISE), (1.0, 1.5, 0.1, 0.8, 0.1))
    # The second column is zero in the first fifth, and twice there.
    late = samples.time > 26.0
    extra = np.column_stack([samples.extra[:, 0], samples.extra[:, 1] * late, samples.extra[:, 1] * late])
    samples = replace(samples, extra=extra, extra_names=("J", "a", "b"))
    assert select_law(samples, (LINEAR, RISE))[0].chosen == RISE
