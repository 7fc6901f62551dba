"""Numbers that are none: texts, nothing, integers beyond a double, NaN, and what overflows on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import adaptctl.envs  # noqa: F401  # registers
from adaptctl.control import ComputedTorque, DeadZone, GainDesign, Gains, PDGravity, ReferencePoint, sampled_gain
from adaptctl.description import Condition, Coupling, Limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError, InputError, NonFiniteError
from adaptctl.simulation import Plant
from adaptctl.tuning import tune

WRONG: tuple[Any, ...] = ("x", None, 10**400, float("nan"), float("inf"), [None] * 6, ["a"] * 6, {}, 1j)
WRONG += ([[1.0, 2.0], [3.0]], np.timedelta64(3, "s"), np.full(6, np.timedelta64(3, "s")))
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
    "period of gains": lambda arm, env, x: GainDesign.from_bandwidth(arm, 4.0, control_period=x),
    "period of a tuning": lambda arm, env, x: tune(arm, control_period=x),
    "substeps of a plant": lambda arm, env, x: Plant(arm, 1e-3, substeps=x),
    "gains": lambda arm, env, x: PDGravity(arm, x, 1.0),
    "bandwidth": lambda arm, env, x: ComputedTorque(arm, x, 1.0),
    "action": lambda arm, env, x: env.step(x),
    "reset": lambda arm, env, x: env.reset(options={"payload": x}),
    "parameters": lambda arm, env, x: env.reset(options={"parameters": x}),
    "duration": lambda arm, env, x: gymnasium.make(ENV, duration=x),
    "period of an environment": lambda arm, env, x: gymnasium.make(ENV, control_period=x),
    "sampled gain": lambda arm, env, x: sampled_gain(arm, 1.0, x),
    "ratio of gains": lambda arm, env, x: Gains.from_bandwidth(arm, 1.0, x),
    "start of a controller": lambda arm, env, x: ComputedTorque(arm, 5.0).init(x, np.zeros(6)),
    "positions of a controller": lambda arm, env, x: positions(arm, x),
    "start of a plant": lambda arm, env, x: Plant(arm, 1e-3).init(np.zeros(6), x),
    "torque of a plant": lambda arm, env, x: moved(Plant(arm, 1e-3), x),
    "dead zone": lambda arm, env, x: DeadZone(np.ones(3), x),
    "rotor": lambda arm, env, x: Drive({} if x is None else x),
    "lower limit": lambda arm, env, x: Limits(x, -1e300),
    "velocity limit": lambda arm, env, x: Limits(velocity=-1.0 if x is WRONG[4] else x),
    "ratio of a coupling": lambda arm, env, x: Coupling("c", "a", "b", x),
    "offset of a coupling": lambda arm, env, x: Coupling("c", "a", "b", 1.0, x),
    "condition": lambda arm, env, x: Condition("c", {"a": 1.0}, x, -1e300),
    "weight of a condition": lambda arm, env, x: Condition("c", {"a": x}),
    "ratio of a shaft": lambda arm, env, x: Drive(turns_with=(("a", x),)),
    "reference": lambda arm, env, x: tick(arm, ReferencePoint(np.zeros(6), np.zeros(6), x)),
}


def positions(arm: Mechanism, p: Any) -> object:
    law, zero = ComputedTorque(arm, 5.0), np.zeros(6)
    return law.step(law.init(zero, zero), p, zero, ReferencePoint(zero, zero, zero))


def moved(plant: Plant, torque: Any) -> object:
    return plant.step(plant.init(np.zeros(6), np.zeros(6)), torque)


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


@pytest.mark.parametrize("taker", [name for name in TAKERS if name.startswith("period")])
def test_a_period_in_ms_is_told(arm: Mechanism, env: gymnasium.Env[Any, Any], taker: str) -> None:
    with pytest.raises(
        InputError, match=r"period: expected a positive time in s \(1 ms is 0\.001\), from .* to 0\.1, got 1"
    ):
        TAKERS[taker](arm, env, 1)


def test_true_and_false_are_no_numbers_of_joints(arm: Mechanism) -> None:
    for wrong in (True, np.True_, [True] * 6):
        with pytest.raises(AdaptctlError, match=r"expected numbers, got .*True"):
            ComputedTorque(arm, wrong)  # type: ignore[arg-type]


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
