"""What notebooks show of mechanisms, bases, runs and comparisons: their numbers, escaped."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import adaptctl
from adaptctl.dynamics import Mechanism
from adaptctl.markup import table
from adaptctl.recording import compared_runs


def parsed(shown: object) -> str:
    """The text of what is shown, which is well formed."""
    html = shown._repr_html_()  # type: ignore[attr-defined]
    return " ".join(ElementTree.fromstring(f"<div>{html}</div>").itertext())


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return adaptctl.load("two_link")


def test_mechanisms_spaces_and_bases_are_tables(arm: Mechanism) -> None:
    space = adaptctl.essential_space(arm)
    basis = adaptctl.fundamental_basis(space)
    shown = " ".join(parsed(arm).split())
    assert "2 links, 2 degrees of freedom, 20 parameters" in shown
    assert "upper ground shoulder" in shown
    assert "lower upper elbow" in shown
    assert f"rank {space.rank} of {len(arm.parameter_names)} parameters of two_link" in parsed(space)
    assert f"{space.certificate.gap:.4g}" in parsed(space)
    for name in basis.names:
        assert f"{name}*" in parsed(basis)
    assert f"{basis.rank} base parameters; a star marks those into which others are regrouped" in parsed(basis)


def test_a_description_is_printed_in_one_line(arm: Mechanism) -> None:
    assert repr(arm.description) == "<Description 'two_link': 2 links>"


def test_names_of_strangers_are_escaped(arm: Mechanism) -> None:
    evil = Mechanism(replace(arm.description, name="<script>alert(1)</script>"))
    assert "<script>" not in evil._repr_html_()
    assert "<script>alert(1)</script>" in parsed(evil)


def test_runs_and_comparisons_show_their_errors(arm: Mechanism) -> None:
    t = 1e-3 * np.arange(3000)[:, None] * np.ones(2)
    run = adaptctl.Rollout.from_arrays(np.sin(t) + 0.01, t, np.sin(t), 1e-3)
    assert "RMS error over the last 2 s: 10 mrad" in parsed(run)
    assert "on the bench" in parsed(compared_runs(arm, {"on the bench": run}))


def test_long_tables_say_what_they_leave_out() -> None:
    assert "and 40 more" in table(("n",), [(k,) for k in range(100)])
