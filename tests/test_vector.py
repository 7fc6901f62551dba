"""Figures as SVG, without Matplotlib."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from comparisons import comparison, no_progress
from nightly import nightly

from adaptctl.dynamics import load
from adaptctl.recording import report as recording_report
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.drawing import data_urls
from adaptctl.recording.figures import drawings
from adaptctl.recording.report import report, shown, write_artifacts
from adaptctl.recording.vector import Sheet
from adaptctl.recording.vector_marks import Axis, nice, plain, power, thinned

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return comparison(load("two_link"), samples=400)


def curve(svg: str) -> np.ndarray:
    """Points (n, 2) of the first curve within the first panel."""
    panel = next(ElementTree.fromstring(svg).iter(f"{SVG}svg")).find(f".//{SVG}svg")
    assert panel is not None
    path = panel.find(f"{SVG}path")
    assert path is not None
    numbers = [float(number) for number in re.findall(r"[-\d.]+", path.attrib["d"])]
    return np.array(numbers).reshape(-1, 2)


def size(svg: str) -> tuple[float, float]:
    """Width and height of the first panel."""
    panel = next(ElementTree.fromstring(svg).iter(f"{SVG}svg")).find(f".//{SVG}svg")
    assert panel is not None
    return float(panel.attrib["width"]), float(panel.attrib["height"])


def test_a_curve_is_where_its_numbers_are() -> None:
    figure, x = Sheet(9.2, 3.0), np.array([0.0, 1.0, 4.0])
    axes = figure.subplots()
    axes.plot(x, np.array([-1.0, 3.0, 1.0]), color="#000000")
    axes.set_xlim(0.0, 4.0)
    axes.set_ylim(-1.0, 3.0)
    width, height = size(figure.svg())
    wanted = [[0.0, height], [0.25 * width, 0.0], [width, 0.5 * height]]
    np.testing.assert_allclose(curve(figure.svg()), wanted, atol=0.11)


def test_curves_end_a_twentieth_of_their_range_before_the_axes() -> None:
    assert Axis().limits([np.array([2.0, 12.0])]) == pytest.approx((1.5, 12.5))


def test_a_curve_leaves_its_panel_as_steeply_as_it_is_and_goes_nowhere_far() -> None:
    figure = Sheet(9.2, 3.0)
    axes = figure.subplots()
    axes.plot(np.array([-0.5, 0.0, 1.0, 1e3, -1e3]), np.array([3.0, -2.0, 1e9, -1e9, 0.0]), color="#000000")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    width, height = size(figure.svg())
    found = curve(figure.svg()) / [width, height]
    np.testing.assert_allclose(found[:3, 0], [-0.5, 0.0, 1.0], atol=1e-3)
    np.testing.assert_allclose(found[:2, 1], [-2.0, 3.0], atol=1e-3)
    np.testing.assert_allclose(found[3:, 0], [2.0, -1.0], atol=1e-3)  # as far out as the panel is wide
    np.testing.assert_allclose(found[2:4, 1], [-9.0, 10.0], atol=1e-3)  # nine times as far as it is high


def test_of_panels_that_share_their_axis_the_lowest_alone_names_its_ticks() -> None:
    figure = Sheet(9.2, 6.0)
    for axes in figure.subplots(3, 1, sharex=True):
        axes.plot([0.0, 1.0], [300.0, 700.0], color="#000000")
    texts = [text.text for text in ElementTree.fromstring(figure.svg()).iter(f"{SVG}text")]
    assert (texts.count("1"), texts.count("500")) == (1, 3)


@pytest.mark.parametrize(("width", "columns"), [(9.2, 4), (3.45, 2), (1.0, 1)])
def test_a_legend_has_as_many_columns_as_there_is_room_for(width: float, columns: int) -> None:
    """A line of 18 and a gap before each text, whose letters are 0.6 of their height of 8."""
    figure = Sheet(width, 3.0)
    axes = figure.subplots()
    for k in range(4):
        axes.plot([0.0, 1.0], [0.0, k], color="#000000", label=f"curve number {k}")
    figure.legend(ncols=4)
    texts = [one for one in ElementTree.fromstring(figure.svg()).iter(f"{SVG}text") if "curve" in (one.text or "")]
    lefts = sorted({float(one.attrib["x"]) for one in texts})
    assert len(lefts) == columns
    assert min(np.diff(lefts), default=np.inf) > 0.6 * 8.0 * len("curve number 0")
    assert len({(one.attrib["x"], one.attrib["y"]) for one in texts}) == 4


def test_a_name_below_all_panels_is_in_the_middle() -> None:
    figure = Sheet(9.2, 3.0)
    figure.subplots().plot(np.arange(2.0), np.arange(2.0), color="#000000")
    figure.supxlabel("below all")
    whole = ElementTree.fromstring(figure.svg())
    (name,) = (text for text in whole.iter(f"{SVG}text") if text.text == "below all")
    assert name.attrib["text-anchor"] == "middle"
    assert 2.0 * float(name.attrib["x"]) == pytest.approx(float(whole.attrib["viewBox"].split()[2]), abs=0.2)


def test_a_logarithmic_scale_is_one_and_has_no_place_for_zero() -> None:
    figure = Sheet(9.2, 3.0)
    axes = figure.subplots()
    axes.semilogy(np.arange(5.0), np.array([1.0, 10.0, 100.0, 0.0, 1.0]), color="#000000")
    axes.set_ylim(1.0, 100.0)
    _, height = size(figure.svg())
    np.testing.assert_allclose(curve(figure.svg())[:, 1], [height, 0.5 * height, 0.0, height], atol=0.11)
    assert figure.svg().count("M") > 1
    assert ">10²<" in figure.svg()


def test_extremes_of_long_curves_stay() -> None:
    x, y = np.linspace(0.0, 600.0, 20_000), np.random.default_rng(0).standard_normal(20_000)
    y[[777, 778, 13_001]] = 50.0, np.nan, -60.0
    few_x, few_y = thinned(x, y, 600.0)
    assert len(few_x) < 1300
    assert (np.nanmax(few_y), np.nanmin(few_y)) == (50.0, -60.0)
    assert np.isnan(few_y).sum() == 1
    assert (few_x[0], few_x[-1]) == (x[0], x[-1])
    assert (np.diff(few_x) > 0.0).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_extremes_stay_beside_samples_that_are_unknown(side: float) -> None:
    """Of values that are all on one side of zero."""
    x, y = np.linspace(0.0, 600.0, 20_000), np.full(20_000, 5.0 * side)
    y[[777, 778, 13_001, 13_002]] = 2.0 * side, np.nan, 9.0 * side, np.nan
    _, few = thinned(x, y, 600.0)
    assert (np.nanmin(side * few), np.nanmax(side * few)) == (2.0, 9.0)


@pytest.mark.parametrize(("low", "high"), [(0.0, 20.0), (-3e-5, 4e-5), (0.1, 0.100001), (-2e8, 1e9)])
def test_ticks_are_round_and_within(low: float, high: float) -> None:
    places = [place for place, _ in Axis().ticks(low, high, 100.0)]
    assert 2 <= len(places) <= 10
    assert all(low - 1e-9 * (high - low) <= place <= high + 1e-9 * (high - low) for place in places)
    np.testing.assert_allclose(np.diff(places), nice(high - low, 5), rtol=1e-6)
    assert nice(20.0, 4) == 5.0


def test_numbers_are_written_in_short() -> None:
    assert [plain(x) for x in (0.0, -2.5, 1e-5, 2.5e-7, 3e9)] == [
        "0",
        "−2.5",
        "1e−5",
        "2.5e−7",
        "3e9",
    ]
    assert power(-12.0) == "10⁻¹²"


def test_every_figure_of_a_report_is_well_formed(compared: Comparison) -> None:
    for drawing in drawings(compared).values():
        assert drawing.plain
        root = ElementTree.fromstring(drawing.svg())
        assert "nan" not in drawing.svg()
        texts = {text.text for text in root.iter(f"{SVG}text")}
        axes = drawing.draw().axes
        assert {name for panel in axes for name in (panel.get_xlabel(), panel.get_title(loc="left")) if name} <= texts
        assert len(axes) == len(list(root.iter(f"{SVG}svg"))) - 1 + sum(not panel.get_visible() for panel in axes)


def test_without_files_a_report_has_its_figures_all_the_same(
    compared: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_artifacts(tmp_path / "run", compared, figures=False)
    assert not (folder / "figures").exists()
    page = (folder / "report.html").read_text()
    for name, url in data_urls(drawings(compared).values()).items():
        assert url in page, name
        assert base64.b64decode(url.removeprefix("data:image/svg+xml;base64,")).startswith(b"<svg")
    assert "figures/" not in page
    result = shown(compared)
    result.write(tmp_path / "again", no_progress)
    assert not (tmp_path / "again" / "figures").exists()
    assert result.figures is not None
    written: list[Any] = []
    monkeypatch.setattr(recording_report, "write_figures", lambda *given: written.extend(given))
    result.figures(tmp_path / "again" / "figures")
    assert written[0] == tmp_path / "again" / "figures"
    assert [one.name for one in written[1]] == [one.name for one in report(compared).drawings]


@nightly
def test_an_experiment_does_without_matplotlib(tmp_path: Path) -> None:
    program = (
        "import sys; from adaptctl.cli.main import main; "
        "code = main(sys.argv[1:]); print('matplotlib' in sys.modules); sys.exit(code)"
    )
    run = [
        "experiment",
        "run",
        "adaptive",
        "--robot",
        "puma560_arm3",
        "--duration",
        "3",
        "--out",
        str(tmp_path / "run"),
    ]
    done = subprocess.run([sys.executable, "-c", program, *run], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "False"
