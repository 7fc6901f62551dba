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
from adaptctl.control import Controller, Guarded, TaskSpaceSlotineLi
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.memory import leaves
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation.closed_loop import guards

GIVEN = ("p", "v", *(f"reference.{part}" for part in ReferencePoint._fields))


@dataclass(frozen=True)
class Field:
    """A field of the interface, a named array of numbers: its shape, its first value, and what each number is called,
    where that is known."""

    name: str
    values: Array
    labels: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of numbers in the field."""
        return int(self.values.size)

    @property
    def dimensions(self) -> str:
        """The C text of the shape; empty for a single number."""
        return "".join(f"[{n}]" for n in self.values.shape)

    def place(self, k: int) -> str:
        """The C text of the k-th number's place."""
        where = np.unravel_index(k, self.values.shape) if self.values.shape else ()
        return self.name + "".join(f"[{int(i)}]" for i in where)

    def label(self, k: int) -> str:
        """Name of the k-th number; the empty string where numbers have no names."""
        return self.labels[k % len(self.labels)] if self.labels else ""


class Brake(NamedTuple):
    """The brake that guards put in place of a law without a torque: -damping v, within limits."""

    damping: Array
    """(r,) N m s/rad"""
    limit: Array
    """(r,) N m, finite"""


@dataclass(frozen=True, eq=False)
class Interface:
    """The interface of a controller in code: its memory, gains, names and the traced law."""

    controller: Controller[Any]

    @cached_property
    def law(self) -> Routine:
        """One tick as a traced routine, from which the native code here is made too."""
        law = self.controller
        sizes = law._given_sizes | law._memory_sizes | law.gain_sizes
        return trace(law._equation(), sizes, name="law")

    @cached_property
    def innermost(self) -> Controller[Any]:
        """The law within the guards, if there are any."""
        law: Any = self.controller
        while isinstance(law, Guarded):
            law = law.of
        return law

    @property
    def guarded(self) -> bool:
        """True if guards stand before the motors."""
        return isinstance(self.controller, Guarded)

    @cached_property
    def brake(self) -> Brake | None:
        """The guards' brake; None without guards."""
        law = self.controller
        if not isinstance(law, Guarded):
            return None
        damping, limit = (per_joint(np.asarray(x), law.dof, "brake") for x in (law.stop_damping, law.torque_limits))
        return Brake(damping, np.minimum(limit, np.finfo(np.float64).max))

    @cached_property
    def model(self) -> ReducedModel | None:
        """The model whose parameters are estimated; None where none are."""
        return getattr(self.innermost, "model", None)

    @cached_property
    def mechanism(self) -> Mechanism | None:
        """The mechanism that is driven; None where a user's law does not tell."""
        return self.model.mechanism if self.model else getattr(self.innermost, "mechanism", None)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in the order of p, v and torque."""
        if self.mechanism is None:
            return tuple(f"joint{k + 1}" for k in range(self.controller.dof))
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def follows_joints(self) -> bool:
        """True if reference points are positions of the joints."""
        law = self.innermost
        if isinstance(law, TaskSpaceSlotineLi):
            return law.reference_in_joints
        return law.reference_size == law.dof

    @cached_property
    def period(self) -> float:
        """Control period, s: the law's own, or 1 ms where it has none, which it then does not depend on."""
        return float(getattr(self.controller, "period", None) or getattr(self.innermost, "period", None) or 1e-3)

    @cached_property
    def started(self) -> list[Array]:
        """The memory's leaves at home and at rest."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(self.controller._blank)]

    @cached_property
    def memory(self) -> tuple[Field, ...]:
        """The fields of the memory, empty ones too."""
        paths = [path.removeprefix("state.").replace(".", "_") for path in self.controller._memory_sizes]
        found = zip(paths, self.started, strict=True)
        return tuple(Field(name, values, self._labels(name, values.size)) for name, values in found)

    @cached_property
    def estimate(self) -> Field | None:
        """The field that holds the estimate; None where the law has none."""
        wanted = getattr(self.controller._blank, "estimate", None)
        pairs = zip(self.memory, leaves(self.controller._blank), strict=True)
        return next((field for field, leaf in pairs if leaf is wanted), None)

    @cached_property
    def gains(self) -> tuple[Field, ...]:
        """Fields of the gains that a tick reads, with their values."""
        used = self._gain_places
        return tuple(field for field, places in self._gain_fields() if used & places)

    @cached_property
    def all_gains(self) -> tuple[Field, ...]:
        """Fields of all gains, in the order of the law's column."""
        return tuple(field for field, _ in self._gain_fields())

    @cached_property
    def marks(self) -> tuple[str, ...]:
        """Names of the guards' marks in a tick."""
        return tuple(getattr(guards(self.controller._blank), "_fields", ()))

    def memory_of(self, state: Any) -> list[Array]:
        """The leaves of a state in Python, in the order of `memory`."""
        return [np.asarray(x, dtype=np.float64) for x in leaves(state)]

    def names_of_constants(self) -> dict[float, str]:
        """Names of parameters that are compiled into the law, by magnitude."""
        values = getattr(self.innermost, "parameters", None)
        if self.mechanism is None or isinstance(values, Column) or values is None:
            return {}
        found: dict[float, str] = {}
        for name, value in zip(self.mechanism.parameter_names, np.abs(np.asarray(values)).tolist(), strict=False):
            if value not in (0.0, 0.5, 1.0, 2.0):
                found[value] = f"{found[value]}, {name}" if value in found else name
        return found

    @property
    def _gain_places(self) -> set[int]:
        part = len(GIVEN) + len(self.controller._memory_sizes)
        return {x.detail[1] for x in self.law.body if x.op is Op.INPUT and x.detail[0] == part}

    def _gain_fields(self) -> Iterator[tuple[Field, set[int]]]:
        first = 0
        for name, values in self.controller.numbers.items():
            field = Field(name.replace(".", "_"), values, self._labels(name, values.shape[-1] if values.ndim else 0))
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


def require_controller(controller: object) -> None:
    """Raise `InputError` for what is no controller whose steps are those of its law."""
    if not isinstance(controller, Controller):
        raise InputError(f"controller: expected a Controller, got {type(controller).__name__}")
    if type(controller).step is not Controller.step:
        raise InputError(f"controller: {type(controller).__name__} has a step of its own, which no graph knows of")
