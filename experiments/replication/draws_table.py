"""Table of all draws in a Parquet file: one row for each arm, seed and component."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.experiments.replication.draws import Draws
from adaptctl.experiments.replication.study import Study
from adaptctl.recording.trace import Quantity, write_columns

SCHEMA = "adaptctl/replication-draws/1"


def write_draws(path: str | Path, study: Study) -> None:
    """Write a Parquet file at `path` of all random draws of states that a `study` has made so far, a row for each arm,
    seed and essential component (the parameters' part along a right singular vector of the energy differences). Columns
    are arm, seed, number (1 for the largest), singular_value (J per SI unit), weight (the energy of the component, J)
    and percent_error (the energy error, %, of keeping the components up to this number). Nothing is returned. Raises
    `FileError` where the file cannot be written."""
    about = {"schema": SCHEMA, "samples": str(study.samples), "velocity_scale": repr(study.velocity_scale)}
    write_columns(path, _columns(study), about)


def _columns(study: Study) -> list[Quantity]:
    labels, draws = list(study.drawn), list(study.drawn.values())
    sizes = [one.weights.size for one in draws]
    seeds = [np.repeat(np.arange(study.seed, study.seed + study.seeds), one.rank) for one in draws]
    numbers = [np.tile(np.arange(1, one.rank + 1), study.seeds) for one in draws]
    return [
        Quantity("arm", "1", "which arm", np.repeat(np.array(labels, dtype=np.str_), np.array(sizes, dtype=int))),
        Quantity("seed", "1", "of the draw", _joined(seeds)),
        Quantity("number", "1", "1 for the largest", _joined(numbers)),
        Quantity(
            "singular_value", "J per SI unit", "of the energy differences H", _joined([_values(one) for one in draws])
        ),
        Quantity("weight", "J", "|beta_j| of equation 19, by falling size", _joined([one.weights for one in draws])),
        Quantity(
            "percent_error",
            "%",
            "energy error when this many components are kept (equation 23)",
            _joined([one.percent_errors[:, 1:] for one in draws]),
        ),
    ]


def _values(draws: Draws) -> Array:
    return draws.singular_values[:, : draws.rank]


def _joined(parts: Sequence[NDArray[Any]]) -> Array:
    return np.concatenate([np.zeros(0), *(np.ravel(part) for part in parts)])
