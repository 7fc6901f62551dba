"""What controllers, adaptation laws and tunings print is one line without arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.control import GainDesign, Gradient, SafetyFilter, SlotineLi, Workspace
from adaptctl.dynamics import load
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning import tune

ARM = load("two_link")


def test_controllers_and_laws_print_their_kind() -> None:
    law = SlotineLi(ReducedModel.full(ARM), 5.0, 4.0, np.full(20, 0.1))
    assert repr(law) == "<SlotineLi of 2 joints>"
    assert repr(SafetyFilter(law)) == "<SafetyFilter of 2 joints>"
    assert repr(Gradient(np.ones(3))) == "<Gradient>"


def test_designs_and_workspaces_print_their_mechanism() -> None:
    assert repr(GainDesign.from_bandwidth(ARM, 6.0)) == "<GainDesign of 'two_link' by bandwidth>"
    assert repr(Workspace.along(ARM, np.zeros((3, 2)))) == "<Workspace of 'two_link': 3 samples>"


def test_tunings_print_their_verdict() -> None:
    tuning = tune(ARM)
    assert repr(tuning) == "<Tuning of 'two_link': learns>"
    failed = replace(tuning, verified=(replace(tuning.verified[0], max_error=2.0),))
    assert repr(failed) == "<Tuning of 'two_link': does not learn>"
    assert repr(replace(tuning, verified=())) == "<Tuning of 'two_link': not verified>"
