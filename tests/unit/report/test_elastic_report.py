"""The page of an elastic fit: springs, methods, verdict; and what the fit predicts of a log."""

import re
from dataclasses import replace
from html import escape

import numpy as np
import pytest

from symid.codegen.functions import ParameterCard
from symid.errors import EstimateError, Notice
from symid.identification.elastic.estimate import ElasticEvidence, HistoryEntry, MethodTrial
from symid.identification.elastic.validation import ElasticTrial, JointTrial, TrackingRun, evaluate_elastic
from symid.identification.estimators.estimate import ParameterEstimate, Residual
from symid.ipopt import Ending
from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from symid.logs.recording import Recording
from symid.report.blocks import Drawing, Table
from symid.report.elastic_page import build_elastic_page, draw_loops, show_spring
from symid.report.pages import render_page
from symid.report.verdict import judge_elastic
from symid.serialization import compute_file_digest
from tests.estimates import build_elastic_estimate
from tests.mistakes import refuse
from tests.pages import PageReader
from tests.recovery.closed_form import build_one_axis

TRUTH = Elasticity(
    stiffness=380.0,
    stops=(Stop(threshold=0.002, stiffness=120.0), Stop(threshold=0.006, stiffness=80.0)),
    knees=(Knee(threshold=-3.0, slope=0.5), Knee(threshold=3.0, slope=0.5)),
)
FOUND = replace(TRUTH, stiffness=399.0)
REACH = 0.02
HEADING = r"<h2>([^<:]*)"


def build_joint(name):
    time = np.linspace(0.0, 20.0, 5001)
    torsion = REACH * np.sin(time) * np.cos(0.31 * time)
    motor, final = (compute_hysteresis_torque(spring, torsion) for spring in (TRUTH, FOUND))
    sides = {"motor": motor, "link": motor + 0.01 * np.cos(5 * time), "final": final, "truth": motor}
    known = {"joint": name, "unit": "N m", "torsion_unit": "rad", "time": time, "torsion": torsion}
    return JointTrial(**known, **sides, initial=600.0 * torsion)


@pytest.fixture(scope="module")
def trial():
    residual = Residual(joint="<one>", norm=1.0, relative_percent=1.5, std=0.02, samples=5001, unit="N m")
    return ElasticTrial(
        source="<held out>",
        joints=(build_joint("<one>"), build_joint("two")),
        residuals=(("Torque of the motors.", (residual, replace(residual, joint="two"))),),
    )


@pytest.fixture(scope="module")
def estimate():
    entry = ParameterEstimate(name="ZZ1", value=0.353, std=0.004, unit="kg m^2", truth=0.35)
    others = tuple(replace(entry, name=name) for name in ("ZZ2", "IA1"))
    values = (0.353, 1e-4, 0.353, 0.353)
    plain = build_elastic_estimate({}, TRUTH, joints=("<one>", "two"))
    return replace(
        plain,
        robot="arm & hand",
        method="two-step",
        simulated=True,
        reason="it explains <most>",
        parameters=(entry, replace(entry, name="MY1", value=1e-4, truth=0.0), *others),
        springs=tuple(replace(spring, elasticity=FOUND) for spring in plain.springs),
        outcome=Ending.CONVERGED,
        history=tuple(
            HistoryEntry(merit=3.0 + 0.1**k, change=0.05**k, norms=(0.07, 20.0 - k, 8.0)) for k in range(1, 5)
        ),
        trials=(
            MethodTrial(method="two-step", outcome=Ending.CONVERGED, error=1.003, values=values),
            MethodTrial(method="elimination", outcome=Ending.SOLVED, error=1.44, values=(0.4, 0, 0.3, 0.35)),
            MethodTrial(method="linear-spring", outcome=Ending.FAILED, error=None, values=values),
        ),
        sources=("<fit>",),
        settings={"stops": 8, "nested": {"rate": 60.0}},
        covariance=tuple(tuple(row) for row in np.diag(np.full(4, 0.004**2)).tolist()),
        notices=(Notice(code="elastic.poorly-identifiable", text="said once"),),
    )


