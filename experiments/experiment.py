"""Base classes of experiments."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar, NamedTuple

from adaptctl.errors import InputError, NonFiniteError
from adaptctl.recording import Progress, Result, Setting

MAX_PERIODS = 300_000
"""control periods of a run"""
DIVERGENCE_ERROR = 100.0
"""rad or m: divergence, where runs are compared to the end"""


class Idle(NamedTuple):
    """Another setting, its value at which a setting has no effect, and why."""

    setting: str
    value: Any
    why: str


def setting(
    default: Any, meaning: str, *, symbol: str = "", low: float = -math.inf, high: float = math.inf,
    idle: Idle | None = None,
) -> Any:  # fmt: skip
    """Dataclass field for a setting."""
    text = f"{symbol}: {meaning}" if symbol else meaning
    metadata = {"meaning": meaning, "low": low, "high": high, "help": text, "idle": idle}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class CheckedSettings:
    """Base class of settings made by `setting`."""

    name: ClassVar[str]

    seed: int = setting(0, "seed of all random numbers", low=0, high=2**31 - 1)

    def __post_init__(self) -> None:
        for entry in fields(self):
            _require(entry, getattr(self, entry.name))
        for entry in fields(self):
            idle = entry.metadata.get("idle")
            if idle and getattr(self, entry.name) != entry.default and getattr(self, idle.setting) == idle.value:
                raise InputError(f"{entry.name}: has no effect {idle.why}")


@dataclass(frozen=True)
class Experiment(CheckedSettings, ABC):
    """Abstract base class of experiments."""

    title: ClassVar[str]

    @abstractmethod
    def run(self, progress: Progress) -> Result:
        """Result of the experiment."""


@dataclass(frozen=True)
class ClosedLoopExperiment(Experiment):
    """Base class of closed-loop experiments."""

    duration: float = setting(20.0, "duration of every run, s", low=0.01, high=300.0)
    control_period: float = setting(1e-3, "control period, s", symbol="T_c", low=1e-4, high=0.02)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration / self.control_period > MAX_PERIODS:
            raise InputError(
                f"duration: {self.duration:g} s at a control period of {self.control_period:g} s is more than "
                f"{MAX_PERIODS} steps; shorten it or lengthen the control period"
            )


def validate_count(experiment: Experiment, names: Iterable[str], count: int, meaning: str) -> None:
    """Raise `InputError` unless each named setting has `count` entries."""
    for name in names:
        if (given := len(getattr(experiment, name))) != count:
            raise InputError(f"{name}: expected {count} numbers, {meaning}, got {given}")


def settings(experiment: Experiment | type[Experiment]) -> Iterator[Field[Any]]:
    """Fields of all settings, own ones first."""
    common = {entry.name for entry in fields(ClosedLoopExperiment)}
    yield from sorted(fields(experiment), key=lambda entry: entry.name in common)


def stated(experiment: Experiment) -> Iterator[Setting]:
    """Settings for summary and report."""
    for entry in settings(experiment):
        name = f"--{entry.name.replace('_', '-')}"
        yield Setting(name, text(getattr(experiment, entry.name)), entry.metadata["meaning"])


def text(value: object) -> str:
    """Text of a value on the command line, from which it is read back the same."""
    if isinstance(value, tuple):
        return " ".join(text(entry) for entry in value)
    short = f"{value:g}" if isinstance(value, float) else str(value)
    return repr(value) if isinstance(value, float) and float(short) != value else short


def _require(entry: Field[Any], value: object) -> None:
    """Check type, finiteness and bounds of a setting."""
    default: Any = entry.default
    if value is default and value != ():
        return  # sound, as tests hold
    many = isinstance(default, tuple)
    values = value if isinstance(value, tuple) else (value,)
    if isinstance(value, tuple) is not many or not values:
        raise InputError(f"{entry.name}: expected {_expected(entry)}, got {value!r}")
    for one in values:
        _validate_one(entry, type(default[0]) if many and default else float if many else type(default), one)


def _validate_one(entry: Field[Any], kind: type, value: object) -> None:
    if kind in (str, bool) and isinstance(value, kind):
        return
    wrong_kind = kind in (str, bool) or isinstance(value, bool) or not isinstance(value, int | float)
    if wrong_kind or (kind is int and not isinstance(value, int)):
        raise InputError(f"{entry.name}: expected {_expected(entry)}, got {value!r}")
    number = float(value)  # type: ignore[arg-type]
    if not math.isfinite(number):
        raise NonFiniteError(f"{entry.name}: expected {_expected(entry)}, got {number}")
    if not entry.metadata["low"] <= number <= entry.metadata["high"]:
        raise InputError(f"{entry.name}: expected {_expected(entry)}, got {number:g}")


def _expected(entry: Field[Any]) -> str:
    default = entry.default
    if isinstance(default, tuple) and default and isinstance(default[0], str):
        return "names"
    what = {int: "a whole number", float: "a number", str: "a name or a file", bool: "true or false", tuple: "numbers"}[
        type(default)
    ]
    low, high = entry.metadata["low"], entry.metadata["high"]
    if math.isfinite(low) and math.isfinite(high):
        return f"{what} from {low:g} to {high:g}"
    return f"{what} of at least {low:g}" if math.isfinite(low) else what
