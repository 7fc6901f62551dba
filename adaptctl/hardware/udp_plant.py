"""
Simulated arm in real time for an exported controller, `python -m adaptctl.hardware.udp_plant ROBOT [SECONDS] [PORT]`.

It sends a count, positions and velocities every millisecond over the loopback, gets torques back, and moves the arm as
`adaptctl` simulates it. A torque that does not come within the period is missed: the last one is held once, then the
arm is braked by friction alone. Start the controller's `example.c` first.
"""

from __future__ import annotations

import ipaddress
import socket
import struct
import sys
import time

import numpy as np

import adaptctl

PERIOD = 1e-3
LOOPBACK = str(ipaddress.IPv4Address(127 * 2**24 + 1))


def main(robot: str, seconds: float = 20.0, port: int = 5150) -> None:
    """Run, and tell how well both kept time and how well the arm follows."""
    mechanism = adaptctl.load(robot)
    plant = adaptctl.Plant(mechanism, PERIOD)
    r = plant.dof
    state = plant.init(mechanism.neutral_configuration, np.zeros(r))
    plant.compile()
    plant.step(state, np.zeros(r))
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect((LOOPBACK, port))
    torque, missed, statuses, trips, late, in_a_row = np.zeros(r), 0, 0, [], 0, 0
    started = time.perf_counter()
    for k in range(round(seconds / PERIOD)):
        due = started + k * PERIOD
        sent = begun(due)
        late += sent - due > PERIOD
        link.send(struct.pack(f"<{1 + 2 * r}d", k, *state.p, *state.v))
        answer = received(link, k, r, max(PERIOD, 2e-4) if k else 1.0)
        if answer is None:
            missed, in_a_row = missed + 1, in_a_row + 1
            torque = torque if in_a_row < 2 else np.zeros(r)
        else:
            torque, status = answer
            statuses, in_a_row = statuses | status, 0
            trips.append(time.perf_counter() - sent)
        state = plant.step(state, torque)
    link.close()
    print(f"{mechanism.name}: {len(trips)} of {round(seconds / PERIOD)} torques came, {missed} did not")
    told = f"{late} periods began late by more than one; all statuses together {statuses}"
    print(f"round trips {percentiles(trips)}; {told}")
    print(f"speed in the end: {np.abs(state.v).max():.3g} rad/s, positions {np.round(state.p, 3).tolist()}")


def begun(due: float) -> float:
    """Wait for a time, and tell when that was."""
    while (ahead := due - time.perf_counter()) > 0.0:
        time.sleep(ahead)
    return time.perf_counter()


def percentiles(trips: list[float]) -> str:
    """Half, nearly all and the slowest of some times in s."""
    return ", ".join(f"{q:g} %: {1e6 * np.percentile(trips, q):.0f} us" for q in (50, 99, 99.9)) if trips else "none"


def received(link: socket.socket, k: int, r: int, patience: float) -> tuple[np.ndarray, int] | None:
    """The torques and the status for count k; None where they do not come in time."""
    until = time.perf_counter() + patience
    while (left := until - time.perf_counter()) > 0.0:
        link.settimeout(left)
        try:
            count, *numbers = struct.unpack(f"<{2 + r}d", link.recv(4096))
        except (TimeoutError, ConnectionRefusedError, struct.error):
            continue
        if count == k:
            return np.array(numbers[:r]), int(numbers[r])
    return None


def asked(words: list[str]) -> tuple[str, float, int]:
    """Robot, seconds and port of a line's words. Raises `ValueError` where they are no such line."""
    name, seconds, port = (*words, *("20", "5150")[len(words) - 1 :])
    if name.startswith("-"):
        raise ValueError
    return name, float(seconds), int(port)


if __name__ == "__main__":
    try:
        given = asked(sys.argv[1:])
    except ValueError:
        sys.exit(str(__doc__).strip())
    try:
        main(*given)
    except adaptctl.AdaptctlError as error:
        sys.exit(str(error))