@pytest.fixture(scope="module")
def tracking():
    time = np.linspace(0.0, 10.0, 4001)
    wave = np.column_stack([np.sin(3 * time), np.cos(time)])
    return tuple(
        TrackingRun(name=name, time=time, error=size * wave)
        for name, size in (("rigid <feed>", 1e-3), ("Case 1", 2e-4), ("Case 2", 4e-4))
    )


def write(estimate, *args, **options):
    return render_page(build_elastic_page(estimate, *args, **options))


def show(estimate, *args, **options):
    """Return all blocks of a page, those that are folded last."""
    page = build_elastic_page(estimate, *args, **options)
    return (*page.blocks, *page.more)


def judge(estimate, trial):
    return build_elastic_page(estimate, (trial,)).verdict


def find_table(blocks, title):
    return next(block for block in blocks if isinstance(block, Table) and block.title.startswith(title))


def list_texts(blocks):
    return [block for block in blocks if isinstance(block, str)]


def test_the_whole_page_is_well_formed_escaped_and_needs_nothing_else(estimate, trial, tracking):
    text = write(estimate, (trial,), tracking=tracking)
    reader = PageReader(text)
    assert (reader.open, reader.wrong, reader.loaded) == ([], [], [])
    assert "said once" in text
    assert reader.tags.count("script") == 1
    assert not re.search(r'@import|url\(|points="[^"]*nan', text)
    # The first screen, loops, springs, parameters, iterations, tracking.
    assert reader.tags.count("svg") == 1 + 2 * 3 + 2 + 1 + 2 + 2
    assert reader.tags.count("title") == reader.tags.count("svg") + 1
    assert text.count("<table>") == text.count('<div class="scroll"') + 1
    heads = "Hysteresis loops|Springs|Parameters|Tracking|Methods|Convergence|Residual of &lt;held out&gt;"
    heads += "|Residual of the fit|What each parameter groups|Details of the verdict|Notices|Settings"
    assert "|".join(re.findall(HEADING, text)) == heads
    for raw in ("<one>", "<held out>", "<most>", "<feed>", "arm & hand"):
        assert raw not in text
        assert escape(raw) in text
    counts = [len(points.split()) for points in re.findall(r'points="([^"]*)"', text)]
    assert max(counts) <= 2000
    assert len(counts) > 20


def test_sections_without_data_are_left_out(estimate):
    text = write(replace(estimate, springs=(), history=(), trials=(), notices=()))
    heads = "Parameters|Held-out logs|Methods|Residual of the fit|What each parameter groups"
    heads += "|Details of the verdict|Settings"
    assert "|".join(re.findall(HEADING, text)) == heads
    assert "--validation" in text
    assert 'class="verdict usable"' in text


def test_errors_against_the_truth_are_told_and_refused_parameters_have_no_value(estimate):
    first, second, *_ = find_table(show(estimate), "With standard deviations").rows
    assert first[4:7] == [0.35, "+0.86 %", True]
    # Where the truth is zero there is no relative error.
    assert second[4:6] == [0.0, ""]
    page = build_elastic_page(replace(estimate, refused=(("IA1", "it never turned"),)))
    rows = find_table(page.blocks, "With standard deviations").rows
    assert [row[0] for row in rows] == ["ZZ1", "MY1", "ZZ2"]
    assert find_table(page.blocks, "Not identifiable").rows == (("IA1", "it never turned"),)
    assert any(text.endswith(": IA1.") for text in page.verdict.details)


def test_torques_beyond_the_limits_of_joints_make_elastic_fits_doubtful(estimate, trial):
    assert judge_elastic(estimate, [trial]).level == "good"
    beyond = replace(estimate, settings={"beyond_limit": {"two": [50.0, 20.0]}})
    found = judge_elastic(beyond, [trial])
    assert found.level == "doubtful"
    assert "limits of the joints: two 2.5 times" in found.headline
    for odd in (5, {"two": 5}, {"two": ["x", 1]}, {"two": [50.0, 0.0]}, {"two": [1.0, 2.0]}):
        changed = replace(estimate, settings={"beyond_limit": odd})
        (notice,) = refuse(judge_elastic, changed, [trial], error=EstimateError)
        assert "'beyond_limit'" in notice.text


