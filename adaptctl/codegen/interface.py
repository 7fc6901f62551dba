"""Interface of exported code: a controller's arguments, memory and results, by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, per_joint
from adaptctl.caching import cached_property
from adaptctl.compilation.graph import Op
from adaptctl.compilation.routine import Routine, trace
from adaptctl.control import Controller, SafetyFilter, TaskSpaceSlotineLi
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.pytree import leaves
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation.closed_loop import guards

GIVEN = ("p", "v", *(f"reference.{part}" for part in ReferencePoint._fields))


@dataclass(frozen=True)
class Field:
    """Field of a controller's exported code, a named array of numbers of its internal state or gains. It has a `name`;
    initial `values`, in SI units, whose shape is the field's; and `labels`, names, such as those of joints or
    parameters, of the numbers along the last axis, the same for every row; empty, the default, where they have none.
    Nothing is checked."""

    name: str
    values: Array
    labels: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of scalars in the field, the product of its axes' lengths."""
        return int(self.values.size)

    @property
    def dimensions(self) -> str:
        """The C text of the field's shape, such as "[3][2]"; empty for a single number."""
        return "".join(f"[{n}]" for n in self.values.shape)

    def place(self, k: int) -> str:
        """The C text of the field's number of zero-based index `k` in row-major order, such as "gain[2][0]"; for a
        field of a single number its name. Raises `ValueError` for an index out of range."""
        where = np.unravel_index(k, self.values.shape) if self.values.shape else ()
        return self.name + "".join(f"[{int(i)}]" for i in where)

    def label(self, k: int) -> str:
        """Name of the field's number of zero-based index `k` in row-major order, such as a joint's or a parameter's;
        empty where the numbers have no names. Nothing is checked: an index out of range counts on from the first
        name."""
        return self.labels[k % len(self.labels)] if self.labels else ""


INNER = "inner."
"""Part of a path that leads from a wrapper, such as a safety filter, to what it wraps."""


class Brake(NamedTuple):
    """Brake of a guarded controller's exported code, which replaces a torque that the law cannot give: -`damping` v for
    joint velocities v, within plus and minus `limit`. `damping` (r,), N m s/rad (N s/m if prismatic), and `limit` (r,),
    N m (N), finite, are of the r joints. Nothing is checked."""

    damping: Array
    limit: Array


