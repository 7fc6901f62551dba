"""Following of loops along straight lines in native code, as far as a cheap test shows each step to be regular."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.compilation import Stepper, compile_step
from adaptctl.scalars import Column, Scalar, where

CALLS, STEPS = 50, 5000
"""Calls and steps of configurations after which native code is made: until then the steps have taken about as long."""


MOST = 10_000
"""Steps that one native call may take, in which Ctrl-C is not heard."""


@dataclass(eq=False)
class StraightWays:
    """Native code that follows the n joints of the spanning tree of a mechanism with closed loops while its r primary
    (independent) joints move along straight lines, in steps, each of which a cheap test must show to be regular.

    `following(p, q)` is the equation of one step, from Columns (vectors of scalars of any kind): the configuration (n,)
    at positions p (r,), rad (m if prismatic), near a closed one q (n,). `sure(q)`, the test, is 1.0 where the
    configuration found is closed and away from singularities of the loops, 0.0 where it is not or the test cannot tell.
    `joints` and `primary` are the numbers n and r. `work` is the number of calls so far over 50 plus that of steps over
    5,000, 0 at first; native code is made once it is 1. Nothing is checked.
    """

    following: Callable[[Column, Column], Column]
    sure: Callable[[Column], Scalar]
    joints: int
    primary: int
    work: float = 0.0
    """calls over 50 plus steps over 5,000, so far; native code pays from 1 on"""

    @property
    def ready(self) -> bool:
        """True if native code is worth making by now: if the number of calls over 50 plus that of steps over 5,000,
        which the method `pays` has counted, is at least 1."""
        return self.work >= 1.0

    def pays(self, steps: NDArray[np.int64]) -> bool:
        """Count one call more, for N straight lines of `steps` (N,) steps each, and return True if native code is worth
        making by now and may follow them: if the number of calls over 50 plus that of steps over 5,000 is at least 1,
        and no line has more than 10,000 steps. Nothing is checked."""
        self.work += 1.0 / CALLS + float(steps.sum()) / STEPS
        return self.ready and int(steps.max(initial=0)) <= MOST

    def followed(self, q: Array, begin: Array, way: Array, steps: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """The configurations (N, n) of n joints at the ends of N straight lines, rad (m if prismatic), and a mask (N,),
        True where every step passed the test `sure`; where it is False, the configuration is undefined. The lines begin
        at closed configurations `q` (N, n), whose r primary joints are at `begin` (N, r), and displace these by `way`
        (N, r), rad (m), in as many equal steps as `steps` (N,), whole numbers of at least 1, says. N is at least 1.
        Nothing is checked."""
        arms = self._many.ensemble(len(q))
        arms.state["q"], arms.state["sure"] = q, 1.0
        arms.held["begin"], arms.held["way"], arms.held["steps"] = begin, way, steps[:, None]
        arms.run(int(steps.max()))
        return arms.state["q"], arms.state["sure"][:, 0] > 0.0

    def followed_alone(self, q: Array, begin: list[float], way: list[float], steps: int) -> Array | None:
        """The configuration (n,) of n joints at the end of one straight line, rad (m if prismatic), or None where a
        step failed the test `sure`. The line begins at the closed configuration `q` (n,), whose r primary joints are at
        `begin` (r,), and displaces these by `way` (r,), rad (m), in `steps` equal steps, a whole number of at least 1.
        Nothing is checked."""
        state, held = np.array([*q, 0.0, 1.0]), np.array([*begin, *way, steps])
        end = self._single.alone(steps, state, held)
        return end[: self.joints] if end[-1] > 0.0 else None

    @cached_property
    def _single(self) -> Stepper:
        return self._compiled(1)

    @cached_property
    def _many(self) -> Stepper:
        return self._compiled(None)

    def _compiled(self, lanes: int | None) -> Stepper:
        state, held = {"q": self.joints, "gone": 1, "sure": 1}, {"begin": self.primary, "way": self.primary, "steps": 1}
        return compile_step(self._step, state=state, held=held, lanes=lanes, name="straight_way")

    def _step(
        self, q: Column, gone: Column, sure: Column, begin: Column, way: Column, steps: Column
    ) -> tuple[Column, Column, Column]:
        """A step; none once the line's own number of steps is taken."""
        k = gone[0] + 1.0
        found = self.following(begin + way * (k / steps[0]), q)
        right = sure[0] * self.sure(found)
        after = Column(where(k <= steps[0], x, old) for x, old in zip(found, q, strict=True))
        return after, Column((k,)), Column((where(k <= steps[0], right, sure[0]),))
