"""Studies: an experiment, the settings that are varied, and every run of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Literal

import msgspec

from adaptctl.caching import cached_property
from adaptctl.compilation.lanes import Precision, require_precision
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.experiments import EXPERIMENTS
from adaptctl.experiments.experiment import CheckedSettings
from adaptctl.files import hashed, read_toml
from adaptctl.nearest_name import nearest_name
from adaptctl.sweeps.measurement import kind_of
from adaptctl.sweeps.values import Span, as_span, parsed

STUDIES = Path(__file__).with_name("studies")
"""Folder of the studies that come with the package."""
Sampling = Literal["grid", "latin-hypercube", "sobol"]


class StudyFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a study's file (TOML), which says which runs of an experiment a sweep makes. `experiment` is the name
    of an experiment or measurement; `question`, what its runs answer; `settings`, the values of its settings by name,
    each a number, true or false, a text such as "0..5:11" or "4,8", or a list, whose texts may have commas;
    `controllers`, the names of the controllers that run, all where empty. `sampling` is "grid", the default, for all
    combinations of values, or "latin-hypercube" or "sobol" for `samples` draws by `sampling_seed`; `precision`,
    "double" by default, is that of runs that are simulated together. `schema` is the file format's name. Types are
    checked where a file is read, not at construction."""

    schema: Literal["adaptctl/study/1"]
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
    """A study, which says which runs of an experiment a sweep makes: `experiment`, the name of an experiment or
    measurement, and `settings`, the values of its settings by name, each a tuple of values or a `Span`, a range to draw
    from; other settings keep their defaults. `controllers` has the names of the controllers that run, all where it is
    empty, and `question` is what the runs answer.

    `sampling` is "grid", the default, for all combinations of values, or "latin-hypercube" or "sobol" for `samples`
    draws of them, by `sampling_seed`; `precision`, "double" by default or "single", is that of runs that are simulated
    together in native code. Raises `InputError` at construction for another precision, a `Span` in a grid, and, unless
    it is a grid, for `samples` out of 1 to 10 000 000.
    """

    experiment: str
    settings: Mapping[str, tuple[Any, ...] | Span]
    controllers: tuple[str, ...] = ()
    question: str = ""
    sampling: Sampling = "grid"
    samples: int = 0
    sampling_seed: int = 0
    precision: Precision = "double"

    def __post_init__(self) -> None:
        require_precision(self.precision)
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
        if target in (entry.name for entry in EXPERIMENTS):
            return cls._made(StudyFile("adaptctl/study/1", target), given, options)
        path = STUDIES / f"{target}.toml"  # a measurement has a study of its name
        if not path.is_file():
            path = Path(target)
        if path.suffix != ".toml":
            names = [*(entry.name for entry in EXPERIMENTS), *shipped()]
            guess = nearest_name(target, names, least=0.4)
            raise NotFoundError(f"unknown experiment or study {target!r}{guess}; there are: {', '.join(names)}")
        try:
            return cls._made(read_toml(path, StudyFile), given, options)
        except NotFoundError as error:
            raise FileError(f"{path}: {error}") from error

    @classmethod
    def _made(cls, file: StudyFile, given: Mapping[str, str], options: Mapping[str, Any]) -> SweepStudy:
        kind = kind_of(file.experiment)
        typed: dict[str, str | list[str]] = {name: _typed(value) for name, value in file.settings.items()}
        typed |= {name.replace("-", "_"): text for name, text in given.items()}
        known = {entry.name: entry for entry in fields(kind)}
        for name in typed:
            if name not in known:
                guess = nearest_name(name, known)
                raise NotFoundError(f"{file.experiment} has no setting {name!r}{guess}; settings: {', '.join(known)}")
        settings = {name: parsed(known[name], values) for name, values in typed.items()}
        chosen: dict[str, Any] = {
            "controllers": tuple(file.controllers),
            "question": file.question,
            "sampling": file.sampling,
        }
        chosen |= {"samples": file.samples, "sampling_seed": file.sampling_seed, "precision": file.precision}
        return cls(file.experiment, settings, **(chosen | {k: v for k, v in options.items() if v}))

    @property
    def kind(self) -> type[CheckedSettings]:
        """Class of the study's experiment or measurement, a dataclass of its settings. Raises `NotFoundError` for an
        unknown name."""
        return kind_of(self.experiment)

    @property
    def count(self) -> int:
        """Number of runs of the study: that of all combinations of the settings' values in a grid, else the field
        `samples`."""
        if self.sampling != "grid":
            return self.samples
        return prod(len(values) for values in self.settings.values() if isinstance(values, tuple))

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
        span = as_span(entry, values)
        if span is not None:
            return span.at(share)
        choices: Any = values
        return choices[min(int(share * len(choices)), len(choices) - 1)]

    def _shares(self) -> list[list[float]]:
        """Points of the unit cube, one row a run."""
        import warnings

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


def _typed(value: str | float | int | bool | list[str | float | int | bool]) -> str | list[str]:
    """A value of a file as it would be typed, or each of a list."""
    return [str(one) for one in value] if isinstance(value, list) else str(value)
