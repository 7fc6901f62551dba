"""Workers of a sweep: how many, of which version, and what is said of those that cannot be had."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from adaptctl.errors import AdaptctlError, InputError
from adaptctl.sweeps.cluster import Cluster, _ended_quietly, _validate_workers
from adaptctl.version import __version__


def test_workers_must_be_there_and_of_this_version() -> None:
    def client(waits: Exception | None = None, runs: Any = __version__) -> Any:
        def wait(count: int, timeout: float) -> None:
            assert (count, timeout) == (1, 15.0)
            if waits:
                raise waits

        def run(call: Any) -> dict[str, Any]:
            assert call() == __version__
            if isinstance(runs, Exception):
                raise runs
            return {"tcp://a": __version__, "tcp://b": runs}

        return SimpleNamespace(wait_for_workers=wait, run=run)

    _validate_workers(client())
    with pytest.raises(InputError, match="no workers after 15 s: start workers"):
        _validate_workers(client(TimeoutError()))
    with pytest.raises(InputError, match="a worker lacks adaptctl"):
        _validate_workers(client(runs=ModuleNotFoundError("adaptctl")))
    with pytest.raises(InputError, match=r"worker tcp://b has adaptctl 0\.1, but this process has"):
        _validate_workers(client(runs="0.1"))


@pytest.mark.parametrize("jobs", [0, 4097])
def test_workers_are_at_least_one_and_at_most_4096(jobs: int) -> None:
    with pytest.raises(InputError, match="--jobs: expected 1 to 4096 workers"):
        Cluster(jobs)
    assert [Cluster(x).jobs for x in (1, 4096)] == [1, 4096]
    with pytest.raises(InputError, match="expected one of --jobs, --scheduler"):
        Cluster(1, "tcp://a")


def test_a_computer_s_workers_are_processes_of_one_thread_that_do_not_watch_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import dask

    started: list[Any] = []

    def local(n_workers: int, threads_per_worker: int, silence_logs: int, **_: object) -> Any:
        assert not dask.config.get("distributed.worker.profile.enabled")
        started.append((n_workers, threads_per_worker))
        return nullcontext()

    monkeypatch.setattr("distributed.LocalCluster", local)
    monkeypatch.setattr("distributed.Client", lambda of: nullcontext("client"))
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {2, 3, 5} if process == 0 else set())
    for jobs in (None, 1, 7):
        with Cluster(jobs).client() as client:
            assert client == "client"
    assert started == [(3, 1), (1, 1), (7, 1)]


def test_a_scheduler_elsewhere_is_reached_encrypted_and_asked_for_its_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import distributed

    asked: list[dict[str, Any]] = []

    def client(**given: Any) -> Any:
        asked.append(given)
        return nullcontext(SimpleNamespace(wait_for_workers=lambda *_, **__: None, run=lambda call: {"a": "0.1"}))

    paths = [tmp_path / name for name in ("ca.pem", "cert.pem", "key.pem")]
    for path in paths:
        path.touch()
    monkeypatch.setattr("distributed.Client", client)
    with pytest.raises(InputError, match="use the same version"), Cluster(None, "tls://a:1", None, (*paths,)).client():
        pass
    with pytest.raises(InputError, match="use the same version"), Cluster(None, None, paths[0]).client():
        pass
    (there, by_file) = asked
    assert (there["address"], by_file["scheduler_file"]) == ("tls://a:1", str(paths[0]))
    assert "security" not in by_file
    security: distributed.Security = there["security"]
    assert security.require_encryption
    assert [security.tls_ca_file, security.tls_client_cert, security.tls_client_key] == [str(path) for path in paths]


def test_workers_that_do_not_start_are_told_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(**_: object) -> None:
        raise RuntimeError("Cluster failed to start:\n timed out")

    monkeypatch.setattr("distributed.LocalCluster", late)
    told = r"workers cannot be started \(Cluster failed to start: timed out\): try fewer --jobs"
    with pytest.raises(AdaptctlError, match=told), Cluster(jobs=1).client():
        pass


def test_a_cluster_that_is_interrupted_while_it_starts_is_closed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed.deploy import spec

    done: list[Any] = []

    def close() -> None:
        done.append("closed")
        raise RuntimeError("half started")

    monkeypatch.setattr(spec, "close_clusters", close)
    monkeypatch.setattr("atexit.unregister", done.append)
    with pytest.raises(KeyboardInterrupt), _ended_quietly():
        raise KeyboardInterrupt
    assert done == [close, "closed"]  # and not once more at exit
