"""The exported loop over UDP, built and run: what it does when measurements stop and come again."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_compiler import build
from every_law import GAIN, guarded, slotine_li

import adaptctl
from adaptctl.codegen.interface import FAULTS, Interface, status_bits
from adaptctl.control import Controller

WATCHDOG, PATIENCE = 400, 4
"""periods without a measurement until the loop brakes, long enough for a busy machine; times that until it ends"""
DAMPING = np.array([2.0, 3.0, 4.0])


@contextlib.contextmanager
def running(law: Controller[Any], folder: Path) -> Iterator[tuple[subprocess.Popen[str], socket.socket]]:
    """The example's program, and a socket to it."""
    done = adaptctl.export(law, folder, name="arm", without_safety_filter=True)
    program = build(done.directory, "arm.c", "example.c", f"-DWATCHDOG={WATCHDOG}", f"-DPATIENCE={PATIENCE}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("localhost", 0))
        port = link.getsockname()[1]
    command = [str(program), str(port)]
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
    ):
        try:
            link.connect(("localhost", port))
            link.settimeout(0.2)
            yield process, link
        finally:  # or a test that fails would wait for it forever
            process.kill()


PASSING = TimeoutError, ConnectionRefusedError, struct.error
"""Errors of a loop that does not listen yet, and of datagrams to a port that another test had before."""


def heard(link: socket.socket) -> tuple[int, np.ndarray, int]:
    """The next answer: its count, torques and status."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        with contextlib.suppress(*PASSING):
            count, *torque, status = struct.unpack("<5d", link.recv(4096))
            return int(count), np.array(torque), int(status)
    raise AssertionError("the loop does not answer")


def told(link: socket.socket, count: int, v: float) -> tuple[np.ndarray, int]:
    """What the loop answers to a measurement, sent again until it does."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        with contextlib.suppress(*PASSING):
            link.send(struct.pack("<7d", count, 0.1, 0.2, -0.1, v, v, v))
            while True:
                found, *torque, status = struct.unpack("<5d", link.recv(4096))
                if found == count:
                    return np.array(torque), int(status)
    raise AssertionError("the loop does not answer")


def test_a_guarded_loop_that_hears_nothing_brakes_until_it_begins_anew_and_ends(tmp_path: Path) -> None:
    law = guarded(slotine_li(GAIN), torque=30.0, rates=1e9, stop_damping=DAMPING)
    stopped = next(bit.value for bit in status_bits(Interface(law)) if bit.name == "STOPPED")
    with running(law, tmp_path / "arm") as (process, link):
        for k in range(20):
            assert told(link, k, 0.0)[1] & stopped == 0
        while not (answer := heard(link))[2] & stopped:
            pass
        assert np.array_equal(answer[1], np.zeros(3))  # at rest there is nothing to brake
        torque, status = told(link, 20, 1.0)
        assert status & stopped
        assert np.array_equal(torque, -DAMPING)
        assert np.array_equal(told(link, 21, 100.0)[0], [-30.0] * 3)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 0
        assert f"no measurement for {WATCHDOG} periods: braking" in said


def stranger(link: socket.socket) -> socket.socket:
    """Another socket to the same loop."""
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.connect(link.getpeername())
    other.settimeout(0.05)
    return other


def answers(link: socket.socket, seconds: float) -> list[tuple[float, ...]]:
    """All that comes in a while; a peer's socket is connected, and so refuses all others."""
    until, came = time.monotonic() + seconds, []
    while (left := until - time.monotonic()) > 0.0:
        link.settimeout(left)
        with contextlib.suppress(*PASSING):
            came.append(struct.unpack("<5d", link.recv(4096)))
    link.settimeout(0.2)
    return came


def test_what_is_no_measurement_is_not_answered(tmp_path: Path) -> None:
    law = guarded(slotine_li(GAIN), torque=30.0, rates=1e9, stop_damping=DAMPING)
    good = [0.1, 0.2, -0.1, 0.0, 0.0, 0.0]
    with running(law, tmp_path / "arm") as (_, link), stranger(link) as other:
        told(link, 3, 0.0)
        numbers = ([3, *good], [2, *good], [-5, *good], [np.nan, *good], [np.inf, *good], [4, *good, 0.0])
        wrong = [struct.pack(f"<{len(row)}d", *row) for row in numbers]
        for datagram in [*wrong, wrong[0][:-1], wrong[0] + b"x", b"", b"junk", struct.pack("<9d", 4, *good, 0, 0)]:
            link.send(datagram)
        other.send(struct.pack("<7d", 100, *good))
        late = answers(link, 0.1)  # of a machine so busy that the watchdog is heard of
        assert all(count == 3 and int(status) & FAULTS[0].value for count, *_, status in late)
        assert not answers(other, 0.05)
        told(link, 4, 0.0)


def test_a_loop_brakes_without_a_velocity_and_whoever_else_sends(tmp_path: Path) -> None:
    """The last velocity is not braked against for ever, which would drive the arm; junk is no sign of life."""
    law = guarded(slotine_li(GAIN), torque=30.0, rates=1e9, stop_damping=DAMPING)
    stopped = next(bit.value for bit in status_bits(Interface(law)) if bit.name == "STOPPED")
    with running(law, tmp_path / "arm") as (process, link), stranger(link) as other:
        told(link, 0, 1.0)
        started, braked = time.monotonic(), []
        while process.poll() is None and time.monotonic() - started < 60.0:
            for datagram in (b"junk", struct.pack("<7d", 7, *np.zeros(6))):
                with contextlib.suppress(ConnectionRefusedError):
                    other.send(datagram)
            with contextlib.suppress(*PASSING):
                link.settimeout(1e-3)
                braked.append(struct.unpack("<5d", link.recv(4096)))
        assert process.returncode == 0
        assert len(braked) == PATIENCE
        assert all(not any(torque) and int(status) & stopped for _, *torque, status in braked)
        assert {count for count, *_ in braked} == {0.0}
        with pytest.raises((TimeoutError, ConnectionRefusedError)):
            other.recv(4096)


def test_a_first_torque_keeps_to_its_rate_in_c(tmp_path: Path) -> None:
    law = guarded(slotine_li(GAIN), torque=30.0, rates=2e3, stop_damping=DAMPING)
    with running(law, tmp_path / "arm") as (_, link):
        torques = [told(link, k, 0.0)[0] for k in range(4)]
        steps = np.diff(torques, axis=0, prepend=0.0)
        np.testing.assert_allclose(np.abs(steps).max(axis=1), law.control_period * 2e3, rtol=1e-12)


def test_an_unguarded_loop_that_hears_nothing_gives_no_torque_and_goes_on_when_it_does(tmp_path: Path) -> None:
    with running(slotine_li(GAIN), tmp_path / "arm") as (_, link):
        torque, status = told(link, 0, 0.0)
        assert status == 0
        assert np.abs(torque).max() > 1.0
        _, torque, status = heard(link)
        assert status == FAULTS[0].value
        assert not torque.any()
        torque, status = told(link, 1, 0.0)
        assert status == 0
        assert np.abs(torque).max() > 1.0
