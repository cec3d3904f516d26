"""The report of friction: its verdict, curves with their band, tables; nothing from elsewhere."""

from dataclasses import replace
from html import escape

import numpy as np
import pytest

from symid.identification.estimators import ParameterEstimate
from symid.identification.friction.identify import FrictionTask, identify_friction
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.report.identification_page import (
    build_friction_figure,
    build_friction_page,
    compute_friction_curve,
)
from symid.report.pages import render_page, write_page
from symid.report.verdict import judge_friction
from tests.pages import PageReader
from tests.recovery.closed_form import build_two_link
from tests.unit.identification.friction.cosine_rigs import RAW, STRIBECK, record

FEW = ("coulomb-viscous-offset", "stribeck+offset")


@pytest.fixture(scope="module")
def found():
    recordings = (record(0.15), record(1.0, seed=1), record(1.0, pose=(0.3, 1.2), seed=2))
    return identify_friction(build_two_link(), recordings, RAW, FrictionTask(candidates=FEW))


def test_the_page_tells_all_and_loads_nothing(found, tmp_path):
    text = write_page(tmp_path / "page.html", build_friction_page(found)).read_text()
    reader = PageReader(text)
    assert reader.loaded == []
    assert "script" not in reader.tags
    (joint,) = found.joints
    # A search that was at its end from the first step has no curve to show.
    history = joint.estimate.history
    moved = len(history) > 2 and max(history) > 1.01 * min(history)
    assert reader.tags.count("svg") == 1 + moved
    settled = replace(joint, estimate=replace(joint.estimate, history=(4.0, 2.0, 1.0)))
    assert "Did the search converge?" in render_page(build_friction_page(replace(found, joints=(settled,))))
    for expected in ("joint1: stribeck+offset", "chosen", *(name for name, _ in found.refused)):
        assert expected in text
    assert escape(joint.poses.verdict[1:]) in text


def test_a_figure_says_what_it_shows_and_holds_the_true_curve(found):
    (joint,) = found.joints
    velocity, torque, half_width = compute_friction_curve(joint)
    law = get_law("stribeck+offset")
    linear, shape = law.from_physical([STRIBECK[entry.name] for entry in law.physical])
    truth = compute_friction_torque(law, {"velocity": velocity}, linear, shape)
    assert np.all(np.diff(velocity) > 0.0)
    # Two of three at least: neighbours along the curve err together.
    assert np.mean(np.abs(torque - truth) <= half_width) > 0.66
    assert half_width.max() < 0.3
    text = build_friction_figure(found.joints[0]).svg
    assert text.startswith("<svg")
    assert "friction (N m)" in text
    # One row each.
    assert text.count("h0") == 600


def test_the_curve_ends_at_the_slowest_row():
    processing = replace(RAW, standstill=0.25)
    found = identify_friction(
        build_two_link(), (record(1.0),), processing, FrictionTask(model="coulomb-viscous-offset")
    )
    (joint,) = found.joints
    slowest = joint.velocity_map.slowest
    assert 0.25 <= slowest < 0.26
    velocity, _, _ = compute_friction_curve(joint)
    assert np.abs(velocity).min() == pytest.approx(slowest)
    assert {-1.0, 1.0} == set(np.sign(velocity))
    # The law and both edges of its band, in either direction; no line through standstill.
    assert build_friction_figure(joint).svg.count("<polyline") == 2 * 3
    reaching = replace(joint, velocity_map=replace(joint.velocity_map, slowest=1e-5))
    assert 0.0 in compute_friction_curve(reaching)[0]
    assert build_friction_figure(reaching).svg.count("<polyline") == 3


def test_the_verdict_weighs_what_was_held_back_refused_or_left_out(found):
    (joint,) = found.joints

    def judge(**changes):
        return judge_friction(replace(found, joints=(replace(joint, **changes),)))

    def judge_law(**changes):
        return judge(estimate=replace(joint.estimate, **changes))

    assert judge().level == "good"
    assert "RMS" in judge().headline
    verdict = judge(selection=None)
    assert verdict.level == "usable"
    assert "RMS" not in verdict.headline
    assert judge(residual=replace(joint.residual, relative_percent=40.0)).level == "doubtful"
    verdict = judge_law(refused=(("vs", "too fast"),))
    assert verdict.level == "usable"
    assert "vs of joint1" in verdict.headline
    excess = ParameterEstimate(name="fE", value=-3.5, std=0.2, unit="N")
    for value, said in ((-3.5, True), (-0.3, False), (3.5, False)):
        verdict = judge_law(parameters=(*joint.estimate.parameters, replace(excess, value=value)))
        assert ("falls towards zero speed" in verdict.headline) is said
        assert verdict.level != "good" or not said
    poses = replace(joint.poses, parameters=(), skipped=(("log 7", "every row is slow"),))
    text = render_page(build_friction_page(replace(found, joints=(replace(joint, poses=poses),))))
    assert "left out: log 7: every row is slow" in text
    assert "pose 1, 95 %" not in text
