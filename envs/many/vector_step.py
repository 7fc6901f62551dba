"""A control period of a tracking environment as one step over scalars, for many arms at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.compilation import Kernel, Stepper, compile_function, compile_step
from adaptctl.compilation.lanes import Precision
from adaptctl.envs.judgement import Judgement
from adaptctl.scalars import Column, Scalar, where
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references_of_many import SinusoidForm

LARGEST = 1e300
"""Squares summed below which a motion has not run away."""


class Facts(NamedTuple):
    """Named tuple of what one control period of one arm gives besides its state and observation, a scalar each (float,
    array over arms, or symbol to be compiled). Conditions are 1.0 for true, 0.0 for false.

    `reward`, unitless, without the penalty for termination; `finite`, 1 where the squares of all joint positions and
    velocities sum to less than 1e300; `lost`, 1 where a joint's position error passed its bound; `sure`, 1 where a
    mechanism has no loops, or a lower bound proves its loops away from singularities (regularity of at least 0.05) and
    its positions are within the conditions that its file states, 0 where this must be computed exactly; `energy`,
    kinetic plus potential, J, with the inertial parameters of that control period; `clipped`, 1 where the torque was
    clipped to its limits. Nothing is checked.
    """

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
    """One control period of a tracking environment, for one arm or many, as an equation over scalars of any kind
    (floats, arrays, or symbols) that is to be compiled: the motion of the plant under a held torque, the observation
    and the reward, each arm at a time (s) of its own.

    `plant` is the `Plant`, of r joints; `look_ahead` (L,) are the times ahead, s, at which the reference is observed;
    `judgement`, a `Judgement`, has the equation of the reward and the bounds on errors that end an episode;
    `sinusoids`, a `SinusoidForm`, states how many sinusoids a reference sums in each joint, which the step evaluates
    from each arm's numbers. If that is 0, the reference is an input, a row of samples: positions, velocities and
    accelerations now, then the positions at each time ahead. Nothing is checked.
    """

    plant: Plant
    look_ahead: Array
    judgement: Judgement
    sinusoids: SinusoidForm

    @property
    def reference(self) -> dict[str, int]:
        """Lengths, by name, of the input columns (vectors) that define an arm's reference. Where references are sampled
        there is one, {"row": 3r + r L}, for r joints and L look-ahead times; else there are "time" (1) and the
        parameters of h sinusoids a joint: "center" (r), "amplitude", "frequency" and "phase" (r h each, with the r
        numbers of the first sinusoid first) and "start_time" (1)."""
        if not self.sinusoids.terms:
            return {"row": (3 + len(self.look_ahead)) * self.plant.dof}
        return self.sinusoids.shared | self.sinusoids.held

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the input columns (vectors) that a step reads and does not change: "torque" (r), "noise"
        (2r, the positions' first, or 0 without sensors), "parameters" (P, the true inertial and friction ones, in the
        order of `Mechanism.parameter_names`) and those of the property `reference`, for r joints."""
        given = {"torque": self.plant.dof, "noise": self.plant.noise_size}
        return given | {"parameters": self.plant.mechanism.equations.parameters} | self.reference

    def compile(self, precision: Precision = "double") -> Stepper:
        """Native code of the step, a `Stepper`, in the given `precision` of floating-point numbers, "double" by default
        or "single", which works on as many arms at once as suit the processor's SIMD registers. Its state columns,
        which a step changes, are the plant's "q", "v", "drives" and "sensors"; its held columns, which a step does not
        change, are "torque", "noise", "parameters" and the reference's, with the lengths in the property `held`. Raises
        `InputError` for another precision."""
        sizes = self.plant.sizes
        return compile_step(self.equation, state=sizes, held=self.held, name="vector_step", precision=precision)

    def compile_row(self) -> Kernel:
        """Native code, a `Kernel`, that evaluates a reference: called with an array for each column in the property
        `reference`, in that order and of the length there, it returns (3r + r L,), the positions, velocities and
        accelerations of r joints now, then the positions at each of L look-ahead times, in rad, rad/s, rad/s^2 (m, m/s,
        m/s^2 if prismatic). Nothing is raised."""

        def row(**reference: Column) -> Column:
            return self.row(reference)

        return compile_function(row, self.reference, name="row")

    def row(self, columns: Mapping[str, Column]) -> Column:
        """Reference's positions, velocities and accelerations now and positions ahead, a `Column` (vector of scalars of
        any kind) of length 3r + r L: those of r joints at one time, then the positions at each of L look-ahead times
        after it, in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic). `columns` maps names to Columns and has those
        whose lengths are in the property `reference`: "row", which is returned as it is, for a sampled reference, else
        "time", s, and the sinusoids' parameters. Raises `KeyError` for one that is missing."""
        if not self.sinusoids.terms:
            return columns["row"]
        now, *ahead = (self.sinusoids.point(columns, delay) for delay in (0.0, *self.look_ahead.tolist()))
        return Column(x for part in (*now, *(point.p for point in ahead)) for x in part)

    def equation(self, **columns: Column) -> tuple[Column, ...]:
        """Results of one control period, a tuple of seven Columns (vectors of scalars of any kind), SI units. The first
        four are the plant's new state: positions q (n,) of the n joints of the spanning tree, velocities v (r,) of the
        r primary (independent) joints and the internal states of drives and of sensors. The fifth is the observation
        (5r + r L,), for L look-ahead times: measured positions and velocities, then the reference's row. The sixth (6 +
        h,) has the six numbers of `Facts` (reward, finite, lost, sure, energy, clipped) and the plant's h flags of
        actuator effects. The seventh (3r,) has the true positions, the velocities and the torques applied at the
        joints.

        `columns` are, by name, the state before the control period, "q", "v", "drives" and "sensors", and those of the
        property `held`: "torque" (r,), "noise", "parameters" (P,) and the reference's. Raises `KeyError` for one that
        is missing.
        """
        plant, row = self.plant, self.row(columns)
        after = plant.equation(columns)
        p = plant.primary(after.q)
        wanted_p, wanted_v = (Column(row.of[k * plant.dof : (k + 1) * plant.dof]) for k in range(2))
        judged = self.judgement.equation(p, after.v, wanted_p, wanted_v, after.applied)
        facts = Facts(
            judged.reward,
            where(after.q @ after.q + after.v @ after.v < LARGEST, 1.0, 0.0),
            judged.lost,
            self._surely_works(after.q, p),
            plant.energy_equation(after.q, after.v, columns["parameters"], after.drives),
            after.clipped[0],
        )
        observation = Column((*after.measured_p, *after.measured_v, *row))
        return *after[:4], observation, Column((*facts, *after.marks)), Column((*p, *after.v, *after.applied))

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
