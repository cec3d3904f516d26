"""Samples of one joint: from recordings, the rigid part, rows left out, folded periods; what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError, LogError
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.extraction import (
    describe_cutoffs,
    extract_joint,
    fold_recording,
    list_independent,
    prepare_joint_logs,
)
from symid.identification.friction.joint_fit import FrictionSamples, build_reduction
from symid.identification.friction.selection import CANDIDATE_LAWS
from symid.joint_models import compute_columns
from symid.joint_models.friction_catalogue import get_law
from symid.logs.recording import Recording
from symid.robot import Decimation
from symid.robot.description import Processing
from tests.recovery.closed_form import build_one_axis, build_two_link
from tests.refusals import raises
from tests.unit.identification.friction.cosine_rigs import BETA, DECIMATED, RATE, RAW, record

LIBRARY = build_two_link()


def extract(*recordings, processing=RAW, **options):
    logs = prepare_joint_logs(LIBRARY, recordings, processing)
    return extract_joint(logs, 0, **options)


def fit(samples, columns):
    rows = samples.rows
    passed = samples.pass_columns(np.hstack([columns, samples.extra]))
    solution = np.linalg.lstsq(passed, rows.torque, rcond=None)[0]
    return solution, rows.torque - passed @ solution


def plain_columns(samples):
    return np.column_stack([samples.velocity, np.sign(samples.velocity), np.ones(samples.count)])


@pytest.mark.parametrize("processing", [RAW, DECIMATED])
def test_one_joint_alone_has_inertia_and_weight_fitted_along(processing):
    found = extract(record(0.8, law="coulomb-viscous-offset", noise=0.0), processing=processing)
    samples = found.samples
    assert samples.extra_names == ("J", "a", "b")
    assert samples.extra_units == ("kg m^2", "N m", "N m")
    assert "J ddq + a sin q + b cos q" in found.rigid
    solution, residual = fit(samples, plain_columns(samples))
    # The effective inertia of the arm at this pose, by its closed form; G = 9.81, L = 0.5.
    inertia = BETA[0] + BETA[3] + 2 * 0.5 * (BETA[4] * np.cos(0.4) - BETA[5] * np.sin(0.4))
    assert solution[:3] == pytest.approx([1.1, 1.8, 0.25], abs=3e-3)
    assert solution[3] == pytest.approx(inertia, rel=5e-3)
    assert np.sqrt(np.mean(residual**2)) < 0.02


def test_several_poses_take_the_columns_of_the_regressor():
    recordings = [record(0.8, pose=(0.3, angle), noise=0.0) for angle in (-0.9, 0.4, 1.3)]
    found = extract(*recordings)
    assert set(found.samples.extra_names) <= {"ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2"}
    assert len(found.samples.extra_names) > 3
    assert f"{len(found.samples.extra_names)} columns" in found.rigid
    assert sorted(set(found.samples.run.tolist())) == [0.0, 1.0, 2.0]


def test_independent_columns_are_the_first_ones_and_many_are_warned_of():
    a, b = np.random.default_rng(0).normal(size=(2, 50))
    assert list_independent(np.column_stack([np.zeros(50), a, 3.0 * a, b, a - b])) == [1, 3]
    rounding = 1e-16 * np.random.default_rng(1).normal(size=50)
    assert list_independent(np.column_stack([rounding, a])) == [1]
    for columns, codes in ((4, []), (8, ["friction.many-columns"])):

        def regress(q, *_, columns=columns):
            found = np.zeros((len(q), 2, 8))
            found[:, 0, :columns] = np.sin(q[:, :1] * np.arange(1, columns + 1))
            return (found,)

        card = replace(LIBRARY.card, beta=LIBRARY.card.beta + LIBRARY.card.beta[:2])
        functions = LIBRARY.functions | {"torque_regressor": regress}
        logs = prepare_joint_logs(replace(LIBRARY, card=card, functions=functions), [record(0.8)], RAW)
        assert [entry.code for entry in extract_joint(logs, 0).notices] == codes


def test_known_base_parameters_are_subtracted():
    found = extract(record(0.8, law="coulomb-viscous-offset", noise=0.0), beta=BETA)
    samples = found.samples
    assert samples.extra.shape[1] == 0
    assert "subtracted" in found.rigid
    expected = plain_columns(samples) @ [1.1, 1.8, 0.25]
    moving = np.abs(samples.velocity) > 0.01
    # Second differences of a cosine are off by (w h)^2 / 6.
    assert np.allclose(samples.torque[moving], expected[moving], atol=2e-3)
    rigid = LIBRARY.evaluate("torque_regressor", *[np.zeros((1, 2))] * 3)[0][0, 0] @ BETA
    assert samples.load.mean() == pytest.approx(rigid, rel=0.5)


def test_friction_that_is_not_the_joints_own_is_fitted_along():
    def rub(dq):
        (found,) = LIBRARY.functions["friction_regressor"](dq)
        found[:, 0, 3] = dq[:, 0] + dq[:, 1]
        return (found,)

    coupled = replace(LIBRARY, functions=LIBRARY.functions | {"friction_regressor": rub})
    logs = prepare_joint_logs(coupled, [record(0.8)], RAW)
    samples = extract_joint(logs, 0).samples
    assert samples.extra_names == ("J", "a", "b", LIBRARY.card.friction[3].name)


def test_a_sliding_joint_has_a_mass():
    time = np.arange(4000) * 1e-3
    q = 0.1 * np.sin(3.0 * time)[:, None]
    library = build_one_axis()
    tau = 95.0 * -9.0 * q + 20.0 * np.sign(np.cos(3.0 * time))[:, None]
    logs = prepare_joint_logs(library, [Recording(time=time, position=q, torque=tau)], RAW)
    samples = extract_joint(logs, 0).samples
    assert samples.prismatic
    assert (samples.extra_names, samples.extra_units) == (("J",), ("kg",))


def test_slow_rows_are_left_out_and_counted():
    processing = Processing(drop_first=20, drop_last=20, standstill=0.2)
    found = extract(record(0.8), processing=processing)
    (notice,) = found.notices
    assert notice.code == "identify.slow-rows"
    rows = found.samples.rows
    assert np.abs(rows.velocity).min() >= 0.2
    whole = extract(record(0.8)).samples.rows
    assert f"{int(np.sum(np.abs(whole.velocity) < 0.2))} of {len(whole.time)} samples" in notice.text
    with raises(IdentifiabilityError, "friction.all-slow"):
        extract(record(0.8), processing=Processing(standstill=2.0))


def test_rows_keep_velocity_and_recording_behind_the_filter():
    samples = extract(record(0.8), record(0.2), processing=DECIMATED).samples
    rows = samples.rows
    assert sorted(set(rows.run.tolist())) == [0, 1]
    count = np.sum(rows.run == 1)
    expected = samples.velocity[samples.run == 1]
    first = len(expected) - 1 - 5 * (count - 1)
    assert np.allclose(rows.velocity[rows.run == 1], expected[first::5], atol=2e-4)
    raw = extract(record(0.8)).samples
    fewer = raw.select_rows(raw.velocity > 0.0)
    assert fewer.count == np.sum(raw.velocity > 0.0)
    assert fewer.load is not None


def test_joints_that_rest_or_are_shaken_and_logs_of_other_robots_are_refused():
    recording = record(0.8)
    logs = prepare_joint_logs(LIBRARY, [recording], RAW)
    assert (logs.resting, logs.list_moving(0), logs.list_alone(0)) == (((1,),), (0,), (0,))
    with raises(IdentifiabilityError, "friction.at-rest", match="joint2"):
        extract_joint(logs, 1)
    position = recording.position.copy()
    position[:, 1] += 0.01 * position[:, 0]
    logs = prepare_joint_logs(LIBRARY, [replace(recording, position=position)], RAW)
    assert logs.carried == ((1,),)
    with raises(IdentifiabilityError, "friction.at-rest", match=r"joint2.* 2 %"):
        extract_joint(logs, 1)
    other = replace(recording, position=recording.position[:, :1], torque=recording.torque[:, :1])
    still = replace(recording, position=np.zeros_like(recording.position))
    for log, error, code in (
        (other, LogError, "log.joints"),
        (still, IdentifiabilityError, "identify.standstill"),
    ):
        with raises(error, code):
            prepare_joint_logs(LIBRARY, [log], RAW)


@pytest.mark.parametrize("period", [2.0, 2.0005])
def test_periods_are_averaged(period):
    time = np.arange(round(10.5 * RATE)) / RATE
    angle = 2.0 * np.pi * time[:, None] / period
    noise = 0.1 * np.random.default_rng(3).normal(size=angle.shape)
    log = Recording(time=time, position=np.cos(angle), torque=np.sin(angle) + noise, source="log")
    folded = fold_recording(log, period, margin=1000)
    assert len(folded.time) == 3000
    error = folded.torque[1000:2000, 0] - np.sin(2.0 * np.pi * np.arange(1000) / 1000)
    # Between samples, noise is that of a mean of two; that of five periods is averaged.
    scatter = 0.1 if period == 2.0 else 0.1 * np.sqrt(2 / 3)
    assert np.std(error) == pytest.approx(scatter / np.sqrt(5), rel=0.15)
    assert "5 periods" in folded.notices[0].text
    assert [notice.code for notice in folded.notices] == ["log.folded"]


TIME = np.arange(5000) / RATE


def make_log(*positions, torque=None):
    """Return a log of columns over 10 s."""
    columns = np.column_stack(positions)
    torque = columns if torque is None else torque[:, None]
    return Recording(time=TIME, position=columns, torque=torque, source="log")


def test_a_wrong_period_is_told_or_refused_and_a_short_log_refused():
    # A mean period is continued by the margin asked for.
    folded = fold_recording(make_log(np.sin(np.pi * TIME)), 2.0, margin=2300)
    expected = np.sin(2.0 * np.pi * np.arange(-2300, 3300) / 1000)
    assert np.allclose(folded.position, expected[:, None])
    # The second joint rests: it has no period to be wrong.
    noise = 1e-6 * np.random.default_rng(0).normal(size=len(TIME))
    half_resting = make_log(np.cos(np.pi * TIME) + 0.03 * TIME, noise)
    drifting = make_log(np.cos(2.0 * TIME) + 0.02 * TIME, torque=np.sin(TIME))
    for recording, period in ((half_resting, 2.0), (drifting, np.pi)):
        codes = [notice.code for notice in fold_recording(recording, period, margin=0).notices]
        assert codes == ["log.folded", "log.not-periodic"]
    for period, code in ((2.5, "log.not-periodic"), (7.0, "log.period"), (0.01, "log.period")):
        with raises(LogError, code, match="one for each log" if period == 2.5 else None):
            fold_recording(drifting, period, margin=0)


# fC, fS, vs, fV, fP, dq0 in N and m/s, and the mass in kg.
SHARP, MASS = np.array([11.6, 23.2, 0.028, 27.9, 0.5, 0.01]), 4.0


def sharp_friction(speed):
    """Return friction with a straight line within dq0, by its formula in numpy."""
    coulomb, static, stribeck, viscous, offset, edge = SHARP
    beyond = np.maximum(np.abs(speed), edge)
    size = coulomb + (static - coulomb) * np.exp(-((beyond / stribeck) ** 2)) + viscous * beyond
    return offset + size * np.clip(speed / edge, -1.0, 1.0)


def record_sharp(seed, *, bits=17, noise=0.3):
    """Return 20 s at 1 kHz of an axis along four sines, its encoder with so many bits a turn."""
    time, generator = 1e-3 * np.arange(20_000), np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.array([0.1, 0.25, 0.4, 0.65])
    phases, peaks = np.array([0.2, 1.1, 2.0, 0.7]), np.array([0.1, 0.2, 0.15, 0.1])
    angles = rates * time[:, None] + phases
    position, speed = np.sin(angles) @ (peaks / rates), np.cos(angles) @ peaks
    force = -np.sin(angles) @ (peaks * rates) * MASS + sharp_friction(speed)
    step = 2.0 * np.pi / 2**bits if bits else 0.0
    if bits:
        position = step * np.floor(position / step + generator.random())
    force = force + noise * generator.standard_normal(len(time))
    return Recording(time=time, position=position[:, None], torque=force[:, None], source=f"seed {seed}")


def fit_sharp(recordings, processing):
    """Return errors of the law's parameters in stated deviations, and the logs."""
    logs = prepare_joint_logs(build_one_axis(), recordings, processing)
    found = fit_friction(extract_joint(logs, 0).samples, get_law("improved-stribeck"))
    stds = np.array([entry.std for entry in found.parameters])
    return (np.array([entry.value for entry in found.parameters]) - SHARP) / stds, logs


