"""What a command line asks for is what the library is asked for, and what is left out is as the help says."""

from __future__ import annotations

import ctypes
import inspect
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import adaptctl
from adaptctl import codegen, control, hardware, tuning
from adaptctl.cli import experiment, identify, numbers, output, sweep, tune
from adaptctl.cli.drive import _driven, connected
from adaptctl.cli.main import main
from adaptctl.cli.memory import return_large_blocks
from adaptctl.codegen import builds
from adaptctl.control import GainDesign
from adaptctl.errors import InputError
from adaptctl.identification import estimator_comparison, files
from adaptctl.simulation.effects import ControlDelay
from adaptctl.sweeps import search
from adaptctl.sweeps.search import BestSettings
from adaptctl.tuning import named_laws

ARM = adaptctl.load("two_link")


class AskedError(Exception):
    """What a function of the library was asked for."""


def asked(*given: Any, **named: Any) -> Any:
    raise AskedError(*given, named)


@pytest.mark.parametrize(
    ("line", "method", "given"),
    [
        ("--method poles", "from_poles", (-8.0, -12.0)),
        ("--method poles --poles -6+2j -6-2j", "from_poles", (-6 + 2j, -6 - 2j)),
        ("--method lqr", "from_lqr", (4096.0, 0.0, 1.0)),
        ("--method lqr --weights 9 8 7", "from_lqr", (9.0, 8.0, 7.0)),
        ("--damping-ratio 1.5", "from_bandwidth", (4.0, 1.5)),
        ("--damping-ratio 1.5 --bandwidth 3", "from_bandwidth", (3.0, 1.5)),
    ],
)
def test_gains_are_designed_as_asked(
    line: str, method: str, given: tuple[complex, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(GainDesign, method, asked)
    with pytest.raises(AskedError) as told:
        main(["gains", "two_link", *line.split(), "--control-period", "0.002", "--delay", "3"])
    _, *found, more = told.value.args
    assert tuple(np.ravel(np.array(found, dtype=complex))) == given
    assert more == {"control_period": 0.002, "delay": 3}


def test_a_robot_is_tuned_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "tune", asked)
    line = "--control-period 0.002 --bandwidth 3 --sampling-ratio 0.4 --adaptation-ratio 0.3 --search 7 --seed 5"
    with pytest.raises(AskedError) as told:
        main(["tune", "two_link", *line.split(), "--delay", "2"])
    assert told.value.args[1] == {
        "control_period": 0.002, "bandwidth": 3.0, "sampling_ratio": 0.4, "adaptation_ratio": 0.3, "search": 7,
        "seed": 5, "effects": [ControlDelay(2)],
    }  # fmt: skip


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("json", [False, True])
def test_a_tuning_that_fails_is_told_and_a_verdict(
    failed: bool, json: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tuning, "tune", lambda *given, **more: SimpleNamespace(failed=failed))
    monkeypatch.setattr(tune, "as_builtins", lambda found: {"failed": found.failed})
    monkeypatch.setattr(tune, "report", lambda found: [f"report of {found.failed}"])
    assert tune.tune("two_link", json=json) == 3 * failed
    assert capsys.readouterr().out.split() == (
        ["{", '"failed":', str(failed).lower(), "}"] if json else ["report", "of", str(failed)]
    )


def test_a_search_tells_the_best_settings_and_how_to_run_them_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = BestSettings({"damping": 4.5, "seed": 3}, "adaptive", 0.00123456, 9)
    told = list[Any]()

    def searched(study: Any, objective: str, trials: int, progress: Any) -> BestSettings:
        progress(1.0)
        told.append((study, objective, trials))
        return found

    monkeypatch.setattr(search, "search", searched)
    monkeypatch.setattr(search, "write_settings", lambda *given: told.append(given))
    study: Any = "study"
    out = tmp_path / "out"
    assert sweep._search(study, "rms", 9, out) == 0
    assert told == [("study", "rms", 9), (out / "best.toml", "study", found)]
    first, *rows, again = capsys.readouterr().out.strip().splitlines()
    assert first.startswith("rms 0.001235 of adaptive, the best of 9 runs")
    assert [row.split() for row in rows if row] == [["damping", "4.5"], ["seed", "3"]]
    assert again.endswith(f"adaptctl sweep {out / 'best.toml'} --out {out / 'again'}")
    (out / "kept").touch()
    with pytest.raises(InputError, match="not empty"):
        sweep._search(study, "rms", 9, out)


@pytest.mark.parametrize(("language", "without"), [("c", False), ("wasm", True)])
def test_a_law_is_exported_as_asked(
    language: str, without: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tuned = SimpleNamespace(validate_learning=lambda flag: None, reference="reference")
    built = list[Any]()
    monkeypatch.setattr(tuning, "tune", lambda arm, **given: tuned)
    monkeypatch.setattr(named_laws, "named_law", lambda name, tuning, model: name)
    monkeypatch.setattr(named_laws, "guarded", lambda law, tuning: f"guarded {law}")
    monkeypatch.setattr(builds, "builds", built.append)
    monkeypatch.setattr(codegen, "export", asked)
    line = ["export", "two_link", "--out", str(tmp_path / "out"), "--language", language, "--check"]
    with pytest.raises(AskedError) as told:
        main([*line, *(["--without-safety-filter"] * without)])
    law, out, more = told.value.args
    assert (law, out) == ("slotine-li-learning" if without else "guarded slotine-li-learning", tmp_path / "out")
    assert more == {
        "name": None, "scalar": "double", "language": language, "without_safety_filter": without, "check": True,
        "reference": "reference", "anyway": False, "large_stack": True,
    }  # fmt: skip
    assert ("compiles the code" in capsys.readouterr().err) == (language == "c")


@pytest.mark.parametrize("any_kernel", [False, True])
def test_a_robot_is_connected_as_asked(any_kernel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    words = {"franka": "Franka", "ur": "UR", "trossen": "Trossen", "udp": "UDP", "mujoco": "MuJoCo"}
    found: dict[str, Any] = {}
    for vendor, word in words.items():
        monkeypatch.setattr(hardware, f"{word}Robot", asked)
        with pytest.raises(AskedError) as told:
            connected(vendor, "there", ARM, any_kernel, [0.1, 0.2] if vendor == "mujoco" else None)
        assert told.value.args[0] == "there"
        found[vendor] = told.value.args[1:]
    assert found["franka"] == ({"real_time": not any_kernel},)
    assert found["mujoco"] == ({"start": [0.1, 0.2], "real_time": True},)
    assert found["trossen"] == ({},)
    for vendor, rate in (("ur", np.inf), ("udp", 1000.0)):
        limits, _ = found[vendor]
        assert (limits.torque.tolist(), limits.torque_rate.tolist()) == (ARM.effort_limits.tolist(), [rate, rate])


def driven(monkeypatch: pytest.MonkeyPatch, **changed: Any) -> Any:
    """What the library is asked to drive, of a robot of two joints at a period of 4 ms that stands at 0.1 and 0.2."""
    here = hardware.RobotReading(0.0, np.array([0.1, 0.2]), np.zeros(2))
    robot = SimpleNamespace(limits=hardware.HardwareLimits.of(ARM), period=4e-3, read=lambda: here, tool="tool")
    given: dict[str, Any] = {"amplitude": 0.2, "on_touch": "ignore", "asked": False, "duration": 9.0} | changed
    vars(robot).update({name: given[name] for name in ("limits", "read", "period") if name in given})
    monkeypatch.setattr(hardware, "motion_about", lambda p, limits, amplitude: (p.tolist(), amplitude))
    monkeypatch.setattr(hardware, "ready_controller", lambda *of: SimpleNamespace(made=of[1:]))
    monkeypatch.setattr(
        control, "with_external_torque", lambda made, cutoff: SimpleNamespace(made=made.made, felt=cutoff)
    )
    monkeypatch.setattr(hardware, "drive", asked)
    interruption: Any = SimpleNamespace(asked=given["asked"])
    motion = given["duration"], given["amplitude"]
    with pytest.raises(AskedError) as told:
        _driven(robot, ARM, motion, Path("out"), "view", given["on_touch"], "there", interruption)  # type: ignore[arg-type]
    return told.value.args


def test_a_robot_is_driven_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    _, law, motion, duration, log, more = driven(monkeypatch)
    assert (motion, duration, log) == (([0.1, 0.2], 0.2), 9.0, Path("out/run.parquet"))
    assert more == {"live": "view", "on_touch": "ignore"}
    assert (law.made, hasattr(law, "felt")) == ((4e-3, motion, "tool", 0), False)
    for period, cutoff in ((4e-3, 60.0), (0.02, 25.0)):  # at most half of the periods in a second
        assert driven(monkeypatch, on_touch="stop", period=period)[1].felt == pytest.approx(cutoff)
    assert driven(monkeypatch, amplitude=3.2)[2][1] == 3.2


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"amplitude": 3.21}, "--amplitude: expected at most 3.2 rad"),
        ({"amplitude": 0.0}, "--amplitude: expected a positive amplitude"),
        ({"duration": 0.0}, "--duration: expected a positive time"),
        (
            {"limits": hardware.HardwareLimits([1.0], [1.0], [-1.0], [1.0])},
            "two_link has 2 joints, but the robot at there 1",
        ),
        ({"read": lambda: None}, "no measurement came from there"),
        ({"read": lambda: hardware.RobotReading(0.0, np.array([0.1, 99.0]), np.zeros(2))}, "stands at 99, outside"),
    ],
)
def test_what_cannot_be_driven_is_refused_before_it_is_tuned_for(
    changed: dict[str, Any], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=told):
        driven(monkeypatch, **changed)


