"""A law has as many operations in a closed loop that is traced as alone."""

from __future__ import annotations

import pytest
from every_law import ARM, law_named

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
