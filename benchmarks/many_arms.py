"""1,024 arms at once, controllers and learning included, against MuJoCo's physics alone; one thread each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.scalars import column
from adaptctl.simulation import Integrator, RungeKutta4, SemiImplicitEuler
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.fleet import Fleet
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.mujoco_arm import Physics, mujoco_model
from benchmarks.tasks import PERIOD, Task, puma, semi_direct_drive

ARMS, STEPS = 1024, 100
COMPARED = 8
"""of the arms, whose motion is compared"""


class Asked(NamedTuple):
    """How much faster, and how well closed the loops are: ours and MuJoCo's, in m."""

    at_least: float
    gap: float = 0.0
    their_gap: float = 0.0


INTEGRATORS: dict[str, Integrator] = {"RK4": RungeKutta4(), "semi-implicit": SemiImplicitEuler()}
TREE = {"RK4": Asked(25.0), "semi-implicit": Asked(15.0)}
LOOP = {"RK4": Asked(100.0, 1e-12, 1e-6), "semi-implicit": Asked(50.0, 1e-7, 1e-4)}


def measure(effort: Effort) -> Iterator[Finding]:
    """A tree and a loop, by two integrators."""
    for task, name, asked in ((puma(), "PUMAs", TREE), (semi_direct_drive(), "semi-direct-drive arms", LOOP)):
        for integrator, goals in asked.items():
            yield from _compared(task, name, integrator, goals, effort)


def _compared(task: Task, name: str, integrator: str, asked: Asked, effort: Effort) -> Iterator[Finding]:
    course, physics = Fleet(task, INTEGRATORS[integrator], ARMS).course(STEPS), _physics(task, integrator)
    physics.run()
    if asked.gap:
        yield from _closed(task, f"gap of the loops of {name}, {integrator}", course.run(), physics.q, asked)
    else:
        yield _moved_alike(task, f"{name}, {integrator}, after {STEPS} steps", integrator, physics)
    arm_steps = ARMS * STEPS
    raced = race(
        {"ours": Statement(course.run, work=arm_steps), "theirs": Statement(physics.run, work=arm_steps)}, effort
    )
    what = f"{ARMS:,} {name} and their controllers, {integrator}, a step of one"
    yield Speedup.of(what, "MuJoCo's rollout, physics alone", raced, "ours", "theirs", asked.at_least)


def _physics(task: Task, integrator: str) -> Physics:
    """The same arms from the same starts, under the torques that would hold them there."""
    p, v = task.starts(ARMS)
    q, equations = task.arm.configuration(p), task.arm.equations
    u = np.array([equations.rates(column(a), column(b)).of for a, b in zip(q, v, strict=True)])
    torque = np.zeros_like(q)
    torque[:, list(task.arm.description.primary)] = _holding(task, p)
    return Physics(mujoco_model(task.arm, PERIOD, integrator), q, u, torque, STEPS)


def _holding(task: Task, p: Array) -> Array:
    return task.arm.inverse_dynamics(p, np.zeros_like(p), np.zeros_like(p))


def _moved_alike(task: Task, what: str, integrator: str, physics: Physics) -> Agreement:
    """Our physics alone, arm by arm."""
    plant = adaptctl.Plant(task.arm, PERIOD, integrator=INTEGRATORS[integrator])
    p, v = task.starts(ARMS)
    held, worst = _holding(task, p), 0.0
    for k in range(COMPARED):
        state = plant.init(p[k], v[k])
        for q in physics.q[k]:
            state = plant.step(state, held[k])
            worst = max(worst, float(np.abs(state.q - q).max()))
    return Agreement(f"joints of {what}", "MuJoCo", worst, 1e-9, "rad")


def _closed(task: Task, what: str, ours: Array, theirs: Array, asked: Asked) -> Iterator[Agreement]:
    """How far the ends of the loops stand apart after all steps."""
    yield Agreement(f"{what}, adaptctl", "zero", _gap(task, ours), asked.gap, "m")
    yield Agreement(f"{what}, MuJoCo", "zero", _gap(task, theirs[:, -1]), asked.their_gap, "m")


def _gap(task: Task, q: Array) -> float:
    residual = task.arm.equations.residual(column(q))  # type: ignore[union-attr]
    return float(np.abs(np.array(residual.of)).max())
