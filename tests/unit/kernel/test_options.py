"""Options are said once: a record has their checks, their meaning, and the options of the command line."""

import click
import numpy as np
import pytest

import symid
from symid.cli.identification import identify_command
from symid.options import ExciteOptions, PayloadOptions, SimulateOptions, list_options, merge

RECORDS = [symid.IdentifyOptions, symid.LawOptions, ExciteOptions, SimulateOptions, PayloadOptions]


def find_notices(call):
    with pytest.raises(symid.UsageError) as caught:
        call()
    return [(notice.code, notice.text) for notice in caught.value.notices]


def test_all_wrong_values_are_refused_at_once():
    found = find_notices(
        lambda: symid.IdentifyOptions(decimate=0, overlap=2.0, rows="torques", prior_weight=-1)
    )
    assert [code for code, _ in found] == ["usage.unknown-rows", "usage.range", "usage.prior", "usage.range"]
    assert "overlap=2.0: expected a finite number of 0 or more, 0.95 at most" in [text for _, text in found]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "fast", 0.0])
def test_a_positive_number_is_one(value):
    assert find_notices(lambda: ExciteOptions(velocity=value))[0][0] == "usage.range"


def test_numbers_of_numpy_and_lists_become_python_s_own():
    options = SimulateOptions(noise=np.float32(0.5), stiffness=np.array([1, 2]), seed=np.int64(3))
    assert (options.noise, options.stiffness, options.seed) == (0.5, (1, 2), 3)
    assert type(options.seed) is int
    assert symid.LawOptions(period=np.int64(2)).period == (2,)


def test_keywords_win_over_fields_where_they_are_given():
    options = SimulateOptions(seed=5, clean=True)
    assert merge(options, SimulateOptions(), seed=None, clean=False) == SimulateOptions(seed=5)
    assert merge(None, SimulateOptions(), seed=7).seed == 7


@pytest.mark.parametrize("record", RECORDS)
def test_records_are_frozen_and_explained(record):
    options = record()
    for name, entry in list_options(record).items():
        assert entry.meaning
        assert f"        {name}: " in record.__doc__
        with pytest.raises(AttributeError):
            setattr(options, name, None)
    assert not hasattr(options, "__dict__")


def test_the_verb_has_the_options_of_its_records():
    shown = {parameter.name: parameter for parameter in identify_command.params}
    for record in (symid.IdentifyOptions, symid.LawOptions):
        known = list_options(record)
        assert {name for name, entry in known.items() if entry.group} <= shown.keys()
    assert shown["threshold_count"].opts == ["--thresholds"]
    assert isinstance(shown["drop_first"].type, click.IntRange)


def test_a_prior_is_percent_of_the_robot_or_a_factor_on_a_fit():
    robot = symid.load("two_link")
    log = robot.simulate(duration=3.0).log
    fit = robot.identify(log)
    for wrong in ({"prior_factor": 2.0}, {"prior": fit, "prior_percent": 10.0}):
        options = symid.IdentifyOptions(estimator="ridge", **wrong)
        assert (
            find_notices(lambda options=options: robot.identify(log, options=options))[0][0] == "usage.prior"
        )
