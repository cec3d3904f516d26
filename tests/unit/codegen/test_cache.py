"""The cache: found again, made again when it must be, safe when two want it at once."""

import ctypes
import json
import os
import platform
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symid.codegen import cache as cache_module, compiler as compiler_module
from symid.codegen.cache import (
    compute_library_key,
    describe_entry_risk,
    locate_cache_folder,
    make_temporary_folder,
    prepare_library,
)
from symid.codegen.compiler import (
    Compiler,
    compile_sources,
    diagnose_compiler,
    locate_compiler,
    read_processor,
)
from symid.environment import mark_scratch
from symid.errors import GenerationError, OutputError
from symid.joint_models.hysteresis import Elasticity
from symid.robot import load_robot, override_settings
from symid.robot.description import Controller, Limits, Processing
from tests.builds import write_program
from tests.refusals import raises

NAMES = ("mass_matrix", "friction")


@pytest.fixture(scope="module")
def robot():
    return load_robot("emps")


def prepare(robot, folder, **options):
    said = []
    library = prepare_library(robot, progress=said.append, names=NAMES, cache=folder, **options)
    return library, said


def list_codes(library):
    return [notice.code for notice in library.notices]


@pytest.fixture(scope="module")
def sound(robot, tmp_path_factory, c_compiler):
    """Return a sound entry of the cache; tests spoil copies of it."""
    folder = tmp_path_factory.mktemp("sound")
    prepare(robot, folder)
    (entry,) = folder.iterdir()
    return entry


@pytest.fixture
def entry(sound, tmp_path):
    return Path(shutil.copytree(sound, tmp_path / sound.name))


def test_fused_products_are_a_library_of_their_own_and_differ_by_rounding(tmp_path, c_compiler):
    options = {"names": ("inverse_dynamics",), "cache": tmp_path, "backend": "c", "compiler": c_compiler}
    plain, fused = (prepare_library(load_robot("ur5"), **options, fused=fused) for fused in (False, True))
    assert len(list(tmp_path.iterdir())) == 2
    states = np.random.default_rng(0).normal(size=(3, 50, 6))
    beta = np.linspace(0.5, 1.5, len(plain.card.beta))
    (expected,), (found,) = (one.evaluate("inverse_dynamics", *states, beta) for one in (plain, fused))
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_the_key_sees_what_functions_depend_on_and_nothing_else(robot, monkeypatch):
    compiler = Compiler(path="/x/cc", version="cc 1")
    (joint,) = robot.joints

    def compute_key(names=None, compiler=compiler, **changes):
        return compute_library_key(replace(robot, **changes), names, compiler)

    def change_joint(**changes):
        return compute_key(joints=(replace(joint, **changes),))

    controller = Controller(stiffness=(5.0,), damping=(1.0,))
    assert {
        compute_key(processing=Processing(drop_first=7)),
        compute_key(path="elsewhere", description="x"),
        compute_key(source="a paper", notices=()),
        compute_key(controller=controller),
        change_joint(limits=Limits(torque=3.0)),
        change_joint(limits=Limits(velocity=3.5)),
        change_joint(drive=replace(joint.drive, torque_constant=7.0)),
    } == {compute_key()}
    others = [
        compute_key(),
        compute_key(name="other"),
        compute_key(NAMES),
        compute_key(compiler=None),
        compute_key(compiler=replace(compiler, version="cc 2")),
        compute_key(compiler=replace(compiler, flags=("-O3",))),
        change_joint(elasticity=Elasticity(stiffness=1e4)),
        change_joint(name="another"),
        change_joint(drive=replace(joint.drive, has_rotor=not joint.drive.has_rotor)),
    ]
    for what in ("machine", "system"):
        monkeypatch.setattr(platform, what, lambda: "another")
        others.append(compute_key())
    code = cache_module._read_code_bytes()
    monkeypatch.setattr(cache_module, "_read_code_bytes", lambda: (*code, ("later.py", b"")))
    assert len({*others, compute_key()}) == len(others) + 1
    paths = {path for path, _ in code}
    assert {"notation.py", "arrays.py", "serialization.py", "codegen/cache.py"} <= paths


