"""`symid fleet`: a study, its table and page, exit codes, and a call that is ended."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from symid.cli.main import run

STUDY = 'robot = "two_link"\nestimator = "ols"\nrepeats = {count}\n[simulate]\nduration = 1.0\n'


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "seeds.toml"
    path.write_text(STUDY.format(count=2))
    return path


def test_a_study_is_run_and_its_table_and_page_are_written(study, capsys, c_compiler):
    arguments = ["fleet", "seeds.toml", "--executor", "serial", "--table", "rows.csv", "--page", "page.html"]
    assert run(arguments) == 0
    out, err = capsys.readouterr()
    assert out == "2 jobs: 2 done\n\ntable: rows.csv\n\npage: page.html\n"
    assert "2 of 2 jobs" in err
    # All is there, but files are not written over without being told.
    assert run(arguments) == 3
    assert "exists already" in capsys.readouterr().err
    assert run([*arguments, "--force", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["result"]["counts"] == {"done": 2}
    assert (study.parent / "seeds" / "fleet.json").exists()


def test_jobs_at_a_limit_are_an_exit_code(study, capsys):
    arguments = ["fleet", "seeds.toml", "--workers", "1", "--time-limit", "0.01", "-o", "out"]
    assert run(arguments) == 1
    out, err = capsys.readouterr()
    assert "time-out" in out
    assert "error: out: 2 of 2 jobs without a fit" in err


def test_options_that_do_not_go_together(study, capsys):
    assert run(["fleet", "seeds.toml", "--executor", "serial", "--cluster", "local"]) == 2
    assert "--cluster needs the executor dask" in capsys.readouterr().err
    assert run(["fleet", "none.toml"]) == 3


def test_a_fleet_that_is_ended_ends_its_workers_and_goes_on(study, project, capsys, c_compiler):
    study.write_text(STUDY.format(count=8))
    environment = os.environ | {"PYTHONPATH": str(project)}
    command = [sys.executable, "-m", "symid", "fleet", "seeds.toml", "--workers", "1"]
    process = subprocess.Popen(command, cwd=study.parent, env=environment, stderr=subprocess.PIPE, text=True)
    results = study.parent / "seeds" / "results"
    for _ in range(1200):
        if results.is_dir() and list(results.glob("*.json")):
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "error: interrupted"
    kept = {path.name: path.stat().st_mtime_ns for path in results.iterdir()}
    assert 1 <= len(kept) < 8
    assert run(["fleet", "seeds.toml", "--executor", "serial"]) == 0
    assert capsys.readouterr().out.startswith("8 jobs: ")
    assert {name: (results / name).stat().st_mtime_ns for name in kept} == kept