def test_a_drive_that_was_interrupted_while_it_was_prepared_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyboardInterrupt):
        driven(monkeypatch, asked=True)


def test_an_experiment_writes_and_prints_no_more_than_is_asked_for() -> None:
    chosen = inspect.signature(experiment.__getattr__("adaptive")).parameters
    assert [chosen[name].default for name in ("overwrite", "figures", "json", "live")] == [False] * 4
    assert (chosen["config"].default, chosen["out"].default) == (None, Path("results/adaptive"))


@pytest.mark.parametrize("complete", [False, True])
@pytest.mark.parametrize("figures", [False, True])
def test_an_interrupted_experiment_is_told_and_its_figures_are_drawn_if_asked(
    complete: bool, figures: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = list[Path]()
    result = SimpleNamespace(
        complete=complete, write=lambda folder, progress: written.append(folder), figures=written.append
    )
    run: Any = SimpleNamespace(run=lambda progress: result)
    interruption: Any = SimpleNamespace(heeded=lambda progress: progress, hold=lambda: None)
    assert experiment._computed(run, tmp_path, interruption, figures) is result
    assert written == [tmp_path, *([tmp_path / "figures"] * figures)]
    assert ("interrupted" in capsys.readouterr().err) == (not complete)


def test_a_comparison_of_estimators_is_of_the_first_log_in_a_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = (Path("a.csv"), Path("b.csv")), "robot", Path("d.toml"), 0.5
    found: Any = SimpleNamespace(write=lambda folder: (folder / "report.html").touch())
    monkeypatch.setattr(estimator_comparison, "compared_estimators", told := MagicMock(return_value=found))
    assert identify._compared(*given, tmp_path / "inner" / "own") is found  # type: ignore[arg-type]
    told.assert_called_once_with(Path("a.csv"), *given[1:])
    assert (tmp_path / "inner" / "own" / "report.html").exists()


def test_files_of_an_identification_tell_what_they_cannot_hold_and_open_no_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(identify, "environ", environment := dict[str, str]())

    def written(*given: Any) -> list[Any]:
        assert environment == {"MUJOCO_GL": "disable"}
        return [SimpleNamespace(note=lambda found, note=note: note) for note in (None, "no springs")]

    monkeypatch.setattr(files, "write_identification", written)
    assert identify._write(Path("out"), *[None] * 4) == ["no springs"]


@pytest.mark.parametrize(
    ("logs", "drives", "fits"), [(1, "d", True), (1, None, False), (2, "d", False), (0, "d", False)]
)
def test_estimators_are_compared_on_one_log_with_its_drives(logs: int, drives: str | None, fits: bool) -> None:
    given = tuple(Path(f"{k}.csv") for k in range(logs)), None if drives is None else Path(drives)
    if fits:
        identify._validate_comparison(*given, 0.5)
        with pytest.raises(InputError, match="got 0"):
            identify._validate_comparison(*given, 0.0)
    else:
        with pytest.raises(InputError, match=r"^--energy-differences needs exactly one log"):
            identify._validate_comparison(*given, 0.5)


def test_a_column_that_is_whole_is_never_folded_and_the_next_one_loses_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    output.print_parts([output.listed([("a" * 20, "b" * 50)], whole=True)])
    told = capsys.readouterr().out
    assert ("a" * 20 in told, told.count("b")) == (True, 50)


@pytest.mark.parametrize(
    ("text", "fits"),
    [("1e-30", True), ("-1e30", True), ("0", True), ("inf", True), ("9.9e-31", False), ("-1.1e30", False)],
)
def test_numbers_are_of_sizes_to_be_reckoned_with(text: str, fits: bool) -> None:
    argument: Any = SimpleNamespace(name="--rate")
    token: Any = SimpleNamespace(value=text, source="x.toml")
    app: Any = None
    if fits:
        numbers._validate_number(app, argument, token)
    else:
        with pytest.raises(InputError, match=r"^x.toml: --rate: expected 0 or a number of a size from 1e-30 to 1e\+30"):
            numbers._validate_number(app, argument, token)


def test_a_comma_is_a_point_of_one_number_and_parts_several() -> None:
    assert numbers._instead("1,5", "s", (float, type(None))).endswith("; write 1.5, with a point")
    for kinds in ((float, float), (float, ...)):
        assert numbers._instead("1,5", "s", kinds).endswith("; numbers are separated by blanks: 1 5")


class Blocks(ctypes.Structure):
    """What glibc tells of its memory; the fourth number is that of blocks which are the system's."""

    _fields_ = [(f"part{k}", ctypes.c_size_t) for k in range(10)]


def test_large_blocks_are_given_back_and_those_below_four_megabytes_kept() -> None:
    """By default glibc keeps blocks up to the largest that was freed before."""
    library = ctypes.CDLL(None)
    library.mallinfo2.restype, library.malloc.restype = Blocks, ctypes.c_void_p
    library.free.argtypes = [ctypes.c_void_p]
    return_large_blocks()
    library.malloc_trim(0)
    filling = [library.malloc(2**24) for _ in range(64)]  # of what other tests left free within the heap
    for size, given in ((2**22 - 64, 0), (2**24, 1), (2**24, 1)):
        before = library.mallinfo2().part3
        block = library.malloc(size)
        assert library.mallinfo2().part3 - before == given
        library.free(block)
        assert library.mallinfo2().part3 == before
    for block in filling:
        library.free(block)
