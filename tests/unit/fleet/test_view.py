"""Which robots changed: the rates of false alarms and of detection, by synthetic fits."""

import csv
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import false_discovery_control, norm

import symid
from symid.errors import UsageError
from symid.fleet import Fleet, FleetJob, FleetRow, FleetValue, view

NIGHTS, PARAMETERS = 7, 10


def make_rows(rng, robots, shifts=None, *, scale=1.0, nights=NIGHTS, residuals=0):
    """Return rows of normal values, deviation 0.1; `shifts`: robot -> deviations from night 4 on."""
    rows = []
    for robot in range(robots):
        values = 3.0 + scale * 0.1 * rng.standard_normal((nights, PARAMETERS))
        values[3:, 2] += 0.1 * (shifts or {}).get(robot, 0.0)
        noise = np.exp(0.05 * rng.standard_normal((nights, residuals)))
        noise[3:] *= math.exp(0.05 * (shifts or {}).get(robot, 0.0))
        for night in range(nights):
            found = [
                FleetValue(name=f"ZZ{k}", value=value, std=0.1, unit="kg m^2")
                for k, value in enumerate(values[night].tolist())
            ]
            found += [
                FleetValue(name=f"joint {k}", value=value, std=math.inf, unit="N m", residual=True)
                for k, value in enumerate(noise[night].tolist())
            ]
            job = FleetJob(robot="arm", name=f"r{robot:03}", night=f"night {night + 1}")
            rows.append(FleetRow(key=f"{robot}-{night}", job=job, status="done", values=tuple(found)))
    return rows


def test_drifting_robots_are_found_with_parameter_and_night():
    rng = np.random.default_rng(1)
    shifts = {
        robot: float(size) for robot, size in zip(range(0, 500, 25), rng.uniform(6.0, 12.0, 20), strict=True)
    }
    found = view.find_changes(make_rows(rng, 500, shifts))
    right = {entry.name for entry in found if entry.quantity == "ZZ2" and int(entry.name[1:]) in shifts}
    assert len(right) >= 19
    since = [entry.since for entry in found if entry.name in right]
    assert since.count("night 4") >= 19
    assert len(found) - len(right) <= 3
    (first,) = [entry for entry in found if entry.name == "r025" and entry.quantity == "ZZ2"]
    assert first.sigma == pytest.approx(shifts[25] / math.sqrt(1 / 3 + 1 / 4), abs=4.0)


@pytest.mark.parametrize("control", ["benjamini-hochberg", "holm"])
def test_false_alarms_come_at_most_at_the_rate_stated(control):
    """Where nothing changed, any alarm is false: both hold the share of such nights at the level."""
    level, repeats = 0.2, 30
    alarms = sum(
        bool(view.find_changes(make_rows(np.random.default_rng(seed), 25), level=level, control=control))
        for seed in range(repeats)
    )
    # Three deviations of a binomial above the level; the bound of Sidak keeps it below.
    assert alarms <= repeats * level + 3.0 * math.sqrt(repeats * level * (1.0 - level))
    assert alarms >= 1


def test_the_share_of_false_alarms_is_held_with_true_ones_among_them():
    shares = []
    for seed in range(12):
        shifts = dict.fromkeys(range(20), 8.0)
        found = view.find_changes(make_rows(np.random.default_rng(seed), 100, shifts), level=0.1)
        false = [entry for entry in found if entry.quantity != "ZZ2" or int(entry.name[1:]) not in shifts]
        shares.append(len(false) / len(found))
    assert np.mean(shares) <= 0.1


def test_small_changes_are_found_as_often_as_the_power_says():
    """A shift d is found where |N(d / sqrt(1/3 + 1/4), 1)| exceeds the limit of Holm's first step."""
    shift, robots, level = 4.0, 60, 0.05
    tests = robots * PARAMETERS
    single = 1.0 - (1.0 - level / tests) ** (1.0 / (NIGHTS - 1))
    limit = norm.isf(single / 2.0)
    power = norm.sf(limit - shift / math.sqrt(1 / 3 + 1 / 4))
    hits = trials = 0
    for seed in range(12):
        drifting = dict.fromkeys(range(0, robots, 6), shift)
        found = view.find_changes(make_rows(np.random.default_rng(seed), robots, drifting), control="holm")
        hits += len(
            {entry.name for entry in found if entry.quantity == "ZZ2"} & {f"r{k:03}" for k in drifting}
        )
        trials += len(drifting)
    spread = math.sqrt(power * (1.0 - power) / trials)
    # Other cuts near the true one add a little.
    assert power - 3.0 * spread <= hits / trials <= power + 3.0 * spread + 0.1


def test_residuals_and_small_deviations_are_judged_by_the_scatter_of_the_fleet():
    rows = make_rows(np.random.default_rng(3), 60, {5: 10.0}, residuals=2)
    found = [entry for entry in view.find_changes(rows) if entry.residual]
    assert {(entry.name, entry.quantity, entry.since) for entry in found} == {
        ("r005", "joint 0", "night 4"),
        ("r005", "joint 1", "night 4"),
    }
    few = make_rows(np.random.default_rng(3), 10, {5: 10.0}, residuals=2)
    assert not [entry for entry in view.find_changes(few) if entry.residual]
    rows = make_rows(np.random.default_rng(4), 100, scale=3.0)
    assert view.find_changes(rows) == ()
    factors = view.compute_scatter(view._collect_series(rows))
    assert list(factors.values()) == pytest.approx([3.0] * PARAMETERS, rel=0.2)
    assert "ZZ0 (" in str(Fleet(folder=symid.fleet.view.Path("x"), rows=tuple(rows)))


