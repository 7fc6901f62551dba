"""A plant and a controller as one step over scalars: a whole run is then one call of native code."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, whole_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.compilation.kernel import MAX_COMPILED_LINKS
from adaptctl.control.controller import GAINS, Controller, Reference, ReferencePoint
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics.equations import ClosedPositions
from adaptctl.errors import InputError, validate_kind
from adaptctl.scalars import Column, Structure
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import REFERENCE

_NOTHING = (Column(()), Column(()))


class Sample(NamedTuple):
    """The record of one control period of a closed loop: the state at its beginning, and the torques commanded and
    applied on it. Its parts are Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled), or
    arrays, with leading axes for more periods or arms. Nothing is checked.

    `q` (n,), rad (m if prismatic), are positions of the n joints of the plant's spanning tree; `v` (r,), rad/s (m/s),
    velocities of its r primary (independent) joints; `measured_p` and `measured_v` (r,), in the same units, what the
    sensors measured of these, (0,) without sensors; `energy` (1,), J, is kinetic plus potential. `torque` (r,), N m
    (N), was commanded, and `applied` (r,) reached the joints; `clipped` (1,) is 1 where the command was beyond the
    plant's torque limits, else 0. `estimate` (k,) has the controller's k parameter estimates, SI units, after the
    period's evaluation of its law, k = 0 where it has none. `flags` (h,), named in `ClosedLoop.flags`, are 1 where an
    actuator effect or a guard of the controller acted, else 0. `learning` (l,) has the l numbers that the adaptation
    law records of its internal state, l = 0 where it records none.
    """

    q: Any
    v: Any
    measured_p: Any
    measured_v: Any
    energy: Any
    torque: Any
    applied: Any
    clipped: Any
    estimate: Any
    flags: Any
    logged_state: Any


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A closed loop of a `plant` and a `controller` as one step, a control period: at its beginning the controller
    computes a torque from the plant's measured positions and velocities, and the plant holds it until the end.

    These columns (vectors of scalars) pass from one period to the next, in this order: q, positions of the n joints of
    the plant's spanning tree; v, velocities of its r primary (independent) joints; the internal states of the plant's
    drives and sensors; where there are sensors, the last measurement; and the controller's internal state. Loops that
    differ in tunable gains alone are equal, and share native code. Raises `InputError` where plant and controller
    differ in their number r of joints.
    """

    plant: Plant
    controller: Controller[Any]

    def __post_init__(self) -> None:
        validate_kind(self.plant, Plant, "closed loop", "as Plant(mechanism, 1e-3) is one")
        validate_kind(self.controller, Controller, "closed loop", "as SlotineLi(...) is one")
        if self.plant.dof != self.controller.dof:
            raise InputError(
                f"closed loop: the plant has {self.plant.dof} joints, the controller is for {self.controller.dof}"
            )

    @cached_property
    def state(self) -> dict[str, int]:
        """Lengths, by name, of the columns (vectors) that pass from one control period of the closed loop to the next.
        They are "q", the n joints of the plant's spanning tree; "v", its r primary (independent) joints; "drives" and
        "sensors", the internal states of the plant's effects; "measured_p" and "measured_v", r each, or 0 where nothing
        is measured; and "memory_0", "memory_1", ..., the arrays of the controller's internal state."""
        measured = dict.fromkeys(("measured_p", "measured_v"), self.controller.dof if self._senses else 0)
        memory = {f"memory_{k}": len(part) for k, part in enumerate(leaves(self._blank))}
        return self.plant.sizes | measured | memory

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the columns (vectors) that are constant over a run of the closed loop: P for
        "parameters", the plant's inertial and friction parameters in the order of `Mechanism.parameter_names`, and,
        where there are any, g for "gains", the controller's tunable gains."""
        return {"parameters": self.plant.mechanism.equations.parameters} | self.controller.gain_sizes

    @property
    def reference(self) -> dict[str, int]:
        """Lengths, by name, of a reference point's columns (vectors) "reference_p", "reference_v" and "reference_a"
        (positions, velocities, accelerations): the number of joints r each, or for a task-space controller that of its
        task-space coordinates."""
        return dict.fromkeys(REFERENCE, self.controller.reference_size)

    @property
    def noise(self) -> dict[str, int]:
        """Length, by its name, of the column (vector) "noise" of the standard normal numbers (no unit) that the sensors
        take in a control period: 2r for r joints, the positions' first, or 0 where there are no sensor effects and no
        encoders on motors of elastic joints."""
        return {"noise": self.plant.noise_size}

    def equation(self, **columns: Column) -> tuple[list[Column], Sample]:
        """The closed loop's state after one control period and the `Sample` recorded of the period, a pair. The state
        is a list of columns (vectors) in the order of the property `state`; the sample has the period's positions,
        velocities, torques and energy (J). Scalars are of any kind: floats, arrays of samples, dual numbers, nodes of
        an expression graph.

        `columns` are, in SI units, those of the state before the period: "q", "v", "drives", "sensors", "measured_p",
        "measured_v" and "memory_0", "memory_1", ... (lengths in the property `state`); "parameters", the plant's P true
        inertial and friction parameters, in the order of `Mechanism.parameter_names`, and "gains", the controller's
        tunable numbers (lengths in the property `held`); "reference_p", "reference_v" and "reference_a", the
        reference's positions, velocities and accelerations, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic)
        (lengths in the property `reference`); "noise", the sensors' standard normal numbers, the positions' first.
        Without "gains" the controller's own are taken. Raises `KeyError` where another is missing; lengths are not
        checked.
        """
        q, v = columns["q"], columns["v"]
        measured = columns["measured_p"], columns["measured_v"]
        reference = ReferencePoint(*(columns[name] for name in REFERENCE))
        memory = like(self._blank, (columns[name] for name in self.state if name.startswith("memory")))
        exact = ClosedPositions(self.plant.primary(q), q, self.plant.mechanism.unconstrained.equations), v
        observed = measured if self._senses else exact
        law = self.controller.substituted(columns[GAINS]) if GAINS in columns else self.controller
        torque, after = law.law(*observed, reference, memory)
        outcome = self.plant.equation({**columns, "torque": torque})
        next_measured = (outcome.measured_p, outcome.measured_v) if self._senses else _NOTHING
        flags = Column((*outcome.flags, *(flag[0] for flag in guards(after))))
        estimate = Column(getattr(after, "estimate", ()))
        energy = Column((self.plant.energy_equation(q, v, columns["parameters"], columns["drives"]),))
        done = torque, outcome.applied, outcome.clipped, estimate, flags, Column(getattr(after, "logged_state", ()))
        return [*outcome[:4], *next_measured, *leaves(after)], Sample(q, v, *measured, energy, *done)

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags in a `Sample`, the record of a control period, in their order. Each is 1 in a period in
        which its effect or guard acted, else 0: first the plant's actuator effects that have a flag for a change of a
        torque, then the guards of a `SafetyFilter` controller, such as "torque_limited"."""
        return (*self.plant.flags, *getattr(guards(self._blank), "_fields", ()))

    def __eq__(self, other: object) -> bool:
        """True if the plants are equal, and the controllers but for their gains."""
        return isinstance(other, ClosedLoop) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)

    @property
    def _parts(self) -> tuple[Structure, Structure]:
        return self.plant.structure, self.controller.structure

    @lru_cache(maxsize=8)  # noqa: B019  # some code is worth keeping, and its loop with it
    def compiled(self) -> Stepper:
        """The compiled step of the loop, one control period in native code, one arm at a time, as a `Stepper`: its
        method `ensemble` makes arms, which are given the reference and the noise of each period as signals. The code of
        the 8 loops used last is kept. Raises `TraceError` where the controller's law cannot be traced into an
        expression graph."""
        shared, name = self.reference | self.noise, type(self.controller).__name__
        return compile_step(self.step, state=self.state, constants=self.held, inputs=shared, lanes=1, name=name)

    def step(self, **columns: Column) -> tuple[Any, ...]:
        """The closed loop's state after one control period, then the fields of the `Sample` recorded of the period, all
        in one tuple of columns (vectors of scalars of any kind). The state is in the order of the property `state`; it
        is what the method `equation` returns. `columns` are by name, in SI units, those of the properties `state`,
        `held`, `reference` and `noise`. Raises `KeyError` where one is missing; without "gains" the controller's own
        are taken."""
        passed_on, sample = self.equation(**columns)
        return (*passed_on, *sample)

    def begin(self, arms: Ensemble, state: PlantState, memory: Any) -> None:
        """Set all M `arms`, an `Ensemble` of copies of this loop's compiled step, to the beginning of a run: to the
        plants' `state` and the controller's internal state `memory`, which `Plant.init` and `Controller.init` return.
        Tunable gains, if any, become the controller's. Each array in `state` and `memory` is (length,), the same for
        all arms, or (M, length), length being that of its column. The plants' parameters, `arms.held["parameters"]`,
        are not changed. Returns nothing. Raises `InputError` for arms of another loop and where arrays do not fit the
        arms, `ValueError` for an internal state of another number of arrays."""
        self._validate_own(arms)
        plant = state.q, state.v, state.drives, state.sensors
        measured = (state.measured_p, state.measured_v) if self._senses else np.zeros((2, 0))
        for name, values in zip(self.state, (*plant, *measured, *leaves(memory)), strict=True):
            arms.state[name] = values
        for name in self.controller.gain_sizes:
            arms.held[name] = self.controller.packed

    def now(self, arms: Ensemble, time: float, member: int = 0) -> tuple[PlantState, Any]:
        """The plant's state and the controller's internal state, a pair, of one of the `arms` (copies of the compiled
        step): the arm of zero-based index `member`, 0 by default. `time` (s) is put into the state as it is. The
        state's `applied` (the torques applied), `clipped` and `flags` (flags of effects), which arms do not keep, are
        zero. Raises `InputError` for an index that no arm has and for arms of another loop."""
        self._validate_own(arms)
        member = whole_number(member, "closed loop: member", 0, arms.members - 1)
        q, v, drives, sensors, *rest = (arms.state[name][member] for name in self.state)
        p = self.plant.positions(q)
        measured, memory = rest[:2] if self._senses else (p, v), like(self._blank, rest[2:])
        done = np.zeros(len(p)), False, np.zeros(len(self.plant.flags))
        return PlantState(time, p, v, q, measured[0], measured[1], *done, drives, sensors), memory

    def _validate_own(self, arms: Ensemble) -> None:
        """Raise `InputError` for arms without one of the columns of `state`; they may have others besides."""
        for name, length in self.state.items():
            found = arms.state.columns.get(name, "none")
            if found != length:
                raise InputError(f"closed loop: arms of this loop have {name} of length {length}, these have {found}")

    @cached_property
    def _blank(self) -> Any:
        """A memory, to learn its layout from."""
        return self.controller.initial_state(self.controller.neutral_configuration, np.zeros(self.controller.dof))

    @property
    def _senses(self) -> bool:
        return self.plant.noise_size > 0


def not_compiled(plant: Plant, controller: Controller[Any]) -> str:
    """The reason why a plant and a controller cannot be compiled together, in words; empty if they can."""
    for part, kind in ((controller, Controller), (plant, Plant)):
        if type(part).step is not kind.step:
            return f"{type(part).__name__} has a step of its own"
    links = len(plant.mechanism.links)
    return f"{links} links are too many to compile" if links > MAX_COMPILED_LINKS else ""


class Driven(ABC):
    """Runs of a closed loop in the making, which native code takes a stretch of control periods at a time: `count` of
    `steps` control periods of `period` s are done. Nothing is checked."""

    loop: ClosedLoop
    steps: int
    control_period: float

    @property
    @abstractmethod
    def count(self) -> int:
        """The number of control periods done."""

    @abstractmethod
    def advance(self) -> object:
        """Take the next stretch, which counts when all of it is done."""

    @property
    def over(self) -> bool:
        """True if there is nothing left to be done."""
        return self.count >= self.steps

    def drive(self, progress: Callable[[float], object] | None) -> tuple[float, bool]:
        """The time, s, that it takes to do all that is left, which this call does, and False if Ctrl-C ended it. In
        between `progress`, if given, is called with the fraction done. Raises what `advance` and it raise."""
        complete, started = False, perf_counter()
        try:
            while not self.over:
                self.advance()
                if progress is not None:
                    progress(self.count / self.steps)
            complete = True
        except KeyboardInterrupt:
            pass
        return perf_counter() - started, complete

    def ahead(self, most: int) -> Array:
        """Times, s, of the next control periods, `most` at most and one at least, in which the true parameters stay as
        they are. Nothing is raised."""
        times = self.control_period * np.arange(self.count, min(self.steps, self.count + most))
        return np.asarray(times[: max(1, int(np.searchsorted(times, self.loop.plant.next_change_time(times[0]))))])


def guards(memory: Any) -> tuple[Any, ...]:
    """The flags of a controller's guards in `memory`, its internal state: where the controller is `SafetyFilter`, a
    named tuple of columns or arrays (1,) each, such as `torque_limited`, that are 1 where that guard acted in the last
    control period, else 0; an empty tuple for a controller without guards. Nothing is raised."""
    flags = getattr(memory, "flags", ())
    return flags if isinstance(flags, tuple) else ()


Judge: TypeAlias = Callable[[Array, Array, ReferencePoint, Array], tuple[Array, NDArray[np.bool_]]]
"""From configurations q (..., n), velocities (..., r), the reference there and the torques applied before (..., r), to
rewards (...) and whether the episode ends there (...)."""


def _untold(parameters: Array, state: PlantState, steps: int, clipped: int, energy: float) -> dict[str, Any]:
    return {}


@sent_as_made
class Episode(NamedTuple):
    """Episode of one arm: plant, state, reference trajectory and all else from which the function `simulate` runs it to
    its end in native code. Nothing is checked.

    `plant` is the arm, now at `state`; `parameters` (P,) are its P true inertial and friction parameters, SI units, in
    the order of `Mechanism.parameter_names`, without the loads of effects such as payloads; `reference` is the
    trajectory, a function from T times (T,), s, to a `ReferencePoint` (positions, velocities, accelerations); `rng`
    draws the sensors' noise, `Plant.noise_size` standard normal numbers a control period; `steps` is the number of
    control periods left. `judge(q, v, point, torque)` returns rewards (...), no unit, and a mask (...), True where the
    episode ends, from what was reached: configurations q (..., n) of the n joints of the spanning tree, rad (m if
    prismatic), velocities v (..., r) of the r primary (independent) joints, rad/s (m/s), the `ReferencePoint` there and
    the torques (..., r), N m (N), applied in the control period before.

    `info(parameters, state, steps, clipped, energy)` is what `Env.step` tells of a state of this energy, J, that was
    reached after so many control periods, of which `clipped` had a clipped torque. An environment begins an episode
    and returns it by `episode(seed=..., options=...)`, which draws what `reset` draws, and takes no step before the
    next `reset`. It raises `NotImplementedError`, with the reason as its message, where its `step` does anything else.
    """

    plant: Plant
    state: PlantState
    parameters: Array
    reference: Reference
    rng: np.random.Generator
    steps: int
    judge: Judge
    info: Callable[[Array, PlantState, int, int, float], dict[str, Any]] = _untold
