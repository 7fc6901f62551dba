"""Arms that take a stretch of time together, so that what they read and write fits the caches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Stepper
from adaptctl.compilation.loop import Source
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.gains_of_many import GainsOfMany
from adaptctl.simulation.lyapunov_rise import first_rise, watched
from adaptctl.simulation.noise import Noise
from adaptctl.simulation.references_of_many import ReferencesOfMany

MEMORY = 2**23
"""Bytes that a native call may read and write besides the arms' states."""
STRETCH = 2000
"""Control periods in one native call, at most: in between progress is reported, and Ctrl-C handled."""


class Herd:
    """A group of M arms, copies of one closed loop, that native code moves together through a stretch of control
    periods, so that what it reads and writes fits the processor's caches.

    `loop` is the closed loop, and `stepper` its native step of one control period; `members` is the slice of these arms
    among all that are simulated, and `references` and `noise` are for these arms alone. `parameters` (M, P) are their P
    true inertial and friction parameters, SI units, in the order of `Mechanism.parameter_names`, without the loads of
    effects. The attribute `arms` is the `Ensemble` of M copies of the step, all zero until `begin`. Raises `InputError`
    where `parameters` has no rows.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        stepper: Stepper,
        references: ReferencesOfMany,
        parameters: Array,
        noise: Noise,
        members: slice,
    ) -> None:
        self.loop, self.references, self.parameters = loop, references, parameters
        self.noise, self.members = noise, members
        self.arms = stepper.ensemble(len(parameters))

    def begin(self, p: Array, v: Array, memory: Any, tuned: GainsOfMany) -> None:
        """Put the M arms of this group, of r joints each, at time zero, at positions `p`, rad (m if prismatic), and
        velocities `v`, rad/s (m/s), (M, r) each. `memory` is the controllers' initial internal state: arrays (M,
        length), or (length,) for all arms alike; None for that of new controllers at the first measurement, whose noise
        is drawn here. `tuned` has the gains of all arms simulated, of which this group takes its own.

        Raises `SingularityError` where loops cannot be followed to p, `InputError` on a wrong shape, `NonFiniteError`
        on NaN or infinity.
        """
        loop, own = self.loop, tuned.of_arms(self.members)
        state = loop.plant.init(p, v, loop.plant.parameters(self.parameters, 0.0), self.noise.drawn(1)[0])
        begun = loop.controller.init(state.measured_p, state.measured_v, own) if memory is None else memory
        loop.begin(self.arms, state, begun)
        for name in loop.controller.gain_sizes if own else ():
            self.arms.held[name] = tuned.packed(self.members)
        for name, values in {"parameters": self.parameters, **self.references.held}.items():
            self.arms.held[name] = values

    def judge(self, bounds: Mapping[str, Array], final: int, tuned: GainsOfMany) -> None:
        """Set the criteria for the tracking errors of this group's arms. `bounds` are arrays (r,), rad (m if
        prismatic), by the names "within", to which errors are to return, and "beyond", past which a run has diverged
        (infinity becomes the largest number of the precision); `final` is the zero-based index of the control period
        from which on errors count as final. The true parameters of the Lyapunov function are set too, where it is
        known; `tuned` has the gains of all arms simulated. Raises `InputError` for other names and lengths."""
        for name, bound in bounds.items():
            self.arms.held[name] = np.minimum(bound, float(np.finfo(self.arms.stepper.dtype).max))
        self.arms.held["final"] = float(final)
        law = watched(self.loop, self.arms.stepper.precision)
        begun, true = first_rise(law, self.parameters, tuned.of_arms(self.members))
        for columns, values in ((self.arms.state, begun), (self.arms.held, true)):
            for name, numbers in values.items():
                columns[name] = numbers

    def longest(self, *, record: bool) -> int:
        """The number of control periods that one native call of this group takes at most, from 1 to STRETCH (2000): as
        many as keep what it reads and writes, besides the arms' states, within MEMORY (2^23 bytes). With `record` the
        samples of all periods count too. Nothing is raised."""
        shapes, columns = self.arms.stepper.outputs, self.arms.stepper.columns
        numbers = sum(columns[Source.DRIVEN].values()) + (sum(map(math.prod, shapes)) if record else 0)
        return max(1, min(STRETCH, MEMORY // (8 * self.arms.members * numbers) if numbers else STRETCH))

    def taken(self, time: Array, *, record: bool, threads: int) -> tuple[Array, ...]:
        """Run this group's M arms through the T control periods that begin at the times `time` (T,), s, and return the
        outputs of the native step, what its equation returns after the new state. They are an array for each output, in
        the equation's order: (T, M, length) of all periods with `record`, else (M, length) of the last one.

        The loads of effects are those at the first of these times. `threads` is the number of threads to which the arms
        are distributed. Raises `InputError` for a number of threads below 1, and what the references raise,
        `InputError` and `NonFiniteError`, where they are sampled.
        """
        if self.loop.plant.loads:
            self.arms.held["parameters"] = self.loop.plant.parameters(self.parameters, time[0])
        signals = {**self.references.signals(time), "noise": self.noise.drawn(len(time))}
        return self.arms.run(len(time), signals, record=record, threads=threads)
