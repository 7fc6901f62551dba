"""The physical arm: equations of motion under a torque held over each control period."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked
from adaptctl.compilation import compile_function, outlined
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loops.continuation import NEAREST
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, Scalar, clip
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.integrator import Integrator, RungeKutta4


class PlantState(NamedTuple):
    """The arm at one time (s): positions (r,) and velocities (r,) of its primary joints, and all its tree's
    joints q (n,), which are p where there are no loops; of many arms with leading axes."""

    time: float
    p: Array
    v: Array
    q: Array


@dataclass(frozen=True, eq=False)
class Plant:
    """A mechanism driven by torques in N m (N for a prismatic joint), each held over one control period.

    `control_period` is in s and is integrated in `substeps` equal steps; `torque_limits` (r,) bound every
    joint's effort, infinity meaning none, the mechanism's own when not given. `friction` is what brakes the joints
    besides the mechanism's own drives. Joints have no stops.

    The inertial parameters are an argument of `step`, so one plant serves an arm with any payload. Mechanisms
    of at most LARGEST_COMPILED links run as native code, longer ones in Python. Equal calls give equal bits.
    """

    mechanism: Mechanism
    control_period: float
    substeps: int = 1
    integrator: Integrator = RungeKutta4()  # noqa: RUF009  # frozen
    torque_limits: Array | None = None
    friction: tuple[JointEffect, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.control_period) and self.control_period > 0.0):
            raise InputError(f"control_period: expected a positive time in s, got {self.control_period}")
        if self.substeps < 1 or self.substeps != int(self.substeps):
            raise InputError(f"substeps: expected a whole number of at least 1, got {self.substeps}")
        own = self.mechanism.effort_limits if self.torque_limits is None else self.torque_limits
        object.__setattr__(self, "torque_limits", _limits(own, self.mechanism.dof))

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.mechanism.dof

    def init(self, p: ArrayLike, v: ArrayLike) -> PlantState:
        """The state at time zero, from positions and velocities (..., r), of as many arms as there are.

        Raises `SingularityError` where loops cannot be followed to p.
        """
        arrays = (np.atleast_1d(np.asarray(values)) for values in (p, v))
        given = zip(arrays, ("p", "v"), strict=True)
        positions, velocities = (checked(x, self.dof, f"{self.mechanism.name}: {what}") for x, what in given)
        positions, velocities = (x.copy() for x in np.broadcast_arrays(positions, velocities))
        return PlantState(0.0, positions, velocities, self.mechanism.configuration(positions))

    def limited(self, torque: ArrayLike) -> Array:
        """The torque (r,) clipped to the limits: what the arm feels. Raises as `step` does."""
        return np.minimum(np.maximum(self._finite(torque), self._lower), self._upper)

    def step(self, state: PlantState, torque: ArrayLike, parameters: ArrayLike | None = None) -> PlantState:
        """One control period under a torque (r,), clipped to the limits and held.

        `parameters` (P,) are the mechanism's own unless given. Raises `InputError` on a wrong shape and
        `NonFiniteError` on NaN or infinity in any argument, or when the motion itself runs away.
        """
        true = self.mechanism.inertial_parameters if parameters is None else parameters
        q, v = self._advance(state.q, state.v, self._finite(torque), true)
        if not math.isfinite(q.dot(q) + v.dot(v)):
            self._blame(state, true)
        p = q if self._primary is None else q[self._primary]
        return PlantState(state.time + self.control_period, p, v, q)

    def energy(self, state: PlantState, parameters: ArrayLike | None = None) -> float:
        """Kinetic plus potential energy, in J."""
        true = self.mechanism.inertial_parameters if parameters is None else parameters
        (energy,) = self._energy(state.q, state.v, true)
        return float(energy[0])

    def compile(self) -> None:
        """Compile now what would else be compiled when first used."""
        _ = self._advance, self._energy

    def may_work(self, state: PlantState) -> NDArray[np.bool_]:
        """Whether loops are away from singularities and within their conditions, at states (...); always so for a
        tree."""
        if self.mechanism.continuation is None:
            return np.ones(state.p.shape[:-1], dtype=np.bool_)
        inside = self.mechanism.description.within_conditions(state.p)
        return np.asarray(inside & (self.mechanism.continuation.regularity(state.q) >= NEAREST))

    @cached_property
    def _advance(self) -> Callable[..., tuple[Array, Array]]:
        joints = self.mechanism.equations.joints
        return self._native(self.equation, "plant", q=joints, v=self.dof, torque=self.dof)

    @cached_property
    def _energy(self) -> Callable[..., tuple[Array]]:
        def energy(q: Column, v: Column, parameters: Column) -> tuple[Column]:
            return (Column((self.energy_equation(q, v, parameters),)),)

        return self._native(energy, "energy", q=self.mechanism.equations.joints, v=self.dof)

    def limited_equation(self, torque: Column) -> Column:
        """The torque (r,) clipped to the limits, over scalars of any kind."""
        return Column(clip(x, -bound, bound) for x, bound in zip(torque, self._limits, strict=True))

    def energy_equation(self, q: Column, v: Column, parameters: Column) -> Scalar:
        """Kinetic plus potential energy, in J, over scalars of any kind."""
        energy: Scalar = self.mechanism.equations.energy_regressor(q, v) @ parameters
        return energy

    def primary(self, q: Column) -> Column:
        """The primary joints' positions p (r,) among the tree's q (n,)."""
        return q if self._primary is None else Column(q[i] for i in self._primary)

    @cached_property
    def equation(self) -> Callable[[Column, Column, Column, Column], tuple[Column, Column]]:
        """A control period over scalars of any kind: from q (n,), v (r,), torque (r,) and parameters (P,) to the q and
        v at its end. Where an integrator has several stages, they share one body of the forward dynamics.

        With loops the dependent joints are integrated too, and one Newton step projects them back.
        """
        dt, equations = self.control_period / self.substeps, self.mechanism.equations
        several = self.integrator.stages > 1

        def motion(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
            """How the configuration and the velocities move: together, for loops need their Jacobian for both."""
            return equations.rates(q, v), equations.forward_dynamics(q, v, torque, parameters)

        moved = outlined(motion) if several else motion

        def substep(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
            def at(q: Column, v: Column) -> tuple[Column, Column]:
                braked = torque
                for effect in self.friction:
                    braked = braked - effect.torque(v)
                return moved(q, v, braked, parameters)

            rates = (lambda q, v: at(q, v)[0]) if several else equations.rates
            q, v = self.integrator.step(lambda q, v: at(q, v)[1], q, v, dt, rates)
            return equations.projected(q), v

        repeated = outlined(substep) if self.substeps > 1 else substep

        def advance(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
            held = self.limited_equation(torque)
            for _ in range(self.substeps):
                q, v = repeated(q, v, held, parameters)
            return q, v

        return advance

    def _native(self, equation: Callable[..., tuple[Column, ...]], name: str, **sizes: int) -> Callable[..., Any]:
        if len(self.mechanism.links) > LARGEST_COMPILED:
            return _on_floats(equation)
        return compile_function(equation, sizes | {"parameters": self.mechanism.equations.parameters}, name=name).call

    @cached_property
    def _primary(self) -> list[int] | None:
        """The primary joints among the tree's; None for a tree, where they are all."""
        return None if self.mechanism.description.loops is None else list(self.mechanism.description.primary)

    @cached_property
    def _limits(self) -> list[float]:
        return np.asarray(self.torque_limits).tolist()

    @cached_property
    def _upper(self) -> Array:
        return np.array(self._limits)

    @cached_property
    def _lower(self) -> Array:
        return -self._upper

    def _finite(self, torque: ArrayLike) -> Array:
        array = torque if isinstance(torque, np.ndarray) else np.asarray(torque)
        if array.dtype != np.float64 or array.shape != (self.dof,) or not math.isfinite(array.dot(array)):
            return self._vector(array, "torque")
        return array

    def _vector(self, values: ArrayLike, what: str) -> Array:
        array = checked(np.atleast_1d(np.asarray(values)), self.dof, f"{self.mechanism.name}: {what}")
        if array.ndim != 1:
            raise InputError(f"{self.mechanism.name}: {what}: expected shape ({self.dof},), got {array.shape}")
        return array

    def _blame(self, state: PlantState, parameters: ArrayLike) -> NoReturn:
        self._vector(state.p, "p"), self._vector(state.v, "v")
        checked(parameters, self.mechanism.equations.parameters, f"{self.mechanism.name}: parameters")
        raise NonFiniteError(
            f"{self.mechanism.name}: the motion ran away after {state.time:g} s: use a shorter control period or "
            "more substeps, weaker gains, and parameters whose mass matrix is positive definite"
        )


def _limits(values: ArrayLike, dof: int) -> Array:
    limits = np.broadcast_to(np.asarray(values, dtype=np.float64), (dof,)) if np.ndim(values) == 0 else values
    array = np.array(limits, dtype=np.float64)
    if array.shape != (dof,) or not np.all(array > 0.0):
        raise InputError(f"torque_limits: expected {dof} positive numbers, got {array.tolist()}")
    array.flags.writeable = False
    return array


def _on_floats(equation: Callable[..., tuple[Column, ...]]) -> Callable[..., tuple[Array, ...]]:
    """The same equation in Python, for mechanisms too long to compile."""

    def on_arrays(*arrays: ArrayLike) -> tuple[Array, ...]:
        columns = equation(*(Column(np.asarray(array, dtype=np.float64).tolist()) for array in arrays))
        return tuple(np.array(column.of, dtype=np.float64) for column in columns)

    return on_arrays
