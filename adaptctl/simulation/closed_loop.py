"""Plant and controller as one compiled step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from math import inf
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, whole_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import GAINS, Controller, Reference, ReferencePoint
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics.equations import ClosedPositions
from adaptctl.errors import InputError, validate_kind
from adaptctl.scalars import Column, Structure, where
from adaptctl.simulation.law_operations import count
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import REFERENCE

_NOTHING = (Column(()), Column(()))
QUICK_PERIODS = 50_000
"""control periods up to which what optimized code would save is less than its compilation takes"""
LATE = "late"
"""column of 1 where torques act a period late, in a single loop of a controller that remembers its last torque"""


class Sample(NamedTuple):
    """Record of one control period, with the state at its beginning."""

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
    """
    Closed loop of a plant and a controller, whose control period is compiled to native code.

    Parameters
    ----------
    plant : Plant
        Robot with r joints.
    controller : Controller
        Controller for r joints.

    Raises
    ------
    InputError
        If plant and controller differ in their number of joints.

    Notes
    -----
    Loops that differ only in gains are equal and share native code.

    Examples
    --------
    >>> loop = adaptctl.simulation.ClosedLoop(plant, law)
    >>> loop
    <ClosedLoop of 'two_link' and SlotineLi>
    >>> loop.state["q"], loop.reference["reference_p"]
    (2, 2)
    """

    plant: Plant
    controller: Controller[Any]

    def __post_init__(self) -> None:
        validate_kind(self.plant, Plant, "closed loop", "as Plant(mechanism, 1e-3) is one")
        validate_kind(self.controller, Controller, "closed loop", "as SlotineLi(...) is one")
        if self.plant.dof != self.controller.dof:
            raise InputError(
                f"closed loop: the plant has {self.plant.dof} joints, but the controller has {self.controller.dof}"
            )

    def __repr__(self) -> str:
        return f"<ClosedLoop of {self.plant.mechanism.name!r} and {type(self.controller).__name__}>"

    @cached_property
    def state(self) -> dict[str, int]:
        """Lengths by name of the columns of plant and controller state."""
        measured = dict.fromkeys(("measured_p", "measured_v"), self.controller.dof if self._senses else 0)
        memory = {f"memory_{k}": len(part) for k, part in enumerate(leaves(self.controller._blank))}
        return self.plant.sizes | measured | memory

    @property
    def held(self) -> dict[str, int]:
        """Lengths by name of the columns that are constant over a run, "parameters" and "gains"."""
        return {"parameters": self.plant.mechanism.equations.parameters} | self.controller.gain_sizes

    @property
    def reference(self) -> dict[str, int]:
        """Lengths by name of the input columns of a reference point."""
        return dict.fromkeys(REFERENCE, self.controller.reference_size)

    @property
    def noise(self) -> dict[str, int]:
        """Length of the column "noise": 2r, or 0 without sensors."""
        return {"noise": self.plant.noise_size}

    def equation(self, **columns: Column) -> tuple[list[Column], Sample]:
        """
        Compute one control period from Columns of floats, arrays or graph nodes.

        Parameters
        ----------
        **columns : Column
            Columns (n,) of the properties `state`, `held`, `reference` and `noise`, by name, SI units; without "gains"
            the controller's own are used.

        Returns
        -------
        tuple
            Columns of the next state, in the order of `state`, and the `Sample` of the period.

        Raises
        ------
        KeyError
            If a column is missing; lengths are not checked.
        """
        q, v = columns["q"], columns["v"]
        measured = columns["measured_p"], columns["measured_v"]
        reference = ReferencePoint(*(columns[name] for name in REFERENCE))
        memory = like(self.controller._blank, (columns[name] for name in self.state if name.startswith("memory")))
        exact = ClosedPositions(self.plant.primary(q), q, self.plant.mechanism.unconstrained.equations), v
        observed = measured if self._senses else exact
        law = self.controller.substituted(columns[GAINS]) if GAINS in columns else self.controller
        torque, after = law.law(*observed, reference, memory)
        if LATE in columns:
            late = columns[LATE][0] > 0.5
            torque = Column(where(late, old, new) for old, new in zip(memory.torque, torque, strict=True))
        outcome = self.plant.equation({**columns, "torque": torque})
        next_measured = (outcome.measured_p, outcome.measured_v) if self._senses else _NOTHING
        flags = Column((*outcome.flags, *(flag[0] for flag in guards(after))))
        estimate = Column(getattr(after, "estimate", ()))
        energy = Column((self.plant.energy_equation(q, v, columns["parameters"], columns["drives"]),))
        done = (
            torque,
            outcome.applied_torque,
            outcome.clipped,
            estimate,
            flags,
            Column(getattr(after, "logged_state", ())),
        )
        return [*outcome[:4], *next_measured, *leaves(after)], Sample(q, v, *measured, energy, *done)

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags of a sample, those of the plant first."""
        return (*self.plant.flags, *getattr(guards(self.controller._blank), "_fields", ()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClosedLoop) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)

    @property
    def _parts(self) -> tuple[Structure, Structure]:
        return self.plant.structure, self.controller.structure

    def compiled(self, periods: float = inf) -> Stepper:
        """
        Compile one control period of plant and controller to native code.

        Parameters
        ----------
        periods : float, default infinity
            Control periods that will be computed, without a unit; for up to 50,000 the code is compiled quickly, and
            runs slower. By default it is optimized.

        Returns
        -------
        Stepper
            Compiled control period; its `ensemble` allocates the states of many closed loops. The code of the last 8
            loops is kept.

        Raises
        ------
        TraceError
            If the controller's law cannot be traced into an expression graph.
        """
        codes = self._codes()
        quick = periods <= QUICK_PERIODS and False not in codes
        if quick not in codes:
            made = self._made(quick)
            codes |= {quick: made, made.quick: made}
        return codes[quick]

    @lru_cache(maxsize=8)  # noqa: B019  # some code is worth keeping, and its loop with it
    def _codes(self) -> dict[bool, Stepper]:
        """Code of this loop, for few periods and for any."""
        return {}

    def _made(self, quick: bool) -> Stepper:
        shared, name = self.reference | self.noise, type(self.controller).__name__
        held = self.held | ({LATE: 1} if isinstance(self.controller._blank, AdaptiveState) else {})
        return compile_step(
            self._counted, state=self.state, constants=held, inputs=shared, lanes=1, name=name, quick=quick
        )

    def _counted(self, **columns: Column) -> tuple[Any, ...]:
        results, states = self.step(**columns), len(self.state)
        memory = results[len(self.plant.sizes) + len(_NOTHING) : states]
        if not self.plant.mechanism.description.closed:  # as the plant closes loops, too
            count(self.controller, chain(Sample(*results[states:]).torque, *memory))
        return results

    def step(self, **columns: Column) -> tuple[Any, ...]:
        """
        Compute one control period, as `equation` does, with all results in one flat tuple.

        Parameters
        ----------
        **columns : Column
            Columns (n,) by name in SI units, as in `equation`.

        Returns
        -------
        tuple
            Columns of the next state, then the fields of the `Sample`.

        Raises
        ------
        KeyError
            If a column is missing.
        """
        passed_on, sample = self.equation(**columns)
        return (*passed_on, *sample)

    def set_state(self, arms: Ensemble, state: PlantState, memory: Any) -> None:
        """
        Set the states of plant and controller in M closed loops.

        Parameters
        ----------
        arms : Ensemble
            Robots, as `compiled().ensemble` returns them.
        state : PlantState
            State of `Plant.init`, for one robot or M.
        memory : object
            Internal state of `Controller.init`, for one robot or M.

        Raises
        ------
        InputError
            If the arms are of another loop or arrays do not fit.
        ValueError
            If the internal state has another number of arrays.
        """
        self._validate_own(arms)
        plant = state.q, state.v, state.drives, state.sensors
        measured = (state.measured_p, state.measured_v) if self._senses else np.zeros((2, 0))
        for name, values in zip(self.state, (*plant, *measured, *leaves(memory)), strict=True):
            arms.state[name] = values
        for name in self.controller.gain_sizes:
            arms.held[name] = self.controller.packed

    def get_state(self, arms: Ensemble, time: float, member: int = 0) -> tuple[PlantState, Any]:
        """
        Return the state of one closed loop.

        Parameters
        ----------
        arms : Ensemble
            Robots, as `compiled().ensemble` returns them.
        time : float
            Time in s, put into the state as it is.
        member : int, default 0
            Index of the robot, from 0. The first by default, the only one of a single loop.

        Returns
        -------
        tuple
            The `PlantState`, whose `applied_torque`, `clipped` and `flags` are zero, and the controller's internal
            state.

        Raises
        ------
        InputError
            If no robot has this index or the arms are of another loop.

        Examples
        --------
        >>> loop = adaptctl.simulation.ClosedLoop(plant, law)
        >>> arms = loop.compiled().ensemble(1)
        >>> loop.set_state(arms, plant.init(p, v), law.init(p, v))
        >>> bool(np.allclose(loop.get_state(arms, 0.0)[0].p, p))
        True
        """
        self._validate_own(arms)
        member = whole_number(member, "closed loop: member", 0, arms.members - 1)
        q, v, drives, sensors, *rest = (arms.state[name][member] for name in self.state)
        p = self.plant.positions(q)
        measured, memory = rest[:2] if self._senses else (p, v), like(self.controller._blank, rest[2:])
        done = np.zeros(len(p)), False, np.zeros(len(self.plant.flags))
        return PlantState(time, p, v, q, measured[0], measured[1], *done, drives, sensors), memory

    def _validate_own(self, arms: Ensemble) -> None:
        for name, length in self.state.items():
            found = arms.state.columns.get(name, "none")
            if found != length:
                raise InputError(f"closed loop: expected {name} of length {length}, got {found}")

    @property
    def _senses(self) -> bool:
        return self.plant.noise_size > 0


