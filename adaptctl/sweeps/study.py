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
from adaptctl.errors import FileError, InputError, NotFoundError, suggested_name
from adaptctl.experiments import EXPERIMENTS, RENAMED, find
from adaptctl.experiments.experiment import CheckedSettings
from adaptctl.files import hashed, read_toml

STUDIES = Path(__file__).with_name("studies")
"""Folder of the studies that come with the package."""
Sampling = Literal["grid", "latin-hypercube", "sobol"]
MOST = 1_000_000
"""Values that one setting may have."""
_RANGE = re.compile(r"^\s*(?P<low>[^:]+?)\.\.(?P<high>[^:]+?)(?::(?P<count>[^:]*))?\s*$")


@dataclass(frozen=True)
class Span:
    """A range of values of a setting to draw from, in the setting's unit: from `low` to `high`, both included, and
    `whole`, True where its values are whole numbers. Nothing is checked."""

    low: float
    high: float
    whole: bool

    def at(self, share: float) -> float | int:
        """The value at the fraction `share`, from 0 to 1, of the way from `low` to `high`; where values are whole, one
        of the whole numbers, each for an equal part of the way. The fraction is not checked."""
        if self.whole:
            return int(min(self.low + math.floor(share * (self.high - self.low + 1)), self.high))
        return self.low + share * (self.high - self.low)


Values = tuple[Any, ...] | Span


class StudyFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a study's file (TOML), which says which runs of an experiment a sweep makes. `experiment` is its name;
    `question`, what its runs answer; `settings`, the values of its settings by name, each a number, true or false, a
    text such as "0..5:11" or "4,8", or a list, whose texts may have commas; `controllers`, the names of the controllers
    that run, all where empty. `sampling` is "grid", the default, for all combinations of values, or "latin-hypercube"
    or "sobol" for `samples` draws by `sampling_seed`; `precision`, "double" by default, is that of runs that are
    simulated together. `schema` is the file format's name. Types are checked where a file is read."""

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
    """A study, which says which runs of an experiment a sweep makes: as `StudyFile`, but with `settings` as tuples of
    values or a `Span`, a range to draw from; other settings keep their defaults. Raises `InputError` at construction
    for another precision, a `Span` in a grid, and, unless it is a grid, for `samples` out of 1 to 10 000 000."""

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
                f"{drawn[0]}: a range of numbers needs a count in a grid, as in 0..5:11; or draw from it with "
                "--sampling latin-hypercube or sobol, and --samples"
            )
        if self.sampling != "grid" and not 1 <= self.samples <= 10_000_000:
            raise InputError(f"samples: expected how many to draw by {self.sampling}, got {self.samples}")

    @classmethod
    def named(cls, target: str, given: Mapping[str, str], **options: Any) -> SweepStudy:
        """The `SweepStudy` that `target` names: an experiment, all of whose settings have their defaults, a study that
        comes with the package, or a study's file (.toml). `given` maps names of settings to values as they are typed,
        such as "4,8,12" or "0..5:11", which replace the study's; `options` are other fields of the study to replace,
        where they are not empty.

        Raises `NotFoundError` for an unknown target and an experiment's unknown setting; `FileError` for a file that
        cannot be read, has other content or names an unknown experiment or setting; `InputError` for values that a
        setting cannot have, and for options that do not fit.
        """
        if target in (*(entry.name for entry in EXPERIMENTS), *RENAMED):
            return cls._made(StudyFile("adaptctl/study/2", target), given, options)
        path = STUDIES / f"{target}.toml"
        if not path.is_file():
            path = Path(target)
        if path.suffix != ".toml":
            names = [*(entry.name for entry in EXPERIMENTS), *shipped()]
            guess = suggested_name(target, names, least=0.4)
            raise NotFoundError(f"unknown experiment or study {target!r}{guess}; there are: {', '.join(names)}")
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
        """Class of the study's experiment, a dataclass of its settings. Raises `NotFoundError` for an unknown name."""
        return find(self.experiment)

    @property
    def count(self) -> int:
        """Number of runs of the study: that of all combinations of the settings' values in a grid, else the field
        `samples`."""
        if self.sampling != "grid":
            return self.samples
        return math.prod(len(values) for values in self.settings.values() if isinstance(values, tuple))

    @property
    def swept(self) -> tuple[str, ...]:
        """Names of the settings of the study that have more than one value, or a range to draw from, in their order."""
        return tuple(name for name, x in self.settings.items() if isinstance(x, Span) or len(x) > 1)

    def runs(self) -> Iterator[dict[str, Any]]:
        """Iterator over the runs of the study, in a fixed order: for each a mapping from the names of the settings that
        the study has to their values; other settings keep the experiment's defaults. Draws are the same for the same
        `sampling_seed`. Raises, unless `sampling` is "grid", `NotFoundError` for an unknown experiment and `KeyError`
        for a setting that it does not have."""
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
        """Points of the unit cube, one row a run."""
        from scipy.stats import qmc

        source = qmc.LatinHypercube if self.sampling == "latin-hypercube" else qmc.Sobol
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Sobol's balance for powers of two: anyone may stop between
            points = source(max(1, len(self.settings)), rng=self.sampling_seed).random(self.samples)
        return [row[: len(self.settings)] for row in points.tolist()]

    @cached_property
    def sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of all in the study that decides its runs and their results: experiment, values,
        controllers (in any order), sampling and precision, but not the question."""
        values = {k: [x.low, x.high] if isinstance(x, Span) else list(x) for k, x in self.settings.items()}
        sampling = [self.sampling, self.samples, self.sampling_seed] if self.sampling != "grid" else []
        return hashed([self.experiment, values, sorted(self.controllers), sampling, *self.unusual])

    @property
    def unusual(self) -> list[str]:
        """Choices of the study, besides settings and controllers, that change results and are not the default, as texts
        for its hash: ["single"] for runs in single precision, an empty list for double."""
        return [self.precision] if self.precision != "double" else []


def shipped() -> list[str]:
    """Names of the studies that come with the package, sorted. Nothing is raised."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))


