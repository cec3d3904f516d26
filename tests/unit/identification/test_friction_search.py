"""Friction laws that were chosen stay only where they predict the whole robot as well as the plain law."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import symid
from symid.identification.estimators import JointEvidence
from symid.identification.estimators.estimate import LawSelection
from symid.identification.friction_search import _give_up_worse, _make_plain
from symid.identification.rigid import PLAIN, FrictionChoice
from symid.identification.rigid.friction_choice import JointLaw, _Trial, choose_trial
from symid.joint_models import FrictionValues, get_law

NAMES = {"shoulder": "auto", "elbow": "auto"}
STRIBECK = FrictionValues(law="stribeck", values=(1.0, 1.0, 0.5), shape=(0.1,))
PLAIN_LEFT = {"shoulder": 3.0, "elbow": 4.0}


@pytest.fixture(scope="module")
def robot():
    """Return the two-link arm with laws that were chosen."""
    stated = symid.load("two_link").description
    joints = tuple(replace(joint, friction=STRIBECK) for joint in stated.joints)
    return replace(stated, joints=joints)


def make_fit(left, calls):
    """Return a fit whose joints leave what `left` says of them with Stribeck friction, else `PLAIN_LEFT`."""

    def fit(robot):
        laws = {joint.name: joint.friction.law for joint in robot.axes}
        calls.append(laws)
        rest = dict.fromkeys(("fitted", "moving", "slow", "torque"), 1.0)
        joints = tuple(
            JointEvidence(
                joint=name, held_out=(PLAIN_LEFT if law == PLAIN else left)[name], share=0.0, **rest
            )
            for name, law in laws.items()
        )
        return SimpleNamespace(evidence=SimpleNamespace(joints=joints)), robot, None

    return fit


def give_up(robot, left, names=NAMES):
    """Return the law of each joint in the end, the choice, and the fits that were made."""
    calls = []
    fit = make_fit(left, calls)
    found, plain = fit(robot), fit(_make_plain(robot, [name for name in names if names[name] == "auto"]))
    calls.clear()
    selection = LawSelection(trials=(), chosen="stribeck", verdict="It was.", blocks=10)
    joints = tuple(JointLaw(joint=name, friction=STRIBECK, selection=selection) for name in NAMES)
    made = FrictionChoice(joints=joints, beta=np.zeros(6), motion=None)
    choice, result = _give_up_worse(made, names, fit, found, plain)
    return {joint.name: joint.friction.law for joint in result[1].axes}, choice, calls


def test_laws_that_predict_better_stay_and_others_give_way_at_their_joints_alone(robot):
    laws, choice, calls = give_up(robot, {"shoulder": 2.0, "elbow": 4.03})
    assert set(laws.values()) == {"stribeck"}
    assert (choice.notices, calls) == ((), [])
    assert [law.selection.chosen for law in choice.joints] == ["stribeck", "stribeck"]
    laws, choice, calls = give_up(robot, {"shoulder": 2.0, "elbow": 4.3})
    assert laws == {"shoulder": "stribeck", "elbow": PLAIN}
    assert calls == [laws]
    assert [law.selection.chosen for law in choice.joints] == ["stribeck", PLAIN]
    verdict = choice.joints[1].selection.verdict
    assert verdict == f"It was. In fits of the whole robot {PLAIN} predicts better."
    (notice,) = choice.notices
    assert notice.code == "identify.plain-friction"
    assert notice.text.endswith(f"(elbow: stribeck leaves 4.3 %, {PLAIN} 4 %)")
    # Where all are worse the fit of the plain law is there already.
    laws, choice, calls = give_up(robot, {"shoulder": 3.2, "elbow": 5.0})
    assert (set(laws.values()), calls) == ({PLAIN}, [])
    assert "shoulder: stribeck leaves 3.2 %" in choice.notices[0].text
    # Laws that were named stay.
    names = {"shoulder": "stribeck", "elbow": "auto"}
    laws, choice, _ = give_up(robot, {"shoulder": 5.0, "elbow": 5.0}, names)
    assert laws == {"shoulder": "stribeck", "elbow": PLAIN}
    assert "shoulder" not in choice.notices[0].text


def make_trial(name, losses):
    law = get_law(name)
    linear = np.zeros(len(law.linear))
    return _Trial(law=law, node=None, linear=linear, losses=losses, own=losses, weak=())


@pytest.mark.parametrize(("behind", "taken"), [(0.5, "temperature"), (2.0, "temperature-viscous")])
def test_of_laws_as_plain_and_as_good_the_one_with_fewer_shape_values_is_taken(behind, taken):
    """A law of a shape value imitates a straight line where the value leaves the data."""
    rng = np.random.default_rng(2)
    best = rng.uniform(1.0, 2.0, 10)
    more = rng.uniform(-0.4, 0.4, 10)
    more += behind * np.std(more, ddof=1) / np.sqrt(10) - more.mean()
    straight, curved = best * np.exp(more), best
    trials = [make_trial("temperature", straight), make_trial("temperature-viscous", curved)]
    trials.append(make_trial("stribeck+cubic", 0.999 * best))
    place, found = choose_trial(trials)
    assert trials[place].law.name == taken
    assert found[0] == pytest.approx(behind, abs=0.1)
