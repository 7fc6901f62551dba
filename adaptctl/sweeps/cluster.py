"""Clusters for sweeps: Dask on this machine, or the user's own."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adaptctl.errors import InputError, MissingExtraError
from adaptctl.version import __version__

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
    """A cluster to use: so many workers of this machine's, or a scheduler by its address or the file that it wrote.

    `tls` has the files of the authority, the certificate and the key of a scheduler whose address is ``tls://``.
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
        """A Dask client, connected. Raises `InputError` where there is no scheduler, no worker, or another version."""
        dask, distributed = _dask()
        patient = {"distributed.comm.timeouts.connect": PATIENCE, "logging.distributed": "error"}
        with dask.config.set(UNWATCHED | patient):
            if self.scheduler is None and self.scheduler_file is None:
                workers = self.jobs or len(os.sched_getaffinity(0))
                options = {
                    "n_workers": workers,
                    "threads_per_worker": 1,
                    "host": "127.0.0.1",
                    "dashboard_address": "127.0.0.1:0",
                    "silence_logs": logging.CRITICAL,
                }
                # A worker whose last heartbeat finds no scheduler any more would print a traceback.
                quiet = dask.config.set({"logging.distributed": "critical"})
                with quiet, distributed.LocalCluster(**options) as local, distributed.Client(local) as client:
                    yield client
                return
            client = self._connected(distributed)
            with client:
                _require_workers(client)
                yield client

    def _connected(self, distributed: Any) -> Any:
        security = None
        if self.tls is not None:
            authority, certificate, key = map(str, self.tls)
            security = distributed.Security(
                tls_ca_file=authority, tls_client_cert=certificate, tls_client_key=key, require_encryption=True
            )
        try:
            if self.scheduler_file is not None:
                return distributed.Client(scheduler_file=str(self.scheduler_file), security=security, timeout=PATIENCE)
            return distributed.Client(self.scheduler, security=security, timeout=PATIENCE)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            place = self.scheduler or self.scheduler_file
            raise InputError(f"scheduler {place}: cannot be reached ({' '.join(str(error).split())})") from error


def versions() -> str:
    """Version of adaptctl on a worker."""
    return __version__


def _require_workers(client: Any) -> None:
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


def _dask() -> tuple[Any, Any]:
    try:
        import dask
        import distributed
    except ImportError as error:
        raise MissingExtraError("sweeps need Dask: pip install 'adaptctl[sweep]'") from error
    return dask, distributed
