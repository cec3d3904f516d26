"""Studies, tables and patterns of logs become jobs; what a job's result depends on is in its hash."""

import sys

import numpy as np
import pytest

import symid
from symid.errors import InputError, SymidError, UsageError
from symid.fleet import FleetJob, jobs as module, read_study, running
from tests.refusals import raises, tell


def write(folder, name, text=""):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_a_pattern_and_a_folder_name_robots_and_nights(tmp_path):
    for name in ("logs/a/2.csv", "logs/a/1.csv", "logs/b/1.csv", "logs/b/notes.txt"):
        write(tmp_path, name)
    write(tmp_path, "arm.toml", 'name = "arm"')
    study = write(tmp_path, "study.toml", 'robot = "arm.toml"\nlogs = "logs/*/*.csv"\n')
    found = read_study(study)
    assert [(job.name, job.night) for job in found] == [("a", "1"), ("a", "2"), ("b", "1")]
    assert {job.robot for job in found} == {str(tmp_path / "arm.toml")}
    assert found[0].seed is None
    study.write_text('robot = "panda"\nlogs = "logs"\nestimator = ["wls", "huber"]\nrows = "momentum"\n')
    found = read_study(study)
    assert [(job.name, job.night, job.estimator) for job in found[:2]] == [
        ("a", "1", "wls"),
        ("a", "1", "huber"),
    ]
    assert {(job.robot, job.rows) for job in found} == {("panda", "momentum")}
    assert len(found) == 6


def test_a_table_states_what_differs(tmp_path):
    table = "name,night,robot,logs,estimator,seed\nr1,n1,panda,a.csv;b.csv,huber,7\nr2,n1,,c.csv,,\n"
    write(tmp_path, "tables/jobs.csv", table)
    text = 'robot = "ur10"\ntable = "tables/jobs.csv"\nestimator = "wls"\n[settings]\n'
    study = write(tmp_path, "study.toml", f'{text}"processing.filter_cutoff" = 5.5\n')
    first, second = read_study(study)
    logs = (str(tmp_path / "tables" / "a.csv"), str(tmp_path / "tables" / "b.csv"))
    assert first == FleetJob(
        robot="panda",
        logs=logs,
        name="r1",
        night="n1",
        estimator="huber",
        seed=7,
        settings={"processing.filter_cutoff": 5.5},
    )
    assert (second.robot, second.estimator, second.seed) == ("ur10", "wls", None)
    pa = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    rows = [{"name": "r1", "night": "n1", "logs": "x.npz", "seed": None}]
    write_table(pa.Table.from_pylist(rows), tmp_path / "jobs.parquet")
    study.write_text('robot = "ur10"\ntable = "jobs.parquet"\n')
    assert read_study(study) == (
        FleetJob(robot="ur10", logs=(str(tmp_path / "x.npz"),), name="r1", night="n1"),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot = 3", "expected a text"),
        ('robot = "a"\nlogs = "x/*"\ntable = "t.csv"', "give one of logs, table and"),
        ('robot = "a"', "give one of logs, table and"),
        ('logs = "x/*"', "a table with a column robot"),
        ('robot = "a"\nlogs = "x/*"', "no logs found"),
        ('robot = "a"\nlogs = "x/*"\nrows = 3', "a text or a list of texts"),
        ('robot = "a"\nlogs = "x/*"\nrows = []', "a text or a list of texts"),
        ('robot = "a"\n[simulate]\nspeed = 3', "no such key here"),
        ('robot = "a"\n[simulate]\nseed = 3', "no such key here"),
        ('robto = "a"', "did you mean"),
        ('robot = "a"\nrepeats = 0\n[simulate]', "must be greater than 0"),
        ("robot =", "not valid TOML"),
        ('robot = "a"\ntable = "none.csv"', "cannot be read"),
    ],
)
def test_mistakes_of_a_study_have_their_place(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read_study(write(tmp_path, "study.toml", text))
    assert words in str(caught.value)
    if words.startswith(("give", "no logs", "a text")):
        assert caught.value.notices[-1].code in {"fleet.source", "fleet.no-logs", "fleet.words"}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            "name,nihgt\na,b\n",
            ["jobs.csv:2: no such column: nihgt", "jobs.csv:2: no robot", "jobs.csv:2: no logs"],
        ),
        ("robot,logs,seed\na,b.csv,-3\n", ["seed: expected a whole number of 0 or more, got '-3'"]),
        ("robot,logs\na,b.csv,c\n", ["no such column: (more cells"]),
        ("robot,logs\n", ["the table has no rows"]),
        ("", ["the table has no rows"]),
    ],
)
def test_mistakes_of_a_table_have_their_lines(tmp_path, table, words):
    write(tmp_path, "jobs.csv", table)
    with pytest.raises(InputError) as caught:
        read_study(write(tmp_path, "study.toml", 'table = "jobs.csv"'))
    assert [word for word in words if word not in str(caught.value)] == []
    assert set(tell(caught.value.notices)) == {"fleet.table"}