OPEN = Processing(automatic=True)


def test_noise_of_an_encoder_does_not_bend_a_sharp_law():
    errors, stated = [], []
    for seed in range(3):
        far, logs = fit_sharp([record_sharp(seed)], OPEN)
        errors.append(far)
        # What the rate alone allows: 0.4 of the samples' rate over five rows.
        stated.append(fit_sharp([record_sharp(seed)], replace(logs.processing, filter_cutoff=200.0))[0])
    means, before = np.mean(errors, axis=0), np.mean(stated, axis=0)
    assert np.all(np.abs(means[:5]) < 1.0)
    # Near rest a coarse encoder's noise is not white.
    assert abs(means[5]) < 3.0
    # Static friction, the Stribeck velocity and the edge of the zone.
    assert before[1] > 8.0
    assert max(before[2], before[5]) < -8.0


def test_without_noise_the_cutoff_follows_the_rate_and_a_stated_one_is_kept():
    far, logs = fit_sharp([record_sharp(0, bits=0)], OPEN)
    assert (logs.cutoffs, logs.processing.filter_cutoff) == ((), 200.0)
    assert np.all(np.abs(far) < 4.0)
    # Ends in motion are left out: two periods of 200 Hz on either side, or of what was chosen.
    assert len(logs.signals[0].time) == 20_000 - 20
    logs = fit_sharp([record_sharp(0)], OPEN)[1]
    assert len(logs.signals[0].time) == 20_000 - 2 * np.ceil(2e3 / logs.cutoffs[0][0])
    logs = fit_sharp([record_sharp(0)], replace(OPEN, filter_cutoff=60.0))[1]
    assert (logs.cutoffs, logs.processing.filter_cutoff) == ((), 60.0)


