"""Reader of the scalars in rerun's recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError, FileError
from adaptctl.logs.arrow import numbers
from adaptctl.logs.table import LogTable, table, validate_size
from adaptctl.logs.units import TIME

SCALARS, ARRIVAL = "Scalars:scalars", ("log_time", "log_tick")


def read_rrd(path: str | Path) -> LogTable:
    """Table of a recording's scalars, named by their entities with points for slashes, over its own timeline."""
    from rerun.chunk import RrdReader

    try:
        chunks = RrdReader(path).store().stream()
        batches = [(c.entity_path, c.to_record_batch()) for c in chunks if not c.is_static]
    except (AdaptctlError, MemoryError):
        raise
    except BaseException as error:  # the package, written in another language, raises many kinds, panics among them
        told = (str(error) or type(error).__name__).splitlines()[0]
        raise FileError(f"{path}: cannot be read as a recording of rerun ({told})") from error
    scalars = [(entity, batch) for entity, batch in batches if SCALARS in batch.schema.names]
    if not scalars:
        raise FileError(f"{path}: no scalars; a log needs positions and torques logged as rerun.Scalars")
    timeline = _timeline(path, [batch for _, batch in scalars])
    columns = _by_entity(scalars, timeline)
    kind = next(b.schema.field(timeline).type for _, b in scalars if timeline in b.schema.names)
    stamps = np.unique(np.concatenate([times for times, _ in columns.values()]))
    validate_size(path, len(stamps), len(columns))
    factor = TIME.get(getattr(kind, "unit", ""), 1.0)
    found, empty = [("time", factor * (stamps - stamps[0]))], dict[str, NDArray[np.bool_]]()
    for name, (times, values) in columns.items():
        whole, mask = np.full(len(stamps), np.nan), np.ones(len(stamps), dtype=np.bool_)
        place = np.searchsorted(stamps, times)
        whole[place], mask[place] = values, False
        found.append((name, whole))
        empty |= {name: mask} if mask.any() else {}
    return table(str(path), found, {"time": "s"} if hasattr(kind, "unit") else {}, empty)


def _timeline(path: str | Path, batches: list[Any]) -> str:
    """Timeline of all scalars: that called time, the only one of their own, or that of their arrival."""
    each = [{f.name for f in b.schema if (f.metadata or {}).get(b"rerun:kind") == b"index"} for b in batches]
    common = set.intersection(*each)
    own = sorted(common - set(ARRIVAL))
    if "time" in common or len(own) == 1:
        return "time" if "time" in common else own[0]
    if own:
        raise FileError(f"{path}: several timelines: {', '.join(own)}; log the scalars on one called time")
    if ARRIVAL[0] not in common:
        raise FileError(f"{path}: its scalars have no timeline in common")
    return ARRIVAL[0]


def _by_entity(scalars: list[tuple[str, Any]], timeline: str) -> dict[str, tuple[NDArray[np.int64], Array]]:
    """Stamps and values of each entity's scalars; several at once are told apart by a number."""
    import pyarrow as pa

    parts: dict[str, list[tuple[NDArray[np.int64], Array]]] = {}
    for entity, batch in scalars:
        stamps = np.asarray(batch.column(timeline).cast(pa.int64()))
        name = entity.strip("/").replace("/", ".")
        places = list(numbers(name, batch.column(SCALARS)))
        for one in places:
            given = np.isfinite(one.values)
            label = name if len(places) == 1 else one.name
            parts.setdefault(label, []).append((stamps[given], one.values[given]))
    joined = {n: tuple(map(np.concatenate, zip(*pairs, strict=True))) for n, pairs in parts.items()}
    return {name: (times, values) for name, (times, values) in joined.items()}