def test_springs_are_compared_by_values_that_thresholds_do_not_change(estimate):
    blocks = list(show_spring(estimate.springs[0]))
    stiff, reversal, secant, loss = find_table(blocks, "Values").rows
    assert stiff[1:] == ("399", "380", "+5 %", "N m/rad")
    assert reversal[1:3] == ("599", "580")
    inner = 380 * REACH + 120 * 0.002 + 80 * 0.006
    assert float(secant[2]) == pytest.approx((inner + 0.5 * (inner - 3.0)) / REACH, rel=1e-3)
    # Oracle: the area of the closed loop, by the trapezoid.
    angle = np.linspace(0.0, 5.0 * np.pi / 2.0, 250_001)
    path = REACH * np.sin(angle)
    torque = compute_hysteresis_torque(TRUTH, path)
    area = np.trapezoid(torque[50_000:], path[50_000:])
    assert float(loss[2]) == pytest.approx(area, rel=1e-3)
    assert find_table(blocks, "Stops").rows == (("2", "120", "0.24"), ("6", "80", "0.48"))
    assert find_table(blocks, "Knees").rows == (("\N{MINUS SIGN}3", "1.5"), ("3", "1.5"))
    assert "True stops: 120 N m/rad at 2 mrad, 80 N m/rad at 6 mrad." in blocks


def test_springs_that_were_not_excited_not_turned_cubic_or_damped(estimate):
    spring = estimate.springs[0]

    def list_words(**changes):
        return list_texts(show_spring(replace(spring, **changes)))

    texts = list_words()
    assert len(texts) == 2 + 2  # heading and excitation, true stops and slopes
    assert re.search("20 mrad.* 11 N m", texts[1])
    words = "\n".join(list_words(torsion=0.005, excited=0.002, torque=2.8))
    assert words.count("\nStops from 6 mrad") == words.count("\nTrue stops from 6 mrad") == 1
    assert "\N{MINUS SIGN}3, 3 N m" in words
    assert "hysteresis" in list_words(elasticity=Elasticity(stiffness=100.0), truth=None)[-1]
    still = show_spring(replace(spring, torsion=0.0, excited=0.0, torque=0.0))
    assert "\N{PLUS-MINUS SIGN}7.5 mrad" in find_table(still, "Values").rows[2][0]
    damped = Elasticity(stiffness=100.0, cubic=5e4, damping=0.3)
    blocks = show_spring(replace(spring, elasticity=damped, truth=None))
    *_, loss, cubic, damping = find_table(blocks, "Values").rows
    assert (cubic[:2], damping[:2]) == (("cubic stiffness", "5e+04"), ("damping", "0.3"))
    assert float(loss[1]) == pytest.approx(0.0, abs=1e-12)
    assert not any(text.startswith("Standard deviations: ") for text in texts)
    (text,) = (x for x in list_words(torque_std=0.0123, slope_std=4.56) if x.startswith("Standard dev"))
    assert re.search(r"4.6 N m/rad of the slope near zero.*0.012 N m \(rms\)", text)


def test_methods_are_compared_by_prediction_and_truth(estimate):
    blocks = show(estimate)
    assert "It explains <most>." in blocks
    table = find_table(blocks, "Methods")
    assert [row[:3] for row in table.rows] == [
        ("two-step (chosen)", "1.003", "0.8571"),
        ("elimination", "1.44", "14.29"),
        ("linear-spring", "\N{EN DASH}", "0.8571"),
    ]
    assert table.picked == 0
    measured = show(replace(estimate, simulated=False))
    assert find_table(measured, "Methods").header == ("method", "prediction error (noise = 1)", "outcome")
    unknown = tuple(replace(entry, truth=None) for entry in estimate.parameters)
    springs = tuple(replace(spring, truth=None) for spring in estimate.springs)
    blocks = show(replace(estimate, parameters=unknown, springs=springs))
    assert not any("truth" in block.header for block in blocks if isinstance(block, Table))
    assert find_table(blocks, "Methods").header == ("method", "prediction error (noise = 1)", "outcome")