def test_adjusted_probabilities_are_those_of_scipy_and_of_the_definition():
    p = np.random.default_rng(5).uniform(size=50) ** 3
    assert view.adjust_probabilities(p, "benjamini-hochberg") == pytest.approx(false_discovery_control(p))
    holm = view.adjust_probabilities(p, "holm")
    for level in (0.01, 0.05, 0.3):
        rejected = []
        for step, k in enumerate(np.argsort(p)):
            if p[k] > level / (len(p) - step):
                break
            rejected.append(k)
        assert sorted(np.flatnonzero(holm <= level)) == sorted(rejected)


def test_the_largest_change_of_a_series_is_that_of_every_cut():
    rng = np.random.default_rng(6)
    values, stds = rng.standard_normal(6), rng.uniform(0.5, 2.0, 6)
    job = FleetJob(robot="arm", name="r")
    rows = [
        FleetRow(
            key=str(k),
            job=replace(job, night=str(k)),
            status="done",
            values=(FleetValue(name="M", value=float(values[k]), std=float(stds[k]), unit="kg"),),
        )
        for k in rng.permutation(6)
    ]
    (found,) = view.find_changes(rows, level=1.0)
    sizes = {}
    for k in range(1, 6):
        parts = [np.average(values[s], weights=stds[s] ** -2.0) for s in (slice(k), slice(k, None))]
        std = math.sqrt(sum(1.0 / np.sum(stds[s] ** -2.0) for s in (slice(k), slice(k, None))))
        sizes[k] = (parts[1] - parts[0]) / std
    best = max(sizes, key=lambda k: abs(sizes[k]))
    assert found.since == str(best)
    assert found.sigma == pytest.approx(sizes[best])
    assert found.p == pytest.approx(1.0 - (1.0 - 2.0 * norm.sf(abs(sizes[best]))) ** 5)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plant")
    rows = make_rows(np.random.default_rng(7), 30, {4: 9.0}, residuals=1)
    rows.append(
        FleetRow(key="x", job=FleetJob(robot="arm", name="r9"), status="crashed", reason="ended by SIGSEGV")
    )
    return Fleet(folder=folder, rows=tuple(rows))


def test_the_table_and_the_page_say_who_what_and_since_when(fleet, tmp_path):
    text = fleet.to_text()
    assert "Robots that changed: 1" in text
    assert next(line for line in text.splitlines() if line.startswith("robot ")).split() == [
        *("robot", "what", "since", "before", "after", "sigma", "adjusted", "p", "unit")
    ]
    assert "ended by SIGSEGV" in text
    line = next(line for line in text.splitlines() if line.startswith("r004") and "ZZ2" in line)
    assert "night 4" in line
    assert fleet.to_dict()["counts"] == {"crashed": 1, "done": 210}
    assert not fleet.accepted
    text = fleet.report(tmp_path / "page.html").read_text()
    assert "1 of 31 robots changed; 1 of 211 jobs have no fit." in text
    assert "ZZ2 changed by" in text
    assert text.count("<svg") == len(fleet.changes())


def test_all_values_are_written(fleet, tmp_path):
    with (fleet.save(tmp_path / "rows.csv")).open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 210 * 11 + 1
    assert rows[-1]["reason"] == "ended by SIGSEGV"
    with pytest.raises(UsageError, match=r"parquet or \.csv"):
        fleet.save(tmp_path / "rows.xlsx")
    pq = pytest.importorskip("pyarrow.parquet")
    table = pq.read_table(fleet.save(tmp_path / "rows.parquet")).to_pylist()
    assert len(table) == len(rows)
    assert table[0]["value"] == float(rows[0]["value"])
    assert table[0]["std"] == 0.1
    assert table[10]["std"] is None


def test_the_questions_of_the_page_are_answered(fleet, tmp_path, monkeypatch, project):
    duckdb, _ = pytest.importorskip("duckdb"), pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    named = [
        replace(row, values=tuple(replace(v, name=v.name.replace("ZZ", "Fv")) for v in row.values))
        for row in fleet.rows
    ]
    replace(fleet, rows=tuple(named)).save("plant.parquet")
    page = (project / "docs" / "fleet.md").read_text(encoding="utf-8")
    lost, largest, scatter = (
        duckdb.sql(text).fetchall() for text in re.findall(r"```sql\n(.*?)```", page, re.DOTALL)
    )
    assert lost == [("crashed", "ended by SIGSEGV", 1, "r9")]
    assert largest[0][:2] == ("r004", "Fv2")
    assert len(scatter) == PARAMETERS
    assert all(ratio == pytest.approx(1.0, abs=0.3) and robots == 30 for _, ratio, robots in scatter)