@dataclass(frozen=True, eq=False)
class Interface:
    """Interface of a `controller` in exported code: by name, the arguments and results of a tick (the work of one
    control period), the internal state and the gains; and the controller's law as a traced `Routine`. Properties are
    computed when they are first asked for; nothing is checked at construction."""

    controller: Controller[Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "controller", self.controller.fixed())

    @cached_property
    def law(self) -> Routine:
        """One tick of the controller (its work in a control period) as a traced `Routine`, from which exported code is
        written. Its arguments are positions, velocities, the reference's positions, velocities and accelerations, in
        rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic), the internal state's fields and, where there are any,
        all gains in one vector, in the order of the property `all_gains`; its results are the torque and the internal
        state's fields after the tick. Raises `TraceError` for a law that cannot be traced, `InputError` for one that
        does not return a torque and an internal state."""
        law = self.controller
        sizes = law._given_sizes | law._memory_sizes | law.gain_sizes
        return trace(law._equation(), sizes, name="law")

    @cached_property
    def innermost(self) -> Controller[Any]:
        """The controller itself, or, where it is `SafetyFilter` (behind guards), the one within all guards."""
        law: Any = self.controller
        while isinstance(law, SafetyFilter):
            law = law.inner
        return law

    @property
    def guarded(self) -> bool:
        """True if the controller is `SafetyFilter`: guards limit its torque and brake the arm in its stead; False
        otherwise."""
        return isinstance(self.controller, SafetyFilter)

    @cached_property
    def brake(self) -> Brake | None:
        """The `Brake` of the controller's guards, its damping and torque limits; None for a controller without
        guards."""
        law = self.controller
        if not isinstance(law, SafetyFilter):
            return None
        damping, limit = (per_joint(np.asarray(x), law.dof, "brake") for x in (law.stop_damping, law.torque_limits))
        return Brake(damping, np.minimum(limit, np.finfo(np.float64).max))

    @cached_property
    def model(self) -> ReducedModel | None:
        """The `ReducedModel`, a robot's model on its fundamental (base) parameters, with which the controller's law
        computes; None for a law without one."""
        return getattr(self.innermost, "model", None)

    @cached_property
    def mechanism(self) -> Mechanism | None:
        """The `Mechanism` that the controller drives; None where its law has neither a reduced model nor an attribute
        `mechanism`."""
        return self.model.mechanism if self.model else getattr(self.innermost, "mechanism", None)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the r primary joints (the degrees of freedom), in the order of positions, velocities and torque;
        "joint1", "joint2", ... where the controller's mechanism is not known."""
        if self.mechanism is None:
            return tuple(f"joint{k + 1}" for k in range(self.controller.dof))
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def follows_joints(self) -> bool:
        """True if the points of the controller's reference are positions of its r joints; False if they are of another
        space, such as a task space."""
        law = self.innermost
        if isinstance(law, TaskSpaceSlotineLi):
            return law.reference_in_joints
        return law.reference_size == law.dof

    @cached_property
    def control_period(self) -> float:
        """Control period, s: the controller's own, or 0.001 where it has none, since its law then does not depend on
        it."""
        return float(
            getattr(self.controller, "control_period", None) or getattr(self.innermost, "control_period", None) or 1e-3
        )

    @cached_property
    def started(self) -> list[Array]:
        """The controller's initial internal state, at its home configuration and at rest: a list of float64 arrays, one
        for each of the state's fields, in SI units."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(self.controller._blank)]

    @cached_property
    def memory(self) -> tuple[Field, ...]:
        """The fields of the controller's internal state between control periods, a `Field` each, empty ones too, with
        their initial values at the home configuration and at rest, in SI units."""
        found = zip(short_names(self._state_paths), self.started, strict=True)
        return tuple(Field(name, values, self._labels(name, values.size)) for name, values in found)

    @cached_property
    def estimate(self) -> Field | None:
        """The `Field` of the controller's internal state that holds the estimate of the law's parameters, SI units;
        None where the law has none."""
        wanted = getattr(self.controller._blank, "estimate", None)
        pairs = zip(self.memory, leaves(self.controller._blank), strict=True)
        return next((field for field, leaf in pairs if leaf is wanted), None)

    @property
    def applied(self) -> tuple[Field, ...]:
        """The fields of the internal state in which guards, and the laws within them, remember the torque that is
        applied to the joints; empty without guards."""
        if not self.guarded:
            return ()
        pairs = zip(self.memory, self._state_paths, strict=True)
        return tuple(field for field, path in pairs if path.replace(INNER, "") == "torque")

    @cached_property
    def gains(self) -> tuple[Field, ...]:
        """The controller's gains that its law reads in a control period, a `Field` each, with their values, in SI
        units, in the order of the property `all_gains`. Raises `TraceError` for a law that cannot be traced."""
        used = self._gain_places
        return tuple(field for field, places in self._gain_fields() if used & places)

    @cached_property
    def all_gains(self) -> tuple[Field, ...]:
        """All gains of the controller, a `Field` each, with their values, in SI units. In this order, each in row-major
        order, they form the one vector of gains that the controller's law takes."""
        return tuple(field for field, _ in self._gain_fields())

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags that the controller's guards set in the internal state in each control period, such as
        "torque_limited" or "stopped", in their order there; empty without guards."""
        return tuple(getattr(guards(self.controller._blank), "_fields", ()))

    def memory_of(self, state: Any) -> list[Array]:
        """The internal state `state` of the controller in Python, a named tuple, as a list of float64 arrays, SI units,
        in the order of the fields of this object's property `memory`. Nothing is checked: a state of another controller
        gives its own arrays."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(state)]

    def names_of_constants(self) -> dict[float, str]:
        """Names of the mechanism's parameters whose values are constants in the law, by the values' magnitudes, for
        comments in code; names of equal values are joined by commas, and 0, 0.5, 1 and 2 are left out. Empty where the
        law has no fixed parameters. Nothing is raised."""
        values = getattr(self.innermost, "parameters", None)
        if self.mechanism is None or isinstance(values, Column) or values is None:
            return {}
        found: dict[float, str] = {}
        for name, value in zip(self.mechanism.parameter_names, np.abs(np.asarray(values)).tolist(), strict=False):
            if value not in (0.0, 0.5, 1.0, 2.0):
                found[value] = f"{found[value]}, {name}" if value in found else name
        return found

    @property
    def _state_paths(self) -> list[str]:
        return [path.removeprefix("state.") for path in self.controller._memory_sizes]

    @property
    def _gain_places(self) -> set[int]:
        part = len(GIVEN) + len(self.controller._memory_sizes)
        return {x.detail[1] for x in self.law.body if x.op is Op.INPUT and x.detail[0] == part}

    def _gain_fields(self) -> Iterator[tuple[Field, set[int]]]:
        first = 0
        numbers = self.controller.numbers
        for name, values in zip(short_names(list(numbers)), numbers.values(), strict=True):
            field = Field(name, values, self._labels(name, values.shape[-1] if values.ndim else 0))
            yield field, set(range(first, first + field.size))
            first += field.size

    def _labels(self, name: str, size: int) -> tuple[str, ...]:
        """Names of numbers by their count: parameters or joints; tree joints where there are loops."""
        if self.model is not None and size == len(self.model.names) and "q" not in name.split("_"):
            return tuple(self.model.names)
        if size == len(self.joints):
            return self.joints
        if self.mechanism is not None and size == len(self.mechanism.links):
            return self.mechanism.description.joint_names
        return ()


