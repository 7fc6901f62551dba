"""Sweeps: every run of a study computed, once, by Dask on this machine or on the user's own cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.sweeps.folder import Folder
from adaptctl.sweeps.rows import rows_of
from adaptctl.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

ATTEMPTS = 3
"""Workers that may die over a shard before it fails."""
PATIENCE = 15.0
"""s to wait for a scheduler, and for its first worker."""
UNWATCHED = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
"""Dask's settings that have it watch itself less: by default that takes some 2 % of a processor for each process."""


@dataclass(frozen=True)
class Cluster:
    """Settings of a Dask cluster that computes the runs of a sweep: `jobs` worker processes on this computer, from 1 to
    4096, or a scheduler that runs already, given by its address `scheduler`, such as "tcp://host:8786", or by the file
    that it wrote, `scheduler_file`. Where all three are None, the default, there is a worker for each processor of this
    computer.

    `tls` has the paths of the certificate authority's file, the certificate and the key for a scheduler whose address
    begins with "tls://", None for no encryption. Raises `InputError` at construction for more than one of the three,
    `jobs` out of range, and files that do not exist.
    """

    jobs: int | None = None
    scheduler: str | None = None
    scheduler_file: Path | None = None
    tls: tuple[Path, Path, Path] | None = None

    def __post_init__(self) -> None:
        given = [x for x in (self.jobs, self.scheduler, self.scheduler_file) if x is not None]
        if len(given) > 1:
            raise InputError("expected one of --jobs, --scheduler and --scheduler-file")
        if self.jobs is not None and not 1 <= self.jobs <= 4096:
            raise InputError(f"jobs: expected from 1 to 4096 workers, got {self.jobs}")
        for path in (*(self.tls or ()), *([self.scheduler_file] if self.scheduler_file else [])):
            if not path.is_file():
                raise InputError(f"{path}: there is no such file")

    @contextmanager
    def client(self) -> Iterator[Any]:
        """Context manager that gives a connected Dask client. Workers that it starts on this computer end with the
        block, those of a scheduler that ran before go on. Raises `InputError` where the scheduler is not reached within
        15 s, has no worker after 15 s, or a worker lacks adaptctl or has another version of it; `MissingExtraError`
        where Dask is not installed."""
        with needed("a sweep"):
            import dask
            import distributed
        patient = {"distributed.comm.timeouts.connect": PATIENCE, "logging.distributed": "error"}
        with dask.config.set(UNWATCHED | patient):
            if self.scheduler is None and self.scheduler_file is None:
                # A worker whose last heartbeat finds no scheduler any more would print a traceback.
                quiet = dask.config.set({"logging.distributed": "critical"})
                local = distributed.LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=self.jobs or len(os.sched_getaffinity(0)),
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
                with quiet, local, distributed.Client(local) as client:  # type: ignore[no-untyped-call]
                    yield client
                return
            with self._connected(distributed) as client:
                _validate_workers(client)
                yield client

    def _connected(self, distributed: Any) -> Any:
        given: dict[str, Any] = {"timeout": PATIENCE}
        if self.tls is not None:
            paths = zip(("tls_ca_file", "tls_client_cert", "tls_client_key"), map(str, self.tls), strict=True)
            given["security"] = distributed.Security(**dict(paths), validate_encryption=True)
        place = self.scheduler or str(self.scheduler_file)
        given["address" if self.scheduler else "scheduler_file"] = place
        try:
            return distributed.Client(**given)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise InputError(f"scheduler {place}: cannot be reached ({' '.join(str(error).split())})") from error


def versions() -> str:
    """Version of adaptctl, as text, that is installed where the function runs: run on a cluster's worker, it tells
    whether the worker has the same version. Nothing is raised."""
    return __version__


def _validate_workers(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError as error:
        raise InputError(f"the scheduler has no workers after {PATIENCE:g} s: start some") from error
    try:
        found = client.run(versions)
    except ModuleNotFoundError as error:
        raise InputError(f"a worker lacks adaptctl ({error}): install {__version__} there") from error
    for worker, version in found.items():
        if version != __version__:
            raise InputError(f"worker {worker} has adaptctl {version}, this is {__version__}: use the same everywhere")


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
    study, total = folder.study, -(-folder.study.count // folder.shard)
    missing = {f"adaptctl-{shard.key}": shard for shard in folder.shards() if not folder.has(shard)}
    progress((total - len(missing)) / total)
    if missing:
        with cluster.client() as client:
            import distributed

            given: dict[str, Any] = {"pure": False, "retries": ATTEMPTS}
            how = study.controllers, study.precision
            futures = [
                client.submit(rows_of, study.experiment, shard.runs, *how, key=key, **given)
                for key, shard in missing.items()
            ]
            for future in distributed.as_completed(futures):  # type: ignore[no-untyped-call]
                folder.keep(missing.pop(future.key), future.result())
                future.release()
                progress((total - len(missing)) / total)
    return folder.finished()
