"""Live view of a running loop."""

from __future__ import annotations

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import positive_number
from adaptctl.description.visual import Box, Visual
from adaptctl.description.writers.mechanism_file import mechanism_toml
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, LiveViewWarning, MissingExtraError, NonFiniteError, validate_kind, warn
from adaptctl.files import validate_place
from adaptctl.optional_packages import viewer_program

HOST, PORT = "127.0.0.1", 9876
# Times in s to wait for a viewer to start or end, and for a file to be whole.
VIEWER_TIMEOUT, FILE_TIMEOUT = 10.0, 60.0

# Address that experiments stream to while they run, or None.
CURRENT: ContextVar[str | None] = ContextVar("live", default=None)


class Live:
    """
    Live view of a control loop, drawn by the rerun viewer.

    A sample is handed over within microseconds and the loop never waits: where the separate process that draws does not
    keep up, samples are dropped. The attributes `sent` and `dropped` count them; `url` is the viewer's or file's, or
    None. It is a context manager, which closes the view.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    to : str, optional
        Address HOST:PORT of a viewer on this computer, or a file that ends in .rrd; 127.0.0.1:9876 by default.
    rate : float, default 100.0
        Largest number of samples per second of the loop's time. 100 look continuous, without drawing all of a loop at 1
        kHz.
    start_viewer : bool, default True
        True starts a viewer, bound to 127.0.0.1, where none answers, and waits for up to 10 s. A `LiveViewWarning`
        tells where none can be reached, and the loop goes on unseen.
    inline : bool, default False
        True starts a server without a window, for notebooks (`display(live)`, which needs rerun-notebook).
    surroundings : sequence of Visual, optional
        What stands beside the arm, of which boxes are drawn. Default: nothing.

    Raises
    ------
    InputError
        If the address is of another form or computer, the rate is not positive and finite, or the mechanism cannot be
        drawn.
    FileError
        If a file cannot be written.

    Examples
    --------
    >>> import warnings
    >>> from adaptctl.recording import Live
    >>> with warnings.catch_warnings(action="ignore"), Live(arm, "127.0.0.1:9", start_viewer=False) as live:
    ...     live.show(0.0, p, p, np.zeros(2))
    ...     live.is_seen
    False
    """

    def __init__(
        self,
        mechanism: Mechanism,
        to: str | None = None,
        *,
        rate: float = 100.0,
        start_viewer: bool = True,
        inline: bool = False,
        surroundings: Sequence[Visual] = (),
    ) -> None:
        validate_kind(mechanism, Mechanism, "live view", "as load(...) gives one")
        self._pause = 1.0 / positive_number(rate, "rate: expected a positive number of samples per second")
        self._dof, self._latest = mechanism.dof, -np.inf
        self.sent, self.dropped = 0, 0
        self._socket: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        place = f"{HOST}:{PORT}" if to is None else to
        if not isinstance(place, str):
            raise InputError(f"to: expected {HOST}:PORT or a path that ends in .rrd, got {to!r}")
        if to_file := is_file(place):
            validate_place(place)
        self.url = place if to_file else reachable(place, start_viewer, inline)
        if self.url is not None:
            self._begin(mechanism, self.url, tuple(surroundings))

    @property
    def is_seen(self) -> bool:
        """True while samples are sent."""
        return self._socket is not None

    def show(self, time: float, p: ArrayLike, reference_p: ArrayLike, torque: ArrayLike) -> None:
        """
        Send a sample to the viewer without blocking the loop.

        Samples that follow sooner than `rate` allows are left out. Invalid values end the view with a
        `LiveViewWarning`; no error is raised, so that the control loop goes on.

        Parameters
        ----------
        time : float
            Time in s.
        p : array_like
            Measured positions (r,) of the r joints in rad (m if prismatic).
        reference_p : array_like
            Desired positions (r,) in rad or m.
        torque : array_like
            Torques (r,) in N m, or forces in N.
        """
        try:
            if self._socket is None or 0.0 <= time - self._latest < 0.999 * self._pause:
                return
            self._latest = time
            self._socket.send(self._sample(time, p, reference_p, torque))
            self.sent += 1
        except BlockingIOError:
            self.dropped += 1
        except (OSError, TypeError, ValueError, OverflowError) as error:
            self._lose(f"{type(error).__name__}: {error}")

    def close(self) -> None:
        """Wait until the samples are drawn, at most 10 s (60 s for a file), and end the view."""
        self._disconnect()
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(FILE_TIMEOUT if is_file(self.url or "") else VIEWER_TIMEOUT)
            self._process.kill()
            self._process.wait()
            self._process = None

    def viewer(self, **options: Any) -> Any:
        """
        Return a widget for notebooks that shows the view.

        Parameters
        ----------
        **options
            Options of `rerun.notebook.Viewer`, such as `height`.

        Returns
        -------
        rerun.notebook.Viewer
            Widget.

        Raises
        ------
        MissingExtraError
            If rerun-notebook is not installed.
        InputError
            If no viewer was reached or the view goes to a file.
        """
        try:
            import rerun_notebook  # noqa: F401  # rerun itself asks for it late, in a traceback
            from rerun.notebook import Viewer
        except ImportError as error:
            raise MissingExtraError("live view: notebooks need rerun-notebook: pip install rerun-notebook") from error
        if self.url is None or is_file(self.url):
            raise InputError(f"live view: no viewer is reachable{f' at {self.url}' if self.url else ''}")
        return Viewer(url=self.url, **options)

    def _ipython_display_(self) -> None:
        self.viewer().display()

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _sample(self, time: float, *given: ArrayLike) -> bytes:
        if any(np.shape(one) != (self._dof,) for one in given):
            raise InputError(f"expected arrays of shape ({self._dof},), got {[np.shape(one) for one in given]}")
        sample = np.concatenate(((time,), *given), dtype=np.float64)
        if not np.isfinite(sample).all():
            raise NonFiniteError(f"expected finite numbers, got {sample[~np.isfinite(sample)][0]}")
        return sample.tobytes()

    def _begin(self, mechanism: Mechanism, url: str, surroundings: tuple[Visual, ...]) -> None:
        solids = [(one.pose.rotation.tolist(), one.pose.translation.tolist(), one.solid) for one in surroundings]
        beside = [(turned, center, solid.size) for turned, center, solid in solids if isinstance(solid, Box)]
        drawn = json.dumps({"robot": mechanism_toml(mechanism.description), "boxes": beside})
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        here.setblocking(False)
        command = [sys.executable, "-m", "adaptctl.recording.live_process", str(there.fileno()), url]
        with there:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=(there.fileno(),))
        if (pipe := self._process.stdin) is not None:
            with pipe:
                pipe.write(drawn.encode())
        self._socket = here

    def _lose(self, why: str) -> None:
        self._disconnect()
        warn(f"live view: ended ({why}); the run continues without it", LiveViewWarning)

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def is_file(place: str) -> bool:
    """True if a view goes to a file, not to a viewer."""
    return place.endswith(".rrd")