def test_convergence_survives_iterates_that_ran_away_or_of_another_method(estimate):
    history = (*estimate.history, HistoryEntry(merit=float("inf"), change=float("nan")))
    blocks = show(replace(estimate, history=history, outcome=Ending.DIVERGED))
    table = find_table(blocks, "Every iteration")
    assert len(table.rows) == 5
    assert table.rows[-1][1:3] == ("inf", "nan")
    assert Ending.DIVERGED.value in blocks[blocks.index("== Convergence ==") + 1]
    assert not any("nan" in block.svg for block in blocks if isinstance(block, Drawing))
    still = tuple(HistoryEntry(merit=0.0, change=0.0) for _ in range(3))
    blocks = show(replace(estimate, history=still))
    assert isinstance(blocks[blocks.index("== Convergence ==") + 2], Table)
    plain = replace(estimate, method="elimination", outcome=Ending.SOLVED, history=still[:1])
    assert "== Convergence ==" not in show(plain)
    # A method without iterations shows those of another one.
    for fit, other in ((plain, estimate), (estimate, replace(estimate, method="other"))):
        assert f"4 iterations of two-step, {Ending.CONVERGED.value}." in show(fit, iterated=other)


def test_tracking_has_the_rms_of_every_joint(estimate, tracking):
    table = find_table(show(estimate, tracking=tracking), "RMS")
    names, *columns = zip(*table.rows, strict=True)
    assert names == ("rigid <feed>", "Case 1", "Case 2")
    values = np.array(columns, dtype=float).T
    expected = np.array([np.sqrt(np.mean(1e6 * run.error**2, axis=0)) for run in tracking])
    np.testing.assert_allclose(values, expected, rtol=1e-3)
    assert table.header[1:] == ("<one> (mrad)", "two (mrad)")


@pytest.mark.parametrize(
    ("share", "outcome", "level"),
    [
        (0.01, Ending.CONVERGED, "good"),
        (0.2, Ending.CONVERGED, "usable"),
        (0.5, Ending.CONVERGED, "doubtful"),
        (0.0, Ending.LIMIT, "usable"),
        (0.0, Ending.DIVERGED, "doubtful"),
    ],
)
def test_the_verdict_follows_what_springs_leave_and_how_the_iteration_ended(
    estimate, trial, share, outcome, level
):
    joints = tuple(replace(joint, final=(1.0 - share) * joint.link) for joint in trial.joints)
    verdict = judge(replace(estimate, outcome=outcome), replace(trial, joints=joints))
    assert verdict.level == level
    assert f"at most {100 * share:.3g} % of a joint's torque" in verdict.headline


def test_linear_springs_that_do_as_well_are_named_and_drawn(estimate, trial):
    joints = tuple(replace(joint, final=joint.straight * joint.torsion) for joint in trial.joints)
    for entry, same in ((trial, False), (replace(trial, joints=joints), True)):
        assert any("no better" in text for text in judge(estimate, entry).details) is same
    joint = trial.joints[0]
    assert "linear start" in draw_loops(joint).svg
    assert "best linear spring" in draw_loops(replace(joint, initial=None)).svg


def test_pages_without_springs_covariance_or_another_log(estimate, trial):
    joints = tuple(replace(joint, final=None, initial=None) for joint in trial.joints)
    page = build_elastic_page(estimate, (replace(trial, joints=joints),))
    assert "at most 1.5 % of a motor's torque" in page.verdict.headline
    assert not any("springs with memory" in text for text in page.verdict.details)
    page = build_elastic_page(estimate, (replace(trial, fitted=True),))
    assert page.verdict.level == "usable"
    assert page.verdict.headline == build_elastic_page(estimate).verdict.headline
    assert "log of the fit" in page.blocks[1]
    page = build_elastic_page(replace(estimate, covariance=()), (trial,))
    rows = find_table(page.blocks, "With standard deviations").rows
    assert {(row[3], row[6]) for row in rows} == {("-", None)}
    assert not any("\N{PLUS-MINUS SIGN}" in row[1] for row in rows)
    assert not any("standard deviations" in text for text in page.verdict.details)


