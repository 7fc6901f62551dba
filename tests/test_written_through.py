"""Files of one stream are written through pipes, devices and /dev/stdout; all others are refused there."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from nightly import mostly_at_night, nightly

import adaptctl
from adaptctl.errors import FileError
from adaptctl.files import write_json
from adaptctl.recording.result import all_or_none
from adaptctl.simulation import Rollout

NULL = Path("/dev/null")
WRITE = """import sys
from adaptctl.files import write_json
print('before')
write_json(sys.argv[1], {'a': [1, 2]})
print('after')
"""
TOLD = "before\n" + json.dumps({"a": [1, 2]}, indent=2) + "\nafter\n"
RUN = Rollout.from_arrays(np.zeros((5, 1)), np.zeros((5, 1)), np.zeros((5, 1)), 0.01)


@pytest.mark.parametrize(
    "name",
    mostly_at_night(["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "/dev/../dev/stdout"], "/dev/stdout", "/dev/fd/1"),
)
def test_standard_output_is_written_through_wherever_it_leads(tmp_path: Path, name: str) -> None:
    done = subprocess.run([sys.executable, "-c", WRITE, name], stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout == TOLD
    with (tmp_path / "out.txt").open("w") as file:
        subprocess.run([sys.executable, "-c", WRITE, name], stdout=file, check=True)
    assert (tmp_path / "out.txt").read_text() == TOLD
    assert [file.name for file in tmp_path.iterdir()] == ["out.txt"]


def test_a_closed_stream_is_told_in_a_line() -> None:
    with pytest.raises(FileError, match="/dev/fd/987654: cannot be written"):
        write_json("/dev/fd/987654", 1)


def test_a_pipe_that_is_read_gets_all(tmp_path: Path) -> None:
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    content = list(range(100_000))  # above what a pipe holds
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    for _ in range(2000):
        try:
            write_json(pipe, content)
            break
        except FileError:  # the reader has not opened it
            threading.Event().wait(0.005)
    reader.join(timeout=30)
    assert json.loads(got[0]) == content
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_device_is_written_and_stays_one() -> None:
    before = NULL.stat()
    write_json("/dev/null", {"a": 1})
    adaptctl.fundamental_basis(adaptctl.essential_space(adaptctl.load("semi_direct_drive"))).save("/dev/null")
    after = NULL.stat()
    assert (before.st_mode, before.st_ino, before.st_rdev) == (after.st_mode, after.st_ino, after.st_rdev)
    if Path("/dev/full").exists():
        with pytest.raises(FileError, match="/dev/full: cannot be written"):
            write_json("/dev/full", {"a": 1})


@pytest.mark.parametrize("place", ["/dev/null", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_formats_that_are_no_one_stream_are_refused(place: str) -> None:
    before = NULL.stat()
    with pytest.raises(FileError, match=place):
        RUN.save(place)
    with pytest.raises(FileError, match=place), all_or_none(place):
        pytest.fail("a folder was begun")
    after = NULL.stat()
    assert (before.st_mode, before.st_ino) == (after.st_mode, after.st_ino)


def test_what_stdout_leads_to_is_not_replaced(tmp_path: Path) -> None:
    code = (
        "import numpy as np, adaptctl; x = np.zeros((5, 1))\n"
        "print('kept', flush=True)\n"
        "adaptctl.Rollout.from_arrays(x, x, x, 0.01).save('/dev/stdout')"
    )
    with (tmp_path / "out.txt").open("w") as file:
        done = subprocess.run([sys.executable, "-c", code], stdout=file, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert "FileError: /dev/stdout: " in done.stderr
    assert (tmp_path / "out.txt").read_text() == "kept\n"


@nightly
def test_commands_write_through(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "adaptctl"]
    done = subprocess.run(
        [*command, "install-completion", "--shell", "bash", "--out", "/dev/stdout"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert subprocess.run(["bash", "-n"], input=done.stdout, text=True).returncode == 0
    basis = [*command, "basis", "semi_direct_drive", "--out", "/dev/stderr", "--json"]
    done = subprocess.run(basis, capture_output=True, text=True, check=True)
    assert json.loads(done.stderr)["schema"].startswith("adaptctl/fundamental-basis/")
    assert json.loads(done.stdout)["rank"] > 0
