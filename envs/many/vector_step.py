"""A control period of a tracking environment as one step over scalars, for many arms at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Kernel, Stepper, compile_function, compile_step
from adaptctl.compilation.lanes import Precision
from adaptctl.envs.reward import RewardWeights
from adaptctl.scalars import Column, Scalar, absolute, where
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references_of_many import SinusoidForm

LARGEST = 1e300
"""Squares summed below which a motion has not run away."""


class Facts(NamedTuple):
    """Facts about an arm after a step, one number each; conditions are 1 or 0. The plant's marks follow."""

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
    """The step of a vector environment: a control period of the plant under a torque, its observation and its reward,
    at a time (s) of each arm's own.

    References are sums of sinusoids, evaluated here from each arm's numbers; with no terms, rows of samples are given:
    p, v, a now and p at each time ahead.
    """

    plant: Plant
    look_ahead: Array
    error_bound: Array
    weights: RewardWeights
    sinusoids: SinusoidForm

    @property
    def reference(self) -> dict[str, int]:
        """Lengths of the columns that say where an arm should be, by name."""
        if not self.sinusoids.terms:
            return {"row": (3 + len(self.look_ahead)) * self.plant.dof}
        return self.sinusoids.shared | self.sinusoids.held

    @property
    def held(self) -> dict[str, int]:
        """Lengths of the columns that are given to a step, by name."""
        given = {"torque": self.plant.dof, "noise": self.plant.noise_size}
        return given | {"parameters": self.plant.mechanism.equations.parameters} | self.reference

    def compile(self, precision: Precision = "double") -> Stepper:
        """Native code of the step in a precision, for as many arms at once as suit the processor."""
        sizes = self.plant.sizes
        return compile_step(self.equation, state=sizes, held=self.held, name="vector_step", precision=precision)

    def compile_row(self) -> Kernel:
        """Native code for the row of the reference alone, from the columns of `reference`."""

        def row(**reference: Column) -> Column:
            return self.row(reference)

        return compile_function(row, self.reference, name="row")

    def row(self, columns: Mapping[str, Column]) -> Column:
        """A reference's row (n,): p, v, a now and p at each time ahead, from its columns."""
        if not self.sinusoids.terms:
            return columns["row"]
        now, *ahead = (self.sinusoids.point(columns, delay) for delay in (0.0, *self.look_ahead.tolist()))
        return Column(x for part in (*now, *(point.p for point in ahead)) for x in part)

    def equation(self, **columns: Column) -> tuple[Column, ...]:
        """The results of a step: columns (n,) of the plant that are passed on, the observation, `Facts` with the
        plant's marks, and the true p, v and torque."""
        plant, row = self.plant, self.row(columns)
        after = plant.equation(columns)
        p = plant.primary(after.q)
        error = p - Column(row.of[: plant.dof])
        facts = Facts(
            -self._cost(error, after.v - Column(row.of[plant.dof : 2 * plant.dof]), after.applied),
            where(after.q @ after.q + after.v @ after.v < LARGEST, 1.0, 0.0),
            self._lost(error),
            self._surely_works(after.q, p),
            plant.energy_equation(after.q, after.v, columns["parameters"], after.drives),
            after.clipped[0],
        )
        observation = Column((*after.measured_p, *after.measured_v, *row))
        return *after[:4], observation, Column((*facts, *after.marks)), Column((*p, *after.v, *after.applied))

    def _cost(self, error: Column, rate: Column, torque: Column) -> Scalar:
        limits = np.asarray(self.plant.torque_limits).tolist()
        relative = Column(x / limit for x, limit in zip(torque, limits, strict=True))
        return self.weights.cost(error @ error, rate @ rate, relative @ relative)

    def _lost(self, error: Column) -> Scalar:
        lost: Any = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost

    def _surely_works(self, q: Column, p: Column) -> Scalar:
        """1 where loops are surely away from singularities and within their conditions, else 0."""
        mechanism = self.plant.mechanism
        if mechanism.continuation is None:
            return 1.0
        sure = mechanism.continuation.surely_regular(q)
        description = mechanism.description
        joints = [description.joint_names[i] for i in description.primary]
        for condition in description.loops.conditions if description.loops else ():
            total = Column(condition.weights.get(name, 0.0) for name in joints) @ p
            sure = where(total > condition.lower, where(total < condition.upper, sure, 0.0), 0.0)
        return sure
