"""Every draw as a table in a Parquet file: one row for each arm, seed and component."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.experiments.replication.ensemble import Ensemble
from adaptctl.experiments.replication.study import Study
from adaptctl.files import replacing

SCHEMA = "adaptctl/replication-draws/1"
COLUMNS = {
    "arm": "puma560, semi_direct_drive, or the one with nearly equal sides",
    "seed": "of the draw",
    "number": "1 for the largest",
    "singular_value": "of the energy differences H, by falling size",
    "weight": "|beta_j| of equation 19, by falling size, J times the root of the number of samples",
    "percent_error": "energy error when this many components are kept (equation 23)",
}


def write_draws(path: str | Path, study: Study) -> None:
    """Write the draws that were made, losslessly compressed."""
    tables = [_table(label, draws, study.seed) for label, draws in study.drawn.items()]
    about = {"schema": SCHEMA} | COLUMNS
    empty = pa.table({name: pa.array([], pa.float64()) for name in COLUMNS})
    table = pa.concat_tables(tables) if tables else empty
    with replacing(path) as beside:
        pq.write_table(table.replace_schema_metadata(about), beside, compression="zstd")


def _table(label: str, draws: Ensemble, seed: int) -> pa.Table:
    seeds, k = draws.weights.shape
    columns = (
        np.full(seeds * k, label),
        np.repeat(np.arange(seed, seed + seeds), k),
        np.tile(np.arange(1, k + 1), seeds),
        draws.singular_values[:, :k].ravel(),
        draws.weights.ravel(),
        draws.percent_errors[:, 1:].ravel(),
    )
    return pa.table({name: pa.array(values) for name, values in zip(COLUMNS, columns, strict=True)})
