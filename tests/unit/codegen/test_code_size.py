"""Sizes of compiled functions: read from object files as binutils read them."""

import shutil
import struct

import pytest

from symid.codegen.compiler import STACK_FLAG, ObjectFile, measure_code_sizes, read_object_file
from tests.builds import run

SOURCE = """
#include <math.h>
#include <stddef.h>
int symid_x_f(const double *q, double *y);
int symid_x_f_batch(size_t n, const double *q, double *y);
int symid_x_f(const double *q, double *y)
{
    double room[40];
    for (int k = 0; k < 40; ++k) {
        room[k] = sin(q[k] + 0.12345);
    }
    for (int k = 0; k < 40; ++k) {
        y[k] = room[39 - k] * room[k];
    }
    return 0;
}
int symid_x_f_batch(size_t n, const double *q, double *y)
{
    for (size_t k = 0; k < n; ++k) {
        (void)symid_x_f(q + 40 * k, y + 40 * k);
    }
    return 0;
}
"""


@pytest.fixture(params=["gcc", "clang"])
def folder(request, tmp_path):
    compiler = shutil.which(request.param)
    if compiler is None:
        pytest.skip(f"wants {request.param}: install it to read its object files")
    (tmp_path / "symid_x_f.c").write_text(SOURCE)
    command = [compiler, "-std=c99", "-O2", "-fPIC", STACK_FLAG, "-c", "symid_x_f.c", "-o", "symid_x_f.o"]
    run(tmp_path, *command)
    return tmp_path


def test_sizes_are_those_of_nm(folder):
    if shutil.which("nm") is None:
        pytest.skip("wants nm: install binutils")
    rows = [line.split() for line in run(folder, "nm", "-S", "symid_x_f.o").stdout.splitlines()]
    wanted = {row[3]: int(row[1], 16) for row in rows if len(row) == 4 and row[2] in "tT"}
    found = read_object_file((folder / "symid_x_f.o").read_bytes())
    assert found is not None
    assert found.functions == wanted
    assert found.constants >= 8


def test_sizes_of_a_function(folder):
    sizes = measure_code_sizes(folder, "symid_x", ("f", "g"))
    assert list(sizes) == ["f"]
    size = sizes["f"]
    assert min(size.code, size.batch_code, size.constants) > 0
    # The array of forty numbers is on it.
    assert size.stack is not None
    assert size.batch_stack is not None
    assert 320 <= size.stack <= size.batch_stack < 2000
    assert measure_code_sizes(folder, "symid_x", ("f",)) == sizes


def test_what_the_compiler_split_off_is_of_the_function(tmp_path, monkeypatch):
    functions = {"symid_x_f": 54, "symid_x_f.part.0": 9000, "symid_x_f.cold": 7, "part_1.isra.0": 100}
    functions |= {"symid_x_f_batch": 300, "symid_x_f_batch.part.0": 20}
    functions |= {"batch_part_1": 50, "find_far_sines": 3}
    (tmp_path / "symid_x_f.o").write_bytes(b"")
    made = ObjectFile(functions=functions, constants=8)
    monkeypatch.setattr("symid.codegen.compiler.read_object_file", lambda _: made)
    size = measure_code_sizes(tmp_path, "symid_x", ("f",))["f"]
    assert (size.code, size.batch_code) == (54 + 9000 + 7 + 100, 300 + 20 + 50 + 3)


def test_without_what_the_compiler_says_of_the_stack_there_is_none(folder):
    usage = folder / "symid_x_f.su"
    for text in ("nonsense", "x.c:1:1:symid_x_f\t16\tdynamic\n"):
        usage.write_text(text)
        size = measure_code_sizes(folder, "symid_x", ("f",))["f"]
        assert (size.stack, size.batch_stack) == (None, None)
    usage.unlink()
    assert measure_code_sizes(folder, "symid_x", ("f",))["f"].stack is None


def test_what_is_no_object_file_gives_nothing(folder):
    content = (folder / "symid_x_f.o").read_bytes()
    for broken in (b"", b"\x7fELF", b"MZ" + content[2:], content[:100], content[:4] + b"\7" + content[5:]):
        assert read_object_file(broken) is None
    (folder / "symid_x_f.o").write_bytes(content[:100])
    assert measure_code_sizes(folder, "symid_x", ("f",)) == {}


def test_32_bits_and_the_other_order_of_bytes():
    """An object file made by hand: one function of 42 bytes, 12 bytes of constants."""
    names = b"\0.symtab\0.strtab\0.rodata.cst4\0"
    labels = b"\0step\0"
    symbols = struct.pack(">IIIBBH", 0, 0, 0, 0, 0, 0) + struct.pack(">IIIBBH", 1, 0, 42, 0x12, 0, 1)
    start = 52
    places = [start, start + len(names), start + len(names) + len(labels)]
    end = places[2] + len(symbols)

    def section(name, kind, offset, size, link=0):
        return struct.pack(">10I", name, kind, 0, 0, offset, size, link, 0, 0, 0)

    table = section(0, 0, 0, 0) + section(17, 1, 0, 12) + section(9, 3, places[0], len(names))
    table += section(9, 3, places[1], len(labels)) + section(1, 2, places[2], len(symbols), link=3)
    head = b"\x7fELF\1\2\1" + bytes(9) + bytes(16) + struct.pack(">I", end) + bytes(10)
    head += struct.pack(">HHH", 40, 5, 2)
    found = read_object_file(head + names + labels + symbols + table)
    assert found is not None
    assert (found.functions, found.constants) == ({"step": 42}, 12)
