"""Interface of exported code."""

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

ARGUMENTS = ("p", "v", *(f"reference.{part}" for part in ReferencePoint._fields))


@dataclass(frozen=True)
class Field:
    """Named array of a controller's internal state or gains."""

    name: str
    values: Array
    labels: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of scalars in the field."""
        return int(self.values.size)

    @property
    def dimensions(self) -> str:
        """C text of the shape, such as "[3][2]"."""
        return "".join(f"[{n}]" for n in self.values.shape)

    def place(self, k: int) -> str:
        """C text of the number k of the field, such as "gain[2][0]"."""
        where = np.unravel_index(k, self.values.shape) if self.values.shape else ()
        return self.name + "".join(f"[{int(i)}]" for i in where)

    def label(self, k: int) -> str:
        """Name of the number k, such as a joint's, or ""."""
        return self.labels[k % len(self.labels)] if self.labels else ""


WRAPPED_PATH = "inner."
"""part of a path from a wrapper to its inner controller"""


class Brake(NamedTuple):
    """Replacement torque -damping v within the limits."""

    damping: Array
    limit: Array


@dataclass(frozen=True, eq=False)
class Interface:
    """Arguments, results, state, gains and traced law of exported code."""

    controller: Controller[Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "controller", self.controller.fixed())

    @cached_property
    def law(self) -> Routine:
        """Control step as a traced routine."""
        law = self.controller
        sizes = law._given_sizes | law._memory_sizes | law.gain_sizes
        return trace(law._equation(), sizes, name="law")

    @cached_property
    def innermost(self) -> Controller[Any]:
        """Controller without any `SafetyFilter`."""
        law: Any = self.controller
        while isinstance(law, SafetyFilter):
            law = law.inner
        return law

    @property
    def guarded(self) -> bool:
        """True if the controller is a `SafetyFilter`."""
        return isinstance(self.controller, SafetyFilter)

    @cached_property
    def brake(self) -> Brake | None:
        """Brake of the guards, None without guards."""
        law = self.controller
        if not isinstance(law, SafetyFilter):
            return None
        damping, limit = (per_joint(np.asarray(x), law.dof, "brake") for x in (law.stop_damping, law.torque_limits))
        return Brake(damping, np.minimum(limit, np.finfo(np.float64).max))

    @cached_property
    def model(self) -> ReducedModel | None:
        """Reduced model of the law, None without one."""
        return getattr(self.innermost, "model", None)

    @cached_property
    def mechanism(self) -> Mechanism | None:
        """Mechanism of the controller, or None."""
        return self.model.mechanism if self.model else getattr(self.innermost, "mechanism", None)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names (r,) of the joints."""
        if self.mechanism is None:
            return tuple(f"joint{k + 1}" for k in range(self.controller.dof))
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def follows_joints(self) -> bool:
        """True if the reference is of the r joints."""
        law = self.innermost
        if isinstance(law, TaskSpaceSlotineLi):
            return law.reference_in_joints
        return law.reference_size == law.dof

    @cached_property
    def control_period(self) -> float:
        """Control period in s, by default 0.001."""
        return float(
            getattr(self.controller, "control_period", None) or getattr(self.innermost, "control_period", None) or 1e-3
        )

    @cached_property
    def started(self) -> list[Array]:
        """Initial internal state at home and at rest."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(self.controller._blank)]

    @cached_property
    def memory(self) -> tuple[Field, ...]:
        """Fields of the internal state with their initial values."""
        found = zip(short_names(self._state_paths), self.started, strict=True)
        return tuple(Field(name, values, self._labels(name, values.size)) for name, values in found)

    @cached_property
    def estimate(self) -> Field | None:
        """Field of the parameter estimate, None without one."""
        wanted = getattr(self.controller._blank, "estimate", None)
        pairs = zip(self.memory, leaves(self.controller._blank), strict=True)
        return next((field for field, leaf in pairs if leaf is wanted), None)

    @property
    def applied(self) -> tuple[Field, ...]:
        """Fields in which guards remember the applied torque."""
        if not self.guarded:
            return ()
        pairs = zip(self.memory, self._state_paths, strict=True)
        return tuple(field for field, path in pairs if path.replace(WRAPPED_PATH, "") == "torque")

    @cached_property
    def gains(self) -> tuple[Field, ...]:
        """Gains that the law reads, with their values."""
        used = self._gain_places
        return tuple(field for field, places in self._gain_fields() if used & places)

    @cached_property
    def all_gains(self) -> tuple[Field, ...]:
        """All gains as `Field`s with values, SI units."""
        return tuple(field for field, _ in self._gain_fields())

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """Names of the guards' flags in their order."""
        return tuple(getattr(guards(self.controller._blank), "_fields", ()))

    def memory_of(self, state: Any) -> list[Array]:
        """Internal state in Python as a list of arrays."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(state)]

    def names_of_constants(self) -> dict[float, str]:
        """Names of the law's constant parameters, by magnitude."""
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
        part = len(ARGUMENTS) + len(self.controller._memory_sizes)
        return {x.detail[1] for x in self.law.body if x.op is Op.INPUT and x.detail[0] == part}

    def _gain_fields(self) -> Iterator[tuple[Field, set[int]]]:
        first = 0
        numbers = self.controller.numbers
        for name, values in zip(short_names(list(numbers)), numbers.values(), strict=True):
            field = Field(name, values, self._labels(name, values.shape[-1] if values.ndim else 0))
            yield field, set(range(first, first + field.size))
            first += field.size

    def _labels(self, name: str, size: int) -> tuple[str, ...]:
        """Names of numbers by their count."""
        if self.model is not None and size == len(self.model.names) and "q" not in name.split("_"):
            return tuple(self.model.names)
        if size == len(self.joints):
            return self.joints
        if self.mechanism is not None and size == len(self.mechanism.links):
            return self.mechanism.description.joint_names
        return ()