def parsed(entry: Field[Any], typed: str | Sequence[str]) -> Values:
    """Values of a setting, parsed from `typed`: a tuple, or a `Span` to draw from. A list, ``4,8,12``, a range of whole
    numbers, ``0..99``, and evenly spaced numbers, ``0..5:11``, 11 from 0 to 5, both included, give a tuple; ``0..5`` of
    numbers that need not be whole gives a `Span`. Values of a setting that is True or False are ``true`` and ``false``,
    in any letter case. Where a value is itself a tuple, its parts are separated by blanks, ``90 150 70``; values that
    are tuples, texts, True or False have no ranges. A sequence of texts, such as a study's file has, is read as its
    texts joined by commas, except for a setting whose values are texts: there each text is a value, commas included.
    `entry` is the setting's dataclass field, whose default tells the kind of value.

    Raises `InputError` for a text in none of these forms, no values, equal values, a range that does not rise, other
    than 2 to a million values in a range, and numbers that are not finite or, of a setting of whole numbers, not whole.
    """
    if isinstance(entry.default, str) and not isinstance(typed, str):
        values: tuple[Any, ...] = tuple(typed)
    else:
        text = typed if isinstance(typed, str) else ",".join(typed)
        if not isinstance(entry.default, tuple | str | bool) and (match := _RANGE.match(text)):
            return _range(entry, match)
        values = tuple(_one(entry, part.strip()) for part in text.split(","))
    if not values or len(set(values)) < len(values):
        raise InputError(f"{entry.name}: expected different values, at least one, got {typed!r}")
    return values


def as_span(entry: Field[Any], values: Values) -> Span | None:
    """The `Span` that a setting is drawn from: `values` where it is one, or the range of `values` that are two or more
    successive whole numbers, in ascending order, of a setting of whole numbers. None for all others, of which a draw
    picks one. `entry` is the setting's dataclass field, whose default tells its kind. Nothing is raised."""
    if isinstance(values, Span):
        return values
    whole = type(entry.default) is int and len(values) > 1 and list(values) == list(range(values[0], values[-1] + 1))
    return Span(values[0], values[-1], whole=True) if whole else None


def _range(entry: Field[Any], match: re.Match[str]) -> Values:
    whole, count = isinstance(entry.default, int), match["count"]
    low, high = (_number(entry, match[end], whole) for end in ("low", "high"))
    if not low < high:
        raise InputError(f"{entry.name}: expected a range that rises, got {match[0]!r}")
    if count is None and not whole:
        return Span(low, high, whole)
    count = str(int(high - low) + 1) if count is None else count
    if not count.isdecimal() or not 2 <= int(count) <= MOST:
        raise InputError(f"{entry.name}: expected from 2 to {MOST} values in {match[0]!r}, got {count!r}")
    points = np.linspace(low, high, int(count)).tolist()
    if whole and any(point != int(point) for point in points):
        raise InputError(f"{entry.name}: {match[0]!r} gives values that are not whole")
    return tuple(int(point) for point in points) if whole else tuple(points)


def _one(entry: Field[Any], text: str) -> Any:
    """One value, of its default's kind."""
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
        form = "numbers apart by commas, or a range such as 0..5:11"
        raise InputError(f"{entry.name}: expected {form}, got {text!r}") from error
    if not math.isfinite(number) or (whole and number != int(number)):
        raise InputError(f"{entry.name}: expected {'a whole' if whole else 'a finite'} number")
    return int(number) if whole else number


def _typed(value: str | float | int | bool | list[str | float | int | bool]) -> str | list[str]:
    """A value of a file as it would be typed, or each of a list."""
    return [str(one) for one in value] if isinstance(value, list) else str(value)