def test_a_truth_that_is_met_within_a_percent_is_met(estimate, trial):
    sharp = tuple(replace(entry, std=1e-6) for entry in estimate.parameters[2:])
    kept = (*estimate.parameters[:2], *sharp)
    good = replace(trial, joints=tuple(replace(joint, final=joint.motor) for joint in trial.joints))
    verdict = judge(replace(estimate, parameters=kept), good)
    assert verdict.level == "good"
    assert any("0.86 % (ZZ" in text for text in verdict.details)
    far = tuple(replace(entry, value=0.36) for entry in sharp)
    verdict = judge(replace(estimate, parameters=(*kept[:2], *far)), good)
    assert verdict.level == "usable"
    assert "ZZ2, IA1" in verdict.reasons[-1]


@pytest.mark.parametrize(
    ("held_out", "springs", "contradiction", "level"),
    [
        (4.0, 0.3, 0.0, "good"),
        (12.0, 0.3, 0.0, "usable"),
        (4.0, 15.0, 0.0, "usable"),
        (4.0, 0.3, 9.0, "usable"),
    ],
)
def test_without_a_held_out_log_stretches_of_its_own_logs_judge(
    estimate, held_out, springs, contradiction, level
):
    evidence = ElasticEvidence(
        held_out=(held_out, 1.0), noise=(1.3, 1.0), springs=(springs, 0.2), contradiction=contradiction
    )
    verdict = judge_elastic(replace(estimate, evidence=evidence, parameters=(), covariance=()), ())
    assert verdict.level == level
    told = f"at most {held_out:.3g} % of a motor's torque, 1.3 times its noise"
    assert told in verdict.headline
    assert ("differ from those without" in verdict.headline) == (contradiction > 5.0)


def test_evidence_has_a_value_a_joint_and_refused_springs_do_not_judge(estimate):
    lost = replace(estimate.springs[0], identifiable=False, reason="no torsion")
    springs = (lost, replace(lost, joint="two", identifiable=True))
    whole = ElasticEvidence(held_out=(4.0, 1.0), noise=(1.0, 1.0), springs=(90.0, 0.2))
    plain = replace(estimate, evidence=whole, springs=springs, parameters=(), covariance=())
    assert "of the springs at most 0.2 %" in judge_elastic(plain, ()).headline
    assert not any("evidence" in text for text in replace(estimate, evidence=whole).list_mistakes())
    for broken in ({"held_out": ()}, {"noise": (1.0,)}, {"springs": (-1.0, 0.2)}):
        wrong = replace(estimate, evidence=replace(whole, **broken)).list_mistakes()
        assert any(text.startswith("evidence: ") for text in wrong)


MASS, ROTOR, STIFFNESS = 40.0, 6.0, 9000.0
FRICTION = (15.0, 0.0, -3.0)
PERIOD = 1e-3
OMEGAS = 2.0 * np.pi * np.array([0.3, 0.7, 1.1])


def find_motion(time, order):
    """Return the derivative of q of an order: a sum of sines."""
    angle = OMEGAS * time[:, None] + np.array([0.0, 1.0, 2.0]) + order * np.pi / 2.0
    return (0.2 * OMEGAS**order * np.sin(angle)).sum(axis=1)


def build_log(source="log"):
    """Return what a slide driven through a linear spring shows, the torque held between samples."""
    time = PERIOD * np.arange(12_001)

    def find_motor(at, order):
        return find_motion(at, order) + MASS / STIFFNESS * find_motion(at, order + 2)

    middle = time + PERIOD / 2.0
    torque = MASS * find_motion(middle, 2) + ROTOR * find_motor(middle, 2)
    torque += FRICTION[0] * find_motor(middle, 1) + FRICTION[2]
    position, motor, torque = (x[:, None] for x in (find_motion(time, 0), find_motor(time, 0), torque))
    return Recording(time=time, position=position, motor_position=motor, torque=torque, source=source)


