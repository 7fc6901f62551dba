"""Folders of results: one run, complete and saying so, or the old one untouched, whatever happens."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from nightly import mostly_at_night, nightly

from adaptctl.cli.main import main
from adaptctl.errors import FileError
from adaptctl.files import name_beside, remove_stale_temporaries, replacing, write_text
from adaptctl.folders import replacing_folder

SMALL = "two_link"
RUN = [sys.executable, "-m", "adaptctl", "experiment", "run", "adaptive", "--robot", SMALL, "--duration", "0.2"]
RUN.append("--overwrite")
RUNS = 7
WHOLE = {"recording.rrd", "summary.json", "trace.parquet", "report.html"}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def written(folder: Path, text: str, overwrite: bool = True) -> None:
    with replacing_folder(folder, overwrite) as beside:
        (beside / "summary.json").write_text(text)
        (beside / "figures").mkdir()
        (beside / "figures" / "a.png").write_text(text)


def test_a_folder_appears_whole_and_is_replaced_whole(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "out"
    written(place, "1", overwrite=False)
    (place / "old.parquet").write_text("1")
    (place / "notes.md").write_text("mine")
    written(place, "2")
    assert names(place) == {"summary.json", "figures", "notes.md"}
    assert (place / "figures" / "a.png").read_text() == "2"
    assert names(place.parent) == {"out"}


def test_the_folder_above_is_written_through_once_the_new_one_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[tuple[Path, set[str]]] = []
    monkeypatch.setattr("adaptctl.folders.flush", lambda path: flushed.append((path, names(tmp_path))))
    written(tmp_path / "out", "1")
    assert flushed[-1] == (tmp_path, {"out"})


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, OSError])
def test_a_failed_folder_leaves_the_old_one_and_nothing_else(tmp_path: Path, failure: type[BaseException]) -> None:
    written(tmp_path / "out", "old")

    def half() -> None:
        with replacing_folder(tmp_path / "out", overwrite=True) as beside:
            (beside / "summary.json").write_text("new")
            raise failure

    with pytest.raises((failure, FileError)):
        half()
    assert (tmp_path / "out" / "summary.json").read_text() == "old"
    assert names(tmp_path) == {"out"}


def test_a_failed_folder_leaves_none_of_those_above_it_that_were_missing(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(ValueError, match="failed"), replacing_folder(tmp_path / "there" / "a" / "b" / "out"):
        raise ValueError("failed")
    assert list(tmp_path.rglob("*")) == [tmp_path / "there"]


def test_ctrl_c_as_the_temporary_folder_is_made_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mkdir = Path.mkdir

    def interrupted(path: Path, **above: bool) -> None:
        mkdir(path, **above)  # type: ignore[arg-type]  # of the folder above
        if not above:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Path, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt), replacing_folder(tmp_path / "out"):
        pass
    assert names(tmp_path) == set()


def test_a_folder_that_holds_something_is_refused_unless_allowed(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FileError, match=r"not empty; .*--overwrite"):
        written(tmp_path, "1", overwrite=False)
    written(tmp_path, "1")
    assert names(tmp_path) == {"thesis.tex", "summary.json", "figures"}


def test_a_folder_that_no_run_has_written_is_not_replaced(tmp_path: Path) -> None:
    mine = {"pyproject.toml": "mine", "log.csv": "hours of measurements"}
    for name, text in mine.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "cat.png").write_text("cat")
    with pytest.raises(FileError, match=r"holds log\.csv, and no run's summary\.json"):
        written(tmp_path, "1")
    assert {name: (tmp_path / name).read_text() for name in mine} == mine
    assert names(tmp_path) == {*mine, "pictures"}


@pytest.mark.parametrize("inside", [False, True])
def test_what_is_not_a_runs_is_kept_at_any_depth(tmp_path: Path, inside: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "out"
    written(place, "1")
    (place / "pictures").mkdir()
    kept = {"notes.md", "figures/notes.md", "pictures/cat.png", "pictures/log.csv"}
    for name in (*kept, "figures/old.png", "old.csv"):
        (place / name).write_text("mine")
    os.mkfifo(place / "figures" / "pipe.png")
    if inside:
        monkeypatch.chdir(place)
    written(place, "2")
    files = {str(path.relative_to(place)) for path in place.rglob("*") if not path.is_dir()}
    assert files == {"summary.json", "figures/a.png", "figures/pipe.png", *kept}
    assert (place / "figures" / "a.png").read_text() == "2"
    assert names(tmp_path) == {"out"}


def test_a_link_to_a_folder_elsewhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    written(tmp_path / "theirs", "old")
    (tmp_path / "mine" / "out").symlink_to(tmp_path / "theirs")
    with pytest.raises(FileError, match=r"out: is a link to .*theirs, outside its folder; give that path itself"):
        written(tmp_path / "mine" / "out", "new")
    assert (tmp_path / "theirs" / "summary.json").read_text() == "old"


def test_a_run_that_was_killed_while_it_moved_in_may_be_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the folder that one stands in files are moved one by one, the summary last."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trace.parquet").write_text("half")
    of_the_dead(tmp_path / tmp_path.name).mkdir()
    written(Path(), "2")
    assert names(tmp_path) == {"summary.json", "figures"}


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(FileError, match="file"):
            written(place, "1")
    with pytest.raises(FileError, match=r"/proc/.*choose another folder"):
        written(Path("/proc/adaptctl-results"), "1")


def test_the_folder_that_one_stands_in_is_written_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for text in ("1", "2"):
        written(Path(), text)
        assert names(tmp_path) == {"summary.json", "figures"}
        assert Path("summary.json").read_text() == text


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    with (
        replacing_folder(tmp_path / "out") as beside,
        pytest.raises(FileError, match="another run is writing it"),
        replacing_folder(tmp_path / "out"),
    ):
        pass
    assert not beside.exists()


def of_the_dead(target: Path) -> Path:
    done = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    return target.with_name(name_beside(target).name.replace(f"-{os.getpid()}-", f"-{int(done.stdout)}-"))


def test_what_the_killed_left_is_cleared_away(tmp_path: Path) -> None:
    folder, file, alive = (
        of_the_dead(tmp_path / "out"),
        of_the_dead(tmp_path / "a.txt"),
        name_beside(tmp_path / "a.txt"),
    )
    folder.mkdir()
    for path in (folder / "half", file, alive, tmp_path / ".a.mine.txt"):
        path.write_text("half")
    written(tmp_path / "out", "1")
    assert not folder.exists()
    write_text(tmp_path / "a.txt", "1")
    assert names(tmp_path) == {"out", "a.txt", alive.name, ".a.mine.txt"}


POD = "adaptctl-sweep-worker-deployment-7d9f8b6c5d-x2x4z"
ELSEWHERE = {
    "pod": "host = host[:-5] + 'q8q8q'",
    "boot": "read = Path.read_text\n"
    "Path.read_text = lambda path, *a, **k: 'b' if path.name == 'boot_id' else read(path, *a, **k)",
    "namespace": "link = os.readlink; os.readlink = lambda path: 'pid:[1]' if 'ns/pid' in str(path) else link(path)",
    "same": "",
}
ASKED = f"""
import os, sys
from pathlib import Path
host = {POD!r}
%s
os.uname = lambda: os.uname_result(("Linux", host, "6", "1", "x86_64"))
from adaptctl.files import is_stale_temporary, name_beside
print(*[is_stale_temporary(name) for name in sys.argv[1:]] or [name_beside(Path("a.txt")).name])
"""


@pytest.mark.parametrize("changed", mostly_at_night(ELSEWHERE, *list(ELSEWHERE)[-2:]))
def test_processes_elsewhere_are_not_taken_for_dead(changed: str) -> None:
    def told(code: str, *arguments: str) -> str:
        command = [sys.executable, "-c", ASKED % code, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    left = told("")
    assert left.startswith(".a.")
    assert told(ELSEWHERE[changed], left) == str(changed == "same")


@pytest.mark.parametrize("inside", [True, False], ids=["in place", "beside"])
@pytest.mark.parametrize("name", ["summary.json", "figures/a.png"])
def test_a_pipe_in_a_runs_folder_is_kept(
    tmp_path: Path, name: str, inside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "out"
    written(place, "old")
    (place / "figures").mkdir(exist_ok=True)
    (place / name).unlink(missing_ok=True)
    (place / "forecast.json").write_text("{}")
    os.mkfifo(place / name)
    if inside:
        monkeypatch.chdir(place)
    with pytest.raises(FileError, match=rf"{name}: is no regular file, but a pipe"):
        written(place, "new")
    assert (place / name).is_fifo()


def validate_one_run(place: Path, old: str) -> None:
    """The folder is as it was, or holds a whole run that says whether it is complete."""
    said = json.loads((place / "summary.json").read_text())
    if said != old:
        assert names(place) == WHOLE
        assert said["complete"] in (True, False)
        whole = said["duration_run"] == said["duration"] and len(said["runs"]) == RUNS
        assert whole or not said["complete"]  # it may be ended after its last run, while that is timed


@pytest.mark.parametrize("number", mostly_at_night([signal.SIGKILL, signal.SIGINT, signal.SIGTERM], signal.SIGKILL))
def test_a_run_that_is_ended_at_any_moment(tmp_path: Path, number: signal.Signals) -> None:
    """Also in its first moments, and while it writes. `AT_RANDOM=200 pytest -k any_moment` tries as many."""
    rng, place = random.Random(int(number)), tmp_path / "out"
    for _ in range(int(os.environ.get("AT_RANDOM", "1"))):
        place.mkdir(exist_ok=True)
        for inner in place.glob("*"):
            if inner.is_file():
                inner.unlink()
        (place / "summary.json").write_text('"old"')
        done = subprocess.Popen(
            [*RUN, "--out", str(place)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        time.sleep(rng.uniform(0.3, 6.0))
        done.send_signal(number)
        _, said = done.communicate(timeout=120)
        ours = "adaptctl/__main__.py" in said or "Traceback" not in said
        if ours:  # else Python itself was still starting, and nothing of ours has run
            assert "Traceback" not in said
            assert done.returncode in (0, 130, -int(number))
        validate_one_run(place, "old")


def test_a_whole_run_replaces_an_old_one(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text('"old"')
    assert main([*RUN[3:], "--out", str(tmp_path)]) == 0
    validate_one_run(tmp_path, "old")
    assert json.loads((tmp_path / "summary.json").read_text())["complete"] is True


@nightly
def test_a_run_on_a_full_disk_says_so_and_leaves_the_old(tmp_path: Path) -> None:
    """No file may grow beyond some size, as where a quota or a disk ends. `AT_RANDOM=20 pytest -k full_disk` tries as
    many sizes, from 100 bytes to as much as the largest file needs."""
    rng, place = random.Random(0), tmp_path / "out"
    for _ in range(int(os.environ.get("AT_RANDOM", "1"))):
        place.mkdir(exist_ok=True)
        (place / "summary.json").write_text('"old"')
        room = int(10.0 ** rng.uniform(2.0, 4.5))
        done = subprocess.run(
            [*RUN, "--out", str(place)],
            capture_output=True,
            text=True,
            preexec_fn=lambda room=room: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        )
        assert "Traceback" not in done.stderr
        assert done.returncode == 2
        assert "cannot be written" in done.stderr
        assert names(place) == {"summary.json"}
        assert (place / "summary.json").read_text() == '"old"'
        assert names(tmp_path) == {"out"}


def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match=r"a\.txt: cannot be written \(no space left on device\)"):
        write_text(tmp_path / "a.txt", "1")
    assert names(tmp_path) == set()


def test_a_file_beside_is_named_by_its_process(tmp_path: Path) -> None:
    with replacing(tmp_path / "a.txt") as beside:
        beside.write_text("1")
        assert f"-{os.getpid()}-" in beside.name


def test_errors_of_the_folder_name_it_and_those_of_other_files_are_theirs(tmp_path: Path) -> None:
    for named, kind in ((tmp_path / "out" / "a", FileError), (Path("/elsewhere/a"), FileNotFoundError)):
        with pytest.raises(kind), replacing_folder(tmp_path / "out"):
            raise FileNotFoundError(2, "No such file or directory", str(named))
    assert names(tmp_path) == set()


def test_a_folder_is_made_beside_the_one_that_it_replaces_unless_that_is_fixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "out"
    written(place, "1")
    for fixed in (False, True):
        monkeypatch.chdir(place if fixed else tmp_path)
        with replacing_folder(place, overwrite=True) as beside:
            assert beside.parent == (place if fixed else tmp_path)


def test_a_run_in_the_working_folder_brings_folders_of_any_depth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with replacing_folder(tmp_path, overwrite=True) as beside:
        for name in ("summary.json", "a/b/c.txt", "a/b/d.txt"):
            (beside / name).parent.mkdir(parents=True, exist_ok=True)
            (beside / name).write_text(name)
    assert (tmp_path / "a" / "b" / "d.txt").read_text() == "a/b/d.txt"
    assert names(tmp_path) == {"summary.json", "a"}


def test_what_an_ended_process_left_goes_though_another_took_some_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = [name_beside(tmp_path / "a.txt") for _ in range(2)]
    left[1].touch()
    monkeypatch.setattr(Path, "iterdir", lambda folder: iter(left))
    monkeypatch.setattr("adaptctl.files.is_stale_temporary", lambda name: True)
    assert remove_stale_temporaries(tmp_path, "a.txt") == []
    assert not left[1].exists()
