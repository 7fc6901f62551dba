"""Live views: what is shown arrives, the loop never waits, and a viewer that is not there is told once."""

from __future__ import annotations

import io
import json
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
import rerun as rr
from nightly import at_night
from recordings import rows

import adaptctl
from adaptctl.description import JointKind, Limits
from adaptctl.description.writers.mechanism_file import mechanism_toml
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.envs import LearningEnv, LiveView, ResidualEnv, TrackingEnv
from adaptctl.envs.contact import surroundings_of
from adaptctl.errors import FileError, InputError, LiveViewWarning, MissingExtraError
from adaptctl.experiments.contest import Contender, contest
from adaptctl.recording import live as viewing
from adaptctl.recording import live_process
from adaptctl.recording.live import CURRENT, HOST, PORT, reachable, streaming
from adaptctl.recording.live_process import _end, _Rows


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def test_what_is_shown_arrives_thinned(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    with adaptctl.Live(arm, str(path), rate=50.0, surroundings=surroundings_of("wall")) as live:
        for k in range(1000):
            live.show(1e-3 * k, np.ones(2), np.zeros(2), np.ones(2))
    assert live.sent + live.dropped == 50
    assert len(rows(path, "/error", "Scalars:scalars")) == live.sent
    assert len(rows(path, "/world/arm/upper", "Transform3D:translation")) == live.sent
    assert rows(path, "/world/surroundings/visual/0", "Boxes3D:half_sizes") == [[pytest.approx([0.02, 0.4, 0.3])]]
    assert not live.is_seen


def test_samples_are_drawn_as_they_came(
    arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the process that draws: in several batches, boxes beside, and what is of another length left out."""
    samples, path = np.random.default_rng(0).normal(size=(6, 7)), tmp_path / "live.rrd"
    samples[:, 0] = 0.1 * np.arange(6)
    turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    given = {"robot": mechanism_toml(arm.description), "boxes": [(turn, [1.0, 2.0, 3.0], [0.2, 0.4, 0.6])]}
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(given)))
    monkeypatch.setattr(live_process, "FILE_BATCH_TIME", 0.0)
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here:
        for one in samples:
            here.send(one.tobytes())
            here.send(one[1:].tobytes())
    handlers = dict[int, object]()
    monkeypatch.setattr(signal, "signal", handlers.__setitem__)
    live_process.main(there.detach(), str(path))
    assert handlers == {signal.SIGINT: signal.SIG_IGN}
    p, desired, torque = np.split(samples[:, 1:], 3, axis=1)
    for entity, values in (
        ("error", 1e3 * (p - desired)),
        ("torque", torque),
        ("position/actual", p),
        ("position/desired", desired),
    ):
        np.testing.assert_allclose(rows(path, f"/{entity}", "Scalars:scalars"), values)
    for name, at in (("arm", p), ("desired", desired)):
        places = np.array(rows(path, f"/world/{name}/lower", "Transform3D:translation"))[:, 0]
        np.testing.assert_allclose(places, link_poses(arm, at).translations[:, 1], atol=1e-6)
    box = "/world/surroundings/visual/0"
    np.testing.assert_allclose(rows(path, box, "Boxes3D:half_sizes"), [[[0.1, 0.2, 0.3]]], rtol=1e-6)
    np.testing.assert_allclose(rows(path, box, "Transform3D:translation"), [[[1.0, 2.0, 3.0]]])
    np.testing.assert_allclose(rows(path, box, "Transform3D:mat3x3"), [[np.transpose(turn).ravel()]])


def test_a_loop_never_waits_for_a_view_that_hangs(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    live = adaptctl.Live(arm, str(tmp_path / "live.rrd"), rate=1e6)
    assert live._process is not None
    live._process.send_signal(signal.SIGSTOP)
    started = time.process_time(), time.monotonic()
    for k in range(5000):
        live.show(float(k), np.ones(2), np.zeros(2), np.ones(2))
    assert time.process_time() - started[0] < 2.0
    assert time.monotonic() - started[1] < 10.0  # however busy the machine is: it does not hang
    assert live.dropped > 0
    live._process.kill()
    live.close()


def test_a_view_that_ends_is_told_once_and_the_loop_goes_on(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    live = adaptctl.Live(arm, str(tmp_path / "live.rrd"))
    assert live._process is not None
    live._process.kill()
    live._process.wait()

    def shown_often() -> None:
        for k in range(100):
            live.show(float(k), np.ones(2), np.zeros(2), np.ones(2))

    with pytest.warns(LiveViewWarning, match="live view: ended") as told:
        shown_often()
    assert len(told) == 1
    assert not live.is_seen


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def test_a_viewer_that_is_not_reachable_is_told_once_and_the_run_goes_on(arm: adaptctl.Mechanism) -> None:
    address = f"127.0.0.1:{free_port()}"
    with pytest.warns(LiveViewWarning, match=f"no viewer is reachable at {address}; the run continues") as told:
        live = adaptctl.Live(arm, address, start_viewer=False)
    env = LiveView(gymnasium.make("adaptctl/Tracking-v0", robot=arm, reference=1, duration=0.05), live)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = adaptctl.rollout(env, adaptctl.ComputedTorque(arm, 8.0))
    assert len(run.time) == 50
    assert len(told) == 1


def test_environments_that_cannot_be_shown_are_refused(arm: adaptctl.Mechanism) -> None:
    env, live = TrackingEnv(arm, 1), cast("adaptctl.Live", None)
    with pytest.raises(InputError, match="expected observations in SI units"):
        LiveView(LearningEnv(env), live)
    with pytest.raises(InputError, match="needs a control_period in s and observation_slices"):
        LiveView(gymnasium.make("CartPole-v1"), live)
    LiveView(ResidualEnv(env, adaptctl.ComputedTorque(arm, 8.0)), live)


@pytest.mark.parametrize("address", ["10.0.0.3:9876", "0.0.0.0:9876", "9876", "127.0.0.1:x", "127.0.0.1:0"])
def test_other_computers_are_refused(address: str) -> None:
    with pytest.raises(InputError, match="on this computer"):
        reachable(address, False, False)


def test_a_file_has_more_time_to_be_whole_than_a_window_to_close() -> None:
    times: list[float] = []
    for url in ("run.rrd", "rerun+http://127.0.0.1:9876/proxy"):
        live: Any = object.__new__(adaptctl.Live)
        live.url, live._socket = url, None
        live._process = SimpleNamespace(wait=lambda *time: times.extend(time), kill=lambda: None)
        live.close()
    assert times == [60.0, 10.0]


def test_a_viewer_is_looked_for_where_reruns_own_program_listens() -> None:
    assert f"rerun+http://{HOST}:{PORT}/proxy" in (rr.connect_grpc.__doc__ or "")


def test_a_viewer_that_answers_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert reachable(f"localhost:{port}", False, False) == f"rerun+http://127.0.0.1:{port}/proxy"


@pytest.mark.parametrize(("ready", "inline"), [(0.15, False), (9.5, True), (10.5, False)])
def test_a_viewer_is_started_and_has_ten_seconds_to_answer(
    ready: float, inline: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a session of its own, which Ctrl-C of the loop does not reach; without a window it ends with Python."""
    waited, started, ended = list[float](), list[tuple[Any, Any]](), list[Any]()
    clock: Any = SimpleNamespace(monotonic=lambda: sum(waited), sleep=waited.append)
    process: Any = lambda command, **how: started.append((command, how)) or SimpleNamespace(pid=7)  # noqa: E731
    monkeypatch.setattr(viewing, "time", clock)
    monkeypatch.setattr(viewing, "viewer_program", lambda: "viewer")
    monkeypatch.setattr(viewing, "_answers", lambda port: sum(waited) > ready)
    monkeypatch.setattr(viewing.subprocess, "Popen", process)
    monkeypatch.setattr(viewing.atexit, "register", lambda *given: ended.append(given))
    with nullcontext() if ready < 10.0 else pytest.warns(LiveViewWarning, match="no viewer is reachable"):
        found = reachable("localhost:4321", True, inline)
    assert found == ("rerun+http://127.0.0.1:4321/proxy" if ready < 10.0 else None)
    assert sum(waited) == pytest.approx(min(ready, 10.0), abs=0.11)
    ((command, how),) = started
    assert command == ["viewer", "--bind", "127.0.0.1", "--port", "4321", *(["--serve-grpc"] if inline else [])]
    assert how["start_new_session"]
    assert ended == ([(viewing._end, 7)] if inline else [])


def test_experiments_stream_while_they_run(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    env: Any = gymnasium.make("adaptctl/Tracking-v0", robot=arm, reference=1, duration=0.2)
    contender = Contender.of("law", "Computed torque", "everything", adaptctl.ComputedTorque(arm, 8.0))
    plain = contest(env, arm, [contender], 0, lambda *_: None)
    with streaming(str(tmp_path / "live.rrd")):
        streamed = contest(env, arm, [contender], 0, lambda *_: None)
    assert CURRENT.get() is None
    np.testing.assert_allclose(streamed.runs[0].rollout.p, plain.runs[0].rollout.p, atol=1e-12)
    assert len(rows(tmp_path / "live.rrd", "/torque", "Scalars:scalars")) == 20


def test_samples_of_a_burst_are_drawn_before_the_next() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    found: list[Any] = []
    with there, here:
        reader = threading.Thread(target=lambda: found.append(_Rows(there, 3).next()), daemon=True)
        for k in range(3):
            here.send(np.full(3 if k else 2, float(k)).tobytes())
        reader.start()
        reader.join(20.0)
        assert len(found) == 1
        np.testing.assert_array_equal(found[0], [[1.0] * 3, [2.0] * 3])  # the first is of another length


def test_a_view_waits_for_a_sample_for_ever_and_draws_it_within_a_twentieth_of_a_second() -> None:
    coming, waits = [np.full(3, 1.0).tobytes(), TimeoutError(), b""], list[float | None]()

    def recv(most: int) -> bytes:
        now = coming.pop(0)
        if isinstance(now, bytes):
            return now
        raise now

    samples: Any = SimpleNamespace(settimeout=waits.append, recv=recv)
    rows = _Rows(samples, 3)
    np.testing.assert_array_equal(rows.next(), np.ones((1, 3)))
    assert rows.next() is rows.next() is None
    first, more, end = waits
    assert first is end is None
    assert more is not None
    assert 0.0 < more <= 0.05


Z = [0.0, 0.0]


@pytest.mark.parametrize(
    ("sample", "why"),
    [
        at_night((("a", Z, Z, Z), "TypeError")),
        at_night(((None, Z, Z, Z), "TypeError")),
        at_night(((10**400, Z, Z, Z), "OverflowError")),
        at_night(((np.nan, Z, Z, Z), "NonFiniteError: expected finite numbers, got nan")),
        ((1.0, [np.nan, 0.0], Z, Z), "NonFiniteError: expected finite numbers, got nan"),
        at_night(((1.0, Z, Z, [0.0, np.inf]), "NonFiniteError: expected finite numbers, got inf")),
        at_night(
            ((1.0, [0.0] * 3, [0.0], Z), r"InputError: expected arrays of shape \(2,\), got \[\(3,\), \(1,\), \(2,\)\]")
        ),
        at_night(((1.0, Z, Z, 0.0), r"InputError: expected arrays of shape \(2,\)")),
    ],
)
def test_what_cannot_be_drawn_ends_the_view_and_not_the_loop(
    arm: adaptctl.Mechanism, tmp_path: Path, sample: Any, why: str
) -> None:
    path = tmp_path / "live.rrd"
    with adaptctl.Live(arm, str(path)) as live:
        live.show(0.0, Z, Z, Z)
        with pytest.warns(LiveViewWarning, match=f"live view: ended \\({why}"):
            live.show(*sample)
        assert not live.is_seen
        live.show(2.0, Z, Z, Z)
    assert len(rows(path, "/error", "Scalars:scalars")) == live.sent == 1


def test_places_that_no_view_can_be_written_to_are_refused(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none/b\.rrd: the folder .* does not exist"):
        adaptctl.Live(arm, str(tmp_path / "none" / "b.rrd"))
    wrong: Any = 5
    with pytest.raises(InputError, match=r"to: expected 127\.0\.0\.1:PORT or a path .* got 5"):
        adaptctl.Live(arm, wrong)


def test_a_rate_is_a_positive_number(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rate: expected a positive number"):
        adaptctl.Live(arm, str(tmp_path / "live.rrd"), rate=0.0)


def test_a_mechanism_that_no_file_can_say_is_refused_before_a_process_is_started(
    arm: adaptctl.Mechanism, tmp_path: Path
) -> None:
    first, *others = arm.description.links
    turning = replace(first.joint, kind=JointKind.CONTINUOUS, limits=Limits(-1.0, 1.0))
    links = (replace(first, joint=turning), *others)
    with pytest.raises(InputError, match=r"is continuous, but has position limits from -1\.0 to 1\.0"):
        adaptctl.Live(adaptctl.Mechanism(replace(arm.description, links=links)), str(tmp_path / "live.rrd"))
    assert list(tmp_path.iterdir()) == []


INLINE = """
import sys, time
import adaptctl
arm = adaptctl.load("two_link")
live = adaptctl.Live(arm, f"127.0.0.1:{sys.argv[1]}", inline=True)
for k in range(200):
    live.show(0.01 * k, [1.0, 0.0], [0.0, 0.0], [0.0, 0.0])
live.close()
print(live.url, live.sent + live.dropped, flush=True)
sys.stdin.readline()
"""


def test_a_notebooks_server_is_this_computers_alone_and_ends_with_python(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    run = [sys.executable, "-c", INLINE, str(port)]
    with subprocess.Popen(run, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as notebook:
        assert notebook.stdout is not None
        assert notebook.stdin is not None
        assert notebook.stdout.readline() == f"rerun+http://127.0.0.1:{port}/proxy 200\n"
        listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        assert f"0100007F:{port:04X}" in listening
        assert f"00000000:{port:04X}" not in listening
        assert socket.create_connection(("127.0.0.1", port), 5.0).close() is None
        notebook.stdin.write("\n")
    deadline = time.monotonic() + 20.0
    while reachable_quietly(port) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not reachable_quietly(port)


def reachable_quietly(port: int) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LiveViewWarning)
        return reachable(f"127.0.0.1:{port}", False, False) is not None


def test_what_notebooks_need_is_named(arm: adaptctl.Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with adaptctl.Live(arm, str(tmp_path / "live.rrd")) as live:
        monkeypatch.setitem(sys.modules, "rerun_notebook", None)
        with pytest.raises(MissingExtraError, match="notebooks need rerun-notebook: pip install rerun-notebook"):
            live.viewer()


@pytest.mark.parametrize("url", [None, "run.rrd", "rerun+http://127.0.0.1:9876/proxy"])
def test_a_notebook_has_the_viewer_that_was_reached(url: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun_notebook", cast(Any, SimpleNamespace()))
    notebook: Any = SimpleNamespace(Viewer=lambda url, **options: (url, options))
    monkeypatch.setitem(sys.modules, "rerun.notebook", notebook)
    live: Any = object.__new__(adaptctl.Live)
    live.url = url
    if url is None or url.endswith(".rrd"):
        with pytest.raises(InputError, match=f"no viewer is reachable(?: at {url})?$"):
            live.viewer()
    else:
        assert live.viewer(width=300) == (url, {"width": 300})
        displayed: list[str] = []
        notebook.Viewer = lambda url: SimpleNamespace(display=lambda: displayed.append(url))
        live._ipython_display_()
        assert displayed == [url]


def test_a_viewer_that_was_closed_ends_the_process_without_a_traceback() -> None:
    class Severed:
        flushed = False

        def flush(self) -> None:
            self.flushed = True
            raise RuntimeError("gRPC connection severed")

    recording: Any = Severed()
    _end(recording)
    assert recording.flushed
