"""A control period of a tracking environment as one step over scalars, for many arms at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Kernel, Stepper, compile_function, compile_step
from adaptctl.control.references import SinusoidNumbers, sinusoids_at
from adaptctl.envs.reward import RewardWeights
from adaptctl.scalars import Column, Scalar, absolute, where
from adaptctl.simulation.real_plant import RealPlant

LARGEST = 1e300
"""Squares summed below which a motion has not run away."""


class Facts(NamedTuple):
    """What a step tells of an arm in one number each; conditions are 1 or 0. The plant's marks follow."""

    reward: Any
    """without what ending costs"""
    finite: Any
    lost: Any
    """an error passed its bound"""
    sure: Any
    """loops may work beyond doubt; where not, one has to look"""
    energy: Any
    """J, with the parameters of the period that ends"""
    clipped: Any


@dataclass(frozen=True, eq=False)
class VectorStep:
    """The plant under a torque, what is observed of it, and what it costs, at a time (s) of each arm's own.

    References are sums of `terms` sinusoids a joint, evaluated here from each arm's numbers; with none, rows of
    samples are given: p, v, a now and p at each time ahead.
    """

    plant: RealPlant
    look_ahead: Array
    error_bound: Array
    weights: RewardWeights
    terms: int

    @property
    def reference(self) -> dict[str, int]:
        """Lengths of what says where an arm should be."""
        r = self.plant.plant.dof
        if not self.terms:
            return {"row": (3 + len(self.look_ahead)) * r}
        waves = self.terms * r
        return {"time": 1} | SinusoidNumbers(r, waves, waves, waves, 1)._asdict()

    @property
    def held(self) -> dict[str, int]:
        """Lengths of what is given to a step."""
        r, parameters = self.plant.plant.dof, self.plant.plant.mechanism.equations.parameters
        noise = 2 * r if self.plant.effects.sensors else 0
        return {"action": r, "noise": noise, "parameters": parameters} | self.reference

    def compile(self) -> Stepper:
        """Native code, for as many arms at once as suit the processor."""
        return compile_step(self.equation, state=self.plant.sizes, held=self.held, name="vector_step")

    def compile_row(self) -> Kernel:
        """Native code for the row of the reference alone."""

        def row(**reference: Column) -> Column:
            return self.row(reference)

        return compile_function(row, self.reference, name="row")

    def row(self, reference: Mapping[str, Column]) -> Column:
        """The reference's p, v, a now and p at each time ahead."""
        if not self.terms:
            return reference["row"]
        numbers = SinusoidNumbers(*(reference[name] for name in SinusoidNumbers._fields))
        (time,) = reference["time"]
        now, *ahead = (sinusoids_at(time + delay, numbers) for delay in (0.0, *self.look_ahead.tolist()))
        return Column(x for part in (*now, *(point.p for point in ahead)) for x in part)

    def equation(
        self,
        q: Column,
        v: Column,
        drives: Column,
        sensors: Column,
        action: Column,
        noise: Column,
        parameters: Column,
        **reference: Column,
    ) -> tuple[Column, ...]:
        """What is passed on; then the observation, `Facts`, and as they truly are p, v and the torque."""
        plant, row = self.plant.plant, self.row(reference)
        after = self.plant.equation(q, v, drives, sensors, action, noise, parameters)
        p = plant.primary(after.q)
        error = p - Column(row.of[: plant.dof])
        facts = Facts(
            -self._cost(error, after.v - Column(row.of[plant.dof : 2 * plant.dof]), after.applied),
            where(after.q @ after.q + after.v @ after.v < LARGEST, 1.0, 0.0),
            self._lost(error),
            self._surely_works(after.q, p),
            plant.energy_equation(after.q, after.v, parameters),
            after.clipped[0],
        )
        told = Column((*after.measured_p, *after.measured_v, *row)), Column((*facts, *after.marks))
        return *after[:4], *told, Column((*p, *after.v, *after.applied))

    def _cost(self, error: Column, rate: Column, torque: Column) -> Scalar:
        limits = np.asarray(self.plant.plant.torque_limits).tolist()
        relative = Column(x / limit for x, limit in zip(torque, limits, strict=True))
        return self.weights.cost(error @ error, rate @ rate, relative @ relative)

    def _lost(self, error: Column) -> Scalar:
        lost: Any = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost

    def _surely_works(self, q: Column, p: Column) -> Scalar:
        """Whether loops are away from singularities and within their conditions."""
        mechanism = self.plant.plant.mechanism
        if mechanism.continuation is None:
            return 1.0
        sure = mechanism.continuation.surely_regular(q)
        description = mechanism.description
        joints = [description.joint_names[i] for i in description.primary]
        for condition in description.loops.conditions if description.loops else ():
            total = Column(condition.weights.get(name, 0.0) for name in joints) @ p
            sure = where(total > condition.lower, where(total < condition.upper, sure, 0.0), 0.0)
        return sure
