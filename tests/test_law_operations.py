"""A law has as many operations in a closed loop that is traced as alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from every_law import ARM, law_named

import adaptctl
from adaptctl.description.loops import Coupling, Loops
from adaptctl.simulation import ClosedLoop, Plant
from adaptctl.simulation.law_operations import _counted, law_flops


@pytest.mark.parametrize("name", ["gradient", "computed torque", "learning"])
def test_operations_in_a_loop_are_those_of_the_law_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law = law_named(name)
    _counted.cache_clear()
    alone = law_flops(law)
    assert law.kernel is not None
    assert alone == law.kernel.operations.flops > 0
    ClosedLoop(Plant(ARM, 1e-3), law).compiled(1.0)
    monkeypatch.setattr(type(law), "kernel", property(lambda _: pytest.fail("the law was traced again")))
    assert law_flops(law) == alone


def test_operations_of_an_arm_with_loops_are_those_of_the_law_alone() -> None:
    """In a simulation the plant closes the loops, too, and what it computes for that would not be counted."""
    arm = adaptctl.load("semi_direct_drive")
    law = adaptctl.control.SlotineLi(adaptctl.ReducedModel(arm), 5.0, 10.0)
    ClosedLoop(Plant(arm, 1e-3), law).compiled(1.0)
    assert law.kernel is not None
    assert law_flops(law) == law.kernel.operations.flops


def test_operations_of_an_arm_with_a_coupled_joint_are_counted_in_its_loop() -> None:
    tree = adaptctl.load("two_link").description
    leader, follower = tree.joint_names
    belt = Coupling("belt", follower, leader, 0.5)
    arm = adaptctl.Mechanism(replace(tree, loops=Loops((leader,), couplings=(belt,))))
    law = adaptctl.control.SlotineLi(adaptctl.ReducedModel(arm), 5.0, 10.0)
    ClosedLoop(Plant(arm, 1e-3), law).compiled(1.0)
    assert law.kernel is not None
    assert abs(_counted(law.structure)[0] - law.kernel.operations.flops) <= 3  # for the coupled position
