"""Sweeps: what is varied, that rows are what each run by itself gives, and that nothing is lost or done twice."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import nightly

from adaptctl.cli.main import main
from adaptctl.cli.sweep import _validate_none_failed
from adaptctl.errors import FileError, InputError, NotFoundError, VerdictError
from adaptctl.experiments import find
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.simulation import Episode
from adaptctl.sweeps.cluster import Cluster, sweep
from adaptctl.sweeps.folder import Folder, read_table
from adaptctl.sweeps.report import SweepReport
from adaptctl.sweeps.rows import TIMES, alone, named, offline, robot, rows_of, started
from adaptctl.sweeps.search import search
from adaptctl.sweeps.study import Span, SweepStudy, parsed, shipped

FIELDS = {entry.name: entry for entry in dataclasses.fields(Puma560Adaptive)}
SHORT = {"duration": "0.05"}


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=ResourceWarning)
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        yield


def study(controllers: tuple[str, ...] = ("adaptive",), **settings: str) -> SweepStudy:
    return SweepStudy.named("puma560-adaptive", {**SHORT, **settings}, controllers=controllers)


def values(table: pa.Table) -> list[dict[str, Any]]:
    return table.drop_columns(list(TIMES)).to_pylist()


class TestValues:
    def test_lists_and_ranges(self) -> None:
        assert parsed(FIELDS["bandwidth"], "4,8,12") == (4.0, 8.0, 12.0)
        assert parsed(FIELDS["seed"], "0..3") == (0, 1, 2, 3)
        assert parsed(FIELDS["payload"], "0..5:3") == (0.0, 2.5, 5.0)
        assert parsed(FIELDS["payload"], "0..5") == Span(0.0, 5.0, whole=False)
        assert parsed(FIELDS["damping"], "1 2 3, 4 5 6") == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        assert parsed(FIELDS["initial_error"], "-0.1..0.1:3") == (-0.1, 0.0, 0.1)

    @pytest.mark.parametrize(
        ("name", "text"),
        [
            ("bandwidth", "4,,8"), ("bandwidth", "fast"), ("bandwidth", "nan"), ("bandwidth", "8..4:3"),
            ("seed", "1.5"), ("seed", "0..5:4"), ("payload", "0..5:1"), ("payload", "0..5:x"), ("bandwidth", "4,4"),
            ("seed", "0..9:"),
        ],
    )  # fmt: skip
    def test_nonsense_is_refused_by_the_setting_s_name(self, name: str, text: str) -> None:
        with pytest.raises(InputError, match=f"^{name}: expected|^{name}: "):
            parsed(FIELDS[name], text)

    @given(st.integers(0, 1000), st.integers(2, 50))
    def test_a_range_has_both_ends(self, low: int, count: int) -> None:
        assert parsed(FIELDS["seed"], f"{low}..{low + count - 1}") == tuple(range(low, low + count))


class TestStudies:
    def test_a_grid_has_every_combination_once(self) -> None:
        grid = study(bandwidth="4,8", seed="0..2")
        runs = list(grid.runs())
        assert grid.count == len(runs) == 6
        assert len({(run["bandwidth"], run["seed"]) for run in runs}) == 6
        assert grid.swept == ("bandwidth", "seed")

    @pytest.mark.parametrize("sampling", ["latin-hypercube", "sobol"])
    def test_samples_fill_the_ranges_the_same_each_time(self, sampling: str) -> None:
        settings = {**SHORT, "bandwidth": "4..12", "seed": "0..3", "robot": "a,b"}
        drawn = SweepStudy.named("puma560-adaptive", settings, sampling=sampling, samples=64)
        runs = list(drawn.runs())
        assert runs == list(drawn.runs())
        assert len(runs) == 64
        eighths = np.histogram([run["bandwidth"] for run in runs], bins=8, range=(4.0, 12.0))[0]
        np.testing.assert_array_equal(eighths, 8)
        assert {run["seed"] for run in runs} == {0, 1, 2, 3}
        assert {run["robot"] for run in runs} == {"a", "b"}

    def test_shipped_ones_can_be_run(self) -> None:
        assert {"payload-robustness", "excitation-versus-convergence"} <= set(shipped())
        for name in shipped():
            made = SweepStudy.named(name, {})
            assert made.question
            made.kind(**next(iter(made.runs())))

    def test_a_file_s_settings_give_way_to_those_typed(self, tmp_path: Path) -> None:
        path = tmp_path / "mine.toml"
        path.write_text(
            'schema = "adaptctl/study/2"\nexperiment = "puma560-adaptive"\n[settings]\nseed = "0..9"\ngain_scale = 1\n'
        )
        made = SweepStudy.named(str(path), {"seed": "3"})
        assert made.settings == {"seed": (3,), "gain_scale": (1.0,)}

    def test_what_does_not_exist_is_told(self, tmp_path: Path) -> None:
        with pytest.raises(NotFoundError, match="did you mean 'bandwidth'"):
            study(bandwith="4")
        with pytest.raises(NotFoundError, match="did you mean 'puma560-adaptive'"):
            SweepStudy.named("puma560-adaptiv", {})
        with pytest.raises(InputError, match=r"payload: a range needs a count .* --sampling"):
            study(payload="0..5")
        path = tmp_path / "bad.toml"
        path.write_text('schema = "adaptctl/study/2"\nexperiment = "puma560-adaptive"\nsettngs = 1\n')
        with pytest.raises(FileError, match=r"bad\.toml.*settngs"):
            SweepStudy.named(str(path), {})
        path.write_text('schema = "adaptctl/study/2"\nexperiment = "puma560-adaptive"\n[settings]\nsped = 1\n')
        with pytest.raises(FileError, match=r"bad\.toml.*'sped'"):
            SweepStudy.named(str(path), {})


class TestRows:
    @nightly
    @pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
    def test_a_batch_s_rows_are_those_of_each_run_alone(self) -> None:
        names = ("adaptive", "adaptation-off", "computed-torque")
        runs = list(study(names, bandwidth="4,8", payload="0,2", initial_error="0.1,-0.2").runs())
        together = rows_of("puma560-adaptive", runs, names)
        assert [row["controller"] for row in together] == [*names] * 8
        for k in (0, 3, 6):
            by_itself = alone(Puma560Adaptive(**runs[k]), names)
            for row, (controller, expected) in zip(together[3 * k : 3 * k + 3], by_itself, strict=True):
                assert row["controller"] == controller
                assert row["status"] == expected.status == "done"
                assert row["final_rms_error"] is None
                assert expected.final_rms_error is None
                for name in ("rms_error", "largest_error"):
                    assert row[name] == pytest.approx(getattr(expected, name), rel=1e-7)
                if expected.lyapunov_rise is not None:
                    assert row["lyapunov_rise"] == pytest.approx(expected.lyapunov_rise, abs=1e-9)

    @pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
    def test_a_run_that_leaves_its_bound_is_a_row_with_the_reason(self) -> None:
        runs = [{**next(iter(study().runs())), "duration": 0.6, "payload": p} for p in (0.0, 300.0)]
        good, bad = rows_of("puma560-adaptive", runs, ("adaptive",))
        ((_, by_itself),) = alone(Puma560Adaptive(**runs[1]), ("adaptive",))
        assert good["status"] == "done"
        assert bad["status"] == by_itself.status == "diverged"
        assert bad["reason"].startswith(f"joint {bad['diverged_joint']} exceeded its error limit at ")
        assert bad["diverged_joint"] == by_itself.diverged_joint
        assert bad["diverged_at"] == pytest.approx(by_itself.diverged_at, abs=2e-3)
        assert bad["rms_error"] == pytest.approx(by_itself.rms_error, rel=0.05)

    def test_controllers_that_are_not_asked_for_are_not_made(self) -> None:
        experiment = Puma560Adaptive(damping=(9e3,) * 6)  # which no control period of 1 ms carries
        mechanism = robot("puma560")
        contenders = experiment.contenders(mechanism, offline(mechanism))
        (asked,) = named(contenders, ("computed-torque",))
        assert asked.controller is asked.controller
        assert [one.name for one in contenders if "controller" in vars(one)] == ["computed-torque"]
        run = {"duration": 0.05, "damping": experiment.damping}
        good, bad = (rows_of("puma560-adaptive", [run], (name,))[0] for name in ("computed-torque", "adaptive"))
        assert (good["status"], bad["status"]) == ("done", "failed")
        usual = rows_of("puma560-adaptive", [{"duration": 0.05}], ("computed-torque",))[0]
        assert good["rms_error"] == usual["rms_error"]

    def test_runs_of_one_task_begin_in_one_environment_as_they_do_in_their_own(self) -> None:
        mechanism, known = robot("puma560"), dict[Any, tuple[Episode, Any]]()
        first = Puma560Adaptive(bandwidth=4.0, payload=2.0)
        chosen = [first, Puma560Adaptive(gain_scale=0.3), Puma560Adaptive(initial_error=-0.2, payload=1.0, seed=7)]
        of = [started(one, mechanism, known) for one in chosen]
        assert of[0][1] is of[1][1] is not of[2][1]
        for one, (shared, _) in zip(chosen, of, strict=True):
            env: Any = one.environment(mechanism)
            own = env.unwrapped.episode(seed=one.seed, options=one.options)
            np.testing.assert_array_equal(shared.parameters, own.parameters)
            np.testing.assert_array_equal(shared.state.p, own.state.p)
            np.testing.assert_array_equal(shared.state.v, own.state.v)
            assert shared.steps == own.steps

    def test_payloads_of_runs_that_share_an_environment_stay_their_own(self) -> None:
        runs = list(study(payload="0,1,2").runs())
        together = [row["rms_error"] for row in rows_of("puma560-adaptive", runs, ("adaptive",))]
        alone_each = [rows_of("puma560-adaptive", [run], ("adaptive",))[0]["rms_error"] for run in runs]
        assert together == pytest.approx(alone_each, rel=1e-12)
        assert len(set(together)) == 3

    def test_a_run_that_cannot_be_is_a_row_with_the_reason(self) -> None:
        runs = list(study(bandwidth="8,1000").runs())
        good, bad = rows_of("puma560-adaptive", runs, ("adaptive",))
        assert good["status"] == "done"
        assert bad["status"] == "failed"
        assert "bandwidth: expected" in bad["reason"]
        assert bad["rms_error"] is None

    def test_gains_that_a_period_cannot_carry_are_a_failed_row(self) -> None:
        runs = list(study(damping="90 150 70 20 16 18, 9e3 9e3 9e3 9e3 9e3 9e3").runs())
        good, bad = rows_of("puma560-adaptive", runs, ("adaptive",))
        assert (good["status"], bad["status"]) == ("done", "failed")
        assert "too stiff" in bad["reason"]


class TestFolders:
    @nightly
    def test_one_worker_and_two_give_the_same_table_and_nothing_is_computed_twice(self, tmp_path: Path) -> None:
        chosen = study(bandwidth="4,6", seed="0..1")
        tables = []
        for jobs in (1, 2):
            folder = Folder.opened(tmp_path / str(jobs), chosen, 2, ["sweep"])
            tables.append(sweep(folder, Cluster(jobs=jobs)))
        assert values(tables[0]) == values(tables[1])
        assert tables[0].schema.field("rms_error").metadata[b"meaning"].startswith(b"root mean square")
        folder = Folder.opened(tmp_path / "1", chosen, 999, ["sweep"])
        before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "1" / "shards").iterdir()}
        lost = sorted(before)[0]
        (tmp_path / "1" / "shards" / lost).write_bytes(b"PAR1 torn")
        again = sweep(folder, Cluster(jobs=1))
        assert values(again) == values(tables[0])
        after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "1" / "shards").iterdir()}
        assert {name for name in before if before[name] != after[name]} == {lost}

    def test_the_folder_of_something_else_is_refused(self, tmp_path: Path) -> None:
        Folder.opened(tmp_path / "a", study(seed="0..3"), 2, [])
        with pytest.raises(InputError, match="another sweep"):
            Folder.opened(tmp_path / "a", study(seed="0..4"), 2, [])
        (tmp_path / "b").mkdir()
        (tmp_path / "b" / "thesis.tex").write_text("")
        with pytest.raises(InputError, match=r"is not empty and has no sweep"):
            Folder.opened(tmp_path / "b", study(seed="0..3"), 2, [])

    def test_a_table_needs_every_shard(self, tmp_path: Path) -> None:
        folder = Folder.opened(tmp_path, study(seed="0..3"), 2, [])
        with pytest.raises(FileError, match="run the command again"):
            folder.finished()
        with pytest.raises(FileError, match="no finished runs"):
            read_table(tmp_path)


class TestReports:
    def test_a_failed_run_fails_the_command_that_asks(self, tmp_path: Path) -> None:
        """Of three runs one diverges and one cannot be set up."""
        chosen = study(("adaptive",), seed="0..2")
        folder = Folder.opened(tmp_path, chosen, 8, [])
        (shard,) = folder.shards()
        rows = rows_of(chosen.experiment, shard.runs, chosen.controllers)
        folder.keep(shard, rows)
        folder.finished()
        _validate_none_failed(tmp_path)
        status = ("diverged", "failed", "done")
        wrong = [row | {"status": one} for row, one in zip(rows, status, strict=True)]
        folder.keep(shard, wrong)
        folder.finished()
        with pytest.raises(VerdictError, match="of 3 rows, 1 diverged and 1 failed"):
            _validate_none_failed(tmp_path)

    def test_a_setting_that_changes_nothing_is_named(self, tmp_path: Path) -> None:
        chosen = study(("adaptive",), bandwidth="4,8", seed="0..1")
        folder = Folder.opened(tmp_path, chosen, 8, [])
        for shard in folder.shards():
            folder.keep(shard, rows_of(chosen.experiment, shard.runs, chosen.controllers))
        folder.finished()
        report = SweepReport.of(tmp_path)
        assert report.without_effect() == {"seed": ["adaptive"]}
        assert "seed has no effect on the results" in report.text()
        (found,) = report.maps("adaptive")
        assert (found.x, found.y, found.across, found.down) == ("bandwidth", "seed", [4.0, 8.0], [0, 1])
        errors = [row["rms_error"] for row in report.rows]
        np.testing.assert_allclose(found.error, np.reshape(errors, (2, 2)).T)
        np.testing.assert_array_equal(found.stable, 1.0)
        worst = report.worst("adaptive")[0]
        assert worst["rms_error"] == max(errors)
        assert report.replay(worst).startswith("adaptctl experiment run puma560-adaptive ")
        assert f"--bandwidth {worst['bandwidth']}" in report.replay(worst)


def test_a_search_finds_what_a_grid_has_as_best() -> None:
    chosen = SweepStudy.named("puma560-adaptive", {**SHORT, "initial_error": "-0.2..0.2"}, controllers=("adaptive",),
                         sampling="sobol", samples=16)  # fmt: skip
    told: list[float] = []
    found = search(chosen, "rms_error", 24, told.append)
    assert told == [pytest.approx(16 / 24), 1.0]
    assert found.trials == 24
    assert abs(found.settings["initial_error"]) < 0.05
    with pytest.raises(InputError, match="minimise: expected one of rms_error"):
        search(chosen, "rms_eror", 4)


def test_a_folder_that_could_not_be_begun_is_begun_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: Any) -> None:
        raise FileError(f"{path}: cannot be written (no space left on device)")

    with monkeypatch.context() as disk:
        disk.setattr("adaptctl.sweeps.folder.write_json", full)
        with pytest.raises(FileError):
            Folder.opened(tmp_path / "out", study(seed="0"), 1, [])
    (tmp_path / "out" / ".study.json-1-1").touch()  # what a process that is killed leaves
    assert len(list(Folder.opened(tmp_path / "out", study(seed="0"), 1, []).shards())) == 1


def test_a_folder_where_a_file_is_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").touch()
    for out in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(FileError, match=rf"{out}: the folder cannot be made \((file exists|not a directory)\)"):
            Folder.opened(out, study(seed="0"), 1, [])
    for more in ([], ["--search", "1", "--objective", "rms_error"]):
        assert main(["sweep", *TestCommand.ARGUMENTS, "--seed", "0", "--out", str(tmp_path / "out"), *more]) != 0
        assert "out: the folder cannot be made (file exists)" in capsys.readouterr().err
    started = Folder.opened(tmp_path / "other", study(seed="0"), 1, [])
    (started.path / "shards").touch()
    with pytest.raises(FileError, match=r"shards: the folder cannot be made \(file exists\)"):
        started.keep(next(started.shards()), [])


class TestCommand:
    ARGUMENTS = ("puma560-adaptive", "--duration", "0.05", "--controllers", "adaptive")

    def test_a_sweep_its_status_and_its_report(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        out = str(tmp_path / "out")
        given = [
            "sweep",
            *self.ARGUMENTS,
            "--bandwidth",
            "4,8,1000",
            "--jobs",
            "1",
            "--out",
            out,
        ]
        assert main(given) == 0
        told = capsys.readouterr().out
        assert "adaptive: 2 done" in told
        assert "bandwidth: expected" in told
        table = pq.read_table(tmp_path / "out" / "sweep.parquet")
        assert table.column("bandwidth").to_pylist() == [4.0, 8.0, 1000.0]
        assert table.column("status").to_pylist() == ["done", "done", "failed"]
        assert main(["sweep", "status", out]) == 0
        assert "1 of 1 shards" in capsys.readouterr().out
        (tmp_path / "out" / "report.html").unlink()
        assert main(["sweep", "report", out]) == 0
        assert "adaptctl experiment run puma560-adaptive" in (tmp_path / "out" / "report.html").read_text()

    @pytest.mark.parametrize(
        ("more", "told"),
        [
            (["--bandwith", "4"], "did you mean 'bandwidth'"),
            (["--seed", "0..99999"], "100000 runs need a confirmation: add --yes"),
            (["--scheduler", "tcp://127.0.0.1:9"], "scheduler tcp://127.0.0.1:9: cannot be reached"),
            (["--scheduler", "nonsense"], "scheduler nonsense: cannot be reached"),
            (["--scheduler-file", "none.json"], "none.json: no such file"),
            (["--jobs", "0"], "--jobs: expected 1"),
            (["--jobs", "1", "--scheduler", "tcp://x:1"], "expected one of --jobs"),
            (["--tls-ca", "ca.pem"], "TLS needs --tls-ca"),
            (["--shard-size", "0"], "shard-size: expected"),
        ],
    )
    def test_bad_input_is_one_line(
        self, more: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        monkeypatch.setattr("adaptctl.sweeps.cluster.CONNECTION_TIMEOUT", 1.0)
        assert main(["sweep", *self.ARGUMENTS, *more, "--out", str(tmp_path / "out")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line


@nightly
def test_a_user_s_own_cluster_is_used(tmp_path: Path) -> None:
    import distributed

    chosen = study(seed="0..3")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as own:
        file = tmp_path / "scheduler.json"
        with distributed.Client(own) as client:
            client.write_scheduler_file(str(file))
        there = [Cluster(scheduler=own.scheduler_address), Cluster(scheduler_file=file)]
        tables = [sweep(Folder.opened(tmp_path / str(k), chosen, 2, []), x) for k, x in enumerate(there)]
    here = rows_of(chosen.experiment, list(chosen.runs()), chosen.controllers)
    assert values(tables[0]) == values(tables[1])
    assert [row["rms_error"] for row in values(tables[0])] == pytest.approx([row["rms_error"] for row in here])


def test_every_experiment_can_be_swept_by_name() -> None:
    assert SweepStudy.named("laws", {"payload": "1,2"}).kind is find("laws")
