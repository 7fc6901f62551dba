"""Compiled objects on disk: used when they are whole and ours, never in the way when they are not."""

from __future__ import annotations

import hashlib
import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from levels import usable
from nightly import nightly

from adaptctl.compilation import compile_function, compile_step
from adaptctl.compilation.native import Processor
from adaptctl.compilation.object_cache import SUFFIX, ObjectCache, cache_folder, stored_objects

KEY, OTHER, OBJECT = b"k" * 32, b"o" * 32, b"machine code" * 100


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, in use."""
    monkeypatch.setenv("ADAPTCTL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def plus(number: float) -> float:
    """1 + number from a kernel compiled now; every number has its own object."""
    return float(compile_function(lambda x: x[0] + number, {"x": 1})([1.0]))


def kept(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


# What is kept is used


def test_an_object_is_kept_for_its_owner_alone(folder: Path) -> None:
    before = os.umask(0)
    try:
        assert plus(1.0) == 2.0
    finally:
        os.umask(before)
    (path,) = kept(folder)
    assert path.suffix == SUFFIX
    assert (mode(folder), mode(path)) == (0o700, 0o600)


def test_the_object_on_disk_is_what_runs(folder: Path) -> None:
    """Under the key of one equation, sealed as it should be, lies the object of another."""
    cache = ObjectCache(folder)
    plus(1.0)
    (first,) = kept(folder)
    plus(2.0)
    (second,) = set(kept(folder)) - {first}
    data = cache.get(bytes.fromhex(second.stem))
    assert data is not None
    cache.put(bytes.fromhex(first.stem), data)
    assert plus(1.0) == 3.0


def test_equal_equations_share_an_object_and_others_do_not(folder: Path) -> None:
    for number in (1.0, 1.0, 2.0, 1.0):
        plus(number)
    assert len(kept(folder)) == 2


def test_every_processor_has_its_own(folder: Path) -> None:
    processors = [Processor.host(), Processor("generic", ""), Processor("generic", "")]
    for processor in processors:
        ensemble = compile_step(lambda x: (2.0 * x,), state={"x": 3}, lanes=1, processor=processor).ensemble(1)
        ensemble.state["x"] = [1.0, 2.0, 3.0]
        ensemble.run(3)
        assert ensemble.state["x"].tolist() == [[8.0, 16.0, 24.0]]
    assert len(kept(folder)) == 2


def test_every_level_of_a_processor_has_its_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for count, level in enumerate(["native", *usable()], 1):
        monkeypatch.setenv("ADAPTCTL_PROCESSOR", level)
        assert plus(1.0) == 2.0
        assert plus(1.0) == 2.0
        assert len(kept(folder)) == count


# What is wrong with it is no matter


def flipped(content: bytes) -> bytes:
    return content[:-1] + bytes([content[-1] ^ 1])


DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:200]),
    "a bit flipped": lambda path: path.write_bytes(flipped(path.read_bytes())),
    "appended to": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "foreign": lambda path: path.write_bytes(b"\x7fELF" + bytes(1000)),
    "of another key": lambda path: path.write_bytes(path.read_bytes().replace(bytes.fromhex(path.stem), OTHER)),
    "of an older form": lambda path: path.write_bytes(path.read_bytes().replace(b"object 1", b"object 0")),
    "open to others": lambda path: path.chmod(0o666),
    "a broken link": lambda path: (path.unlink(), path.symlink_to("nowhere")),
    "a link": lambda path: (path.rename(path.with_name("there")), path.symlink_to("there")),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_object_is_compiled_anew_and_replaced(folder: Path, damage: str) -> None:
    plus(1.0)
    (path,) = kept(folder)
    whole = path.read_bytes()
    DAMAGE[damage](path)
    assert plus(1.0) == 2.0
    assert not path.is_symlink()
    assert path.read_bytes() == whole
    assert mode(path) == 0o600


@pytest.mark.parametrize("block", [lambda path: path.mkdir(), os.mkfifo], ids=["folder", "pipe"])
def test_what_is_no_file_is_left_alone(folder: Path, block: Callable[[Path], object]) -> None:
    plus(1.0)
    (path,) = kept(folder)
    path.unlink()
    block(path)
    assert plus(1.0) == 2.0


@pytest.mark.parametrize("place", ["a file", "below a file", "nowhere to make it"])
def test_a_folder_that_cannot_be_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    (tmp_path / "file").touch()
    folder = {
        "a file": tmp_path / "file",
        "below a file": tmp_path / "file" / "x",
        "nowhere to make it": Path("/proc/x"),
    }
    monkeypatch.setenv("ADAPTCTL_CACHE", str(folder[place]))
    assert plus(1.0) == 2.0
    assert kept(tmp_path) == [tmp_path / "file"]


@pytest.mark.parametrize("permissions", [0o777, 0o770, 0o1777])
def test_a_folder_that_others_can_write_to_is_not_trusted(folder: Path, permissions: int) -> None:
    folder.mkdir()
    folder.chmod(permissions)
    assert plus(1.0) == 2.0
    assert kept(folder) == []
    folder.chmod(0o700)
    plus(1.0)
    (path,) = kept(folder)
    path.write_bytes(path.read_bytes())
    folder.chmod(permissions)
    assert ObjectCache(folder).get(bytes.fromhex(path.stem)) is None


def test_a_folder_that_may_only_be_read_is_read(folder: Path) -> None:
    run("plus(1.0)")
    (path,) = kept(folder)
    used = path.stat().st_mtime_ns
    folder.chmod(0o500)
    assert run("print(plus(1.0), plus(2.0))", LIKE_ANYBODY) == "2.0 3.0\n"
    folder.chmod(0o700)
    assert kept(folder) == [path]
    assert path.stat().st_mtime_ns > used


LIKE_ANYBODY = """
import ctypes, os, sys
ctypes.CDLL(None).prctl(24, 1)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""
"""Gives up what root has over others, to write where that is forbidden (CAP_DAC_OVERRIDE; see prctl(2))."""


