"""1,024 arms at once, controllers and learning included, against MuJoCo's physics alone; one thread each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.scalars import column
from adaptctl.simulation import Integrator, RungeKutta4, SemiImplicitEuler
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.fleet import Fleet
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.mujoco_arm import SOLVERS, Physics, mujoco_model
from benchmarks.tasks import PERIOD, Task, puma, semi_direct_drive

ARMS, STEPS = 1024, 100
COMPARED, LASTING = 8, 100_000
"""Arms whose motion is compared, and control periods of a loop that must last."""


class Asked(NamedTuple):
    """Goals of a measurement: the speed-up, and how well loops stay closed, ours and MuJoCo's, in m."""

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
    fleet, physics = Fleet(task, INTEGRATORS[integrator], ARMS), _contenders(task, integrator, asked)
    course = fleet.course(STEPS)
    if asked.gap:
        yield _closed(task, f"gap of the loops of {name}, {integrator}, adaptctl", course.run(), asked.gap)
        for solver, one in physics.items():
            what = f"gap of the loops of {name}, {integrator}, MuJoCo with {solver}"
            yield _closed(task, what, one.q[:, -1], asked.their_gap)
    else:
        yield _moved_alike(task, f"{name}, {integrator}, after {STEPS} steps", integrator, physics["Newton"])
    yield _lasting(replace(fleet, arms=COMPARED), f"{name}, {integrator}, after {LASTING // 1000} s")
    arm_steps = ARMS * STEPS
    theirs = {solver: Statement(one.run, work=arm_steps) for solver, one in physics.items()}
    raced = race({"ours": Statement(course.run, work=arm_steps), **theirs}, effort)
    what = f"{ARMS:,} {name} and their controllers, {integrator}, a step of one"
    best = min(theirs, key=lambda solver: raced.time(solver).median)
    against = "MuJoCo's rollout, physics alone" + (f", {best} of its solvers" if asked.gap else "")
    yield Speedup.of(what, against, raced, "ours", best, asked.at_least)


def _contenders(task: Task, integrator: str, asked: Asked) -> dict[str, Physics]:
    """MuJoCo with each solver that closes the loops as well as is asked; they have been run. Trees need none."""
    physics = {"Newton": _physics(task, integrator, "Newton")}
    if asked.gap:
        physics |= {solver: _physics(task, integrator, solver) for solver in SOLVERS}
    for one in physics.values():
        one.run()
    good = {k: one for k, one in physics.items() if not asked.gap or _gap(task, one.q[:, -1]) <= asked.their_gap}
    return good or physics


def _lasting(fleet: Fleet, what: str) -> Agreement:
    """Agreement of the arms with their reference at the end: the loop that is timed is stable."""
    q = fleet.course(LASTING).run()
    error = fleet.plant.positions(q) - fleet.task.references(LASTING).p[-1]
    return Agreement(f"tracking of {what}", "the reference", float(np.abs(error).max()), 0.1, "rad")


def _physics(task: Task, integrator: str, solver: str) -> Physics:
    """The same arms from the same starts, under the torques that would hold them there."""
    p, v = task.starts(ARMS)
    q, equations = task.arm.configuration(p), task.arm.equations
    u = np.array([equations.joint_velocities(column(a), column(b)).of for a, b in zip(q, v, strict=True)])
    torque = np.zeros_like(q)
    torque[:, list(task.arm.description.primary)] = _holding(task, p)
    return Physics(mujoco_model(task.arm, PERIOD, integrator, solver), q, u, torque, STEPS)


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


def _closed(task: Task, what: str, q: Array, at_most: float) -> Agreement:
    """Distance of the ends of the loops after all steps, m."""
    return Agreement(what, "zero", _gap(task, q), at_most, "m")


def _gap(task: Task, q: Array) -> float:
    residual = task.arm.equations.residual(column(q))  # type: ignore[union-attr]
    return float(np.abs(np.array(residual.of)).max())