def not_compiled(plant: Plant, controller: Controller[Any]) -> str:
    """Reason why the two cannot be compiled, or ""."""
    for part, kind in ((controller, Controller), (plant, Plant)):
        if type(part).step is not kind.step:
            return f"{type(part).__name__} has a custom step"
    links = len(plant.mechanism.links)
    return f"{links} links are too many to compile" if links > MAX_COMPILED_LINKS else ""


class Driven(ABC):
    """Base class of native runs that proceed in chunks."""

    loop: ClosedLoop
    steps: int
    control_period: float

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of control periods done."""

    @abstractmethod
    def advance(self) -> object:
        """Compute the next chunk."""

    @property
    def over(self) -> bool:
        """True if the run has ended."""
        return self.count >= self.steps

    def drive(self, progress: Callable[[float], object] | None) -> tuple[float, bool]:
        """Computing time (s), and False after Ctrl-C."""
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
        """Times (s) of the next control periods with constant true parameters."""
        times = self.control_period * np.arange(self.count, min(self.steps, self.count + most))
        return np.asarray(times[: max(1, int(np.searchsorted(times, self.loop.plant.next_change_time(times[0]))))])


def guards(memory: Any) -> tuple[Any, ...]:
    """Names of a `SafetyFilter`'s flags, or ()."""
    flags = getattr(memory, "flags", ())
    return flags if isinstance(flags, tuple) else ()