def test_a_full_disk_is_done_without(folder: Path) -> None:
    """No file may grow beyond a hundred bytes here."""
    run("import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)); assert plus(1.0) == 2.0")
    assert kept(folder) == []


def test_a_disk_that_gets_full_while_writing_leaves_nothing(tmp_path: Path) -> None:
    """Half of the object fits, then none: what was started is removed, and the next that fits is kept."""
    beside = tmp_path / "cache"
    beside.mkdir(mode=0o700)
    run(f"""
import adaptctl.compilation.object_cache as cache
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
kept = cache.ObjectCache(cache.Path({str(beside)!r}))
kept.put(b"k" * 32, b"x" * 10_000)
assert kept.get(b"k" * 32) is None
kept.put(b"k" * 32, b"x" * 1_000)
assert kept.get(b"k" * 32) == b"x" * 1_000
""")
    assert [path.name for path in kept(beside)] == [f"{KEY.hex()}{SUFFIX}"]


# Where it is, and how large it may grow


def test_the_cache_can_be_turned_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert plus(1.0) == 2.0
    assert kept(tmp_path) == []


def test_where_the_cache_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("ADAPTCTL_CACHE", raising=False)
    assert cache_folder() == tmp_path / "home" / ".cache" / "adaptctl"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative, so not valid")
    assert cache_folder() == tmp_path / "home" / ".cache" / "adaptctl"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert cache_folder() == tmp_path / "caches" / "adaptctl"
    monkeypatch.setenv("ADAPTCTL_CACHE", "")
    assert cache_folder() == tmp_path / "caches" / "adaptctl"
    monkeypatch.setenv("ADAPTCTL_CACHE", "~/kept")
    assert cache_folder() == tmp_path / "home" / "kept"
    monkeypatch.setenv("ADAPTCTL_CACHE", "~nobody-of-this-name/kept")
    assert cache_folder() is None
    assert plus(1.0) == 2.0


def test_what_was_used_longest_ago_goes_first(tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path, limit=3 * len(OBJECT) + 400)
    keys = [bytes([k]) * 32 for k in range(4)]
    (tmp_path / "somebody's file").write_bytes(b"x" * 10_000)
    for age, key in zip((30, 20, 10), keys[:3], strict=True):
        cache.put(key, OBJECT)
        os.utime(tmp_path / f"{key.hex()}{SUFFIX}", (1e9 - age, 1e9 - age))
    assert cache.get(keys[0]) == OBJECT  # used now
    cache.put(keys[3], OBJECT)
    assert [cache.get(key) for key in keys] == [OBJECT, None, OBJECT, OBJECT]
    assert (tmp_path / "somebody's file").exists()


