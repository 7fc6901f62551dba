"""Motor drivers that speak the UDP of exported controllers."""

from __future__ import annotations

import math
import socket
import struct

import numpy as np

from adaptctl.arrays import Array, positive_period
from adaptctl.errors import InputError
from adaptctl.hardware.robot import HardwareLimits, RobotReading

PATIENCE = 5.0
"""periods without a measurement, after which there is none; s before the first"""


class UDPRobot:
    """
    Motor driver that sends a datagram of doubles each period: a count, positions and velocities.

    Parameters
    ----------
    address : str
        Address HOST:PORT to listen at, such as 127.0.0.1:5150.
    limits : HardwareLimits
        Limits of the robot.
    control_period : float, default 0.001
        Period of the datagrams in s.
    compensates_gravity : bool, default False
        True if the motor driver adds the gravity torque of the description.

    Raises
    ------
    InputError
        If the address is of another form or cannot be listened at.

    Notes
    -----
    The answer is the count, the torques and a status of 0, as that of an exported `example.c`. The sender of the first
    valid datagram is the only peer; datagrams of another length, from others, or with a count that is not greater than
    the last are dropped. A motor driver must brake by itself when answers stop.

    Examples
    --------
    >>> from adaptctl.hardware import HardwareLimits, UDPRobot
    >>> robot = UDPRobot("127.0.0.1:0", HardwareLimits.of(arm))
    >>> robot.stop()
    """

    delay = 0.0

    def __init__(
        self,
        address: str,
        limits: HardwareLimits,
        control_period: float = 1e-3,
        compensates_gravity: bool = False,
    ) -> None:
        self.period, self.limits = positive_period(control_period, "control_period"), limits
        self.compensates_gravity = compensates_gravity
        host, _, port = str(address).rpartition(":")
        if not host or not port.isdecimal() or int(port) > 65535:
            raise InputError(f"{address}: expected HOST:PORT, such as 127.0.0.1:5150")
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._link.bind((host, int(port)))
        except OSError as error:
            self._link.close()
            raise InputError(f"{address}: cannot listen there ({error})") from error
        self.port = int(self._link.getsockname()[1])
        self._peer: tuple[str, int] | None = None
        self._count = -1.0

    def read(self) -> RobotReading | None:
        """
        Wait for the next measurement.

        Returns
        -------
        RobotReading or None
            Measurement; None if none came within 5 periods.
        """
        self._link.settimeout(PATIENCE if self._peer is None else PATIENCE * self.period)
        while True:
            try:
                data, sender = self._link.recvfrom(65536)
            except TimeoutError:
                return None
            if (numbers := self._valid(data, sender)) is not None:
                r = self.limits.dof
                self._peer, self._count = sender, numbers[0]
                p, v = np.array(numbers[1 : 1 + r]), np.array(numbers[1 + r :])
                return RobotReading(self._count * self.period, p, v)

    def write(self, torque: Array) -> None:
        """
        Answer the latest measurement.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m (N).
        """
        if self._peer is not None:
            self._link.sendto(struct.pack(f"<{2 + len(torque)}d", self._count, *torque, 0.0), self._peer)

    def stop(self) -> None:
        """Answer no longer: the motor driver brakes."""
        self._link.close()

    def _valid(self, data: bytes, sender: tuple[str, int]) -> tuple[float, ...] | None:
        """Numbers of a datagram that counts."""
        size = 1 + 2 * self.limits.dof
        if len(data) != 8 * size or self._peer not in (None, sender):
            return None
        numbers = struct.unpack(f"<{size}d", data)
        return numbers if math.isfinite(numbers[0]) and numbers[0] > self._count else None
