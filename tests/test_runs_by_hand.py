"""Runs made of a few samples: their numbers by hand, and their figure as it is seen."""

from __future__ import annotations

import base64
import re
import struct
from dataclasses import replace

import numpy as np
import pytest

from adaptctl.errors import InputError
from adaptctl.simulation import Rollout

PERIOD = 0.0625


def run(count: int = 4, dof: int = 2, **given: object) -> Rollout:
    p = np.linspace(0.0, 1.0, count)[:, None] + np.arange(dof)
    return Rollout.from_arrays(p, -p, p - 0.002, PERIOD, **given)  # type: ignore[arg-type]


def test_derivatives_are_central_differences_and_one_sided_at_both_ends() -> None:
    p = np.array([[0.0], [1.0], [4.0], [9.0]])
    one = Rollout.from_arrays(p, p, 2.0 * p, PERIOD)
    assert one.v[:, 0].tolist() == [16.0, 32.0, 64.0, 80.0]
    assert one.reference_v[:, 0].tolist() == [32.0, 64.0, 128.0, 160.0]
    assert one.reference_a[:, 0].tolist() == [512.0, 768.0, 768.0, 512.0]
    assert one.velocity_error[:, 0].tolist() == [-16.0, -32.0, -64.0, -80.0]
    assert one.time.tolist() == [0.0, 0.0625, 0.125, 0.1875]
    assert one.reward.tolist() == [0.0] * 4


def test_a_sample_is_clipped_where_the_torque_of_one_joint_is() -> None:
    applied = -run().p
    applied[2, 1] += 1e-12
    assert run(applied=applied).clipped.tolist() == [0.0, 0.0, 1.0, 0.0]


def test_runs_have_two_samples_and_a_joint_at_least_and_times_that_rise() -> None:
    assert len(run(2, 1).time) == 2
    for shape in ((1, 1), (2, 0)):
        with pytest.raises(InputError, match="p: expected shape"):
            Rollout.from_arrays(*[np.zeros(shape)] * 3, PERIOD)
    assert run(time=[3.0, 4.0, 5.0, 6.5]).time[-1] == 6.5
    with pytest.raises(InputError, match="4 increasing numbers"):
        run(time=[0.0, 1.0, 1.0, 2.0])


def test_a_run_lasts_to_the_end_of_its_last_sample() -> None:
    assert run().duration == 0.25
    assert replace(run(time=[3.0, 3.1875, 3.375, 3.5625]), every=3).duration == 3.75
    assert replace(run(), every=3).sample_time == 0.1875
    assert replace(run(), time=np.empty(0)).duration == 0.0


def test_a_figure_fits_on_a_page_and_shows_each_joint_in_a_color_of_its_own() -> None:
    figure = run(estimate=np.ones((4, 3))).plot()
    panels, (title, *small) = figure.axes, [figure.axes[0].title, *(axes.yaxis.label for axes in figure.axes)]
    assert 4.0 < figure.get_figwidth() < 8.27  # A4 in inches
    assert 4.0 < figure.get_figheight() < 11.69
    small += [figure.legends[0].get_texts()[0], *(axes.yaxis.get_ticklabels()[0] for axes in panels)]
    (size,) = {text.get_fontsize() for text in small}
    assert size < title.get_fontsize() < 10.0  # matplotlib's own
    solid, dotted = panels[0].lines[:2], panels[0].lines[2:]
    assert len({line.get_color() for line in solid}) == len(solid) == 2
    for line, faint in zip(solid, dotted, strict=True):
        assert line.get_color() == faint.get_color()
        assert faint.get_linewidth() < line.get_linewidth() < 1.5  # matplotlib's own
    assert all(0.0 < axes.xaxis.get_gridlines()[0].get_alpha() < 0.5 for axes in panels)
    assert [axes.get_xlabel() for axes in panels] == ["", "", "", "time [s]"]
    assert {axes.get_xlim() for axes in panels} == {panels[0].get_xlim()}
    np.testing.assert_allclose(np.ptp(np.array([line.get_ydata() for line in panels[1].lines])), 0.0, atol=1e-9)
    assert panels[1].lines[0].get_ydata()[0] == pytest.approx(2.0)  # mrad


@pytest.mark.parametrize(("count", "shown"), [(4000, 4000), (4001, 2001), (8000, 4000), (8001, 2667)])
def test_a_curve_has_four_thousand_points_at_most(count: int, shown: int) -> None:
    assert {len(line.get_xdata()) for axes in run(count).plot().axes for line in axes.lines} == {shown}


def test_a_notebook_shows_the_last_two_seconds_and_a_picture() -> None:
    many = run(11, time=0.5 * np.arange(11))
    many = replace(many, reference_p=many.p - 1e-3 * (1.0 + 9.0 * (many.time < 3.0)[:, None]))
    html = many._repr_html_()
    assert "over the last 2 s: 1 mrad" in html
    picture = base64.b64decode(re.findall('base64,([^"]*)', html)[0])
    assert struct.unpack(">I", picture[16:20]) == (640,)
    assert "samples" not in html
    assert "over the last 1 s: " in run(11, time=0.1 * np.arange(11))._repr_html_()
    none = replace(many, **{name: getattr(many, name)[:0] for name in ("time", "p", "reference_p")})
    assert none._repr_html_().endswith("over the last 0 s: nan mrad (mm)</p>")
