"""Settings, readings and surroundings that nothing has: refused in a line that names them, never a traceback."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import at_night, turn_by_turn

from adaptctl import ReducedModel, arrays, load
from adaptctl.cli.main import main
from adaptctl.control import SafetyFilter
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.identification.log_files import read_log, table
from adaptctl.tuning import tune

TWO_LINK = "two_link"


@pytest.mark.parametrize(
    "words",
    [
        "tune ROBOT --control-period 1e-320",
        "tune ROBOT --control-period 1e-20",
        "export ROBOT --control-period 1e-320",
        "gains ROBOT --bandwidth 1e200",
        "excite ROBOT --duration 1e308",
        "excite ROBOT --duration 1e20",
        "excite ROBOT --jerk 1e-100",
        "design ROBOT --max-offset 1e308",
        "design ROBOT --max-offset 1e25",
    ],
)
def test_absurd_settings_are_refused_by_their_name(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    option = words.split()[2].removeprefix("--")
    assert main(words.replace("ROBOT", TWO_LINK).split()) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert option in told.replace("_", "-").replace("control period", "control-period")
    assert re.search(" (to|at most) [01]", told)


@pytest.mark.parametrize("duration", [1e308, 1e12])
def test_episodes_have_lengths_that_can_be_counted(duration: float) -> None:
    with pytest.raises(InputError, match=r"^duration: expected .* to 1e\+09, got 1"):
        TrackingEnv(load(TWO_LINK), tune(load(TWO_LINK)).reference, duration=duration)


@pytest.mark.parametrize("reading", [1e308, 1e31])
def test_readings_beyond_reason_name_column_and_row(reading: float) -> None:
    log = table("log.csv", [("tau1", np.array([1.0, -reading, 2.0]))])
    with pytest.raises(InputError, match=r"^log\.csv: column 'tau1' \(torque\): .*-1e\+3.* in row 2"):
        log.column("tau1", "torque")


def test_columns_too_small_to_be_squared_are_refused_and_zeros_are_not() -> None:
    log = table("log.csv", [("tau1", np.array([1e-200, 0.0])), ("tau2", np.zeros(2))])
    with pytest.raises(InputError, match="'tau1'"):
        log.column("tau1", "torque")
    assert not log.column("tau2", "torque").any()


@pytest.mark.parametrize(
    ("suffix", "content"),
    turn_by_turn([".bag", ".mcap", ".db3"], [b"\xde\xad" * 25_000, b"#ROSBAG V2.0\n" + bytes(range(256)) * 20]),
)
def test_junk_is_no_bag(tmp_path: Path, suffix: str, content: bytes) -> None:
    (tmp_path / f"junk{suffix}").write_bytes(content)
    with pytest.raises(InputError, match=r"junk\.\w+: cannot be read as (a ROS bag|MCAP)"):
        read_log(tmp_path / f"junk{suffix}")


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3", ".parquet", ".rrd"])
def test_empty_logs_and_folders_without_one_are_called_so(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"log{suffix}").touch()
    for path, said in ((tmp_path / f"log{suffix}", "is empty"), (tmp_path, "is a folder without a log; give a file")):
        with pytest.raises(InputError, match=rf"{path}: {said}"):
            read_log(path)


@pytest.mark.parametrize(
    ("words", "encoding"), [(("gains",), "ascii"), *map(at_night, [(("gains",), "latin-1"), (("tune",), "ascii")])]
)
def test_any_terminal_shows_reports(words: tuple[str, ...], encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding=encoding, write_through=True))
    assert main([*words, TWO_LINK]) == 0
    assert rb"\u03" in shown.getvalue()


TAKING_NAMES = [
    ("basis", "puma560", "--out"),
    ("export", "puma560", "--out"),
    ("identify", "--robot", TWO_LINK),
    ("runs",),
    ("sweep", "status"),
    ("sweep", "report"),
]


@pytest.mark.parametrize("words", [at_night((words,)) if k % 3 else words for k, words in enumerate(TAKING_NAMES)])
def test_file_names_too_long_are_refused(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, str(tmp_path / ("a" * 300))]) == 2
    told = capsys.readouterr().err
    assert "file name too long" in told
    assert "Errno" not in told


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize(
    "words", [("basis", TWO_LINK, "--out"), ("install-completion", "--shell", "bash", "--out")], ids=" ".join
)
def test_a_full_disk_is_no_wrong_input(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "/dev/full"]) == 1
    assert capsys.readouterr().err.endswith("/dev/full: cannot be written (no space left on device)\n")


def test_a_deleted_working_folder_is_named(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    program = "import os, sys; os.rmdir(os.getcwd()); from adaptctl.cli.main import main; sys.exit(main())"
    told = subprocess.run(
        [sys.executable, "-c", program, "basis", TWO_LINK, "--out", "x.json"],
        cwd=gone,
        env={**os.environ, "PYTHONPATH": str(Path(arrays.__file__).parent.parent)},
        capture_output=True,
        check=False,
    )
    assert told.returncode == 2, told.stderr.decode()
    assert b"x.json: cannot be written (the working folder does not exist any more" in told.stderr


MASKED = np.ma.array([0.1, 0.2], mask=[False, True])
FIELDS = np.array([(0.1,), (0.2,)], dtype=[("a", float)])


@pytest.mark.parametrize("given", [MASKED, FIELDS, FIELDS[0], [MASKED], (0.1, np.ma.masked)], ids=repr)
def test_masked_elements_and_fields_are_no_numbers(given: Any) -> None:
    with pytest.raises(InputError, match=r"^x: expected numbers"):
        arrays.numbers(given, "x")


def test_a_mask_that_hides_nothing_is_no_matter() -> None:
    assert arrays.numbers(np.ma.array([0.1, 0.2]), "x").tolist() == [0.1, 0.2]


@pytest.mark.parametrize("given", [MASKED, FIELDS], ids=["masked", "fields"])
def test_kernels_laws_and_environments_read_no_masked_elements(given: Any) -> None:
    arm = load(TWO_LINK)
    tuning = tune(arm)
    law = SafetyFilter(tuning.controller(ReducedModel.full(arm)))
    plain, point = np.array([0.1, 0.2]), tuning.reference(0.0)
    state = law.init(plain, plain)
    env = TrackingEnv(arm, tuning.reference)
    env.reset(seed=0)
    for call in (
        lambda: arm.mass_matrix(given),
        lambda: law.init(given, plain),
        lambda: law.step(state, given, plain, point),
        lambda: law.step(state, plain, plain, point._replace(v=given)),
        lambda: law.reset(state, np.True_, given, plain),
        lambda: env.step(given),
    ):
        with pytest.raises(InputError):
            call()