def reachable(address: str, start_viewer: bool, inline: bool) -> str | None:
    """URL of a viewer on this computer."""
    host, _, port = address.rpartition(":")
    if host not in (HOST, "localhost") or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"live view: expected {HOST}:PORT on this computer, or a .rrd file, got {address!r}")
    url = f"rerun+http://{HOST}:{port}/proxy"
    if _answers(int(port)):
        return url
    viewer = viewer_program()
    if start_viewer and viewer is not None:
        command = [viewer, "--bind", HOST, "--port", port, *(["--serve-grpc"] if inline else [])]
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        started = subprocess.Popen(command, **quiet, start_new_session=True)
        if inline:
            atexit.register(_end, started.pid)
        deadline = time.monotonic() + VIEWER_TIMEOUT
        while time.monotonic() < deadline:
            if _answers(int(port)):
                return url
            time.sleep(0.1)
    warn(
        f"live view: no viewer is reachable at {HOST}:{port}; the run continues without a live view",
        LiveViewWarning,
    )
    return None


@contextmanager
def streaming(to: str | None) -> Iterator[None]:
    """Context manager in which experiments stream their runs to a live view."""
    token = CURRENT.set(to)
    try:
        yield
    finally:
        CURRENT.reset(token)


def _end(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGTERM)


def _answers(port: int) -> bool:
    try:
        socket.create_connection((HOST, port), 0.5).close()
    except OSError:
        return False
    return True