def test_a_process_looks_how_full_the_folder_is_at_its_first_object_and_then_now_and_again(tmp_path: Path) -> None:
    """At every 64th of the limit: to look at thousands of files for each object would take longer than to write it."""
    cache = ObjectCache(tmp_path, limit=64 * 3 * len(OBJECT))
    old = tmp_path / f"{OTHER.hex()}{SUFFIX}"

    def left_by(keys: range) -> list[bool]:
        """Whether what is too large for the folder is still there, after each object put."""
        old.write_bytes(b"x" * cache.limit)
        os.utime(old, (0, 0))
        return [cache.put(bytes([k]) * 32, OBJECT) or old.exists() for k in keys]

    assert left_by(range(1)) == [False]
    assert left_by(range(1, 4)) == [True, True, False]


def test_what_is_left_of_a_writer_that_died_goes_too(tmp_path: Path) -> None:
    leftover = tmp_path / f".0123456789abcdef{SUFFIX}"
    leftover.write_bytes(OBJECT)
    os.utime(leftover, (0, 0))
    ObjectCache(tmp_path, limit=len(OBJECT) + 400).put(KEY, OBJECT)
    assert not leftover.exists()


def test_what_others_remove_while_it_is_listed_is_passed_over(tmp_path: Path) -> None:
    kept, gone = tmp_path / "kept.object", tmp_path / "gone.object"
    kept.write_bytes(OBJECT)
    ended = threading.Event()

    def come_and_go() -> None:
        while not ended.is_set():
            gone.write_bytes(b"x")
            gone.unlink()

    other = threading.Thread(target=come_and_go)
    other.start()
    try:
        for _ in range(300):
            sizes = {path: status.st_size for status, path in stored_objects(tmp_path)}
            assert sizes[str(kept)] == len(OBJECT)
    finally:
        ended.set()
        other.join()


def test_keys_do_not_meet(tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path / "not there yet")
    assert cache.get(KEY) is None
    cache.put(KEY, OBJECT)
    assert cache.get(KEY) == OBJECT
    assert cache.get(OTHER) is None
    content = next((tmp_path / "not there yet").iterdir()).read_bytes()
    assert hashlib.sha256(OBJECT).digest() in content


# Processes and threads

PROGRAM = """
import os, signal, sys, threading, time
from adaptctl.compilation import compile_function, outlined
from adaptctl.scalars import Column, sin

def plus(number):
    return float(compile_function(lambda x: x[0] + number, {"x": 1})([1.0]))

def long(number):
    def equation(x):
        for k in range(30):
            x = Column(sin(a + number) * b for a, b in zip(x, (*x.of[1:], x[0]), strict=True))
        return x
    return compile_function(equation, {"x": 3})([0.1, 0.2, 0.3])
"""


def start(program: str, first: str = "") -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", PROGRAM + program]
    if first:
        command = [sys.executable, "-c", first, *command[1:]]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(program: str, first: str = "") -> str:
    process = start(program, first)
    try:
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    return output


def test_another_process_gets_the_same_code(folder: Path) -> None:
    first = run("print(long(1.0).tolist())")
    before = kept(folder)
    assert run("print(long(1.0).tolist())") == first
    assert kept(folder) == before
    assert len(before) == 1


@nightly
def test_processes_that_compile_at_once(folder: Path) -> None:
    processes = [start("print([long(k).tolist() for k in range(3)])") for _ in range(2)]
    outputs = [process.communicate(timeout=60) for process in processes]
    assert [process.returncode for process in processes] == [0, 0], outputs
    assert len({output for output, _ in outputs}) == 1
    assert len(kept(folder)) == 3
    assert all(path.name[0] != "." for path in kept(folder))


def test_threads_that_compile_at_once(folder: Path) -> None:
    gate = threading.Barrier(8)

    def work(k: int) -> float:
        gate.wait()
        return plus(float(k % 3))

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(work, range(8))) == [1.0 + k % 3 for k in range(8)]
    assert len(kept(folder)) == 3


FORKS = """
def keep_compiling():
    while not stop.is_set():
        long(time.perf_counter())

stop = threading.Event()
before = compile_function(lambda x: x[0] * 2.0, {"x": 1})
threads = [threading.Thread(target=keep_compiling, daemon=True) for _ in range(2)]
for thread in threads:
    thread.start()
for k in range(5):
    time.sleep(0.03)
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        os._exit(0 if before([3.0]) == 6.0 and plus(float(k)) == 1.0 + k else 1)
    assert os.waitpid(child, 0)[1] == 0
stop.set()
for thread in threads:
    thread.join()
print(plus(41.0))
"""


@pytest.mark.usefixtures("folder")
def test_a_process_may_fork_while_its_threads_compile() -> None:
    """The children use what was compiled, and compile themselves."""
    assert run(FORKS) == "42.0\n"
