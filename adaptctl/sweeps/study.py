"""Studies: an experiment, the values that its settings take, as they are typed, and every run of them."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from adaptctl.caching import cached_property
from adaptctl.compilation.lanes import Precision, validate_precision
from adaptctl.description.readers.registry import READERS
from adaptctl.errors import FileError, InputError, NotFoundError, suggested_name
from adaptctl.experiments import EXPERIMENTS, RENAMED, find
from adaptctl.experiments.experiment import CheckedSettings
from adaptctl.files import hashed, read_toml

# Folder of the studies that come with the package.
STUDIES = Path(__file__).with_name("studies")
Sampling = Literal["grid", "latin-hypercube", "sobol"]
# Values that one setting may have.
MAX_VALUES = 1_000_000
_RANGE = re.compile(r"^\s*(?P<low>[^:]+?)\.\.(?P<high>[^:]+?)(?::(?P<count>[^:]*))?\s*$")


@dataclass(frozen=True)
class Span:
    """Range of a setting, from which values are drawn."""

    low: float
    high: float
    whole: bool

    def at(self, share: float) -> float | int:
        """Value at a fraction of the way."""
        if self.whole:
            return int(min(self.low + math.floor(share * (self.high - self.low + 1)), self.high))
        return self.low + share * (self.high - self.low)


Values = tuple[Any, ...] | Span


class StudyFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a study's file (TOML)."""

    schema: Literal["adaptctl/study/2"]
    experiment: str
    question: str = ""
    settings: dict[str, str | float | int | bool | list[str | float | int | bool]] = {}
    controllers: list[str] = []
    sampling: Sampling = "grid"
    samples: int = 0
    sampling_seed: int = 0
    precision: Precision = "double"


@dataclass(frozen=True)
class SweepStudy:
    """Study: experiment, values of its settings, controllers and sampling."""

    experiment: str
    settings: Mapping[str, Values]
    controllers: tuple[str, ...] = ()
    question: str = ""
    sampling: Sampling = "grid"
    samples: int = 0
    sampling_seed: int = 0
    precision: Precision = "double"

    def __post_init__(self) -> None:
        validate_precision(self.precision)
        drawn = [name for name, values in self.settings.items() if isinstance(values, Span)]
        if self.sampling == "grid" and drawn:
            raise InputError(
                f"{drawn[0]}: a range needs a count in a grid, as in 0..5:11; or sample it with "
                "--sampling latin-hypercube or sobol, and --samples"
            )
        if self.sampling != "grid" and not 1 <= self.samples <= 10_000_000:
            raise InputError(f"--samples: expected the number of {self.sampling} samples, got {self.samples}")

    @classmethod
    def named(cls, target: str, given: Mapping[str, str], **options: Any) -> SweepStudy:
        """Study of a name or file, with values as they are typed."""
        if target in (*(entry.name for entry in EXPERIMENTS), *RENAMED):
            return cls._made(StudyFile("adaptctl/study/2", target), given, options)
        path = STUDIES / f"{target}.toml"
        if not path.is_file():
            path = Path(target)
        if path.suffix != ".toml":
            names = [*(entry.name for entry in EXPERIMENTS), *shipped()]
            is_robot = path.suffix in READERS
            guess = f"; adaptive --robot {target} is one" if is_robot else suggested_name(target, names, least=0.4)
            raise NotFoundError(f"unknown experiment or study {target!r}{guess}; known: {', '.join(names)}")
        try:
            return cls._made(read_toml(path, StudyFile), given, options)
        except NotFoundError as error:
            raise FileError(f"{path}: {error}") from error

    @classmethod
    def _made(cls, file: StudyFile, given: Mapping[str, str], options: Mapping[str, Any]) -> SweepStudy:
        known = {entry.name: entry for entry in fields(find(file.experiment))}
        typed: dict[str, str | list[str]] = {name: _typed(value) for name, value in file.settings.items()}
        typed |= {name.replace("-", "_"): text for name, text in given.items()}
        for name in typed:
            if name not in known:
                guess = suggested_name(name, known)
                raise NotFoundError(f"{file.experiment} has no setting {name!r}{guess}; settings: {', '.join(known)}")
        chosen = msgspec.structs.asdict(file) | {"controllers": tuple(file.controllers)}
        chosen |= {name: value for name, value in options.items() if value}
        chosen |= {"settings": {name: parsed(known[name], values) for name, values in typed.items()}}
        del chosen["schema"]
        return cls(**chosen)

    @property
    def kind(self) -> type[CheckedSettings]:
        """Class of the experiment."""
        return find(self.experiment)

    @property
    def count(self) -> int:
        """Number of runs."""
        if self.sampling != "grid":
            return self.samples
        return math.prod(len(values) for values in self.settings.values() if isinstance(values, tuple))

    @property
    def swept(self) -> tuple[str, ...]:
        """Names of the settings with more than one value."""
        return tuple(name for name, x in self.settings.items() if isinstance(x, Span) or len(x) > 1)

    def runs(self) -> Iterator[dict[str, Any]]:
        """Runs in a fixed order, each a mapping of settings to values."""
        if self.sampling == "grid":
            for values in product(*(x for x in self.settings.values() if isinstance(x, tuple))):
                yield dict(zip(self.settings, values, strict=True))
            return
        known = {entry.name: entry for entry in fields(self.kind)}
        for shares in self._shares():
            yield {name: self._drawn(known[name], share) for name, share in zip(self.settings, shares, strict=True)}

    def _drawn(self, entry: Any, share: float) -> Any:
        values = self.settings[entry.name]
        if (span := as_span(entry, values)) is not None:
            return span.at(share)
        choices: Any = values
        return choices[min(int(share * len(choices)), len(choices) - 1)]

    def _shares(self) -> list[list[float]]:
        from scipy.stats import qmc

        source = qmc.LatinHypercube if self.sampling == "latin-hypercube" else qmc.Sobol
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Sobol's balance for powers of two: anyone may stop between
            points = source(max(1, len(self.settings)), rng=self.sampling_seed).random(self.samples)
        return [row[: len(self.settings)] for row in points.tolist()]

    @cached_property
    def sha256(self) -> str:
        """Hash of all that decides the runs and their results."""
        values = {k: [x.low, x.high] if isinstance(x, Span) else list(x) for k, x in self.settings.items()}
        sampling = [self.sampling, self.samples, self.sampling_seed] if self.sampling != "grid" else []
        return hashed([self.experiment, values, sorted(self.controllers), sampling, *self.unusual])

    @property
    def unusual(self) -> list[str]:
        """Choices that change results and are not the default, for the hash."""
        return [self.precision] if self.precision != "double" else []


