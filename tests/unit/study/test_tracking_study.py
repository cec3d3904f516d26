"""Which methods the tracking study lets the automatic choice choose from."""

from unittest.mock import Mock

import pytest

from symid.identification.elastic.methods import AUTOMATIC_METHODS
from symid.study import elastic_methods as tracking_study


def test_the_automatic_choice_has_all_its_candidates(monkeypatch):
    fit_all = Mock(side_effect=KeyError("asked"))
    for name in ("prepare_elastic_scene", "observe_runs"):
        monkeypatch.setattr(tracking_study, name, Mock())
    monkeypatch.setattr(tracking_study, "fit_all_methods", fit_all)
    with pytest.raises(KeyError, match="asked"):
        tracking_study._run_seed((Mock(), "auto", 1))
    methods = set(fit_all.call_args.args[3])
    assert set(AUTOMATIC_METHODS) <= methods
    assert {"independent", "independent, link encoder"} <= methods