@pytest.fixture(scope="module")
def library():
    plain = build_one_axis(np.array([MASS, *FRICTION]))
    rotor = ParameterCard(name="IA1", expression="IA1", unit="kg", reason="turns alone", joint="joint1")
    card = replace(plain.card, rotors=(rotor,), elasticity=(Elasticity(stiffness=STIFFNESS),))
    return replace(plain, card=card)


def predict(library, stiffness=STIFFNESS, truth=None, **options):
    """Return what true parameters and a spring predict of the log."""
    estimate = build_estimate()
    spring = replace(estimate.springs[0], elasticity=Elasticity(stiffness=stiffness), truth=truth)
    estimate = replace(estimate, springs=(spring,) if stiffness else ())
    return evaluate_elastic(estimate, library, build_log("another"), **options)


def test_true_parameters_leave_nothing_and_a_wrong_spring_is_seen(library):
    trial = predict(library)
    (joint,) = trial.joints
    assert (joint.joint, joint.unit, joint.torsion_unit) == ("joint1", "N", "m")
    scale = np.abs(joint.motor).max()
    for other in (joint.link, joint.final, STIFFNESS * joint.torsion):
        np.testing.assert_allclose(other, joint.motor, atol=2e-3 * scale)
    assert (joint.initial, joint.truth, trial.fitted) == (None, None, False)
    assert joint.straight == pytest.approx(STIFFNESS, rel=2e-3)
    assert len(trial.residuals) == 3
    assert all(entry.relative_percent < 0.2 for _, lines in trial.residuals for entry in lines)
    trial = predict(library, 1.1 * STIFFNESS)
    dynamics, motors, links = (lines[0] for _, lines in trial.residuals)
    assert dynamics.relative_percent < 0.2
    assert motors.norm == pytest.approx(0.1 * np.linalg.norm(trial.joints[0].motor), rel=0.02)
    assert links.relative_percent == pytest.approx(10.0, abs=0.2)


def test_start_and_truth_are_drawn_where_they_are_known(library):
    start = (Elasticity(stiffness=0.5 * STIFFNESS),)
    trial = predict(library, initial=start, truth=Elasticity())
    (joint,) = trial.joints
    np.testing.assert_allclose(joint.initial, 0.5 * joint.final, rtol=1e-12)
    # A robot file may name a spring without its value.
    assert joint.truth is None
    trial = predict(library, None)
    assert (trial.joints[0].final, len(trial.residuals)) == (None, 1)


def build_estimate(**settings):
    names, spring = ("M1", "IA1", "Fv1", "Fc1", "offset1"), Elasticity(stiffness=STIFFNESS)
    values = dict(zip(names, (MASS, ROTOR, *FRICTION), strict=True))
    settings = {"stops": 8, "rate": 60.0, "cutoff": 0.0, **settings}
    return build_elastic_estimate(values, spring, unit="N", signature="one_axis-signature", settings=settings)


def test_an_estimate_is_tried_with_its_own_filters_and_knows_its_logs(library, tmp_path):
    log = build_log("another")
    ((joint,), (other,)) = (
        evaluate_elastic(build_estimate(rate=rate), library, log).joints for rate in (60.0, 120.0)
    )
    np.testing.assert_array_equal(joint.truth, joint.final)
    # Rows are as many a time constant of the filter.
    lag = np.max(np.abs(other.torsion[::2] - joint.torsion))
    assert lag > 0.02 * np.max(np.abs(joint.torsion))
    copy = tmp_path / "copy.npz"
    copy.write_bytes(b"the same bytes")
    digests = [compute_file_digest(str(copy))]
    for source, known, fitted in (("log", [], True), ("", [], False), (str(copy), digests, True)):
        trial = evaluate_elastic(build_estimate(log_digests=known), library, replace(log, source=source))
        assert trial.fitted is fitted
