"""Methods of a mechanism on arrays, as users call them, against Pinocchio's: at one state, and at thousands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio

import adaptctl
from adaptctl.arrays import Array
from benchmarks.findings import Agreement, Finding, Measurement, Speedup
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.offline import HALF, chain
from benchmarks.tasks import puma_at_joints

STATES, OFTEN = 10_000, 60
"""States at once, and calls after which a method is native code."""


class Method(NamedTuple):
    """Method of a mechanism and Pinocchio's function, by names; how many of the states p, v, a they take, and the
    goals for their speed-up at one state and at many."""

    ours: str
    theirs: str
    arguments: int
    one: float
    many: float


METHODS = (
    Method("inverse_dynamics", "rnea", 3, 3.0, 15.0),
    Method("torque_regressor", "computeJointTorqueRegressor", 3, 3.0, 15.0),
    Method("mass_matrix", "crba", 1, 2.5, 15.0),
    Method("forward_dynamics", "aba", 3, 3.0, 15.0),
)


def measure(effort: Effort) -> Iterator[Finding]:
    """A tree of six links, a long one, and an arm with a loop, which has no peer."""
    puma, long = puma_at_joints().arm, chain(HALF)
    for method in METHODS:
        yield from _agreement(puma, method)
        yield from _compared(puma, "the PUMA", method, effort)
        yield from _many(puma, "the PUMA", method, effort)
    for method in METHODS:
        yield from _agreement(long, method)
        goal = 3.0 if method.ours == "torque_regressor" else 1.0
        yield from _compared(long, f"a chain of {HALF} links", method._replace(one=goal), effort)
    yield from _with_loops(effort)


def _states(arm: adaptctl.Mechanism, *samples: int) -> Array:
    """Positions, velocities and accelerations, or torques."""
    drawn = np.random.default_rng(0).uniform(-0.5, 0.5, (3, *samples, arm.dof))
    drawn[0] += arm.neutral_configuration
    return drawn


def _called(arm: adaptctl.Mechanism, method: Method) -> Mapping[str, object]:
    """Names of a call in Python, whose code is native by then; and of its peer's."""
    ours: Callable[..., Array] = getattr(arm, method.ours)
    states = _states(arm)[: method.arguments]
    for _ in range(OFTEN):
        ours(*states)
    model = arm.to_pinocchio()
    theirs = getattr(pinocchio, method.theirs)
    names = dict(zip(("p", "v", "a"), states, strict=False))
    return {**names, "ours": ours, "theirs": theirs, "model": model, "data": model.createData()}


def _compared(arm: adaptctl.Mechanism, what: str, method: Method, effort: Effort) -> Iterator[Finding]:
    """Speed-up at one state."""
    names, given = _called(arm, method), ", ".join(("p", "v", "a")[: method.arguments])
    statements = {"ours": f"ours({given})", "theirs": f"theirs(model, data, {given})"}
    raced = race({name: Statement(text, names) for name, text in statements.items()}, effort)
    peer = f"Pinocchio's `{method.theirs}`, a call"
    yield Speedup.of(f"`{method.ours}` of {what}, a call", peer, raced, "ours", "theirs", method.one)


def _many(arm: adaptctl.Mechanism, what: str, method: Method, effort: Effort) -> Iterator[Finding]:
    """Speed-up at many states."""
    states, model = _states(arm, STATES)[: method.arguments], arm.to_pinocchio()
    data, theirs = model.createData(), getattr(pinocchio, method.theirs)
    ours: Callable[..., Array] = getattr(arm, method.ours)

    def loop() -> None:
        for state in zip(*states, strict=True):
            theirs(model, data, *state)

    raced = race(
        {"ours": Statement(lambda: ours(*states), work=STATES), "theirs": Statement(loop, work=STATES)}, effort
    )
    name = f"`{method.ours}` of {what}, {STATES:,} states, each"
    yield Speedup.of(name, "a loop over Pinocchio's", raced, "ours", "theirs", method.many)


def _with_loops(effort: Effort) -> Iterator[Finding]:
    """Inverse dynamics of a five-bar, whose loop is closed in each call."""
    arm = adaptctl.load("semi_direct_drive")
    one, many = _states(arm), _states(arm, STATES)
    for _ in range(OFTEN):
        arm.inverse_dynamics(*one)
    raced = race(
        {
            "one": Statement(lambda: arm.inverse_dynamics(*one)),
            "many": Statement(lambda: arm.inverse_dynamics(*many), work=STATES),
        },
        effort,
    )
    what = "`inverse_dynamics` of the semi-direct-drive arm, its loop followed from the reference"
    yield Measurement(f"{what}, a call", raced.time("one"), "s", 20e-6)
    yield Measurement(f"{what}, {STATES:,} states, each", raced.time("many"), "s", 2e-6)


def _agreement(arm: adaptctl.Mechanism, method: Method) -> Iterator[Finding]:
    """Difference over the largest entry, before and after the code is native."""
    states, model = _states(arm)[: method.arguments], arm.to_pinocchio()
    theirs = np.array(getattr(pinocchio, method.theirs)(model, model.createData(), *states))
    if method.theirs == "crba":
        theirs = np.triu(theirs) + np.triu(theirs, 1).T
    largest = np.abs(theirs).max()
    ours = [getattr(arm, method.ours)(*states) for _ in range(OFTEN)]
    worst = max(float(np.abs(one - theirs).max() / largest) for one in (ours[0], ours[-1]))
    yield Agreement(f"`{method.ours}`, {arm.name}", "Pinocchio", worst, 1e-10)
