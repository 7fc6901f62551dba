"""Numbers that are none: texts, nothing, integers beyond a double, NaN, and what overflows on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import adaptctl.envs  # noqa: F401  # registers
from adaptctl.control import ComputedTorque, PDGravity, ReferencePoint
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError, NonFiniteError
from adaptctl.simulation import Plant

WRONG: tuple[Any, ...] = ("x", None, 10**400, float("nan"), float("inf"), [None] * 6, ["a"] * 6, {}, 1j)
ENV = "adaptctl/Puma560Tracking-v0"


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def env() -> gymnasium.Env[Any, Any]:
    made = gymnasium.make(ENV)
    made.reset(seed=0)
    return made


TAKERS: dict[str, Callable[[Mechanism, gymnasium.Env[Any, Any], Any], object]] = {
    "inverse_dynamics": lambda arm, env, x: arm.inverse_dynamics(x, np.zeros(6), np.zeros(6)),
    "forward_dynamics": lambda arm, env, x: arm.forward_dynamics(np.zeros(6), x, np.zeros(6)),
    "energy_regressor": lambda arm, env, x: arm.energy_regressor(np.zeros(6), x),
    "period of a plant": lambda arm, env, x: Plant(arm, x),
    "substeps of a plant": lambda arm, env, x: Plant(arm, 1e-3, substeps=x),
    "gains": lambda arm, env, x: PDGravity(arm, x, 1.0),
    "bandwidth": lambda arm, env, x: ComputedTorque(arm, x, 1.0),
    "action": lambda arm, env, x: env.step(x),
    "reset": lambda arm, env, x: env.reset(options={"payload": x}),
    "parameters": lambda arm, env, x: env.reset(options={"parameters": x}),
    "duration": lambda arm, env, x: gymnasium.make(ENV, duration=x),
    "period of an environment": lambda arm, env, x: gymnasium.make(ENV, control_period=x),
    "reference": lambda arm, env, x: tick(arm, ReferencePoint(np.zeros(6), np.zeros(6), x)),
}


def tick(arm: Mechanism, reference: ReferencePoint, arms: tuple[int, ...] = ()) -> object:
    p = np.zeros((*arms, 6))
    law = PDGravity(arm, np.full(6, 100.0), np.full(6, 10.0))
    return law.step(law.init(p, p), p, p, reference)


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: repr(wrong)[:12])
@pytest.mark.parametrize("taker", TAKERS)
def test_what_is_no_number_is_refused(arm: Mechanism, env: gymnasium.Env[Any, Any], taker: str, wrong: Any) -> None:
    with pytest.raises(AdaptctlError):
        TAKERS[taker](arm, env, wrong)


@pytest.mark.parametrize("arms", [(), (4,)])
def test_a_reference_is_checked_whole(arm: Mechanism, arms: tuple[int, ...]) -> None:
    with pytest.raises(NonFiniteError, match=r"reference\.a"):
        tick(arm, ReferencePoint(np.zeros(6), np.zeros(6), np.full(6, np.nan)), arms)


@pytest.mark.parametrize("speed", [1e200, 1e308])
@pytest.mark.parametrize("samples", [(), (3,)])
def test_nothing_that_is_not_finite_is_returned(arm: Mechanism, speed: float, samples: tuple[int, ...]) -> None:
    p, v = np.zeros((*samples, 6)), np.full(6, speed)
    for method, given in (
        (arm.inverse_dynamics, (p, v, v)),
        (arm.forward_dynamics, (p, v, p)),
        (arm.energy_regressor, (p, v)),
        (arm.torque_regressor, (p, v, v)),
        (arm.slotine_li_regressor, (p, v, v, v)),
    ):
        with pytest.raises(NonFiniteError, match="puma560_measured: the result is not finite"):
            method(*given)
