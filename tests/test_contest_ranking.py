"""Ranks of a contest, their intervals, page and figures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from contest_rows import ROWS, large, of_robots, rows_of, written
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from adaptctl.contest import figures
from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.contest_file import Contest
from adaptctl.contest.figures import drawings, latex
from adaptctl.contest.measures import ContestRuns, measured
from adaptctl.contest.page import BAD, GOOD, content, short, tint, write_page
from adaptctl.contest.ranking import Ranking, _settled, agreement
from adaptctl.contest.resampling import _counts, median_interval, medians
from adaptctl.contest.step_times import slowest


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
    assert "weakest under clean, 2.45 times" in ranking.failure("best")  # the root of 2 and 3, as in the table
    # Demšar (2006): q of 4 laws at 5 % is 2.569, and here is one block
    assert ranking.critical_difference == pytest.approx(2.569 * np.sqrt(4 * 5 / 6.0), rel=1e-3)
    two = Ranking(rows_of({"a": [1.0], "b": [2.0]}))
    assert two.critical_difference == pytest.approx(1.960, rel=1e-3)  # of two laws in one block, as a sign test
    assert np.isnan(Ranking(rows_of({"a": [1.0]})).critical_difference)
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


def test_seeds_and_families_are_drawn_anew_from_one_stream_for_ever() -> None:
    """So that a page says the same each time; families with all of their robots."""
    counts = _counts(("ur", "panda", "ur"), (3, 2, 4)).reshape(-1, 3, 2, 4)
    rng = np.random.default_rng(0)
    seeds = rng.integers(0, 4, (len(counts), 4))
    panda, ur = np.sum(rng.integers(0, 2, (len(counts), 2))[:, :, None] == [0, 1], axis=1).T
    for b in (0, 1, len(counts) - 1):
        robots = np.array([ur[b], panda[b], ur[b]])
        for condition in (0, 1):
            np.testing.assert_array_equal(counts[b, :, condition], np.outer(robots, np.bincount(seeds[b], minlength=4)))


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
    twentieths = [1.0] * 16 + [np.sqrt(2.0)] + [2.0] * 3  # two of three samples of the 17th are before 10 s
    assert found["curve"] == pytest.approx(twentieths)
    whole = runs._replace(time=0.25 * np.arange(10.0), error=error[:10], torque=torque[:10])  # until 2.5 s
    assert "error_2_s" in measured(whole, 0, np.array([1.0, 2.0]), None)
    assert "error_2_s" not in measured(whole._replace(time=0.249 * np.arange(10.0)), 0, np.array([1.0, 2.0]), None)


def test_an_error_is_back_when_its_next_half_second_is_below_twice_the_two_before() -> None:
    time = 0.01 * np.arange(1200)

    def back(event: float | None, low: float, begin: float, end: float) -> float:
        """Return time of errors that are ten times as large for a second, and large too long before."""
        size = np.where((time >= begin) & (time < end), 10.0, 1.0) * np.where(time < low, 100.0, 1.0)
        runs = ContestRuns(time, 1e-3 * size[:, None, None], *np.zeros((4, 1200, 1, 1)))
        return float(measured(runs._replace(diverged_at=np.full(1, np.nan)), 0, np.ones(1), event)["return_time"])

    # a share x of large errors in a window of 50 has 100 x + 1 - x < 4 for one sample alone
    assert back(6.0, 3.995, 6.0, 7.0) == pytest.approx(0.99)
    assert back(8.0, 3.995, 8.0, 9.5) == pytest.approx(1.49)  # a push that ends at 8 s began at 6 s at the latest
    assert back(8.0, 3.995, 6.0, 8.5) == pytest.approx(0.49)
    assert back(3.0, 0.995, 3.0, 4.0) == pytest.approx(0.99)
    assert back(6.0, 4.005, 6.0, 7.0) == 0.0  # one large error before: five times the rest in the mean square
    assert np.isnan(back(6.0, 3.995, 6.0, 12.0))
    assert np.isnan(back(None, 0.0, 6.0, 7.0))
    assert np.isnan(back(11.99, 0.0, 6.0, 7.0))
    ones = ContestRuns(np.arange(10.0), *np.ones((2, 10, 1, 1)), np.ones((1, 1)), np.array([np.nan]), np.zeros((1, 0)))
    last = [measured(ones, 0, np.ones(1), event)["return_time"] for event in (8.0, 9.0)]
    assert last == pytest.approx([0.0, np.nan], nan_ok=True)  # after the last sample there is nothing
    twice = ones._replace(error=np.where(np.arange(10) < 8, 1.0, 2.0)[:, None, None])
    assert np.isnan(measured(twice, 0, np.ones(1), 8.0)["return_time"])


def test_a_run_fails_by_what_came_first() -> None:
    torque = np.where(np.arange(10) < 4, 1.0, np.nan)[:, None, None]
    runs = ContestRuns(0.5 * np.arange(10.0), np.zeros((10, 1, 1)), torque, *np.zeros((2, 1, 1)), np.zeros((1, 0)))
    found = [measured(runs._replace(diverged_at=np.array([x])), 0, np.ones(1), None) for x in (1.0, 2.0, 3.0, np.nan)]
    wrong = "torque is not a number from 2.00 s on"
    assert [each["reason"] for each in found] == ["error beyond 2 rad at 1.00 s", wrong, wrong, wrong]


@pytest.mark.parametrize("seeds", [5, 9, 14])
def test_the_interval_of_a_median_is_that_of_the_binomial_distribution(seeds: int) -> None:
    # the median of an odd resample is at most the k-th value where at least half of it are among the k smallest
    values = np.sort(np.random.default_rng(seeds).normal(size=seeds))
    found = median_interval(values.reshape(1, 1, seeds), ["arm"])
    assert found[0] == pytest.approx(np.median(values))
    half, places = seeds // 2 + 1, np.arange(1, seeds + 1) / seeds
    below = binom.sf(half - 1, seeds, places)
    low, high = (values[np.searchsorted(below, share)] for share in (0.025, 0.975))
    near = 0.0 if seeds % 2 else np.diff(values).max()  # the middle of two values where there is no middle one
    assert found[1:] == pytest.approx([low, high], abs=near + 1e-12)


def test_a_family_is_drawn_with_all_of_its_robots() -> None:
    values = np.array([0.0, 1.0, 1.0, 1.0])[:, None, None]  # robots, one condition, one seed
    together, alone = (median_interval(values, names) for names in (["a", "b", "b", "b"], ["a", "b", "c", "d"]))
    assert together.tolist() == [1.0, 0.0, 1.0]  # a quarter of the samples has the first alone
    assert alone.tolist() == [1.0, 0.0, 1.0]
    assert median_interval(np.full((1, 1, 2), np.nan), ["a"]) == pytest.approx([np.nan] * 3, nan_ok=True)


def test_orders_that_differ_are_told() -> None:
    one = Ranking(rows_of({"a": [1.0, 1.1], "b": [2.0, 2.1], "c": [3.0, 3.1]}))
    other = Ranking(rows_of({"a": [1.0, 1.1], "b": [3.0, 3.1], "c": [2.0, 2.1]}))
    assert agreement(one, one) == (1.0, [])
    found = agreement(one, other)
    assert found.reversed_pairs == [("b", "c")]
    assert found.tau_b == pytest.approx(1.0 / 3.0)
    assert str(found) == "tau-b 0.33; settled pairs in another order: b and c"
    assert str(one.halves()) == "tau-b 1.00; settled pairs in another order: none"


def test_a_pair_that_is_settled_in_one_ranking_alone_is_not_in_another_order() -> None:
    one = Ranking(rows_of({"a": [1.0, 1.0, 3.0], "b": [1.1, 1.1, 1.0]}))
    other = Ranking(rows_of({"a": [3.0, 3.0, 3.1], "b": [1.0, 1.0, 1.0]}))
    assert (_settled(one, "a", "b"), _settled(other, "a", "b")) == (0, 1)
    assert one.ratio("a", "b") < 1.0 < other.ratio("a", "b")
    assert agreement(one, other) == (-1.0, [])


def test_two_laws_have_an_order_and_one_has_none() -> None:
    two = Ranking(rows_of({"a": [1.0, 1.1], "b": [2.0, 2.1]}))
    assert agreement(two, two).tau_b == 1.0
    alone = Ranking(rows_of({"a": [1.0, 1.1]}))
    assert np.isnan(agreement(alone, alone).tau_b)


@pytest.mark.parametrize(("low", "high", "settled"), [(1.0, 1.1, 0), (0.9, 1.0, 0), (1.01, 2.0, 1), (0.5, 0.99, -1)])
def test_a_pair_is_settled_where_its_interval_is_beside_one(low: float, high: float, settled: int) -> None:
    ranking: Any = SimpleNamespace(over=lambda one, other: (0.5 * (low + high), low, high))
    assert _settled(ranking, "a", "b") == settled


def test_the_page_of_a_large_contest_is_small_and_asks_for_nothing_else(tmp_path: Path) -> None:
    contest, ranking = Contest.of(written(tmp_path)), Ranking(list(large()))
    rows = Ranking(list(large(2, 2, 10, 2))).table()
    table = [{**rows[0], "law": law, "condition": x} for law in ranking.laws for x in ("all", *ranking.conditions)]
    write_page(tmp_path / "index.html", contest, ranking, table)
    text = (tmp_path / "index.html").read_text()
    assert len(text) < 3e6 * 3 / 15  # a fifth of 15 laws
    assert not re.search(r"(src|href)=|https?://|@import|url\(", text)
    assert text.count("data-cell=") == 30


def test_the_page_has_the_times_of_laws_that_were_timed(tmp_path: Path) -> None:
    ranking = Ranking([{**row, "curve": [1.0]} for row in rows_of(ROWS)])
    laws = [{"law": "best", "making": 0.5, "compilation": x, "step": 1.5} for x in (2.25, 3.75, np.nan)]
    laws += [{"law": law, "making": np.nan, "compilation": np.nan, "step": np.nan} for law in list(ROWS)[1:]]
    times = slowest(laws)
    assert times["best"] == {"making": 0.5, "compilation": 3.75, "step": 1.5}
    contest, texts = Contest.of(written(tmp_path)), []
    for taken in ({}, times):
        write_page(tmp_path / "index.html", contest, ranking, ranking.table(), taken)
        texts.append((tmp_path / "index.html").read_text())
    heads = [re.findall('<th scope="col".*?</th>', text) for text in texts]
    assert len(heads[1]) == len(heads[0]) + 3
    assert ">3.75</td>" in texts[1]
    assert ">3.75</td>" not in texts[0]


def test_figures_have_names_units_and_legends() -> None:
    ranking = Ranking([{**row, "curve": [2.0, 1.0]} for row in rows_of(ROWS)])
    found = {one.name: one.draw() for one in drawings(ranking, ranking.table(), 20.0)}
    assert {figure.get_figwidth() for figure in found.values()} == {3.45}
    assert found["ranks"].axes[0].get_xlabel() == "mean rank"
    assert [text.get_text() for text in found["map"].axes[0].get_yticklabels()] == ranking.order
    assert found["course"].axes[0].get_xlabel() == "time [s]"
    assert found["course"].get_supylabel() == "median RMS error [mrad]"
    assert [text.get_text() for text in found["course"].legends[0].get_texts()] == ranking.order


def test_errors_of_joints_that_slide_are_in_millimetres(tmp_path: Path) -> None:
    contest = Contest.of(written(tmp_path))
    assert contest.error_unit == "mrad"
    rows = [{**row, "curve": [2.0, 1.0]} for row in rows_of({"a": [1.0, 2.0]})]
    ranking = Ranking(rows, {}, "mrad or mm")
    found = {one.name: one.draw() for one in drawings(ranking, ranking.table(), 20.0)}
    assert found["map"].axes[0].get_title() == "median error [mrad or mm]"
    assert found["course"].get_supylabel() == "median RMS error [mrad or mm]"
    assert {"mrad or mm", "mrad or mm at 2 s"} <= set(content(contest, ranking, ranking.table(), {})["heads"])


def of_conditions() -> Ranking:
    """Four laws under two conditions, the second twice as hard, with errors that fall over time."""
    rows = [{**row, "curve": [3.0 * row["error"], row["error"]]} for row in rows_of(ROWS)]
    hard = [{**row, "condition": "noise", "error": 2.0 * row["error"]} for row in rows]
    return Ranking(rows + hard)


def test_figures_show_the_numbers_of_the_table_within_their_axes() -> None:
    ranking = of_conditions()
    table = {(row["law"], row["condition"]): row for row in ranking.table()}
    found = {one.name: one.draw() for one in drawings(ranking, ranking.table(), 20.0)}
    ranks, cells = found["ranks"].axes[0], found["map"].axes[0]
    dots, bar = ranks.lines
    assert dots.get_xdata() == pytest.approx([table[law, "all"]["rank"] for law in ranking.order])
    stems = sorted(np.asarray(stem)[:, 0].tolist() for stem in ranks.collections[0].get_segments())
    assert stems == sorted([0.0, x] for x in dots.get_xdata())
    assert np.ptp(bar.get_xdata()) == pytest.approx(ranking.critical_difference)
    assert max(bar.get_ydata()) < min(dots.get_ydata())
    for axes, x, y in ((ranks, [0.0, *bar.get_xdata()], [-1.0, 3.0]), (cells, [-0.5, 1.5], [-0.5, 3.5])):
        assert min(axes.get_xlim()) <= min(x) < max(x) <= max(axes.get_xlim())
        assert min(axes.get_ylim()) <= min(y) < max(y) <= max(axes.get_ylim())
        assert axes.get_ylim()[0] > axes.get_ylim()[1]  # the best is above
    told = {text.get_position(): text.get_text() for text in cells.texts}
    assert len(told) == len(cells.patches) == 8
    for patch in cells.patches:
        (left, top), (right, bottom) = patch.get_xy().min(axis=0), patch.get_xy().max(axis=0)
        assert (right - left, bottom - top) == (1.0, 1.0)
        law, name = ranking.order[round((top + bottom) / 2)], ranking.conditions[round((left + right) / 2)]
        value = table[law, name]["over_true"]
        assert told[(left + right) / 2, (top + bottom) / 2] == short(value)
        assert patch.get_facecolor()[:3] == pytest.approx(np.array(tint(value, True)) / 255)
    for axes in found["course"].axes:
        best = next(line for line in axes.lines if line.get_label() == "best")
        assert best.get_xdata().tolist() == [5.0, 15.0]  # the middles of two halves of 20 s
        assert best.get_ydata() == pytest.approx([7.5, 2.5])


def test_figures_grow_with_laws_and_conditions() -> None:
    def heights(laws: int, conditions: int) -> list[float]:
        rows = [{**row, "condition": list(CONDITIONS)[k], "curve": [1.0]}
                for k in range(conditions) for row in rows_of({f"law{n}": [1.0 + n] for n in range(laws)})]  # fmt: skip
        ranking = Ranking(rows)
        figures = [one.draw() for one in drawings(ranking, ranking.table(), 1.0)]
        assert sum(axes.get_visible() for axes in figures[-1].axes) == conditions
        assert [len(axes.lines) for axes in figures[-1].axes if axes.get_visible()] == [min(laws, 6)] * conditions
        return [figure.get_figheight() for figure in figures]

    few, many = heights(2, 1), heights(7, 5)
    assert all(0.5 < low < high < 8.0 for low, high in zip(few, many, strict=True))  # inches
    assert heights(2, 2)[2] == few[2]  # two panels in a row
    assert len(heights(1, 1)) == 2  # one law has no ranks


def test_the_page_has_each_run_its_course_and_what_it_is_compared_with(tmp_path: Path) -> None:
    ranking, contest = of_conditions(), Contest.of(written(tmp_path))
    write_page(tmp_path / "index.html", contest, ranking, table := ranking.table())
    text = (tmp_path / "index.html").read_text()
    data = json.loads(text.partition('id="data">')[2].partition("</script>")[0])
    assert data["laws"] == list(ROWS)
    assert [ranking.laws[k] for k in data["others"]] == ["true", "pd-gravity"]
    assert data["runs"][0] == [[[1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0, 8.0]]]  # robot, condition, seed
    assert data["curves"][0] == [[[7.5, 2.5], [7.5, 2.5]]]
    assert data["curves"][3] == [[[0.3, 0.1], [0.3, 0.1]]]  # of the runs that did not fail
    told = content(contest, ranking, table, {})
    assert [row["name"] for row in told["rows"]] == ranking.order
    heads = dict(zip(told["heads"][1:], told["rows"][1]["cells"], strict=True))
    own = next(row for row in table if (row["law"], row["condition"]) == ("best", "all"))
    assert (heads["rank"].text, heads["mrad"].value, heads["failed"].text) == ("2.00", own["error"], "0 of 8")
    assert heads["over PD with gravity"].note == "[0.5, 0.5]"
    assert heads["how it fails"].words
    assert [[cell.text for cell in law["cells"]] for law in told["cells"]] == [
        ["2.45", "2.45"], ["4.9", "4.9"], ["1", "1"], ["∞", "∞"],
    ]  # fmt: skip


def test_names_and_reasons_are_texts_in_the_page_and_the_table(tmp_path: Path) -> None:
    rows = [{**row, "curve": [1.0]} for row in rows_of({"a_b": [1.0, 2.0], "c": [np.nan, 1.0]})]
    for row in rows:
        row["reason"] = row["reason"] and "</script><b>&"
    ranking = Ranking(rows)
    write_page(tmp_path / "index.html", Contest.of(written(tmp_path)), ranking, table := ranking.table())
    text = (tmp_path / "index.html").read_text()
    assert f"--out {tmp_path}</pre>" in text
    assert "1 robot, " in text
    assert text.count("</script>") == 2
    data = json.loads(text.partition('id="data">')[2].partition("</script>")[0])
    assert data["runs"] == [[[[1.0, 2.0]]], [[["</script><b>&", 1.0]]]]
    assert "a\\_b &" in latex(table, "mm")
    assert "error [mm] &" in latex(table, "mm")


def test_a_table_for_a_paper_has_three_digits_intervals_and_dashes() -> None:
    ranking = Ranking(rows_of({"a": [12345.0, 12345.0], "true": [1e4, 1e4], "lost": [np.nan, np.nan]}))
    lines = {line.split(" & ")[0]: line for line in latex(ranking.table(), "mrad").splitlines() if " & " in line}
    assert lines["a"] == r"a & limits & 2.00 & $1.23\times10^{4}$ & 1.23 [1.23, 1.23] & -- & 0 of 2 \\"
    assert lines["lost"] == r"lost & limits & 3.00 & -- & $\infty$ [$\infty$, $\infty$] & -- & 2 of 2 \\"


def test_colors_tell_better_from_worse_and_failed() -> None:
    better, same, worse, failed = (tint(x, True) for x in (0.01, 1.0, 100.0, np.inf))
    assert better.blue > worse.blue
    assert worse.red > better.red
    assert min(same) > 240
    assert [tint(x, True) for x in (0.001, 1e6)] == [better, worse]
    assert (better, worse) == (GOOD, BAD)
    assert failed not in (better, same, worse)


def test_a_paper_gets_figures_a_table_and_what_to_cite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(
        figures, "write_for_paper", lambda place, made: drawn.extend((place, *(one.name for one in made)))
    )
    ranking = Ranking([{**row, "curve": [1.0]} for row in rows_of(ROWS)])
    figures.write_paper(tmp_path, ranking, ranking.table(), 20.0)
    assert drawn == [tmp_path / "figures", "ranks", "map", "course"]
    assert (tmp_path / "figures").is_dir()
    assert r"\begin{tabular}" in (tmp_path / "table.tex").read_text()
    assert re.match(r"@software\{adaptctl,\n.*version = \{[\w.+]+\},\n\}\n$", (tmp_path / "cite.bib").read_text(), re.S)


def test_a_course_of_one_value_is_in_the_middle_of_the_run() -> None:
    ranking = Ranking([{**row, "curve": [row["error"]]} for row in rows_of({"a": [2.0, 3.0]})])
    (line,) = figures.course(ranking, 20.0).axes[0].lines
    assert (line.get_xdata().tolist(), line.get_ydata().tolist()) == ([10.0], [2.5])