def test_a_damaged_table_is_refused(tmp_path):
    pytest.importorskip("pyarrow")
    write(tmp_path, "jobs.parquet", "no Parquet")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        read_study(write(tmp_path, "study.toml", 'table = "jobs.parquet"'))
    write(tmp_path, "jobs.csv", "robot,logs\n" + '"' + "a" * 200_000 + "\n")
    with pytest.raises(InputError, match="no CSV"):
        read_study(write(tmp_path, "study.toml", 'table = "jobs.csv"'))


def test_seeds_are_spawned_and_depend_on_nothing_but_their_own_job(tmp_path):
    study = write(tmp_path, "study.toml", 'robot = "two_link"\nrepeats = 50\n[simulate]\nduration = 2\n')
    found = read_study(study)
    seeds = [job.seed for job in found]
    assert len(set(seeds)) == 50
    study.write_text(study.read_text().replace("50", "80"))
    assert [job.seed for job in read_study(study)][:50] == seeds
    # With another job before it, the same; with another root, others.
    other = FleetJob(robot="panda", simulate={"duration": 2})
    own = FleetJob(robot="two_link", simulate={"duration": 2}, name="two_link")
    assert [job.seed for job in module.spawn_jobs([other, own], repeats=50)[50:]] == seeds
    assert {job.seed for job in module.spawn_jobs([other, own], repeats=50, seed=1)}.isdisjoint(seeds)
    # They are those of NumPy's own children.
    root = np.random.SeedSequence(0, spawn_key=(int(module.compute_signature(own)[:15], 16),))
    assert seeds[3] == int(root.spawn(4)[3].generate_state(1, np.uint64)[0]) >> 1


def test_what_counts_is_in_the_hash(tmp_path):
    log = write(tmp_path, "log.csv", "t\n")
    robot = write(tmp_path, "arm.toml", 'name = "arm"')
    job = FleetJob(robot=str(robot), logs=(str(log),))

    def compute():
        return module.compute_key(job, module.digest_robot)

    keys = [compute()]
    assert compute() == keys[0]
    log.write_text("t\n1\n")
    keys.append(compute())
    robot.write_text('name = "other"')
    keys.append(compute())
    runs = write(tmp_path, "runs.toml", '[[run]]\nfile = "log.csv"\n')
    job = FleetJob(robot=str(robot), logs=(str(runs),))
    keys.append(compute())
    log.write_text("t\n2\n")
    keys.append(compute())
    runs.write_text("[[run")
    keys.append(compute())
    job = FleetJob(robot=str(tmp_path / "none.urdf"), logs=("none.csv",))
    keys.append(compute())
    assert len(set(keys)) == len(keys)
    body = (
        "<body name='b'><joint type='hinge'/><inertial pos='0 0 0' mass='MASS' diaginertia='1 1 1'/></body>"
    )
    inner = f"<mujocoinclude><worldbody>{body}</worldbody></mujocoinclude>"
    write(tmp_path, "inner.xml", inner.replace("MASS", "1"))
    model = write(tmp_path, "arm.xml", "<mujoco model='arm'><include file='inner.xml'/></mujoco>")
    before = module.digest_robot(str(model))
    write(tmp_path, "inner.xml", inner.replace("MASS", "2"))
    assert module.digest_robot(str(model)) != before


def test_addresses_are_read_through_fsspec(tmp_path):
    pytest.importorskip("fsspec")
    log = write(tmp_path, "logs/a/1.csv", "t\n")
    write(tmp_path, "logs/a/notes.txt")
    for name in (f"file://{tmp_path}/logs/*/*.csv", f"file://{tmp_path}/logs"):
        (job,) = read_study(write(tmp_path, "study.toml", f'robot = "panda"\nlogs = "{name}"\n'))
        assert job.logs == (f"file://{log}",)
        assert (job.name, job.night) == ("a", "1")
    before = module.compute_key(job, module.digest_robot)
    log.write_text("t\n1\n")
    assert module.compute_key(job, module.digest_robot) != before
    with pytest.raises(SymidError, match="nothing://x"):
        module.open_address("nothing://x/y")
    with pytest.raises(InputError):
        module.list_logs(f"file://{tmp_path}/none")
    with raises(InputError, "fleet.address"):
        running._fetch(f"file://{tmp_path}/none.csv", tmp_path)
    gone = symid.fleet.run(
        [FleetJob(robot="two_link", logs=("file:///no/log.csv",))], tmp_path / "out", executor="serial"
    )
    assert gone.rows[0].status == "refused"
    assert "file:///no/log.csv: cannot be read" in gone.rows[0].reason


def test_without_a_package_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with raises(UsageError, "usage.no-fsspec", match="pip install"):
        module.open_address("s3://x/y")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with raises(UsageError, "usage.no-pyarrow"):
        read_study(write(tmp_path, "study.toml", 'table = "jobs.parquet"'))