def short_names(paths: list[str]) -> list[str]:
    """Names in C of dotted paths: what a wrapped law has goes by its own name, or with `law_` where the "
    "wrapper has it."""
    short = [path.replace(INNER, "").replace(".", "_") for path in paths]
    names: list[str] = []
    for path, name in zip(paths, short, strict=True):
        depth = path.count(INNER)
        names.append(name if short.count(name) == 1 or not depth else "law_" * depth + name)
    return names


def validate_controller(controller: object) -> None:
    """Raise `InputError` unless `controller` is a `Controller` that does not override `step`, so that its steps are
    those of its law, which is what exported code is written from."""
    if not isinstance(controller, Controller):
        raise InputError(f"controller: expected a Controller, got {type(controller).__name__}")
    if type(controller).step is not Controller.step:
        raise InputError(f"controller: {type(controller).__name__} has a step of its own, which no graph knows of")


class StatusBit(NamedTuple):
    """A bit of the status that exported code returns for a tick (the work of one control period): its `name`, such as
    "NOT_FINITE", its `value`, a power of 2, and its `meaning`, a clause in English. Nothing is checked."""

    name: str
    value: int
    meaning: str


FAULTS = (
    StatusBit(
        "NOT_FINITE", 1, "a measurement, a reference or the outcome is not finite, or an angle is too far to turn"
    ),
    StatusBit("WRONG_STATE", 2, "the state did not begin, or is another code's"),
    StatusBit("NOT_CLOSED", 4, "the loops cannot be closed there, or nearly lock"),
)
_MARKS = {
    "torque_limited": "a torque was beyond its limit",
    "rate_limited": "a torque would have changed too fast",
    "frozen": "nothing is learned from the period that begins",
    "bounded": "an estimate was brought back to its bounds",
    "ringing": "a joint's sliding variable changes its sign from tick to tick",
    "stopped": "something was not finite, out of bounds or ringing, now or before: the arm is braked",
}


def status_bits(interface: Interface) -> tuple[StatusBit, ...]:
    """All status bits, a `StatusBit` each, of a controller's exported code, from its `interface`: NOT_FINITE (1),
    WRONG_STATE (2) and NOT_CLOSED (4), then, from 8 on, one for each flag that its guards set, such as TORQUE_LIMITED.
    Nothing is raised."""
    own = enumerate(interface.flags, start=len(FAULTS))
    return (*FAULTS, *(StatusBit(name.upper(), 1 << k, _MARKS.get(name, name)) for k, name in own))


def status_of(interface: Interface, state: Any) -> int:
    """The status of a tick, an integer, as far as a controller's guards decide it: the sum of the status bits whose
    flags are set in `state`, the controller's internal state after the tick in Python; 0 without guards. Faults, such
    as NOT_FINITE, are not among them. Raises `ValueError` for a state with another number of flags than the controller
    of the `interface` has."""
    bits = status_bits(interface)[len(FAULTS) :]
    return sum(bit.value for bit, flag in zip(bits, guards(state), strict=True) if flag[0] > 0.5)