def shipped() -> list[str]:
    """Names of the studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))


def parsed(entry: Field[Any], typed: str | Sequence[str]) -> Values:
    """Values of a setting as typed: a list ``4,8,12``, a range ``0..99`` or ``0..5:11``, or a span to draw from."""
    if isinstance(entry.default, str) and not isinstance(typed, str):
        values: tuple[Any, ...] = tuple(typed)
    else:
        text = typed if isinstance(typed, str) else ",".join(typed)
        if not isinstance(entry.default, tuple | str | bool) and (match := _RANGE.match(text)):
            return _range(entry, match)
        values = tuple(_one(entry, part.strip()) for part in text.split(","))
    if not values or len(set(values)) < len(values):
        raise InputError(f"{entry.name}: expected one or more different values, got {typed!r}")
    return values


def as_span(entry: Field[Any], values: Values) -> Span | None:
    """Span that a setting is drawn from."""
    if isinstance(values, Span):
        return values
    whole = type(entry.default) is int and len(values) > 1 and list(values) == list(range(values[0], values[-1] + 1))
    return Span(values[0], values[-1], whole=True) if whole else None


def _range(entry: Field[Any], match: re.Match[str]) -> Values:
    whole, count = isinstance(entry.default, int), match["count"]
    low, high = (_number(entry, match[end], whole) for end in ("low", "high"))
    if not low < high:
        raise InputError(f"{entry.name}: expected an ascending range, got {match[0]!r}")
    if count is None and not whole:
        return Span(low, high, whole)
    count = str(int(high - low) + 1) if count is None else count
    if not count.isdecimal() or not 2 <= int(count) <= MAX_VALUES:
        raise InputError(f"{entry.name}: expected from 2 to {MAX_VALUES} values in {match[0]!r}, got {count!r}")
    points = np.linspace(low, high, int(count)).tolist()
    if whole and any(point != int(point) for point in points):
        raise InputError(f"{entry.name}: {match[0]!r} gives non-integer values")
    return tuple(int(point) for point in points) if whole else tuple(points)


def _one(entry: Field[Any], text: str) -> Any:
    default = entry.default
    if isinstance(default, tuple):
        kind = type(default[0]) if default else float
        return tuple(word if kind is str else _number(entry, word, kind is int) for word in text.split())
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        if text.lower() not in ("true", "false"):
            raise InputError(f"{entry.name}: expected true or false, got {text!r}")
        return text.lower() == "true"
    return _number(entry, text, isinstance(default, int))


def _number(entry: Field[Any], text: str, whole: bool) -> float | int:
    try:
        number = float(text)
    except ValueError as error:
        form = "numbers separated by commas, or a range such as 0..5:11"
        raise InputError(f"{entry.name}: expected {form}, got {text!r}") from error
    if not math.isfinite(number) or (whole and number != int(number)):
        raise InputError(f"{entry.name}: expected {'a whole' if whole else 'a finite'} number")
    return int(number) if whole else number


def _typed(value: str | float | int | bool | list[str | float | int | bool]) -> str | list[str]:
    return [str(one) for one in value] if isinstance(value, list) else str(value)
