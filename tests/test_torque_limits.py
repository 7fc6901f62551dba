"""Torque limits of actions where a mechanism states none: some multiple of what motions ask."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.control.gains.gains import SAMPLED_ACCELERATION, TORQUE_MARGIN, finite_torque_limits
from adaptctl.description import Description, JointKind, Limits, read
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError


@pytest.mark.parametrize("effort", [np.inf, 3.0])
def test_a_joint_alone_without_gravity_is_asked_for_its_inertia_times_accelerations_of_either_sign(
    effort: float,
) -> None:
    """Of 200 random accelerations up to the largest the greatest is near it, and never it."""
    (link,) = random_chain(1, 1).links
    link = replace(link, joint=replace(link.joint, kind=JointKind.REVOLUTE, limits=Limits(effort=effort)))
    mechanism = Mechanism(Description("one", (link,), np.zeros(3)))
    most = TORQUE_MARGIN * SAMPLED_ACCELERATION * float(mechanism.mass_matrix(np.zeros(1))[0, 0])
    found = float(finite_torque_limits(mechanism)[0])
    assert found == effort if np.isfinite(effort) else max(1.0, 0.9 * most) <= found < most


def test_without_a_state_that_loops_reach_there_is_no_limit() -> None:
    """Within these limits the semi-direct-drive arm's condition on its second and third angle never holds."""
    arm = read("semi_direct_drive")
    links = tuple(replace(link, joint=replace(link.joint, limits=Limits(0.0, 0.1))) for link in arm.links)
    with pytest.raises(InputError, match="semi_direct_drive reaches none of 200 random positions within its joint"):
        finite_torque_limits(Mechanism(replace(arm, links=links)))