def test_every_log_and_joint_has_its_own_cutoff():
    logs = fit_sharp([record_sharp(0, bits=20), record_sharp(1, bits=16)], OPEN)[1]
    (fine,), (coarse,) = logs.cutoffs
    assert 5.0 <= coarse < fine < 200.0
    # Another log of the fit is filtered by its own noise.
    assert (logs.processing.filter_cutoff, logs.processing.automatic) == (None, True)
    assert [notice.file for notice in describe_cutoffs(logs)] == ["seed 0", "seed 1"]
    assert f"(Hz): joint1 {fine:g};" in describe_cutoffs(logs)[0].text


def build(**changes):
    fields = {
        "joint": "1",
        "time": np.arange(4.0),
        "velocity": np.ones(4),
        "torque": np.zeros(4),
        "extra": np.zeros((4, 0)),
    }
    return FrictionSamples(**(fields | changes))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"velocity": np.ones(3)}, "shape"),
        ({"temperature": np.ones(3)}, r"temperature .*shape"),
        ({"torque": np.array([0.0, np.nan, 0.0, 0.0])}, "not finite"),
        ({"extra": np.zeros((4, 2))}, r"extra .*\(4, 2\)"),
        ({"extra": np.zeros((4, 1)), "extra_names": ("J",), "extra_units": ("a", "b")}, "extra_units"),
        ({"velocity": np.zeros(0)}, "no samples"),
    ],
)
def test_what_does_not_fit_is_refused(changes, word):
    with pytest.raises(LogError, match=word) as refused:
        build(**changes)
    assert {notice.code for notice in refused.value.notices} == {"friction.samples"}


