"""Reports of sweeps by numbers worked out by hand, and which runs shards and searches ask for."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from matplotlib import rc_context
from scipy.stats import qmc

from adaptctl.errors import FileError, InputError
from adaptctl.recording.drawing import STYLE
from adaptctl.sweeps import rows as rows_module
from adaptctl.sweeps.folder import Folder, Saved, read_table, write_checked
from adaptctl.sweeps.report import SweepReport, map_figure
from adaptctl.sweeps.rows import RunOutcome, alone, rows_of
from adaptctl.sweeps.search import search
from adaptctl.sweeps.study import Span, SweepStudy
from adaptctl.version import __version__

NAME = "puma560-adaptive"


def row(seed: int, load: float, error: float | None, status: str = "done", **more: Any) -> dict[str, Any]:
    known = {"controller": "adaptive", "reason": "", "diverged_at": None, "largest_error": error}
    return (
        {"seed": seed, "payload": load, "status": status, "rms_error": error, "final_rms_error": error} | known | more
    )


def report(rows: list[dict[str, Any]], *swept: str) -> SweepReport:
    saved = Saved(
        "adaptctl/sweep/2", __version__, "0", NAME, "", ["adaptctl"], [*(swept or ("seed", "payload"))], len(rows), 8
    )
    return SweepReport(saved, pa.Table.from_pylist(rows))


def test_a_map_has_mean_errors_and_shares_of_stable_runs() -> None:
    rows = [row(1, 0.0, 1.0), row(1, 0.0, 3.0), row(2, 0.0, 5.0), row(1, 2.0, 7.0), row(1, 2.0, None, "diverged"),
            row(2, 2.0, None, "diverged"), row(2, 2.0, None, "diverged"), row(2, 2.0, 4.0), row(2, 2.0, 8.0),
            row(9, 9.0, None, "failed")]  # fmt: skip
    (found,) = report(rows).maps("adaptive")
    assert (found.x, found.y, found.across, found.down) == ("seed", "payload", [1, 2], [0.0, 2.0])
    np.testing.assert_array_equal(found.error, [[2.0, 5.0], [7.0, 6.0]])
    np.testing.assert_array_equal(found.stable, [[1.0, 1.0], [0.5, 0.5]])
    with rc_context(STYLE):
        figure = map_figure(found)
    for axes, shown, title in zip(
        figure.axes[:2], (found.error, found.stable), ("final error", "fraction"), strict=True
    ):
        (image,) = axes.images
        np.testing.assert_array_equal(np.ma.filled(image.get_array(), np.nan), shown)
        assert axes.get_title("left").startswith(title)
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("seed", "payload")
        assert [tick.get_text() for tick in axes.get_yticklabels()] == ["0", "2"]
        assert not any(line.get_visible() for line in axes.get_xgridlines() + axes.get_ygridlines())
    assert image.get_clim() == (0.0, 1.0)  # so that maps can be compared
    assert len(figure.axes) == 4  # with a bar of colours each


def test_one_run_makes_a_map_of_one_place() -> None:
    (found,) = report([row(1, 0.5, 2.0)]).maps("adaptive")
    assert (found.across, found.down, found.error.tolist(), found.stable.tolist()) == ([1], [0.5], [[2.0]], [[1.0]])


@pytest.mark.parametrize(("count", "bins"), [(16, 16), (17, 8), (33, 8)])
def test_more_than_sixteen_values_are_put_together_in_eighths(count: int, bins: int) -> None:
    (found,) = report([row(k, 0.0, float(k)) for k in range(count)]).maps("adaptive")
    assert len(found.across) == bins
    if bins == 8:
        width = (count - 1) / 8.0
        assert found.across == pytest.approx([width * k for k in range(8)])
        members = [[k for k in range(count) if min(int(k / width), 7) == place] for place in range(8)]
        assert found.error[0].tolist() == pytest.approx([float(np.mean(each)) for each in members])


def test_words_and_numbers_of_a_report() -> None:
    rows = [row(1, 0.0, 0.001), row(2, 0.0, 0.004), row(3, 0.0, 0.003), row(4, 0.0, 0.5, "diverged"),
            row(5, 0.0, None, "failed", reason="too fast"), row(6, 0.0, None, "failed", reason="too fast")]  # fmt: skip
    made = report(rows)
    assert made.text().splitlines()[:3] == [
        f"{NAME}: 6 rows of 6 runs",
        "  adaptive: 3 done, 1 diverged, 2 failed; median final error 0.003, largest 0.004",
        "  failed: too fast",
    ]
    assert [(one.question, one.answer) if hasattr(one, "question") else tuple(one)[:2] for one in made.facts()] == [
        ("Runs", "6"), ("Rows", "6"), ("Stable", "50.0 %"), ("Diverged", "1"), ("Failed", "2"),
    ]  # fmt: skip
    short = report([row(1, 0.0, 0.002) | {"final_rms_error": None}])
    assert "median final error 0.002" in short.text()
    assert short.facts()[2].answer == "100.0 %"


def test_the_worst_runs_are_those_that_diverged_first_then_those_of_large_errors() -> None:
    rows = [row(k, 0.0, 0.1 * k) for k in range(5)]
    rows += [row(7, 0.0, 9.0, "diverged", diverged_at=2.0), row(8, 0.0, 9.0, "diverged", diverged_at=1.0)]
    rows += [row(9, 0.0, None, "failed"), row(10, 0.0, 0.25) | {"final_rms_error": None}]
    assert [one["seed"] for one in report(rows).worst("adaptive")] == [8, 7, 4, 3, 10]
    at_once = [row(k, 0.0, error, "diverged", diverged_at=1.0) for k, error in ((1, None), (2, 0.5))]
    assert [one["seed"] for one in report(at_once).worst("adaptive")] == [2, 1]


def test_a_setting_without_effect_is_told_for_whom() -> None:
    def both(error: float, other: float, load: float, seed: int) -> list[dict[str, Any]]:
        return [row(seed, load, error), row(seed, load, other) | {"controller": "fixed"}]

    rows = both(1.0, 2.0, 0.0, 1) + both(1.0 + 1e-12, 2.0, 0.0, 2) + both(3.0, 2.0, 1.0, 1)
    made = report(rows)
    assert made.without_effect() == {"seed": ["adaptive", "fixed"], "payload": ["fixed"]}
    assert made.text().splitlines()[-2:] == [
        "  seed has no effect on the results", "  payload has no effect on the results of fixed",
    ]  # fmt: skip
    for change, idle in ((0.9e-9, True), (1.1e-9, False)):  # of 1e-9 and more an effect
        assert bool(report([row(1, 0.0, 1.0), row(2, 0.0, 1.0 + change)]).without_effect()) is idle
    assert report([row(1, 0.0, 1.0), row(2, 1.0, 1.0)]).without_effect() == {}  # both differ
    gone = [row(seed, 0.0, None, "diverged") for seed in (1, 2)]
    assert report(gone).without_effect() == {"seed": ["adaptive"]}


def test_outcomes_are_of_all_joints_and_divergence_of_one() -> None:
    many: Any = SimpleNamespace(
        rms_error=np.sqrt(2.0) * np.array([[3.0, 4.0]] * 2), final_rms_error=np.array([[np.nan] * 2, [0.6, 0.8]]),
        largest_error=np.array([[9.0, 7.0], [6.0, 8.0]]), lyapunov_rise=np.array([0.5, np.nan]),
        diverged_at=np.array([np.nan, 2.5]), diverged_joint=np.array([-1, 0]),
    )  # fmt: skip
    done, gone = RunOutcome.each_of(many)
    assert (done.status, done.final_rms_error, done.largest_error, done.lyapunov_rise) == ("done", None, 9.0, 0.5)
    assert done.rms_error == gone.rms_error == pytest.approx(5.0)
    assert gone.reason == "joint 1 exceeded its error limit at 2.5 s"
    assert (gone.status, gone.final_rms_error, gone.diverged_at, gone.diverged_joint) == ("diverged", None, 2.5, 1)
    assert (gone.largest_error, gone.lyapunov_rise) == (8.0, None)


def test_an_experiment_by_itself_has_the_same_columns() -> None:
    def run(name: str, gone: bool, count: int = 3) -> Any:
        error = np.array([[0.1, -0.2], [0.5, 0.3], [-0.1, 0.4]])[:count]
        return SimpleNamespace(
            name=name, duration=2.0, final_rms_error=0.3, lyapunov_max_increase=0.7, rms_error=lambda: 0.2,
            rollout=SimpleNamespace(error=error, terminated=gone),
        )  # fmt: skip

    runs = [run("a", False), run("b", True), run("c", True, 0)]
    experiment: Any = SimpleNamespace(name="x", compare=lambda progress: SimpleNamespace(runs=runs))
    (_, a), (_, b), (_, c) = alone(experiment, ())
    assert a == RunOutcome("done", "", 0.2, 0.3, 0.5, None, None, 0.7)
    assert b == RunOutcome("diverged", "the environment ended the run", 0.2, None, 0.5, 2.0, 2, 0.7)
    assert (c.largest_error, c.diverged_joint) == (None, None)
    assert [name for name, _ in alone(experiment, ("c", "a"))] == ["a", "c"]
    assert "x compares no controllers" in alone(SimpleNamespace(name="x"), ())[0][1].reason  # type: ignore[arg-type]


def test_the_time_of_a_batch_is_shared_by_its_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([10.0, 16.0, 20.0, 24.0])
    monkeypatch.setattr(rows_module.time, "perf_counter", lambda: next(times))
    monkeypatch.setattr(rows_module, "_outcomes", lambda made, *_: [[("a", RunOutcome("done"))] for _ in made])
    found = rows_of(NAME, [{"seed": 1}, {"seed": 2, "duration": -1.0}, {"seed": 3}])
    assert [one["wall_time"] for one in found] == [2.0, 2.0, 2.0]
    assert [(one["seed"], one["status"], one["controller"]) for one in found] == [
        (1, "done", "a"), (2, "failed", ""), (3, "done", "a"),
    ]  # fmt: skip
    assert {one["version"] for one in found} == {__version__}
    assert rows_of(NAME, [{}])[0]["wall_time"] == 4.0


@pytest.mark.parametrize(
    ("share", "whole", "real"), [(0.0, 2, 2.0), (0.24, 2, 2.72), (0.26, 3, 2.78), (0.999, 5, 4.997), (1.0, 5, 5.0)]
)
def test_a_share_of_a_span_is_a_value_of_it(share: float, whole: int, real: float) -> None:
    assert Span(2, 5, whole=True).at(share) == whole
    assert Span(2.0, 5.0, whole=False).at(share) == pytest.approx(real)


def drawn(seed: int, sampling: Any = "sobol", samples: int = 7) -> SweepStudy:
    given = {"payload": "0..5", "seed": "1,2,5"}
    return SweepStudy.named(NAME, given, sampling=sampling, samples=samples, sampling_seed=seed)


def test_draws_are_those_of_seed_0_unless_another_is_given() -> None:
    made = SweepStudy.named(NAME, {"payload": "0..5"}, sampling="sobol", samples=8)
    expected = 5.0 * qmc.Sobol(1, rng=0).random(8)[:, 0]
    assert [run["payload"] for run in made.runs()] == pytest.approx(expected)
    with pytest.raises(InputError, match="got 0"):
        SweepStudy.named(NAME, {"payload": "0..5"}, sampling="sobol")


def test_hashes_tell_apart_what_gives_other_runs() -> None:
    made = [drawn(1), drawn(2), drawn(1, samples=8), drawn(1, "latin-hypercube")]
    assert len({one.sha256 for one in made}) == 4
    assert drawn(1).sha256 == made[0].sha256
    grids = [SweepStudy.named(NAME, {"seed": "1,2"}, sampling_seed=k, controllers=("a", "b")[::s])
             for k, s in ((1, 1), (2, -1))]  # fmt: skip
    assert grids[0].sha256 == grids[1].sha256  # a grid draws nothing, and has no order of controllers
    assert SweepStudy.named(NAME, {"seed": "1,2"}, precision="single").sha256 != grids[0].sha256
    assert {run["seed"] for run in drawn(1, samples=64).runs()} == {1, 2, 5}


def test_shards_are_all_runs_once_in_order(tmp_path: Path) -> None:
    study = SweepStudy.named(NAME, {"seed": "0..6"}, controllers=("adaptive", "fixed"))
    shards = list(Folder(tmp_path, study, 3).shards())
    assert [[run["seed"] for run in shard.runs] for shard in shards] == [[0, 1, 2], [3, 4, 5], [6]]
    assert len({shard.key for shard in shards}) == 3
    assert all(re.fullmatch(r"[0-9a-f]{32}", shard.key) for shard in shards)
    turned = SweepStudy.named(NAME, {"seed": "0..6"}, controllers=("fixed", "adaptive"))
    other = SweepStudy.named(NAME, {"seed": "0..6"}, controllers=("fixed", "adaptive"), precision="single")
    assert next(Folder(tmp_path, turned, 3).shards()).key == shards[0].key
    assert next(Folder(tmp_path, other, 3).shards()).key != shards[0].key


def test_a_search_keeps_the_best_that_ran(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[Any]] = []

    def ran(experiment: str, runs: list[dict[str, Any]], controllers: tuple[str, ...], precision: str) -> Any:
        asked.append([run["seed"] for run in runs])
        assert (experiment, controllers, precision) == (NAME, ("adaptive",), "double")
        for run in runs:
            assert run["duration"] == 1.0
            error = abs(run["payload"] - 3.0) + (run["seed"] != 5)
            status = "diverged" if run["payload"] < 2.0 else "done"  # and would be best if it counted
            yield {"status": status, "controller": "adaptive", "rms_error": 0.0 if status == "diverged" else error}

    monkeypatch.setattr("adaptctl.sweeps.search.rows_of", lambda *given: list(ran(*given)))
    given = {"payload": "0..5", "seed": "1,2,5", "duration": "1.0"}
    study = SweepStudy.named(NAME, given, sampling="sobol", samples=1, controllers=("adaptive",))
    shares: list[float] = []
    found = search(study, "rms_error", 40, shares.append, seed=3)
    assert [len(batch) for batch in asked] == [16, 16, 8]
    assert shares == [0.4, 0.8, 1.0]
    assert {x for batch in asked for x in batch} == {1, 2, 5}
    assert found.settings["seed"] == 5
    assert 2.0 <= found.settings["payload"] <= 4.0
    assert found.value == pytest.approx(abs(found.settings["payload"] - 3.0))
    assert (found.controller, found.trials) == ("adaptive", 40)
    before = [list(batch) for batch in asked]
    asked.clear()
    search(study, "rms_error", 40, seed=3)
    assert asked == before
    asked.clear()
    for seed in ({}, {"seed": 0}):
        search(study, "rms_error", 16, **seed)
    assert asked[:1] == asked[1:] != before[:1]
    with pytest.raises(InputError, match="minimise: expected one of rms_error"):
        search(study, "status", 1)


@pytest.mark.parametrize("samples", [None, 0, -1, 10_000_001])
def test_draws_need_a_number(samples: int | None) -> None:
    given = {} if samples is None else {"samples": samples}
    with pytest.raises(InputError, match="--samples: expected the number of sobol samples"):
        SweepStudy(NAME, {"payload": Span(0.0, 5.0, whole=False)}, sampling="sobol", **given)


def test_a_sweep_that_goes_on_has_the_rows_of_its_shards_so_far(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no finished runs"):
        read_table(tmp_path)
    (tmp_path / "shards").mkdir()
    for shard in (1, 0):
        own = pa.table({"run": [2 * shard, 2 * shard + 1]}).replace_schema_metadata({"runs": "2"})
        write_checked(tmp_path / "shards" / f"{shard}.parquet", own)
    (tmp_path / "shards" / ".2.parquet").write_bytes(b"half")
    assert read_table(tmp_path)["run"].to_pylist() == [0, 1, 2, 3]
