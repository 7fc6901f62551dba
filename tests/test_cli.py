"""The command line: what it prints, what it refuses and how, and that it answers at once."""

from __future__ import annotations

import errno
import io
import os
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

from adaptctl.cli.main import main
from adaptctl.errors import InputError
from adaptctl.experiments import EXPERIMENTS

RUN = ("experiment", "run", "puma560-adaptive")
HEAVY = ("numpy", "scipy", "pinocchio", "gymnasium", "rerun", "matplotlib", "pyarrow", "control", "llvmlite", "msgspec")


def refused(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    """The one line on stderr with which a command line is refused."""
    assert main(command) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    lines = [line for line in shown.err.splitlines() if not line.startswith("adaptctl: note:")]
    assert len(lines) == 1, shown.err
    assert lines[0].startswith("adaptctl: ")
    assert "Traceback" not in shown.err
    return lines[0].removeprefix("adaptctl: ")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"adaptctl {version('adaptctl')}\n"


def test_help_names_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert "basis" in shown
    assert "experiment" in shown


def test_list_names_the_experiments(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", "list"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names == [entry.name for entry in EXPERIMENTS]
    assert {"puma560-adaptive", "adaptive"} <= set(names)


def test_help_of_an_experiment_tells_every_setting_its_symbol_and_default(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([*RUN, "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--bandwidth FLOAT Λ: bandwidth, the decay rate of errors, 1/s [default: 8]" in shown
    assert "K: damping of each joint, N m s [default: 90 150 70 20 16 18]" in shown
    for flag in ("--seed INT", "--duration FLOAT", "--out DIR", "--overwrite", "--initial-error", "--robot"):
        assert flag in shown


@pytest.mark.parametrize("command", [["--help"], ["--version"], ["experiment", "list"], ["experiment", "run", "-h"]])
def test_what_needs_no_robot_imports_nothing_heavy(command: list[str]) -> None:
    script = f"""
import sys
from adaptctl.cli.main import main
from adaptctl.experiments import EXPERIMENTS
assert main({command!r}) == 0
print("loaded", [name for name in {HEAVY!r} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded []"


DRIVE = ("drive", "mujoco", "two_link", "--robot", "two_link", "--duration", "1", "--out", "a")


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (
            (),
            "a command is missing: new, basis, gains, identify, ",
        ),
        (
            ("bases",),
            'Unknown command "bases". Did you mean "basis"? Available commands: new, basis, gains,',
        ),
        (("experiment",), "a command is missing: run, list, compare, convert; see adaptctl experiment --help"),
        (("experiment", "lst"), 'Unknown command "lst". Did you mean "list"?'),
        (("experiment", "list", "x"), "'x': no argument of this command. See adaptctl experiment list --help"),
        (("experiment", "run"), "an experiment is missing: puma560-adaptive, semi-direct-drive-adaptive, "),
        (
            ("experiment", "run", "puma-adaptive"),
            'Unknown command "puma-adaptive". Did you mean "puma560-adaptive"? Available commands: puma560-adaptive, ',
        ),
        ((*RUN, "--durations", "1"), "Unknown option: --durations. Did you mean --duration?"),
        ((*RUN, "--dur", "1"), "Unknown option: --dur. Did you mean --duration?"),
        ((*RUN, "--out"), "--out needs a value: "),
        ((*RUN, "--duration", "long"), r"--duration: expected a number in s, got 'long'"),
        ((*RUN, "--duration", "5s"), "--duration: expected a number in s, got '5s'; write 5"),
        (("drive", "mujoco", "a", "--robot", "a", "--out", "a", "--duration", "1ms"), "in s, got '1ms'; write 0.001"),
        (("drive", "mujoco", "a", "--robot", "a", "--amplitude", "10deg"), "in rad, got '10deg'; write 0.1745329252"),
        (("drive", "mujoco", "a"), "--robot, --duration, --out are missing; see adaptctl drive --help"),
        ((*RUN, "--lawn", "a"), "Unknown option: --lawn; options: --"),
        (("gains", "two_link", "--poles", "-3"), "--poles: expected 2 values, got 1. See"),
        (("basis", "two_link", "--gravity", "0", "0"), "--gravity: expected 3 values, got 2. See"),
        (("excite", "two_link", "--out", "a", "--start", "1"), "--start: two_link has 2 joints (shoulder, elbow), but"),
        ((*DRIVE, "--start", "0.3"), "--start: two_link has 2 joints (shoulder, elbow), but 1 position is given"),
        ((*DRIVE, "--start", "0.3", "9"), "--start: joint 'elbow' at 9 is outside its range"),
        (
            ("drive", "udp", *DRIVE[2:], "--start", "0.3", "0"),
            "--start is for mujoco: a udp robot stands where it stands",
        ),
        (("gains", "puma560", "--bandwidth", "0,5"), "expected a number in 1/s, got '0,5'; write 0.5, with a point"),
        (("gains", "puma560", "--bandwidth", "3Hz"), "got '3Hz'; write the number alone, in 1/s"),
        (("identify", "a", "--friction", "viscous", "coulomb"), "join them by commas: --friction viscous,coulomb"),
        (
            ("identify", "a", "--robot", "two_link", "--columns", "position=a", "b"),
            "one more of the last: position=a,b",
        ),
        ((*RUN, "--duration", "0"), "duration: expected a number from 0.01 to 300, got 0"),
        ((*RUN, "--duration", "-3"), "--duration: expected a number from 0.01 to 300, got -3"),
        ((*RUN, "--duration", "1e9"), "duration: expected a number from 0.01 to 300, got 1e+09"),
        ((*RUN, "--duration", "nan"), "duration: expected a number from 0.01 to 300, got nan"),
        ((*RUN, "--duration", "inf"), "duration: expected a number from 0.01 to 300, got inf"),
        ((*RUN, "--duration", "200", "--control-period", "1e-4"), "more than 300000 steps"),
        ((*RUN, "--seed", "-1"), "seed: expected a whole number from 0 to"),
        ((*RUN, "--seed", "1.5"), "--seed: expected a whole number, got '1.5'"),
        ((*RUN, "--seed", "99999999999"), "seed: expected a whole number from 0 to"),
        ((*RUN, "--damping", "90", "150"), "damping: expected 6 numbers, one per joint, got 2"),
        (
            (*RUN, "--damping", "90", "150", "70", "20", "16", "0"),
            "damping: expected numbers from 0.001 to 10000, got 0",
        ),
        ((*RUN, "--frequency", "nan", "0", "0", "0", "0", "0"), "frequency: expected numbers from 0 to 5, got nan"),
        ((*RUN, "--damping", "90,150,70,20,16,18"), "numbers are separated by blanks: 90 150 70 20 16 18"),
        (("experiment", "run", "laws", "--laws", "a,b"), "unknown law 'a,b'; several are separated by blanks; laws: "),
        ((*RUN, "5"), "'5': no argument of this command."),
        (("experiment", "run", "adaptive", "my_arm.toml"), "Did you mean --robot my_arm.toml? See"),
        (("my_arm.urdf",), "Did you mean adaptctl tune my_arm.urdf? See adaptctl --help"),
        (("experiment", "run", "a.xml"), "Did you mean adaptctl experiment run adaptive --robot a.xml? See"),
        (("run", "adaptive"), "Unknown command 'run'. Did you mean adaptctl experiment run? See adaptctl --help"),
        (("basis", "--robot", "a.urdf"), "Unknown option: --robot; ROBOT is given without it. See adaptctl basis"),
        (("tune", "--robot=a.urdf"), "Unknown option: --robot; ROBOT is given without it. See adaptctl tune --help"),
        ((*RUN, "--no-overwrite"), "Unknown option: --no-overwrite."),
        (("basis",), "ROBOT is missing: name of a built-in robot, or a .urdf, .xml (MJCF) or .toml file. See"),
        (("export", "puma560"), "--out is missing: folder to write, which must not exist, such as --out results/new."),
        (("sweep", "puma560-adaptive"), "--out is missing: results folder, such as --out results/new. See"),
        (("tune", "two_link", "--law", "a"), "option: --law, which is one of adaptctl export, contest; options: --a"),
        (("basis", "two_link", "--gravity", "0,0"), "--gravity: expected 3 values, got 2. See"),
        (("basis", "two_link", "--gravity=0,0,9.81"), "separate them by blanks: --gravity 0 0 9.81. See"),
        (("basis", "two_link", "--lock", "elbow 0.2"), "no joint 'elbow 0.2'; write elbow=0.2; joints:"),
        (("basis", "two_link", "--lock", "elbow", "0.2"), "expected JOINT=VALUE, got '0.2'; write elbow=0.2"),
        (("tune", "two_link", "--control-period", "100Hz"), "in s, got '100Hz'; write 0.01"),
        (("tune", "two_link", "--control-period", "1"), "--control-period: expected a positive time in s"),
        (("tune", "two_link", "--delay", "-1"), "--delay: expected a whole number from 0 to 64"),
        (("gains", "two_link", "--delay=-1"), "--delay: expected a whole number from 0 to 100"),
        (("gains", "two_link", "--damping-ratio", "0"), "--damping-ratio: expected positive numbers"),
        (("basis", "two_link", "--gravity", "nan", "0", "0"), "--gravity: x, y, z in m/s^2: expected finite"),
        (("basis", "two_link", "--gravity", "1e20", "0", "0"), "two_link: --gravity: expected at most 1e+09"),
        (("contest", "--out", "a"), "FILE is missing: TOML file"),
        (("help",), "Did you mean adaptctl --help?"),
        (("version",), "Did you mean adaptctl --version?"),
        (("experiment", "run", "--list"), "Did you mean adaptctl experiment list?"),
        (("experiment", "adaptive"), "Did you mean adaptctl experiment run adaptive?"),
        (("sweep", "run", "adaptive", "--out", "a"), "Did you mean adaptctl sweep adaptive?"),
        (("sweep", "a.urdf", "--out", "a"), "unknown experiment or study 'a.urdf'; adaptive --robot a.urdf is one;"),
        (("sweep", "report"), "FOLDER is missing: results folder of a sweep. See adaptctl sweep report --help"),
        (("identify", "a.urdf", "log.csv"), "--robot is missing: write --robot a.urdf"),
        (
            ("identify", "a.csv", "--robot", "two_link", "--energy-differences", "0.1"),
            "--energy-differences needs exactly one log",
        ),
        ((*DRIVE, "--amplitude", "90"), "--amplitude: expected at most 3.2 rad (m), got 90: is it in deg?"),
        (
            ("experiment", "convert", "gone", "--to", "mcap"),
            "gone/trace.parquet: does not exist; give a results folder",
        ),
        (("basis", "two_link", "--lock", "elbow=0,2"), "got '0,2'; write elbow=0.2, with a point"),
        ((*RUN, "--gain-scale", "-1"), "--gain-scale: expected a number from 1e-06 to 1000, got -1"),
    ],
)
def test_wrong_command_lines_are_refused_in_a_line(
    command: tuple[str, ...],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert told in refused(capsys, *command)
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_the_same_name_or_of_another_kind_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("gantry.toml").touch()
    Path("arm.urdf").write_text("<robot/>")
    assert "(did you mean 'gantry.toml'?)" in refused(capsys, "basis", "gantry.urdf")
    assert "arm.urdf: expected a TOML file, got a .urdf" in refused(capsys, "contest", "arm.urdf", "--out", "a")
    assert "gone.xml: cannot be read" in refused(capsys, "drive", "mujoco", "gone.xml", *DRIVE[3:])


def test_what_an_arm_does_is_not_said_of_the_flag_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def moving(*_: object) -> None:
        raise InputError("robot: shoulder moves, at 0.1 rad/s: start at rest")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module("adaptctl.hardware.drive"), "standing", moving)
    assert refused(capsys, *DRIVE) == "robot: shoulder moves, at 0.1 rad/s: start at rest"


def test_unknown_robot_is_told_what_exists(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, *RUN, "--out", str(tmp_path / "out"), "--robot", "puma56")
    assert "unknown robot 'puma56' (did you mean 'puma560'?)" in line
    assert "puma560_measured" in line


def test_arm_with_other_joints_is_sent_to_the_right_experiment(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(capsys, *RUN, "--out", str(tmp_path / "out"), "--robot", "puma560_arm3")
    assert line == "--robot: puma560_arm3 has 3 joints, but this experiment needs 6; use the experiment 'adaptive'"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("links = [", "not valid TOML"),
        ('schema = "adaptctl/denavit-hartenberg/1"\nconvention = "classic"\nlinks = []', "$.convention"),
        (
            'schema = "adaptctl/denavit-hartenberg/1"\nconvention = "standard"\n[[links]]\nalpha_deg = 0\nlenght = 1.0',
            "lenght",
        ),
    ],
)
def test_malformed_file_is_refused_by_file_and_element(
    text: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(text)
    line = refused(capsys, "experiment", "run", "adaptive", "--out", str(tmp_path / "out"), "--robot", str(path))
    assert str(path) in line
    assert told in line


def test_missing_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = str(tmp_path / "none.urdf")
    line = refused(capsys, "experiment", "run", "adaptive", "--out", str(tmp_path / "out"), "--robot", robot)
    assert robot in line
    assert "cannot be read" in line


def test_damping_that_the_period_cannot_carry_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, *RUN, "--out", str(tmp_path / "out"), "--control-period", "0.02")
    assert "too stiff for a control period of 0.02 s" in line
    assert re.search(r"use at most [\d.]+ times this damping or a period of at most [\d.]+ s", line)


def test_folder_with_something_in_it_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "summary.json").write_text("{}")
    assert f"{tmp_path}: the folder is not empty" in refused(capsys, *RUN, "--out", str(tmp_path))
    assert (tmp_path / "summary.json").read_text() == "{}"


def test_folder_that_cannot_be_written_is_refused_before_anything_is_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert "is a file; give a folder" in refused(capsys, *RUN, "--out", str(tmp_path / "file"))
    assert "choose another folder" in refused(capsys, *RUN, "--out", "/proc/results")


@pytest.mark.parametrize("command", ["design", "export"])
def test_a_place_that_cannot_be_written_is_refused_before_the_robot_is_read(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert "is below a file; give a folder" in refused(capsys, command, "gone.urdf", "--out", str(tmp_path / "file/x"))
    assert "gone.urdf: cannot be read" in refused(capsys, command, "gone.urdf", "--out", str(tmp_path / "a/b"))
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


LISTED = f"{sys.executable} -m adaptctl experiment list"


def printed_at_once_and_at_the_end(command: str) -> list[subprocess.CompletedProcess[str]]:
    """A shell's command line with standard output that keeps nothing, and with one that is written at the end."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return [
        subprocess.run(["bash", "-o", "pipefail", "-c", command], env=env, capture_output=True, text=True, check=False)
        for env in (kept, kept | {"PYTHONUNBUFFERED": "1"})
    ]


def test_reader_that_goes_away_is_no_error_to_tell() -> None:
    for done in printed_at_once_and_at_the_end(f"{LISTED} | true"):
        assert (done.returncode, done.stderr) == (1, "")


def test_no_standard_output_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    for done in printed_at_once_and_at_the_end(f"{LISTED} >&-"):
        assert (done.returncode, done.stderr) == (0, "")
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["basis", "two_link", "--json"]) == 0


def test_full_disk_behind_standard_output_is_told_in_a_line() -> None:
    for done in printed_at_once_and_at_the_end(f"{LISTED} > /dev/full"):
        assert done.returncode == 1
        assert done.stderr == "adaptctl: the output cannot be written (no space left on device)\n"


def test_a_terminal_that_is_gone_is_not_called_full(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(sys, "stdout", Gone())
    assert main(["experiment", "list"]) == 1
    assert "cannot be written (input/output error)" in capsys.readouterr().err
