"""Sweeps of settings that are true or false, or texts with blanks: kept, read back, and run again."""

from __future__ import annotations

import shlex
from contextlib import nullcontext
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from nightly import nightly

from adaptctl.cli.main import main
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.sweeps.cluster import sweep
from adaptctl.sweeps.folder import Folder, table
from adaptctl.sweeps.report import SweepReport
from adaptctl.sweeps.rows import rows_of, validate_controllers
from adaptctl.sweeps.search import BestSettings, write_settings
from adaptctl.sweeps.study import SweepStudy, as_span, parsed

FIELDS = {entry.name: entry for entry in fields(AdaptiveTracking)}
SHORT = {"robot": "two_link", "duration": "0.02"}


def study(**settings: str) -> SweepStudy:
    return SweepStudy.named("adaptive", SHORT | settings, controllers=("adaptive",))


def rows(made: SweepStudy) -> list[dict[str, Any]]:
    return list(rows_of(made.experiment, list(made.runs()), made.controllers))


def test_true_and_false_are_values() -> None:
    assert parsed(FIELDS["as_written"], "true, false") == (True, False)
    assert parsed(FIELDS["as_written"], ["False", "True"]) == (False, True)
    assert as_span(FIELDS["as_written"], (False, True)) is None


@pytest.mark.parametrize("text", ["1", "0..1", "yes", "", "true,true", "nan"])
def test_what_is_neither_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^as_written: expected (true or false|one or more different values)"):
        parsed(FIELDS["as_written"], text)


@nightly
def test_a_sweep_of_any_arm_is_kept_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sweep", "adaptive", "--out", str(tmp_path / "out"), "--jobs", "1", "--seed", "0,1"]
    for _ in range(2):
        assert main([*words, *(word for name, value in SHORT.items() for word in (f"--{name}", value))]) == 0
    assert "of 2 runs" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.html").exists()


def test_draws_pick_true_or_false() -> None:
    made = SweepStudy.named("adaptive", SHORT | {"as_written": "false,true"}, sampling="sobol", samples=8)
    assert {run["as_written"] for run in made.runs()} == {False, True}
    assert all(isinstance(run["as_written"], bool) for run in made.runs())
    entry = next(entry for entry in fields(made.kind) if entry.name == "as_written")
    assert [made._drawn(entry, share) for share in (0.0, 0.49, 0.51, 1.0)] == [False, False, True, True]


def test_a_sweep_tells_the_share_of_shards_that_are_kept_and_lets_each_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares: list[float] = []
    released: list[str] = []

    class Client:
        def submit(self, run: Any, *given: Any, key: str, **how: Any) -> Any:
            return SimpleNamespace(key=key, result=lambda: run(*given), release=lambda: released.append(key))

    monkeypatch.setattr("distributed.as_completed", iter)
    own: Any = SimpleNamespace(client=lambda: nullcontext(Client()))
    folder = Folder.opened(tmp_path, study(seed="0,1"), 1, [])
    first, again = (sweep(folder, own, shares.append) for _ in range(2))
    assert shares == [0.0, 0.5, 1.0, 1.0]
    assert len(set(released)) == 2
    assert first.equals(again)


def test_a_range_has_so_many_values_at_most() -> None:
    with pytest.raises(InputError, match="from 2 to 1000000 values"):
        study(bandwidth="4..6:1000001")


def test_a_range_has_two_ends() -> None:
    for ends in ("4..4", "4..3"):
        with pytest.raises(InputError, match="ascending range"):
            SweepStudy.named("adaptive", {"bandwidth": ends})


def test_best_settings_are_read_back_whatever_they_are(tmp_path: Path) -> None:
    best = BestSettings({"as_written": True, "robot": "my arm.urdf", "seed": 3}, "adaptive", 0.1, 5)
    write_settings(tmp_path / "best.toml", study(), best)
    again = SweepStudy.named(str(tmp_path / "best.toml"), {})
    assert again.settings == {"as_written": (True,), "robot": ("my arm.urdf",), "seed": (3,)}


def test_a_run_is_shown_again_with_all_its_settings(tmp_path: Path) -> None:
    made = study(as_written="true")
    row = rows(made)[0] | {"robot": "my arm.urdf"}
    words = shlex.split(SweepReport(made, table(made, [row], 1)).replay(row))  # type: ignore[arg-type]
    assert "--as-written" in words
    assert "True" not in words
    assert words[words.index("--robot") + 1] == "my arm.urdf"
    words[words.index("my arm.urdf")] = "two_link"
    assert main([*words[1:-1], str(tmp_path / "replay")]) in (0, 1)


def test_runs_that_all_fail_do_not_tell_of_a_setting() -> None:
    made = SweepStudy.named("adaptive", SHORT | {"bandwidth": "4,8"}, controllers=("nosuch",))
    failed = rows(made)
    assert {row["status"] for row in failed} == {"failed"}
    text = SweepReport(made, table(made, failed, made.count)).text()  # type: ignore[arg-type]
    assert "unknown controller 'nosuch'" in text
    assert "has no effect on the results" not in text


def test_a_controller_that_no_run_has_is_refused_before_any_runs() -> None:
    refused = r"^controllers: unknown controller 'nosuch'; controllers: learning, adaptive, "
    made = SweepStudy.named("adaptive", SHORT | {"seed": "0,1"}, controllers=("adaptive", "nosuch"))
    with pytest.raises(NotFoundError, match=refused):
        validate_controllers(made.experiment, made.runs(), made.controllers)
    both = SweepStudy.named("adaptive", SHORT | {"plant": "adaptctl,both"})
    first, last = both.runs()
    for runs in ([first, first, last], [last, first, first]):  # which the last run has, or the first
        validate_controllers(both.experiment, iter(runs), ("adaptive", "mujoco-fine"))
    wrong = [{"robot": "nosuch"}]  # is told of in its row
    validate_controllers(both.experiment, iter(wrong), ("nosuch",))


def test_a_number_of_draws_is_for_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "adaptive", "--out", str(tmp_path / "out"), "--seed", "0,1", "--samples", "3"]) == 2
    assert "--samples is not for a grid: give --sampling latin-hypercube or sobol" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("values", "whole"), [((4, 5), True), ((4, 5, 6), True), ((4,), False), ((4, 6), False)])
def test_whole_numbers_in_a_row_are_drawn_from_a_range(values: tuple[int, ...], whole: bool) -> None:
    entry = next(entry for entry in fields(AdaptiveTracking) if entry.name == "seed")
    span = as_span(entry, values)
    assert (span is not None) is whole
    assert span is None or (span.low, span.high, span.whole) == (values[0], values[-1], True)
