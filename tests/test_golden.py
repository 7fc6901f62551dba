"""What is kept in tests/golden, where that takes a moment to compare; `make golden` compares all of it."""

from __future__ import annotations

import json
import shlex
import warnings
from collections.abc import Iterator

import pytest
from golden import capture
from golden.kept import kept, validate_same
from rich.console import Console
from test_documented_commands import take

from adaptctl.cli.experiment import run
from adaptctl.cli.main import app
from adaptctl.experiments import EXPERIMENTS

ROBOTS = (
    *(
        "puma560",
        "puma560_measured",
        "puma560_geared",
        "puma560_arm3",
        "semi_direct_drive",
        "two_link",
        "cart.toml",
    ),
    *("mjcf_classes.xml", "mjcf_coupled.xml", "mjcf_geoms.xml", "ur5_robot.urdf", "panda.urdf"),
    *("xarm7.urdf", "double_pendulum.urdf floating"),
)


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("COLUMNS", "NO_COLOR", "TERM"):
        monkeypatch.setenv(name, capture.SAME_EVERYWHERE[name])
    # Else cyclopts takes the console that the first help of a process made, with the width of then.
    monkeypatch.setattr(app, "_console", Console())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def test_public_names_are_those_kept() -> None:
    validate_same(kept("names"), capture.names())


def test_defaults_and_bounds_of_settings_are_those_kept() -> None:
    """Of those that are kept: of new ones `make golden` tells."""
    before, now = kept("settings"), capture.settings()
    validate_same(before, {name: {key: now[name][key] for key in own} for name, own in before.items()})


def test_help_is_the_one_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the experiments of users' own that other tests have named, which are listed from then on."""
    known = {entry.name for entry in EXPERIMENTS}
    for name in [name for name in run._commands if not name.startswith("-") and name not in known]:
        monkeypatch.delitem(run._commands, name)
    before = {name: text for name, text in kept("help").items() if " run " not in name}
    validate_same(before, {name: capture.help_of(*name.split()[1:]) for name in before})


def test_figures_and_recordings_show_what_is_kept() -> None:
    """Places, sizes, colors and styles of all that is drawn, whatever the words say."""
    validate_same(kept("pictures"), capture.pictures())


@pytest.mark.parametrize("name", ROBOTS)
def test_rank_certificate_and_basis_are_those_kept(name: str) -> None:
    source, how = capture.sources()[name]
    validate_same(kept("robots")[name], capture.robot(source, **how))


def test_every_robot_and_every_command_is_kept() -> None:
    assert set(kept("robots")) == set(capture.sources())
    assert set(kept("exports")) >= {f"{arm}: {law}" for arm, laws in capture.arms().items() for law in laws}


def test_what_differs_is_told_and_round_off_is_not() -> None:
    before = {
        "rms": 1.0,
        "rows": ["one", "two"],
        "basis": {"a": "1 x 0.5 y"},
        "proof": {"gap": 12.0},
        "gone": 1,
        "none": None,
    }
    now = {
        "rms": 1.0 + 1e-7,
        "rows": ["one", "three"],
        "basis": {"a": "1 x 0.50000000001 y"},
        "proof": {"gap": 13.5},
        "none": 0.0,
    }
    assert list(capture.compared(before, before)) == []
    assert list(capture.compared(before, now)) == [
        "rows: -two", "rows: +three", "gone: 1 -> nothing", "none: null -> 0.0"
    ]  # fmt: skip
    assert list(capture.compared({"rms": 1.0}, {"rms": 1.00001})) == ["rms: 1.0 -> 1.00001"]
    assert list(capture.compared({"a": "1 x 0.5 y"}, {"a": "1 x 0.6 y"})) == ["a: 1 x 0.5 y -> 1 x 0.6 y"]
    assert list(capture.compared({"a": {"gap": 12.0}}, {"a": {"gap": 8.0}})) == ["a.gap: 12.0 -> 8.0"]
    assert list(capture.compared({"law.c": "9a4df059"}, {"law.c": "bef192cd"})) == ["law.c: 9a4df059 -> bef192cd"]
    assert list(capture.compared({"passed": True}, {"passed": 1.0})) == ["passed: true -> 1.0"]


def test_kept_experiments_are_run_by_commands_that_are_accepted() -> None:
    """`make golden` runs them; with a flag of a former name it compares nothing."""
    for path in sorted((capture.HERE / "experiments").glob("*.json")):
        take(shlex.split(json.loads(path.read_text())["command"])[1:])
