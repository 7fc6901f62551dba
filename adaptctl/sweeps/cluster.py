"""Sweeps: every run of a study computed, once, by Dask on this machine or on a cluster."""

from __future__ import annotations

import atexit
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptctl.errors import AdaptctlError, InputError
from adaptctl.optional_packages import needed
from adaptctl.sweeps.folder import Folder
from adaptctl.sweeps.rows import rows_of
from adaptctl.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

# Time in s to wait for a scheduler, and for its first worker.
CONNECTION_TIMEOUT = 15.0
# Dask's settings that have it watch itself less: by default that takes some 2 % of a processor for each process.
QUIET_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}


@dataclass(frozen=True)
class Cluster:
    """Workers of a sweep: so many on this computer, or those of a Dask scheduler."""

    jobs: int | None = None
    scheduler: str | None = None
    scheduler_file: Path | None = None
    tls: tuple[Path, Path, Path] | None = None

    def __post_init__(self) -> None:
        given = [x for x in (self.jobs, self.scheduler, self.scheduler_file) if x is not None]
        if len(given) > 1:
            raise InputError("expected one of --jobs, --scheduler and --scheduler-file")
        if self.jobs is not None and not 1 <= self.jobs <= 4096:
            raise InputError(f"--jobs: expected 1 to 4096 workers, got {self.jobs}")
        for path in (*(self.tls or ()), *([self.scheduler_file] if self.scheduler_file else [])):
            if not path.is_file():
                raise InputError(f"{path}: no such file")

    @contextmanager
    def client(self) -> Iterator[Any]:
        """Context manager with a connected Dask client."""
        with needed("a sweep"):
            import dask
            import distributed
        patient = {"distributed.comm.timeouts.connect": CONNECTION_TIMEOUT, "logging.distributed": "error"}
        with dask.config.set(QUIET_SETTINGS | patient):
            if self.scheduler is None and self.scheduler_file is None:
                # A worker whose last heartbeat finds no scheduler any more would print a traceback.
                quiet = dask.config.set({"logging.distributed": "critical"})
                with _ended_quietly(), _named():
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
        given: dict[str, Any] = {"timeout": CONNECTION_TIMEOUT}
        if self.tls is not None:
            paths = zip(("tls_ca_file", "tls_client_cert", "tls_client_key"), map(str, self.tls), strict=True)
            given["security"] = distributed.Security(**dict(paths), require_encryption=True)
        place = self.scheduler or str(self.scheduler_file)
        given["address" if self.scheduler else "scheduler_file"] = place
        try:
            return distributed.Client(**given)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise InputError(f"scheduler {place}: cannot be reached ({' '.join(str(error).split())})") from error


@contextmanager
def _named() -> Iterator[None]:
    """Context in which a start that fails, as without a loopback interface or in time, is an error of one line."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise AdaptctlError(f"workers cannot be started ({' '.join(str(error).split())}): try fewer --jobs") from error


@contextmanager
def _ended_quietly() -> Iterator[None]:
    """Context in which a cluster whose start is interrupted is closed; at exit Dask would print a traceback of it."""
    try:
        yield
    except BaseException:
        from distributed.deploy.spec import close_clusters

        atexit.unregister(close_clusters)
        with suppress(Exception):
            close_clusters()
        raise


def versions() -> str:
    """Version of adaptctl where the function runs, such as a cluster's worker."""
    return __version__


def _validate_workers(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECTION_TIMEOUT)
    except TimeoutError as error:
        raise InputError(f"the scheduler has no workers after {CONNECTION_TIMEOUT:g} s: start workers") from error
    try:
        found = client.run(versions)
    except ModuleNotFoundError as error:
        raise InputError(f"a worker lacks adaptctl ({error}): install {__version__} there") from error
    for worker, version in found.items():
        if version != __version__:
            raise InputError(
                f"worker {worker} has adaptctl {version}, but this process has {__version__}: use the same version"
            )


def sweep(folder: Folder, cluster: Cluster, progress: Callable[[float], object] = lambda share: None) -> pa.Table:
    """Run all missing runs of a folder's study, and return the table of its rows."""
    study, total = folder.study, -(-folder.study.count // folder.shard)
    missing = {f"adaptctl-{shard.key}": shard for shard in folder.shards() if not folder.has(shard)}
    progress((total - len(missing)) / total)
    if missing:
        with cluster.client() as client:
            import distributed

            how = study.controllers, study.precision
            futures = [
                client.submit(rows_of, study.experiment, shard.runs, *how, key=key) for key, shard in missing.items()
            ]
            for future in distributed.as_completed(futures):  # type: ignore[no-untyped-call]
                folder.keep(missing.pop(future.key), future.result())
                future.release()
                progress((total - len(missing)) / total)
    return folder.finished()
