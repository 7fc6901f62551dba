"""Searches: the settings of an experiment that make one of its numbers smallest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.errors import InputError
from adaptctl.files import toml_string, write_text
from adaptctl.optional_packages import needed
from adaptctl.sweeps.rows import OUTCOME, rows_of
from adaptctl.sweeps.study import Span, SweepStudy, Values

# Trials that are asked for, and run, at once.
BATCH_TRIALS = 16
OBJECTIVES = tuple(name for name, (kind, _) in OUTCOME.items() if kind == "double")


@dataclass(frozen=True, eq=False)
class BestSettings:
    """Settings found by a search, their controller and outcome."""

    settings: Mapping[str, Any]
    controller: str
    value: float
    trials: int


def search(
    study: SweepStudy,
    objective: str,
    trials: int,
    progress: Callable[[float], object] = lambda share: None,
    seed: int = 0,
) -> BestSettings:
    """Settings with the smallest `objective`, by tree-structured Parzen estimators (Bergstra et al. 2011)."""
    with needed("a search"):
        import optuna
    if objective not in OBJECTIVES:
        raise InputError(f"minimise: expected one of {', '.join(OBJECTIVES)}, got {objective!r}")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    asked = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, constant_liar=True))
    best: BestSettings | None = None
    controllers = study.controllers[:1]
    for first in range(0, trials, BATCH_TRIALS):
        batch = [asked.ask() for _ in range(min(BATCH_TRIALS, trials - first))]
        settings = [{name: _one_of(name, x, trial) for name, x in study.settings.items()} for trial in batch]
        controllers = controllers or _first_controller(study, settings)
        rows = rows_of(study.experiment, settings, controllers, study.precision)
        for trial, chosen, row in zip(batch, settings, rows, strict=True):
            value = row[objective] if row["status"] == "done" and row[objective] is not None else np.inf
            asked.tell(trial, min(value, 1e300))
            if np.isfinite(value) and (best is None or value < best.value):
                best = BestSettings(chosen, row["controller"], float(value), trials)
        progress(min(1.0, (first + BATCH_TRIALS) / trials))
    if best is None:
        raise InputError(
            f"search: none of {trials} runs of {study.experiment} completed with a value of {objective}: widen the "
            "ranges, or minimise rms_error for runs shorter than two seconds"
        )
    return best


def write_settings(path: Path, study: SweepStudy, found: BestSettings) -> None:
    """Write the settings found to a study's file (TOML)."""
    lines = [
        'schema = "adaptctl/study/2"',
        f"experiment = {toml_string(study.experiment)}",
        f"controllers = [{toml_string(found.controller)}]",
        f"precision = {toml_string(study.precision)}",
        "\n[settings]",
        *(f"{name} = [{_toml(value)}]" for name, value in found.settings.items()),
    ]
    write_text(path, "\n".join(lines) + "\n")


def _toml(value: Any) -> str:
    text = " ".join(map(str, value)) if isinstance(value, tuple) else value
    if isinstance(text, str):
        return toml_string(text)
    return repr(text).lower() if isinstance(text, bool) else repr(text)


def _first_controller(study: SweepStudy, settings: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    first = (rows_of(study.experiment, [chosen], (), study.precision)[0] for chosen in settings)
    return next(((row["controller"],) for row in first if row["controller"] or row["status"] != "failed"), ())


def _one_of(name: str, values: Values, trial: Any) -> Any:
    if isinstance(values, Span):
        return trial.suggest_float(name, values.low, values.high)
    return values[0] if len(values) == 1 else values[trial.suggest_int(name, 0, len(values) - 1)]