Judge: TypeAlias = Callable[[Array, Array, ReferencePoint, Array], tuple[Array, NDArray[np.bool_]]]
"""From q (..., n), v (..., r), the reference and the last torques (..., r) to rewards (...) and ends (...)."""


def _untold(parameters: Array, state: PlantState, steps: int, clipped: int, energy: float) -> dict[str, Any]:
    return {}


@sent_as_made
class Episode(NamedTuple):
    """
    Episode of one robot, with all that `simulate` needs to run it in native code.

    Parameters
    ----------
    plant : Plant
        Robot with r joints.
    state : PlantState
        Its initial state.
    parameters : ndarray
        True inertial and friction parameters (P,) without loads, SI units, ordered as `Mechanism.parameter_names`.
    reference : Reference
        Trajectory, a function of times (T,) in s.
    rng : numpy.random.Generator
        Source of the sensors' noise.
    steps : int
        Control periods left.
    judge : callable
        Function of q (..., n), v (..., r), the `ReferencePoint` and the torques (..., r) just applied that returns
        rewards (...) and a mask (...) of episodes that end.
    info : callable, optional
        Function of parameters, state, steps, clipped count and energy (J) that returns what `Env.step` reports.
        Default: an empty dict.

    Notes
    -----
    An environment's method `episode(seed=..., options=...)` returns it, or raises `NotImplementedError`.

    Examples
    --------
    >>> env.episode(seed=0)
    <Episode of 'two_link': 200 control periods>
    """

    plant: Plant
    state: PlantState
    parameters: Array
    reference: Reference
    rng: np.random.Generator
    steps: int
    judge: Judge
    info: Callable[[Array, PlantState, int, int, float], dict[str, Any]] = _untold

    def __repr__(self) -> str:
        return f"<Episode of {self.plant.mechanism.name!r}: {self.steps} control periods>"