def test_without_a_compiler_the_python_module_is_used_and_said(robot, tmp_path):
    library, said = prepare(robot, tmp_path, compiler="no-such-compiler")
    assert library.backend == "python"
    assert list_codes(library) == ["codegen.no-compiler"]
    assert "'no-such-compiler'" in library.notices[0].text
    assert "NumPy module" in said[-1]
    found = library.evaluate("mass_matrix", np.zeros((3, 1)), np.array([95.0]))[0]
    np.testing.assert_allclose(found, np.full((3, 1, 1), 95.0))
    assert prepare(robot, tmp_path, compiler="no-such-compiler")[1] == []


SCRIPT = """
import sys
from pathlib import Path
from symid.codegen.cache import prepare_library
from symid.robot.toml_reader import read_robot
library = prepare_library(read_robot(Path(sys.argv[1])), names=("mass_matrix",), cache=Path(sys.argv[2]))
print(library.evaluate("mass_matrix", [0.0], [3.0])[0][0, 0])
print(*(notice.code for notice in library.notices))
print(sorted({"sympy", "casadi", "jinja2", "mpmath"} & set(sys.modules)))
"""


@pytest.fixture(scope="module")
def start(robots_folder, project):
    """Return a call that starts a process which prepares the library in a folder."""

    def call(folder, **variables):
        command = [sys.executable, "-c", SCRIPT, str(robots_folder / "emps.toml"), str(folder)]
        environment = {**os.environ, "PYTHONPATH": str(project), **variables}
        pipe = subprocess.PIPE
        return subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True)

    return call


def finish(*processes):
    """Return what notices the processes had, and whether they imported what is slow, a line each."""
    said = []
    for process in processes:
        out, err = process.communicate(timeout=200)
        assert (process.returncode, err) == (0, "")
        mass, *rest = out.splitlines()
        assert mass == "3.0"
        said.append(rest)
    return said


