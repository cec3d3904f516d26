"""A fleet on SLURM, as docs/fleet.md starts it, gives the bytes of the serial run."""

import re
import subprocess
import sys

import pytest

import symid

pytestmark = pytest.mark.slurm

JOBS = 200
STUDY = f'robot = "two_link"\nestimator = "wls"\nrepeats = {JOBS}\n[simulate]\nduration = 3.0\n'


def read_example(project):
    """Return the example of the page, with two workers, on which everything else stays as it is."""
    page = (project / "docs" / "fleet.md").read_text(encoding="utf-8")
    (example,) = (text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "SLURM" in text)
    assert "cluster.scale(100)" in example
    return example.replace("cluster.scale(100)", "cluster.scale(2)") + "    print(fleet)\n"


def read_results(folder):
    return {path.name: path.read_bytes() for path in (folder / "results").iterdir()}


def test_a_fleet_on_slurm_gives_the_bytes_of_the_serial_run(node, project, tmp_path, c_compiler):
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not here: make test-slurm installs it")
    (tmp_path / "plant.toml").write_text(STUDY)
    (tmp_path / "script.py").write_text(read_example(project))
    variables = node.variables | {"DASK_DISTRIBUTED__DASHBOARD__ENABLED": "False"}
    command = [sys.executable, "script.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False, timeout=3600
    )
    workers = [path.read_text(errors="replace") for path in tmp_path.glob("slurm-*.out")]
    assert done.stdout.splitlines()[-1:] == [f"{JOBS} jobs: {JOBS} done"], (done.stderr, *workers)
    # Dask's workers were jobs of SLURM, and ended with the script.
    assert len(workers) == 2
    assert all("Starting established connection" in text for text in workers)
    assert node.wait_until_idle()
    serial = symid.fleet.run(tmp_path / "plant.toml", tmp_path / "serial", executor="serial")
    assert serial.counts == {"done": JOBS}
    assert read_results(tmp_path / "plant") == read_results(tmp_path / "serial")