def draw_long(count=5000):
    rng = np.random.default_rng(7)
    return FrictionSamples(
        joint="1",
        time=np.arange(count) * 1e-3,
        velocity=np.sin(np.arange(count) / 300.0) + 0.01 * rng.normal(size=count),
        torque=rng.normal(size=count),
        extra=rng.normal(size=(count, 2)),
        extra_names=("a", "b"),
        run=np.repeat([0, 1], [2000, count - 2000]),
        reduce=build_reduction([2000, count - 2000], Decimation(factor=10)),
    )


def test_columns_and_rows_of_a_part_are_those_that_pass_the_operator_of_the_whole():
    samples = draw_long()
    kept = np.random.default_rng(8).uniform(size=500) < 0.7
    then = np.arange(kept.sum()) % 3 > 0
    part = samples.select_rows(kept).select_rows(then)
    for name in (*CANDIDATE_LAWS, "stribeck+offset"):
        law = get_law(name)
        if "load" in law.inputs:
            continue
        for scale in (0.2, 0.5, 0.2):
            shape = [scale] * len(law.shape)
            passed = samples.pass_columns(compute_columns(law, samples.inputs, shape))
            np.testing.assert_allclose(samples.pass_law(law, shape), passed, 1e-13, 1e-14)
            np.testing.assert_allclose(part.pass_law(law, shape), passed[kept][then], 1e-13, 1e-14)
    whole, rows = samples.rows, part.rows
    np.testing.assert_allclose(whole.torque, samples.pass_columns(samples.torque[:, None])[:, 0], 1e-13)
    np.testing.assert_allclose(rows.extra, samples.pass_columns(samples.extra)[kept][then], 1e-13, 1e-14)
    assert set(rows.run.tolist()) == {0, 1}
    with pytest.raises(ValueError, match="read-only"):
        whole.torque[0] = 1.0