def test_generated_code_that_does_not_compile_is_an_error_and_leaves_no_entry(
    robot, tmp_path, monkeypatch, c_compiler
):
    """With a sound compiler the fault is ours: nothing falls back, nothing stays behind."""

    def spoil(compiler, sources, output, **options):
        sources[0].write_text("this is no C\n", encoding="utf-8")
        return compile_sources(compiler, sources, output, **options)

    monkeypatch.setattr(cache_module, "compile_sources", spoil)
    with pytest.raises(GenerationError):
        prepare_library(robot, cache=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_said(robot, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    with raises(OutputError, "output.cache") as caught:
        prepare(robot, tmp_path / "file" / "cache")
    assert caught.value.notices[0].file == str(tmp_path / "file" / "cache")
    # Nor is there a user's folder, as the XDG specification has it, or a temporary one.
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert locate_cache_folder() == Path.home() / ".cache" / "symid"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert locate_cache_folder() == tmp_path / "file" / "symid"
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    with raises(OutputError, "output.cache", match=f"{tmp_path / 'file'}"):
        prepare(robot, None)


def test_the_compilers_message_reaches_the_reader(tmp_path, c_compiler):
    source = tmp_path / "bad.c"
    source.write_text("int f(void) { return missing; }\n")
    compiler = locate_compiler(c_compiler)
    with raises(GenerationError, "codegen.compiler-failed", match="missing") as caught:
        compile_sources(compiler, [source], tmp_path / "x.so")
    assert f"{c_compiler} -std=c99" in str(caught.value)
    assert not (tmp_path / "x.so").exists()
    # Straight lines get flags of their own, where the compiler knows them.
    with raises(GenerationError, "codegen.compiler-failed", match="missing") as caught:
        compile_sources(compiler, [source], tmp_path / "x.so", straight=True)
    knows = not diagnose_compiler(replace(compiler, flags=("-fpeephole2",)))
    assert ("-O1" in str(caught.value)) == knows
    assert locate_compiler("no-such-compiler") is None


def test_models_with_other_friction_share_what_was_compiled(tmp_path, c_compiler, monkeypatch):
    """What was compiled once is linked again, and a friction law, or a header, makes other code."""
    made, run = [], compiler_module._run_compiler

    def note(command, *rest, **options):
        made.extend(Path(part).name for part in command if "-c" in command and part.endswith(".c"))
        return run(command, *rest, **options)

    monkeypatch.setattr(compiler_module, "_run_compiler", note)
    compiler_module._keep_object.cache_clear()
    first, other = (
        override_settings(load_robot("two_link"), (), law) for law in ("coulomb-viscous", "coulomb")
    )
    names = ("gravity", "mass_matrix", "friction")
    libraries = [
        prepare_library(robot, names=names, cache=tmp_path, compiler=c_compiler) for robot in (first, other)
    ]
    own = [made.count(f"symid_two_link_{name}.c") for name in names]
    assert own == [1, 1, 2]
    q, beta = [0.3, -0.4], np.arange(1.0, 7.0)
    for name, inputs in (("gravity", (q, beta)), ("mass_matrix", (q, beta))):
        one, two = (library.evaluate(name, *inputs)[0] for library in libraries)
        np.testing.assert_array_equal(one, two)
    # A number that comes from a header.
    source, header = tmp_path / "of_header.c", tmp_path / "of_header.h"
    source.write_text('#include "of_header.h"\nint number(void) { return NUMBER; }\n')
    found = []
    for number in (1, 2, 1):
        header.write_text(f"int unused(int x[{number}]);\n#define NUMBER {number % 2}\n")
        binary = tmp_path / f"{len(found)}.so"
        compile_sources(locate_compiler(c_compiler), [source], binary, straight=True)
        found.append(ctypes.CDLL(str(binary)).number())
    assert (found, made.count("of_header.c")) == ([1, 0, 1], 2)


def test_a_cache_that_cannot_be_written_is_replaced_by_a_temporary_one(robot, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    library, said = prepare(robot, None)
    assert said
    assert list_codes(library)[:1] == ["codegen.cache-temporary"]
    assert str(tmp_path / "file") in library.notices[0].text
    folder = tmp_path / f"symid-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert prepare(robot, None)[1] == []


def test_a_user_without_a_home_gets_a_temporary_cache(robot, tmp_path, monkeypatch):
    def fail():
        message = "Could not determine home directory."
        raise RuntimeError(message)

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", fail)
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    assert locate_cache_folder() == tmp_path / f"symid-{os.getuid()}"
    assert list_codes(prepare(robot, None)[0])[:1] == ["codegen.cache-temporary"]


def test_a_temporary_folder_that_others_can_write_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / f"symid-{os.getuid()}"
    assert make_temporary_folder() == folder
    folder.chmod(0o755)
    assert make_temporary_folder() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)
    assert make_temporary_folder() != folder


def test_an_entry_that_cannot_be_moved_in_is_said(robot, tmp_path, monkeypatch):
    rename = Path.rename

    def fail(self, target):
        if self.name.startswith(".new-") and Path(target).parent == tmp_path:
            raise PermissionError(13, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fail)
    with raises(OutputError, "output.cache", match="Permission denied"):
        prepare(robot, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_robots_name_cannot_leave_the_cache(robot, tmp_path):
    folder = tmp_path / "cache"
    library, _ = prepare(replace(robot, name="../../a b"), folder)
    assert library.card.robot == "../../a b"
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
    assert [path.name[:15] for path in folder.iterdir()] == ["symid_______a_b"]


def test_a_compiler_that_compiles_nothing_is_said_and_numpy_is_used(robot, tmp_path, monkeypatch):
    """As on a machine with gcc but without the headers of the C library."""
    action = '[ "$1" = --version ] && echo cc 1.0 && exit 0\necho no math.h >&2\nexit 1'
    broken = write_program(tmp_path / "bin" / "cc", action)
    monkeypatch.setenv("PATH", f"{broken.parent}:/usr/bin:/bin")
    library = prepare_library(robot, cache=tmp_path / "cache")
    assert (library.backend, list_codes(library)) == ("python", ["codegen.compiler-unusable"])
    assert "no math.h" in library.notices[0].text


def seal_again(entry):
    seal = json.loads((entry / "seal.json").read_text())
    (entry / "seal.json").write_text(json.dumps({**seal, "files": cache_module._read_digests(entry)}))


@pytest.fixture(scope="module")
def sound_of_processes(start, tmp_path_factory, c_compiler):
    folder = tmp_path_factory.mktemp("processes")
    finish(start(folder))
    (entry,) = folder.iterdir()
    return entry


@pytest.fixture
def made_elsewhere(sound_of_processes, tmp_path):
    """Return a copy of an entry that another process made."""
    return Path(shutil.copytree(sound_of_processes, tmp_path / sound_of_processes.name))


def test_a_process_that_is_killed_leaves_no_entry(tmp_path, start, c_compiler):
    cache, mark = tmp_path / "cache", tmp_path / "reached"
    action = f'[ "$1" = --version ] && echo cc 1 && exit 0\ntouch {mark}\nexec sleep 60'
    slow = write_program(tmp_path / "bin" / "cc", action)
    process = start(cache, PATH=f"{slow.parent}:{os.environ['PATH']}")
    for _ in range(6000):
        if mark.exists():
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=100)
    # What it had begun, and the file of its lock, which holds no longer.
    assert sorted(path.name[:5] for path in cache.iterdir()) == [".new-", ".symi"]
    # Makers of another entry could still be at work, until they are too old.
    (cache / ".new-other").mkdir()
    (cache / ".new-old").mkdir()
    os.utime(cache / ".new-old", (0, 0))
    # Of a process that was killed while it wrote the sources.
    dead = mark_scratch("..new-").replace(f"-{os.getpid()}-", f"-{process.pid}-")
    (cache / f"{dead}abc").mkdir()
    assert finish(start(cache))[0][0] == ""
    assert sorted(path.name[:10] for path in cache.iterdir()) == [".new-other", "symid_emps"]


@pytest.mark.parametrize("begin", [".new-", "..new-"])
def test_a_clock_that_is_set_takes_nothing_from_a_living_process(robot, entry, tmp_path, monkeypatch, begin):
    own = mark_scratch(begin)
    at_work, left = tmp_path / f"{own}{cache_module._PROCESS}abc", tmp_path / f"{own}def"
    other = tmp_path / f"{own.removesuffix(f'{os.getpid()}-')}{os.getppid()}-abc"
    for path in (at_work, left, other):
        path.mkdir()
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 86400.0 * 400)
    cache_module._clear_scraps(tmp_path)
    # What has this process's number and is not its own is of one before it.
    assert [path.is_dir() for path in (at_work, left, other)] == [True, False, True]
    assert prepare(robot, tmp_path)[1] == []


def test_of_many_processes_on_an_empty_cache_one_compiles(tmp_path, start, c_compiler):
    cache = tmp_path / "cache"
    counted = write_program(tmp_path / "bin" / "cc", f'echo "$*" >> {tmp_path}/calls\nexec {c_compiler} "$@"')
    path = f"{counted.parent}:{os.environ['PATH']}"
    assert [codes for codes, _ in finish(*(start(cache, PATH=path) for _ in range(4)))] == [""] * 4
    links = [line for line in (tmp_path / "calls").read_text().splitlines() if "libsymid_emps.so" in line]
    assert len(links) == 1
    assert [path.name[:10] for path in cache.iterdir()] == ["symid_emps"]
    # Then a hit, without heavy imports.
    assert finish(start(cache, PATH=path)) == [["", "[]"]]


def replace_file(path, content=b"{}"):
    """Put another file in the place of `path`: whoever has the old one mapped keeps it."""
    path.unlink()
    path.write_bytes(content)


@pytest.mark.parametrize("sealed", [False, True])
def test_processes_make_a_library_again_that_does_not_load(tmp_path, start, made_elsewhere, sealed):
    """Cut off, as a full disk leaves it; or no library at all, and the seal edited to say so."""
    path = made_elsewhere / "libsymid_emps.so"
    replace_file(path, b"no library" if sealed else path.read_bytes()[: path.stat().st_size // 2])
    if sealed:
        seal_again(made_elsewhere)
    said = finish(*(start(tmp_path) for _ in range(1 if sealed else 3)))
    assert "codegen.cache-rebuilt" in [codes for codes, _ in said]
    assert [path.name for path in tmp_path.iterdir()] == [made_elsewhere.name]
    assert finish(start(tmp_path))[0][0] == ""


def change_manifest(entry):
    (entry / "manifest.json").write_text('{"symid": "1", "files": {}}')
    seal_again(entry)


def link_entry(entry):
    shutil.move(entry, entry.parent / ".elsewhere")
    entry.symlink_to(entry.parent / ".elsewhere")


def link_library(entry):
    shutil.move(entry / "libsymid_emps.so", entry.parent / ".elsewhere")
    (entry / "libsymid_emps.so").symlink_to(entry.parent / ".elsewhere")


def replace_by_file(entry):
    shutil.rmtree(entry)
    entry.write_text("x")


DAMAGES = {
    "another library": (lambda entry: replace_file(entry / "libsymid_emps.so"), ""),
    "another header": (lambda entry: replace_file(entry / "symid_emps.h"), ""),
    "another manifest": (lambda entry: replace_file(entry / "manifest.json"), ""),
    "another seal": (lambda entry: replace_file(entry / "seal.json"), ""),
    "a foreign file": (lambda entry: (entry / "extra.so").write_bytes(b"x"), "extra.so"),
    "a manifest and a seal of somebody else": (change_manifest, "manifest"),
    "a link": (link_entry, "it is a link or no file"),
    "a linked library": (link_library, "libsymid_emps.so is a link or no file"),
    "a pipe": (lambda entry: os.mkfifo(entry / "pipe"), "pipe is a link or no file"),
    "a file": (replace_by_file, "it is no folder"),
    "open to the group": (lambda entry: entry.chmod(0o770), "it may be written by others"),
    "an open library": (
        lambda entry: (entry / "libsymid_emps.so").chmod(0o646),
        "libsymid_emps.so may be written by others",
    ),
    "an open seal": (lambda entry: (entry / "seal.json").chmod(0o666), "seal.json may be written by others"),
}


@pytest.mark.parametrize("damage", sorted(DAMAGES))
def test_what_is_damaged_or_may_be_of_others_is_made_again(robot, tmp_path, entry, damage):
    change, text = DAMAGES[damage]
    assert prepare(robot, tmp_path)[1] == []
    change(entry)
    library, said = prepare(robot, tmp_path)
    assert said
    assert list_codes(library) == ["codegen.cache-rebuilt"]
    assert text in library.notices[0].text
    np.testing.assert_allclose(library.evaluate("mass_matrix", np.zeros(1), np.array([95.0]))[0], [[95.0]])
    assert prepare(robot, tmp_path)[0].notices == ()
    assert not list(tmp_path.glob(".old-*"))
    if "link" in damage:
        assert (tmp_path / ".elsewhere").exists()


def test_what_belongs_to_another_user_is_not_loaded(robot, tmp_path, entry, monkeypatch):
    assert describe_entry_risk(entry) == ""
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    assert describe_entry_risk(entry) == "it belongs to another user"
    with raises(OutputError, "output.cache"):
        prepare(robot, tmp_path)
    # As on a system without owners.
    monkeypatch.delattr(os, "getuid")
    entry.chmod(0o777)
    assert describe_entry_risk(entry) == ""


def test_a_folder_in_which_others_can_replace_entries_is_not_used(robot, tmp_path, c_compiler):
    tmp_path.chmod(0o777)
    with raises(OutputError, "output.cache"):
        prepare(robot, tmp_path)
    assert list(tmp_path.iterdir()) == []
    # As in /tmp, where others can add but not replace.
    tmp_path.chmod(0o1777)
    assert prepare(robot, tmp_path)[0].notices == ()


def test_the_users_own_folder_is_closed_to_others(robot, tmp_path, monkeypatch, c_compiler):
    (tmp_path / "symid").mkdir()
    (tmp_path / "symid").chmod(0o775)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert prepare(robot, None)[0].notices == ()
    assert stat.S_IMODE((tmp_path / "symid").stat().st_mode) == 0o755
    assert len(list((tmp_path / "symid").iterdir())) == 1


def test_entries_are_closed_to_others_whatever_the_umask(robot, tmp_path, c_compiler):
    before = os.umask(0)
    try:
        prepare(robot, tmp_path / "cache")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "cache").stat().st_mode) == 0o700
    assert prepare(robot, tmp_path / "cache")[0].notices == ()
    modes = {stat.S_IMODE(path.stat().st_mode) & 0o022 for path in (tmp_path / "cache").rglob("*")}
    assert modes == {0}


def write_processors(path, *, flags="fpu avx2", speed="3000.0"):
    one = f"processor\t: %d\nmodel name\t: X 1\ncpu MHz\t\t: {speed}\nflags\t\t: {flags}\n\n"
    path.write_text(one % 0 + one % 1)


def test_the_key_names_the_processor_that_code_is_made_for(robot, tmp_path, monkeypatch, c_compiler):
    told = tmp_path / "cpuinfo"
    monkeypatch.setattr(compiler_module, "_PROCESSORS", told)

    def compute_key():
        return compute_library_key(robot, None, locate_compiler(c_compiler, native=True))

    write_processors(told)
    assert read_processor() == "flags: fpu avx2\nmodel name: X 1"
    key = compute_key()
    write_processors(told, speed="800.0")
    assert compute_key() == key
    write_processors(told, flags="fpu avx2 avx512f")
    assert compute_key() != key
    # Without what it can do, a processor is not known: no code is made for it.
    for text in ("processor: 0\nmodel name: X 1\n", ""):
        told.write_text(text)
        assert locate_compiler(c_compiler, native=True) == locate_compiler(c_compiler)
    told.unlink()
    assert locate_compiler(c_compiler, native=True) == locate_compiler(c_compiler)


@pytest.mark.parametrize("refused", ["", "-march=native"])
def test_code_is_made_for_the_processor_where_the_compiler_can(tmp_path, c_compiler, refused, monkeypatch):
    told = tmp_path / "cpuinfo"
    monkeypatch.setattr(compiler_module, "_PROCESSORS", told)
    write_processors(told)
    source = tmp_path / "one.c"
    source.write_text("double one(double x) { return x + 1.0; }\n")
    # A compiler that tells what it was asked for, and may not know a flag.
    check = f'case "$*" in *{refused}*) echo unknown >&2; exit 1;; esac' if refused else ""
    action = f'echo "$@" >> {tmp_path}/said\n{check}\nexec {c_compiler} "$@"'
    command = str(write_program(tmp_path / "cc", action))
    for native in (True, False):
        (tmp_path / "said").unlink(missing_ok=True)
        compile_sources(locate_compiler(command, native=native), [source], tmp_path / "one.so")
        (asked,) = (line for line in (tmp_path / "said").read_text().splitlines() if "one.c" in line)
        assert ("-march=native" in asked) == (native and not refused)
        assert "-ffp-contract=off" in asked
        assert "fast-math" not in asked


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_code_for_the_processor_gives_the_same_bytes(tmp_path, compiler):
    """No product is fused with a sum, whatever the processor can do."""
    if locate_compiler(compiler) is None:
        pytest.skip(f"wants {compiler}")
    robot, rng = load_robot("puma560"), np.random.default_rng(8)
    q, dq, ddq = rng.uniform(-1, 1, (3, 64, 6))
    found = []
    for native in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            if not native:
                patch.setattr(compiler_module, "_PROCESSORS", tmp_path / "none")
            library = prepare_library(robot, names=("torque_regressor",), cache=tmp_path, compiler=compiler)
        bound = library.bind("torque_regressor")
        one = np.array([bound(*state)[0] for state in zip(q, dq, ddq, strict=True)])
        found.append((library.evaluate("torque_regressor", q, dq, ddq)[0].tobytes(), one.tobytes()))
    assert len(list(tmp_path.iterdir())) == 2
    assert found[0] == found[1]


def test_what_another_process_stored_meanwhile_is_kept(tmp_path):
    def make(folder):
        folder.mkdir()
        (folder / "file").write_text("1")

    entry = cache_module.CacheEntry(name="a", key="k" * 24, make=make, load=lambda place: place.stat().st_ino)
    place = tmp_path / f"a-{entry.key}"
    looked = []

    def make_second(folder):
        cache_module._store_entry(entry, place)
        looked.append(place.stat().st_ino)
        make(folder)

    second = replace(entry, make=make_second)
    assert cache_module.obtain_entry(second, tmp_path) == (looked[0], ())
    assert list(tmp_path.iterdir()) == [place]
