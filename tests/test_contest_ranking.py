"""Ranks of a contest, their intervals, page and figures."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from contest_rows import ROWS, large, of_robots, rows_of, written
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.contest.contest_file import Contest
from adaptctl.contest.figures import drawings, latex
from adaptctl.contest.measures import ContestRuns, measured
from adaptctl.contest.page import tint, write_page
from adaptctl.contest.ranking import Ranking, agreement
from adaptctl.contest.resampling import medians


def test_failures_are_ranked_last_and_ratios_are_paired() -> None:
    ranking = Ranking(rows_of(ROWS))
    assert ranking.order == ["true", "best", "pd-gravity", "fails"]
    assert ranking.over("best", "pd-gravity") == pytest.approx((0.5, 0.5, 0.5))
    assert ranking.over("fails", "pd-gravity").high == np.inf
    assert ranking.over("best", "true").low < 2.4 < ranking.over("best", "true").high
    assert (
        ranking.failure("fails")
        == "Fails in 2 of 4 runs, 2 of them under clean: error beyond 2 rad at 1.00 s (arm, seed 2)."
    )
    assert "weakest under clean, 2.5 times" in ranking.failure("best")
    # Demšar (2006): q of 4 laws at 5 % is 2.569, and here is one block
    assert ranking.critical_difference == pytest.approx(2.569 * np.sqrt(4 * 5 / 6.0), rel=1e-3)
    all_of = ranking.table()[2]
    assert (all_of["law"], all_of["failed"], all_of["error"]) == ("pd-gravity", 0, 5.0)


def test_robots_of_a_family_are_one_block_and_are_drawn_together() -> None:
    rows = of_robots({"ur3": (1.0, 2.0), "ur5": (1.0, 4.0), "ur10": (1.0, 2.0), "panda": (2.0, 1.0)})
    alone, together = Ranking(rows), Ranking(rows, dict.fromkeys(("ur3", "ur5", "ur10"), "ur"))
    assert alone.mean_ranks.tolist() == [1.25, 1.75]
    assert together.mean_ranks.tolist() == [1.5, 1.5]
    assert together.critical_difference == pytest.approx(alone.critical_difference * np.sqrt(2.0))
    assert alone.over("a", "b")[:2] == pytest.approx((0.5, 0.25))  # of four robots, three draws of ur5 are not rare
    assert together.over("a", "b") == pytest.approx((0.5, 0.5, 2.0))


@given(st.lists(st.integers(-3, 3) | st.just(np.nan), min_size=1, max_size=9), st.integers(0, 99))
def test_medians_are_those_of_the_values_written_out(values: list[float], seed: int) -> None:
    counts = np.random.default_rng(seed).integers(0, 4, (5, len(values)))
    written = [np.repeat(values, count) for count in counts]
    expected = [np.nanmedian(x) if np.isfinite(x).any() else np.nan for x in written]
    np.testing.assert_array_equal(medians(np.array(values, float), counts), expected)


def test_measures_are_those_of_errors_written_by_hand() -> None:
    time = 0.01 * np.arange(1200)
    error = np.where(time < 10.0, 0.001, 0.002)[:, None, None] * np.ones((1, 1, 2))
    torque = np.where(np.arange(1200) % 2, 1.0, -1.0)[:, None, None] * np.array([[[1.0, 0.5]]])
    runs = ContestRuns(time, error, torque, np.full((1, 2), 0.002), np.array([np.nan]), np.zeros((1, 0)))
    found = measured(runs, 0, np.array([1.0, 2.0]), None)
    assert found["error_2_s"] == pytest.approx(1.0)
    assert found["error_10_s"] == found["error"] == found["largest_error"] == pytest.approx(2.0)
    assert "error_20_s" not in found
    assert found["torque"] == pytest.approx(np.sqrt((1.0 + 1.0 / 16.0) / 2.0))
    assert found["torque_rate"] == pytest.approx(200.0 * np.sqrt((1.0 + 1.0 / 16.0) / 2.0))
    assert found["saturated"] == 1.0


def test_orders_that_differ_are_told() -> None:
    one = Ranking(rows_of({"a": [1.0, 1.1], "b": [2.0, 2.1], "c": [3.0, 3.1]}))
    other = Ranking(rows_of({"a": [1.0, 1.1], "b": [3.0, 3.1], "c": [2.0, 2.1]}))
    assert agreement(one, one) == (1.0, [])
    found = agreement(one, other)
    assert found.reversed_pairs == [("b", "c")]
    assert found.tau_b == pytest.approx(1.0 / 3.0)
    assert str(found) == "tau-b 0.33; settled pairs in another order: b and c"
    assert str(one.halves()) == "tau-b 1.00; settled pairs in another order: none"


def test_the_page_of_a_large_contest_is_small_and_asks_for_nothing_else(tmp_path: Path) -> None:
    contest, ranking = Contest.of(written(tmp_path)), Ranking(list(large()))
    rows = Ranking(list(large(2, 2, 10, 2))).table()
    table = [{**rows[0], "law": law, "condition": x} for law in ranking.laws for x in ("all", *ranking.conditions)]
    write_page(tmp_path / "index.html", contest, ranking, table)
    text = (tmp_path / "index.html").read_text()
    assert len(text) < 3e6 * 3 / 15  # a fifth of 15 laws
    assert not re.search(r"(src|href)=|https?://|@import|url\(", text)
    assert text.count("data-cell=") == 30


def test_figures_have_names_units_and_legends() -> None:
    ranking = Ranking([{**row, "curve": [2.0, 1.0]} for row in rows_of(ROWS)])
    found = {one.name: one.draw() for one in drawings(ranking, ranking.table(), 20.0)}
    assert {figure.get_figwidth() for figure in found.values()} == {3.45}
    assert found["ranks"].axes[0].get_xlabel() == "mean rank"
    assert [text.get_text() for text in found["map"].axes[0].get_yticklabels()] == ranking.order
    assert found["course"].axes[0].get_xlabel() == "time [s]"
    assert found["course"].get_supylabel() == "median RMS error [mrad]"
    assert [text.get_text() for text in found["course"].legends[0].get_texts()] == ranking.order


def test_names_and_reasons_are_texts_in_the_page_and_the_table(tmp_path: Path) -> None:
    rows = [{**row, "curve": [1.0]} for row in rows_of({"a_b": [1.0, 2.0], "c": [np.nan, 1.0]})]
    for row in rows:
        row["reason"] = row["reason"] and "</script><b>&"
    ranking = Ranking(rows)
    write_page(tmp_path / "index.html", Contest.of(written(tmp_path)), ranking, table := ranking.table())
    text = (tmp_path / "index.html").read_text()
    assert text.count("</script>") == 2
    data = json.loads(text.partition('id="data">')[2].partition("</script>")[0])
    assert data["runs"] == [[[[1.0, 2.0]]], [[["</script><b>&", 1.0]]]]
    assert "a\\_b &" in latex(table)


def test_colors_tell_better_from_worse_and_failed() -> None:
    better, same, worse, failed = (tint(x, True) for x in (0.01, 1.0, 100.0, np.inf))
    assert better.blue > worse.blue
    assert worse.red > better.red
    assert min(same) > 240
    assert failed not in (better, same, worse)
