"""The status of a tick as a sum of bits."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.codegen.interface import Interface
from adaptctl.simulation.closed_loop import guards


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
    own = enumerate(interface.marks, start=len(FAULTS))
    return (*FAULTS, *(StatusBit(name.upper(), 1 << k, _MARKS.get(name, name)) for k, name in own))


def status_of(interface: Interface, state: Any) -> int:
    """The status of a tick, an integer, as far as a controller's guards decide it: the sum of the status bits whose
    flags are set in `state`, the controller's internal state after the tick in Python; 0 without guards. Faults, such
    as NOT_FINITE, are not among them. Raises `ValueError` for a state with another number of flags than the controller
    of the `interface` has."""
    bits = status_bits(interface)[len(FAULTS) :]
    return sum(bit.value for bit, mark in zip(bits, guards(state), strict=True) if mark[0] > 0.5)
