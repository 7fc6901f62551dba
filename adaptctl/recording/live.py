"""A live view of a running loop: samples are thinned and handed to another process, which shows them in rerun."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import positive_number
from adaptctl.description.writers.mechanism_file import mechanism_toml
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, LiveViewWarning, MissingExtraError, NonFiniteError, validate_kind
from adaptctl.files import validate_place
from adaptctl.optional_packages import viewer_program

HOST, PORT = "127.0.0.1", 9876
PATIENCE, WRITING = 10.0, 60.0
"""s to wait for a viewer that was started, or to end; and for a file to be whole"""

CURRENT: ContextVar[str | None] = ContextVar("live", default=None)
"""Address that experiments stream to while they run, or None."""


class Live:
    """Live view of a control loop on a `mechanism` of r joints, drawn by the rerun viewer: its method `show` takes a
    sample of the loop and returns within microseconds.

    At most `rate` samples per second of the loop's time, 100 by default, are sent to a separate process that draws
    them; where it does not keep up, samples are dropped and the loop never waits. The attributes `sent` and `dropped`
    count them. `to` is the address HOST:PORT of a viewer on this computer, None for 127.0.0.1:9876, or a file that ends
    in .rrd. With `start_viewer` (the default) a viewer is started where none is at the address, bound to 127.0.0.1
    alone and waited for up to 10 s. Where none can be reached, one `LiveViewWarning` is given, and the loop goes on
    unseen. The attribute `url` is the viewer's or the file's, None where there is none. With `inline` (False by
    default), for notebooks, what is started is a server without a window, to which what is displayed in a cell connects
    (`display(live)`; needs rerun-notebook); it ends with Python.

    It is a context manager, which closes the view at its end. Raises `InputError` for another address or computer, a
    `to` that is not a text, a rate that is not positive and finite, and a mechanism with position limits of a
    continuous joint or with loops that have neither closures nor couplings, `FileError` for a file that cannot be
    written.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        to: str | None = None,
        *,
        rate: float = 100.0,
        start_viewer: bool = True,
        inline: bool = False,
    ) -> None:
        validate_kind(mechanism, Mechanism, "live view", "as load(...) gives one")
        self._pause = 1.0 / positive_number(rate, "rate: expected a positive number of samples a second")
        self._dof, self._latest = mechanism.dof, -np.inf
        self.sent, self.dropped = 0, 0
        self._socket: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        place = f"{HOST}:{PORT}" if to is None else to
        if not isinstance(place, str):
            raise InputError(f"to: expected the text {HOST}:PORT or a file's that ends in .rrd, got {to!r}")
        if is_file := place.endswith(".rrd"):
            validate_place(place)
        self.url = place if is_file else reachable(place, start_viewer, inline)
        if self.url is not None:
            self._begin(mechanism, self.url)

    @property
    def is_seen(self) -> bool:
        """True while samples are sent to a viewer or a file; False where no viewer was reached, and after the view's
        end. Where the process that draws has ended by itself, only the next call of `show` notices it."""
        return self._socket is not None

    def show(self, time: float, p: ArrayLike, reference_p: ArrayLike, torque: ArrayLike) -> None:
        """Send a sample to the viewer, without waiting: `time` in s, positions `p` and desired positions `reference_p`
        (r,) of the r joints, rad (m if prismatic), and `torque` (r,), N m (N). The sample is left out where it follows
        the last one sooner than the view's `rate` (samples a second) allows; one with an earlier time than the last is
        sent. Values that are not numbers, NaN or infinite, and arrays of another shape end the view with a
        `LiveViewWarning`; no error is raised, so that the control loop goes on."""
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
        """Close the live view: wait until the samples that were sent are drawn, at most 10 s, or 60 s for a file, then
        end the process that draws them, also where it is not done. Without a view, or called again, it does nothing; an
        error of that process is not raised."""
        self._disconnect()
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(WRITING if self.url is not None and self.url.endswith(".rrd") else PATIENCE)
            self._process.kill()
            self._process.wait()
            self._process = None

    def viewer(self, **options: Any) -> Any:
        """A widget for notebooks, a `rerun.notebook.Viewer`, that shows the view's samples; `options`, such as
        `height`, are passed to that class. Raises `MissingExtraError` without rerun-notebook, `InputError` where no
        viewer could be reached or the view goes to a file."""
        try:
            import rerun_notebook  # noqa: F401  # rerun itself asks for it late, in a traceback
            from rerun.notebook import Viewer
        except ImportError as error:
            raise MissingExtraError("live view: notebooks need rerun-notebook: pip install rerun-notebook") from error
        if self.url is None or self.url.endswith(".rrd"):
            raise InputError(f"live view: there is no viewer to show: {self.url or 'none could be reached'}")
        return Viewer(url=self.url, **options)

    def _ipython_display_(self) -> None:
        """The viewer, shown by a notebook for a live view."""
        self.viewer().display()

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _sample(self, time: float, *given: ArrayLike) -> bytes:
        """The sample as it is sent. Raises `InputError` for arrays that are not (r,), `NonFiniteError` for NaN."""
        if any(np.shape(one) != (self._dof,) for one in given):
            raise InputError(f"expected arrays of shape ({self._dof},), got {[np.shape(one) for one in given]}")
        sample = np.concatenate(((time,), *given), dtype=np.float64)
        if not np.isfinite(sample).all():
            raise NonFiniteError(f"expected finite numbers, got {sample[~np.isfinite(sample)][0]}")
        return sample.tobytes()

    def _begin(self, mechanism: Mechanism, url: str) -> None:
        robot = mechanism_toml(mechanism.description).encode()
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        here.setblocking(False)
        command = [sys.executable, "-m", "adaptctl.recording.live_process", str(there.fileno()), url]
        with there:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=(there.fileno(),))
        if (pipe := self._process.stdin) is not None:
            with pipe:
                pipe.write(robot)
        self._socket = here

    def _lose(self, why: str) -> None:
        """Close the connection with a warning, and go on without the live view."""
        self._disconnect()
        warnings.warn(f"live view: it has ended ({why}); the run goes on unseen", LiveViewWarning, stacklevel=4)

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def reachable(address: str, start_viewer: bool = False, inline: bool = False) -> str | None:
    """The URL of a rerun viewer on this computer at `address`, such as "127.0.0.1:9876" (or "localhost:9876"), for a
    live view to send to; None, after a `LiveViewWarning`, where none can be reached.

    With `start_viewer` (False by default) a viewer is started where none answers, and waited for up to 10 s; with
    `inline` it is a server without a window, for notebooks, which ends with Python. Raises `InputError` for an address
    of another form or computer, and for a port that is not from 1 to 65535.
    """
    host, _, port = address.rpartition(":")
    if host not in (HOST, "localhost") or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"live view: expected {HOST}:PORT, this computer's own, or a file .rrd, got {address!r}")
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
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if _answers(int(port)):
                return url
            time.sleep(0.1)
    warnings.warn(
        f"live view: no viewer is reachable at {HOST}:{port}; the run goes on unseen", LiveViewWarning, stacklevel=4
    )
    return None


@contextmanager
def streaming(to: str | None) -> Iterator[None]:
    """Context manager in which experiments that can be watched stream their runs to a live view: `to` is the address
    HOST:PORT of a rerun viewer on this computer, or a file that ends in .rrd; None for no live view. At its end the
    earlier setting is restored. The address is checked only where an experiment uses it."""
    token = CURRENT.set(to)
    try:
        yield
    finally:
        CURRENT.reset(token)


def _end(group: int) -> None:
    """End a server and what it was started by."""
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGTERM)


def _answers(port: int) -> bool:
    try:
        socket.create_connection((HOST, port), 0.5).close()
    except OSError:
        return False
    return True
