"""Long runs: what is kept is what would have been, in memory that does not grow with the run, and on disk."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from figures import require
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import nightly
from sampled_loops import arm, gains, reduced, swinging

from adaptctl.control import SafetyFilter, SlotineLi
from adaptctl.envs import TrackingEnv
from adaptctl.errors import AdaptctlError, FileError, InputError
from adaptctl.simulation import Rollout, rollout, simulate
from adaptctl.simulation.effects import Encoder, PayloadHeld
from adaptctl.simulation.rollout import KeptSamples
from adaptctl.simulation.rollout_file import RolloutFile

ARM = "puma560_arm3"


@lru_cache
def environment(duration: float = 2.5) -> TrackingEnv:
    effects = (Encoder(1e-4, 2e-5), PayloadHeld(1.5, 0.2, 0.6005))
    return TrackingEnv(
        arm(ARM), swinging(arm(ARM)), duration=duration, initial_error=0.05, effects=effects, error_bound=np.inf
    )


@lru_cache
def law() -> SafetyFilter:
    return SafetyFilter(SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, np.full(15, 0.01)), 60.0)


@lru_cache
def whole() -> Rollout:
    return simulate(environment(), law(), seed=3)


def validate_samples(run: Rollout, chosen: Any, of: Rollout, tolerance: float = 0.0) -> None:
    """Every array of a run is that of another at the samples chosen."""
    for field in fields(Rollout):
        got, wanted = getattr(run, field.name), getattr(of, field.name)
        if isinstance(wanted, np.ndarray):
            assert not got.flags.writeable
            scale = np.abs(wanted).max(initial=1e-300)
            np.testing.assert_allclose(got, wanted[chosen], rtol=0.0, atol=tolerance * scale, err_msg=field.name)
    assert list(run.flags) == list(of.flags)
    for name in run.flags:
        np.testing.assert_array_equal(run.flags[name], of.flags[name][chosen])
    assert (run.interrupted, run.terminated, run.info["time"]) == (of.interrupted, of.terminated, of.info["time"])
    assert run.info["clipped"] == of.info["clipped"]


@pytest.mark.parametrize("every", [1, 7, 2400])
@pytest.mark.parametrize("last", [None, 1e-3, 0.05, 2.2, 60.0])
def test_what_is_kept_is_what_would_have_been(every: int, last: float | None) -> None:
    run = simulate(environment(), law(), seed=3, record_every=every, keep_last=last)
    chosen = np.arange(0, 2500, every)[-max(1, round(last / (every * 1e-3))) if last else 0 :]
    validate_samples(run, chosen, whole())
    assert run.every == every
    assert run.duration == pytest.approx(2.5, abs=every * 1e-3)


@pytest.mark.parametrize(("every", "last"), [(1, None), (7, None), (3, 0.2)])
def test_the_gymnasium_loop_keeps_the_same(every: int, last: float | None) -> None:
    python, native = (
        drive(environment(0.9), law(), seed=3, record_every=every, keep_last=last) for drive in (rollout, simulate)
    )
    validate_samples(native, slice(None), python, 1e-9)


@settings(max_examples=80, deadline=None)
@given(every=st.integers(1, 9), most=st.none() | st.integers(1, 12), stretches=st.lists(st.integers(1, 30), max_size=6))
def test_rows_in_order_are_the_last_of_every_nth(every: int, most: int | None, stretches: list[int]) -> None:
    kept, steps = KeptSamples(every, most), sum(stretches)
    ring, first = np.full(kept.room(steps), -1), 0
    for count in stretches:
        periods = np.arange(first, first + count)
        rows = kept.rows(first, count)
        ring[rows[-len(ring) :]] = periods[kept.among(first, count)][-len(ring) :]
        assert [kept.row(k) for k in periods if k % every == 0] == rows.tolist()
        assert all(kept.row(k) is None for k in periods if k % every)
        first += count
        expected = np.arange(0, first, every)
        np.testing.assert_array_equal(ring[kept.order(first)], expected if most is None else expected[-most:])


@pytest.mark.parametrize(("every", "last"), [(1, None), (3, 0.1)])
def test_a_streamed_run_is_all_on_disk(tmp_path: Path, every: int, last: float | None) -> None:
    run = simulate(environment(), law(), seed=3, record_every=every, keep_last=last, stream=tmp_path / "run.parquet")
    again = Rollout.load(tmp_path / "run.parquet")
    for field in fields(Rollout):
        got, wanted = getattr(again, field.name), getattr(whole(), field.name)
        if isinstance(wanted, np.ndarray):
            np.testing.assert_array_equal(got, wanted[::every], err_msg=field.name)
    assert list(again.flags) == list(run.flags)
    for name in again.flags:
        np.testing.assert_array_equal(again.flags[name], whole().flags[name][::every])
    assert (again.every, again.reached_end, again.control_period) == (every, True, 1e-3)


def test_a_streamed_run_that_ends_early_is_whole_on_disk(tmp_path: Path) -> None:
    """Ctrl-C keeps what was computed; an error leaves nothing."""

    def fail(share: float) -> None:
        raise AdaptctlError("enough")

    simulate(
        environment(),
        law(),
        seed=3,
        stream=tmp_path / "a.parquet",
        progress=lambda share: signal.raise_signal(signal.SIGINT),
    )
    part = Rollout.load(tmp_path / "a.parquet")
    assert part.interrupted
    np.testing.assert_array_equal(part.p, whole().p[: len(part.p)])
    with pytest.raises(AdaptctlError, match="enough"):
        simulate(environment(), law(), seed=3, stream=tmp_path / "b.parquet", progress=fail)
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"]


def test_a_file_of_a_run_without_samples_is_refused_as_such(tmp_path: Path) -> None:
    says = r"none\.parquet: not written: no samples were appended"
    with pytest.raises(FileError, match=says), RolloutFile(tmp_path / "none.parquet", 3):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"record_every": 0}, "record_every: expected a whole number of control periods, at least 1, got 0"),
        ({"record_every": 1.5}, "record_every: expected a whole number"),
        ({"keep_last": 0.0}, r"keep_last: expected a positive time in s, got 0\.0"),
        ({"keep_last": np.nan}, "keep_last: expected a positive time in s, got nan"),
    ],
)
@pytest.mark.parametrize("drive", [rollout, simulate])
def test_what_is_no_number_of_periods_and_no_time_is_refused(drive: Any, given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        drive(environment(), law(), **given)


GROWTH = """
import resource, sys
sys.path.insert(0, "tests")
from test_long_runs import environment, law
from adaptctl.simulation import simulate

def megabytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0

simulate(environment(40.0), law(), seed=3, keep_last=1.0, stream=sys.argv[1])
before = megabytes()
simulate(environment(400.0), law(), seed=3, keep_last=1.0, stream=sys.argv[1])
print(megabytes() - before)
"""


@nightly
def test_memory_stays_flat(tmp_path: Path) -> None:
    """Ten times as long, 400,000 control periods: all samples would take 150 MB."""
    done = subprocess.run(
        [sys.executable, "-c", GROWTH, str(tmp_path / "run.parquet")], capture_output=True, text=True, check=True
    )
    require("memory-growth", float(done.stdout), 20.0, "memory that a run ten times as long takes more", unit="MB")


def test_a_run_whose_numbers_were_changed_is_refused_until_told(tmp_path: Path) -> None:
    """One bit of one torque, and one entry, in files that are Parquet as before; parts written one by one are whole."""
    path, edited = tmp_path / "run.parquet", tmp_path / "edited.parquet"
    run = simulate(environment(), law(), seed=3, stream=path)
    np.testing.assert_array_equal(Rollout.load(path).torque, run.torque)
    table = pq.read_table(path)
    torque = table["torque.joint1"].to_numpy().copy()
    torque[7] = np.nextafter(torque[7], np.inf)
    place = table.column_names.index("torque.joint1")
    changed = table.set_column(place, table.schema.field(place), pa.array(torque))
    metadata = pq.read_metadata(path).metadata
    about = {key: value for key, value in metadata.items() if key != b"ARROW:schema"}
    for wrong in (
        changed.replace_schema_metadata(about),
        table.replace_schema_metadata(about | {b"interrupted": b"true"}),
        table.replace_schema_metadata({key: value for key, value in about.items() if key != b"sha256"}),
    ):
        pq.write_table(wrong, edited)
        with pytest.raises(FileError, match=r"not those that were written; .*, accept_edited=True\)"):
            Rollout.load(edited)
        assert len(Rollout.load(edited, accept_edited=True).time) == len(run.time)
