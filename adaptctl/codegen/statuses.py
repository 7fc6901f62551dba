"""The status of a tick as a sum of bits."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.codegen.interface import Interface
from adaptctl.simulation.closed_loop import guards


class StatusBit(NamedTuple):
    """A bit of a tick's status: its name, its value and its meaning."""

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
    """All status bits: those of faults, then those of the guards, which are marks of theirs."""
    own = enumerate(interface.marks, start=len(FAULTS))
    return (*FAULTS, *(StatusBit(name.upper(), 1 << k, _MARKS.get(name, name)) for k, name in own))


def status_of(interface: Interface, state: Any) -> int:
    """The status, as a number, that the guards' marks of a state give."""
    bits = status_bits(interface)[len(FAULTS) :]
    return sum(bit.value for bit, mark in zip(bits, guards(state), strict=True) if mark[0] > 0.5)
