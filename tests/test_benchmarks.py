"""What the benchmarks say is what was measured; nothing here depends on how fast anything is."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from nightly import nightly

from benchmarks import stability, tuning_table
from benchmarks.__main__ import SUBJECTS
from benchmarks.findings import Agreement, DisagreementError, Measurement, Speedup, plain
from benchmarks.interleaved import Effort, Spread, Statement, race
from benchmarks.published import agreements, comparisons, inserted, line, measurements

ROOT = Path(__file__).parent.parent


class Clock:
    """A clock that only moves when something works, on a machine that gets slower and slower."""

    def __init__(self) -> None:
        self.now, self.slowness = 0.0, 1.0

    def __call__(self) -> float:
        return self.now

    def work(self, seconds: float) -> None:
        self.now += seconds * self.slowness
        self.slowness *= 1.001


def test_a_ratio_is_that_of_the_work_though_the_machine_slows_down() -> None:
    clock = Clock()
    names = {"clock": clock}
    raced = race(
        {"fast": Statement("clock.work(1e-3)", names), "slow": Statement(lambda: clock.work(8e-3), work=2)},
        Effort(rounds=12, seconds=5e-3),
        clock,
    )
    assert raced.ratio("slow", "fast").median == pytest.approx(4.0, rel=0.02)
    times = raced.seconds["fast"]
    assert times.shape == (12,)
    assert np.all(np.diff(times) > 0.0)
    assert raced.time("fast").lower < raced.time("fast").median < raced.time("fast").upper


def test_every_turn_takes_the_time_that_is_asked() -> None:
    clock, calls = Clock(), []

    def work() -> None:
        calls.append(clock.now)
        clock.work(1e-5)

    race({"only": Statement(work)}, Effort(rounds=1, seconds=0.01), clock)
    assert len(calls) > 1000


FASTER = Speedup("loop", "peer", Spread(2e-7, 1e-7, 3e-7), Spread(4e-6, 4e-6, 4e-6), Spread(20.0, 19.0, 1234.5), 25.0)


def test_what_is_found_reads_as_it_is() -> None:
    assert "| loop | peer | 200 ns | 4 µs | 20 (19 to 1,234) | 25, missed |\n" in comparisons([FASTER])
    within = Measurement("start", Spread(0.1234, 0.1, 0.2), "s", 0.15)
    assert "| start | 123 ms (100 ms to 200 ms) | 150 ms |\n" in measurements([FASTER, within])
    assert "| growth | 1.2 (1.1 to 1.3) | 1.3 |\n" in measurements(
        [Measurement("growth", Spread(1.2, 1.1, 1.3), "", 1.3)]
    )
    equal = Agreement("joints", "peer", 2.5e-13, 1e-9, "rad")
    assert "| joints | peer | 2e-13 rad | 1e-09 |\n" in agreements([equal, FASTER])
    for finding in (FASTER, within, equal):
        assert finding.what in line(finding)
        json.dumps(plain(finding), allow_nan=False)


@pytest.mark.parametrize("difference", [1.1e-9, float("nan")])
def test_a_disagreement_is_none_to_be_timed(difference: float) -> None:
    with pytest.raises(DisagreementError, match="joints against peer"):
        Agreement("joints", "peer", difference, 1e-9)


def test_tables_take_the_place_of_the_last_ones() -> None:
    page = "a\n<!-- begin: written by make bench -->\nold\n<!-- end: written by make bench -->\nb\n"
    once = inserted(page, "new")
    assert "old" not in once
    assert once.startswith("a\n")
    assert once.endswith("b\n")
    assert inserted(once, "new") == once
    with pytest.raises(ValueError, match="no place to write to"):
        inserted("no marks", "new")


def test_there_is_a_place_for_everything() -> None:
    for page, command in (("docs/speed.md", "make bench"), ("docs/verification.md", "make figures")):
        inserted((ROOT / page).read_text(encoding="utf-8"), "", command)
    inserted((ROOT / "docs/speed.md").read_text(encoding="utf-8"), "", "python -m benchmarks.other_compilers")
    inserted(tuning_table.PAGE.read_text(encoding="utf-8"), "", tuning_table.COMMAND)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_subjects_measure(subject: str) -> None:
    assert callable(import_module(f"benchmarks.{subject}").measure)


def tuned(name: str, last: float | None, learns: bool, **more: object) -> dict[str, object]:
    """A row of the table of tuned robots, all four runs alike."""
    run = {
        "initial_rms_error": 0.04,
        "final_rms_error": last,
        "final_rms_error_adaptation_off": None,
        "max_error": 0.1,
        "limited_share": 0.0,
        "is_learning": learns,
    }
    found = dict.fromkeys(tuning_table.CASES, run)
    return {"name": name, "dof": 7, "cpu": 0.5, "rule": found, **more}


def test_the_table_of_tuned_robots_counts_its_rows(tmp_path: Path) -> None:
    """A robot that is run again has the later row; what is refused counts as not learning, and is told."""
    searched = tuned("a/good", 1e-3, True)["rule"]
    rows = [
        tuned("a/good", 2e-2, False),
        tuned("a/slow", 9e-3, True),
        tuned("a/lost", None, False),
        {"name": "a/wrong", "dof": 2, "error": "no gains hold it"},
        tuned("a/good", 1e-3, True, search=searched),
    ]
    file = tmp_path / "rows.jsonl"
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))
    text = tuning_table.published(tuning_table.rows(file))
    assert "| a/good | 7 | 40 | 1 | unstable | 1 | 1 | 1 |\n" in text
    assert "| a/lost | 7 | 40 | (unstable) |" in text
    assert "Tuning rules: 2 of 4 learn nominally, 1 of them to a tenth" in text
    assert "median of the last two seconds 9 mrad" in text
    assert "With `--search 20`: 1 of 1 learn" in text
    assert "`a/wrong` is refused: no gains hold it" in text
    assert tuning_table.rows(tmp_path / "none.jsonl") == []


@nightly
@pytest.mark.filterwarnings("ignore:arm. adaptation gain. lowered:adaptctl.errors.TuningWarning")
def test_loops_of_random_arms_are_counted() -> None:
    """In earnest, for a moment: gains are offered, none is lost so soon, and the promise is judged on the sums."""
    found = stability.counted(1, 8, 0.05, 2)
    assert found == stability.LoopCounts(1, 1, 8, found.certified, beside=2)
    assert found.certified > 0
    both = found + stability.LoopCounts(arms=1)
    assert (both.arms, both.offered, both.loops) == (2, 1, 8)
    assert found.as_promised
    assert not both.as_promised
    assert not (found + stability.LoopCounts(loops=1000, lost=2)).as_promised
    assert not (found + stability.LoopCounts(loops=1000, lost_certified=1)).as_promised


@pytest.mark.filterwarnings("ignore:arm. adaptation gain. lowered:adaptctl.errors.TuningWarning")
def test_loops_whose_torques_are_late_stay_finite() -> None:
    """Ranges that leave no more than torques on time would lose a quarter of these, and a certified one."""
    found = stability.counted(1, 20, 20.0, 1, delay=2)
    assert (found.lost, found.lost_certified) == (0, 0)
    assert 0 < found.falls < found.loops < 20
    assert found.certified > 0