def short_names(paths: list[str]) -> list[str]:
    """C names of dotted paths, with `law_` where inner ones clash."""
    short = [path.replace(WRAPPED_PATH, "").replace(".", "_") for path in paths]
    names: list[str] = []
    for path, name in zip(paths, short, strict=True):
        depth = path.count(WRAPPED_PATH)
        names.append(name if short.count(name) == 1 or not depth else "law_" * depth + name)
    return names


def validate_controller(controller: object) -> None:
    """Raise `InputError` unless its `step` is that of its law."""
    if not isinstance(controller, Controller):
        raise InputError(f"controller: expected a Controller, got {type(controller).__name__}")
    if type(controller).step is not Controller.step:
        raise InputError(f"controller: {type(controller).__name__} has a custom step, which cannot be traced")


ORDINARY = ("TORQUE_LIMITED", "RATE_LIMITED", "FROZEN", "BOUNDED", "RINGING")
"""status bits with which the law goes on"""


class StatusBit(NamedTuple):
    """Bit of the status of exported code: name, value and meaning."""

    name: str
    value: int
    meaning: str

    @property
    def is_ordinary(self) -> bool:
        """True if the law goes on."""
        return self.name in ORDINARY


FAULTS = (
    StatusBit("NOT_FINITE", 1, "a measurement, a reference or a result is not finite, or an angle is too large"),
    StatusBit("WRONG_STATE", 2, "the state is not initialised, or from other code"),
    StatusBit("NOT_CLOSED", 4, "the loops cannot be closed there, or are nearly singular"),
)
_MARKS = {
    "torque_limited": "a torque was limited",
    "rate_limited": "a torque rate was limited",
    "frozen": "adaptation is frozen in the period that begins",
    "bounded": "an estimate was projected onto its bounds",
    "ringing": "the sliding variable of a joint changes sign from step to step",
    "stopped": "a value was not finite, out of bounds or oscillating, now or before: the arm is braked",
}


def status_bits(interface: Interface) -> tuple[StatusBit, ...]:
    """All status bits of a controller's exported code."""
    own = enumerate(interface.flags, start=len(FAULTS))
    return (*FAULTS, *(StatusBit(name.upper(), 1 << k, _MARKS.get(name, name)) for k, name in own))


def status_of(interface: Interface, state: Any) -> int:
    """Status of a control step by its guards."""
    bits = status_bits(interface)[len(FAULTS) :]
    return sum(bit.value for bit, flag in zip(bits, guards(state), strict=True) if flag[0])
