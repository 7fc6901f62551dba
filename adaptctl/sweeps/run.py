"""Sweeps: every run of a study computed, once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any

import pyarrow as pa

from adaptctl.sweeps.cluster import Cluster
from adaptctl.sweeps.folder import Folder, Shard
from adaptctl.sweeps.rows import rows_of

AHEAD = 3
"""Shards a worker, at most, that are under way or wait for it."""
ATTEMPTS = 3
"""Workers that may die over a shard before it fails."""


def sweep(folder: Folder, cluster: Cluster, progress: Callable[[float], object] = lambda share: None) -> pa.Table:
    """Run all missing runs of the study of a `folder` on the workers of a `cluster`, and return the table (pyarrow) of
    its rows. A row is for one setting of the study's values and one of the controllers compared; the table is also
    written to the folder, as "sweep.parquet". Runs come in shards, groups whose rows this process writes to one file
    each as they are computed; shards whose file exists are not computed again.

    `progress(share)` is called with the fraction of shards that is done, 0 to 1; by default it does nothing. Raises
    `InputError` where the cluster cannot be reached or its workers have another version of adaptctl,
    `MissingExtraError` where Dask is not installed, `FileError` where the folder cannot be written, what a worker
    raises for a shard in spite of three retries, and Dask's `KilledWorker` where too many workers die over one.
    """
    total = -(-folder.study.count // folder.shard)
    missing = [shard for shard in folder.shards() if not folder.has(shard)]
    done = total - len(missing)
    progress(done / total)
    if missing:
        with cluster.client() as client:
            for shard, rows in _computed(client, folder, missing):
                folder.keep(shard, rows)
                done += 1
                progress(done / total)
    return folder.finished()


def _computed(client: Any, folder: Folder, missing: Sequence[Shard]) -> Iterator[tuple[Shard, list[dict[str, Any]]]]:
    """Shards and their rows, in the order in which they come."""
    import distributed

    waiting, under_way = iter(missing), distributed.as_completed(with_results=False)  # type: ignore[no-untyped-call]
    shards: dict[str, Shard] = {}

    def begin(count: int) -> None:
        for shard in islice(waiting, count):
            work = (folder.study.experiment, shard.runs, folder.study.controllers, folder.study.precision)
            future = client.submit(rows_of, *work, key=f"adaptctl-{shard.key}", pure=False, retries=ATTEMPTS)
            shards[future.key] = shard
            under_way.add(future)  # type: ignore[no-untyped-call]

    begin(AHEAD * max(1, len(client.scheduler_info()["workers"])))
    for future in under_way:
        rows = future.result()
        shard = shards.pop(future.key)
        future.release()
        begin(1)
        yield shard, rows
