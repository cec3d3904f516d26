"""Friction laws that were chosen stay only where they predict the whole robot as well as the plain law."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import symid
from symid.identification import rigid
from symid.identification.estimators.estimate import LawSelection
from symid.identification.friction_search import (
    _give_up_worse,
    _hold_shape,
    _keep_slow_rows,
    _move_friction,
    _Result,
    _take_deviations,
)
from symid.identification.rigid import PLAIN, FrictionChoice, friction_choice
from symid.identification.rigid.friction_choice import JointLaw, Trial, choose_plainest, choose_trial
from symid.joint_models import FrictionValues, compute_columns, get_law
from symid.robot import Processing
from tests.estimates import build_estimate

NAMES = {"shoulder": "auto", "elbow": "auto"}
STRIBECK = FrictionValues(law="stribeck", values=(1.0, 1.0, 0.5), shape=(0.1,))
PLAIN_LEFT = {"shoulder": 3.0, "elbow": 4.0}


@pytest.fixture(scope="module")
def robot():
    """Return the two-link arm with laws that were chosen."""
    stated = symid.load("two_link").description
    joints = tuple(replace(joint, friction=STRIBECK) for joint in stated.joints)
    return replace(stated, joints=joints)


def make_losses(left):
    """Return losses (24, 2) of joints whose laws leave what `left` says, in percent, in parts that differ."""
    rng = np.random.default_rng(1)
    return np.square([left[name] for name in NAMES]) * rng.uniform(0.9, 1.1, (24, 2)) / 24


def make_fit(left, calls):
    """Return a fit whose joints leave what `left` says of them with Stribeck friction, else `PLAIN_LEFT`."""

    def fit(robot):
        laws = {joint.name: joint.friction.law for joint in robot.axes}
        calls.append(laws)
        losses = make_losses(
            {name: (PLAIN_LEFT if law == PLAIN else left)[name] for name, law in laws.items()}
        )
        return _Result(estimate=None, robot=robot, library=None, refit=None, measure=lambda _: losses)

    return fit


def give_up(robot, left, names=NAMES):
    """Return the law of each joint in the end, the choice, and the fits that were made."""
    calls = []
    fit = make_fit(left, calls)
    found = fit(robot)
    calls.clear()
    selection = LawSelection(trials=(), chosen="stribeck", verdict="It was.", blocks=10)
    joints = tuple(JointLaw(joint=name, friction=STRIBECK, selection=selection) for name in NAMES)
    made = FrictionChoice(joints=joints, beta=np.zeros(6), motion=None)
    choice, result = _give_up_worse(made, names, fit, found, make_losses(PLAIN_LEFT))
    return {joint.name: joint.friction.law for joint in result.robot.axes}, choice, calls


def test_laws_that_predict_better_stay_and_others_give_way_at_their_joints_alone(robot):
    # One percent less in the residual is two in its squares, which does not matter.
    laws, choice, calls = give_up(robot, {"shoulder": 2.0, "elbow": 4.03})
    assert set(laws.values()) == {"stribeck"}
    assert (choice.notices, calls) == ((), [])
    assert [law.selection.chosen for law in choice.joints] == ["stribeck", "stribeck"]
    laws, choice, calls = give_up(robot, {"shoulder": 2.0, "elbow": 4.4})
    assert laws == {"shoulder": "stribeck", "elbow": PLAIN}
    assert calls == [laws]
    assert [law.selection.chosen for law in choice.joints] == ["stribeck", PLAIN]
    verdict = choice.joints[1].selection.verdict
    assert verdict == f"It was. In fits of the whole robot {PLAIN} predicts better."
    (notice,) = choice.notices
    assert notice.code == "identify.plain-friction"
    assert notice.text.endswith("(elbow: stribeck has 1.21 times the squared residual)")
    laws, choice, calls = give_up(robot, {"shoulder": 3.3, "elbow": 5.0})
    assert set(laws.values()) == {PLAIN}
    assert len(calls) == 1
    assert "shoulder: stribeck has 1.21 times" in choice.notices[0].text
    # Laws that were named stay.
    names = {"shoulder": "stribeck", "elbow": "auto"}
    laws, choice, _ = give_up(robot, {"shoulder": 5.0, "elbow": 5.0}, names)
    assert laws == {"shoulder": "stribeck", "elbow": PLAIN}
    assert "shoulder" not in choice.notices[0].text


def test_a_law_that_is_worse_in_one_part_alone_stays(robot):
    """Chance, or a collision, makes one part bad."""
    plain = make_losses(PLAIN_LEFT)
    bad = plain.copy()
    bad[3] *= 20.0
    selection = LawSelection(trials=(), chosen="stribeck", verdict="It was.", blocks=10)
    joints = tuple(JointLaw(joint=name, friction=STRIBECK, selection=selection) for name in NAMES)
    made = FrictionChoice(joints=joints, beta=np.zeros(6), motion=None)
    found = _Result(estimate=None, robot=robot, library=None, refit=None, measure=lambda _: bad)
    assert _give_up_worse(made, NAMES, None, found, plain) == (made, found)


def make_trial(name, losses):
    law = get_law(name)
    linear = np.zeros(len(law.linear))
    return Trial(law=law, node=None, linear=linear, losses=losses, own=losses, fitted=1.0, weak=())


@pytest.mark.parametrize(("behind", "taken"), [(0.5, "temperature"), (2.0, "temperature-viscous")])
def test_of_laws_as_plain_and_as_good_the_one_with_fewer_shape_values_is_taken(behind, taken):
    """A law of a shape value imitates a straight line where the value leaves the data."""
    rng = np.random.default_rng(2)
    best = rng.uniform(1.0, 2.0, 24)
    more = rng.uniform(-0.4, 0.4, 24)
    more += behind * np.std(more, ddof=1) / np.sqrt(24) - more.mean()
    straight, curved = best * np.exp(more), best
    trials = [make_trial("temperature", straight), make_trial("temperature-viscous", curved)]
    trials.append(make_trial("stribeck+cubic", 0.999 * best))
    choice = choose_trial(trials)
    assert trials[choice.taken].law.name == taken
    # Student's t with 23 degrees of freedom; two hundredths of the mean are added to both losses.
    assert choice.chances[0] == pytest.approx(scipy.stats.t.sf(behind, 23), abs=0.05)


def test_the_plainest_of_many_is_taken_at_the_rate_that_the_level_says():
    """Twenty richer candidates that only differ by chance: one of ten families may name one of them."""
    rng, wrong = np.random.default_rng(5), 0
    for _ in range(300):
        common = rng.uniform(0.5, 2.0, 24)
        losses = common * np.exp(0.1 * rng.standard_normal((21, 24)))
        wrong += choose_plainest(losses, [1, *[2] * 20], [0] * 21).taken != 0
    assert 0.02 < wrong / 300 < 0.2
    # A better one is found, and of those as good the plainest.
    losses[7:] *= 0.8
    assert choose_plainest(losses, [1, *range(21, 1, -1)], [0] * 21).taken == 20


@pytest.mark.parametrize("bend", [0.15, 0.2, 0.3])
def test_a_curve_whose_friction_drives_its_joint_gives_way_to_one_that_brakes(bend):
    """A wide fall below zero, added to dry friction and taken away again, imitates any gentle curve."""
    rng, law = np.random.default_rng(0), get_law("stribeck")
    dq = rng.uniform(0.05, 1.0, 2400) * rng.choice((-1.0, 1.0), 2400)
    size = 1.0 + 0.4 * np.exp(-((dq / 0.15) ** 2)) - bend * np.sin(np.pi * np.abs(dq)) ** 2
    tau = np.sign(dq) * size + 0.3 * dq + 0.01 * rng.standard_normal(2400)
    given = {"velocity": dq}, lambda columns: columns, np.zeros((2400, 0)), tau
    parts, fold, speeds = np.array_split(np.arange(2400), 24), np.arange(24) // 4, np.abs(dq)

    def tabulate(wanted, _):
        return [rigid.tabulate_rows(wanted[0], *given, parts, fold)]

    nodes = [(law, shape) for shape in rigid.list_shape_nodes(law, speeds)]
    free = [np.linalg.lstsq(compute_columns(law, given[0], shape), tau, None) for _, shape in nodes]
    assert min(free, key=lambda fit: fit[1])[0][0] < 0.0 or bend < 0.2
    ((trial,),) = rigid.search_laws(tabulate, [nodes], [speeds]).trials
    assert np.all(trial.linear[:3] > 0.0)
    assert trial.shape[0] == pytest.approx(0.15, rel=1.0)


@pytest.mark.parametrize(
    ("chances", "bent", "moved"),
    [
        # Values of the law and of another, by name; what is added to the variances of Fc and Fv of joint 1.
        ((0.0, 1.0), (0.7, 1.2, 0.5), (0.04, 0.09)),
        ((1.0, 1.0), (0.7, 1.2, 0.5), (0.5 * 0.01 + 0.5 * 0.04, 0.5 * 0.09)),
        ((1.0, 0.25), (0.7, 1.2, 0.5), (0.8 * 0.01 + 0.2 * 0.04, 0.2 * 0.09)),
        # A law that drives its joint says nothing.
        ((0.0, 1.0), (-0.7, 1.2, 0.5), (0.0, 0.0)),
    ],
)
def test_laws_that_predict_alike_all_count_in_the_deviations(monkeypatch, chances, bent, moved):
    cards = [
        SimpleNamespace(name=name, number=k, friction="coulomb-viscous") for k, name in enumerate(NAMES, 1)
    ]
    fitted = [SimpleNamespace(name=f"{name}{k}") for k in (1, 2) for name in ("ZZ", "Fv", "Fc")]
    library, joints = SimpleNamespace(card=SimpleNamespace(joints=cards, fitted=fitted, size=2)), []
    selection = LawSelection(trials=(), chosen="stribeck", verdict="It was.", blocks=10)
    weights = [chance / sum(chances) for chance in chances]
    for joint in cards:
        laws = (
            FrictionValues(law="coulomb-viscous", values=(1.0, 1.1)),
            FrictionValues(law="stribeck", values=bent, shape=(0.1,)),
        )
        taken = laws[weights.index(max(weights))]
        tried = tuple(zip(laws, weights, strict=True))[: 2 if joint.name == "shoulder" else 1]
        joints.append(JointLaw(joint=joint.name, friction=taken, selection=selection, tried=tried))
    made = FrictionChoice(joints=tuple(joints), beta=np.zeros(6), motion=None)
    monkeypatch.setattr(friction_choice, "choose_laws", lambda *_, **__: made)
    values = np.ones(len(fitted))
    errors, notices = friction_choice.measure_law_errors(library, (), None, [True, False], values)
    added = dict(zip((entry.name for entry in fitted), np.sum(errors**2, axis=0), strict=True))
    assert (added.pop("Fc1"), added.pop("Fv1")) == pytest.approx(moved)
    assert not any(added.values())
    assert [one.code for one in notices] == ["identify.friction-law"] * (weights[1] > 0.5 and bent[0] > 0.0)


def test_values_that_stay_get_the_deviations_of_the_columns_about_them():
    earlier = build_estimate(symid.load("two_link").description)
    wider = tuple(replace(entry, value=7.0, std=3.0 * entry.std) for entry in earlier.parameters[1:])
    found = _take_deviations(earlier, replace(earlier, parameters=wider))
    assert [entry.value for entry in found.parameters] == [entry.value for entry in earlier.parameters]
    first, *rest = (new.std / old.std for new, old in zip(found.parameters, earlier.parameters, strict=True))
    # What the later fit does not have keeps its own.
    assert (first, set(rest)) == (1.0, {3.0})


def make_parameter(name, value, std=0.01):
    return SimpleNamespace(name=name, value=value, std=std)


@pytest.mark.parametrize(
    ("step", "std", "moved"),
    [
        (0.03, 0.02, 0.13),
        (-0.04, 0.001, 0.06),
        # A long step is shortened, and none where it may be chance; the speed stays positive.
        (-0.2, 0.02, 0.05),
        (0.9, 0.02, 0.2),
        (-0.2, 0.1, 0.1),
        (0.9, 1.0, 0.1),
    ],
)
def test_shape_values_go_no_farther_than_their_columns_are_straight(robot, step, std, moved):
    found = (make_parameter("Fe1", -3.0), make_parameter("vs1", 0.1 + step, std))
    first = _move_friction(robot, SimpleNamespace(parameters=found, unresolved=())).axes[0].friction
    assert first.shape == pytest.approx((moved,))
    assert first.values == (1.0, 1.0, -3.0)


def test_slow_samples_are_kept_from_the_bend_of_the_law_on_that_was_found(robot):
    """From half of that speed: the law of the first joint bends at 0.1 rad/s, that of the second nowhere."""
    joints = (robot.joints[0], replace(robot.joints[1], friction=FrictionValues(law=PLAIN)))
    robot = replace(robot, joints=joints, processing=Processing(automatic=True))
    plan = rigid.FitPlan(processing=replace(robot.processing, standstill=(0.2, 0.3)), estimator="wls")
    kept = _keep_slow_rows(plan, robot, np.array([0.0123456, 0.01]))
    assert kept.processing.standstill == (0.05, 0.3)
    assert kept.notices[-1].text.endswith("shoulder 0.05")
    # Not those that the choice of laws left out.
    kept = _keep_slow_rows(plan, robot, np.array([0.123456, 0.01]))
    assert kept.processing.standstill == (0.123, 0.3)
    # None is left out, or fewer.
    assert _keep_slow_rows(plan, robot, np.array([0.4, 0.01])) == plan
    early = replace(plan, processing=replace(plan.processing, standstill=(0.02, 0.3)))
    assert _keep_slow_rows(early, robot, np.array([0.01, 0.01])) == early
    # Those that a user states stay.
    stated = replace(robot, processing=plan.processing)
    assert _keep_slow_rows(plan, stated, np.array([0.01, 0.01])) == plan
    open_plan = replace(plan, processing=replace(plan.processing, standstill=None))
    assert _keep_slow_rows(open_plan, robot, np.array([0.01, 0.01])) == open_plan


@pytest.mark.parametrize("step", [0.001, 0.03])
def test_values_are_those_of_a_fit_about_the_shape_values_that_are_stated(robot, step):
    """A straight step of a shape value together with those of its linear values is no fit of the law."""
    plain = build_estimate(robot)
    new = replace(plain.parameters[0], name="vs1", value=0.1 + step, std=0.05)
    both = (*plain.parameters, new)
    spread = np.outer(stds := [one.std for one in both], stds) * (0.5 + 0.5 * np.eye(len(both)))
    stepped = replace(plain, parameters=both, covariance=tuple(map(tuple, spread.tolist())))
    held = replace(plain, parameters=tuple(replace(one, value=5.0, std=1e-9) for one in plain.parameters))
    library = SimpleNamespace(card=SimpleNamespace(searched=(SimpleNamespace(name="vs1"),)))
    moved = _move_friction(robot, stepped)
    found = _hold_shape(_Result(stepped, robot, library, lambda _: held, None), moved, stepped)
    assert [entry.std for entry in found.estimate.parameters] == [one.std for one in stepped.parameters]
    # Of the values that are kept too, so that the fit can be stored and read again.
    assert found.estimate.list_mistakes() == []
    np.testing.assert_allclose(found.estimate.covariance, spread)
    if step == 0.001:
        assert found.estimate.parameters == stepped.parameters
    else:
        assert [entry.value for entry in found.estimate.parameters] == [*[5.0] * len(plain.parameters), 0.13]
    assert found.robot.axes[0].friction.shape == moved.axes[0].friction.shape == pytest.approx((0.1 + step,))
