"""A logger for a control loop of one's own: bounded memory, a few microseconds a sample, a run at the end."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import positive_number
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError, LostSamplesWarning
from adaptctl.files import validate_place
from adaptctl.simulation.rollout_file import RolloutFile, joint_names, stated_units
from adaptctl.simulation.run import Rollout

SHARE_OF_MEMORY = 0.5
"""of the computer's, that a log may take"""


class RunLogger:
    """Log of a control loop of `dof` joints (r), one sample a `control_period` (s); its method `rollout` makes it a
    `Rollout`.

    The last `capacity` samples are kept, 300 000 by default, which is 300 s at 1 kHz, in memory that is all allocated
    at construction; older ones are overwritten, and the property `lost` counts them. `append` neither allocates nor
    touches files, so a loop at 1 kHz can call it. The attribute `count` is the number of samples appended, `faulty` of
    those left out for a wrong length, NaN or infinity. `estimates` is the number k of the controller's parameter
    estimates, 0 by default; `joints` (r,) names the joints in the file, None for joint1, joint2, ..., and
    `position_units` (r,) has "rad" for revolute joints and "m" for prismatic ones, empty, the default, where that is
    not to be kept.

    As a context manager it warns (`LostSamplesWarning`) at the end if samples were overwritten or left out, and saves
    the run to a Parquet file at `path`, None for no file, if there are at least two samples. It also does so when an
    exception ends the loop; the run's `complete` is then False.

    Raises `InputError` for a period that is not positive, counts that are not whole numbers of at least 1 (`dof`), 0
    (`estimates`) or 2 (`capacity`), `joints` that are not r different names, `position_units` that are not r of these
    units, and a capacity that takes over half of the computer's memory. With a `path`, raises `FileError` if it cannot
    be written, `MissingExtraError` without pyarrow.
    """

    def __init__(
        self,
        dof: int,
        control_period: float,
        path: str | Path | None = None,
        *,
        estimates: int = 0,
        capacity: int = 300_000,
        joints: tuple[str, ...] | None = None,
        position_units: tuple[str, ...] = (),
    ) -> None:
        for what, number, least in (("dof", dof, 1), ("estimates", estimates, 0), ("capacity", capacity, 2)):
            if isinstance(number, bool) or not isinstance(number, int) or number < least:
                raise InputError(f"{what}: expected a whole number of at least {least}, got {number!r}")
        self.control_period = positive_number(control_period, "control_period: expected a positive time in s")
        width = 7 * dof + estimates + 1
        _validate_memory(8 * capacity * width, capacity)
        self._joints, self._units = joint_names(dof, joints), stated_units(dof, position_units)
        if path is not None:  # what is missing should be known before the loop, not after it
            RolloutFile(path, dof, joints)
            validate_place(path)
        self._rows, self._dof, self._path = np.zeros((capacity, width)), dof, path
        self._sample, self._lengths = np.zeros(width), [dof] * 7 + [estimates]
        self.count, self.faulty = 0, 0
        """samples that were appended; samples left out since they did not fit or were not finite"""

    @property
    def lost(self) -> int:
        """Number of samples that have been overwritten by later ones, since more were appended than the log's
        `capacity`."""
        return max(0, self.count - len(self._rows))

    def append(
        self,
        time: float,
        p: ArrayLike,
        v: ArrayLike,
        reference: ReferencePoint,
        torque: ArrayLike,
        applied: ArrayLike | None = None,
        estimate: ArrayLike = (),
    ) -> None:
        """Append a sample at `time` (s) to the log, of r joints: the measured positions `p`, rad (m if prismatic), and
        velocities `v`, rad/s (m/s), the positions, velocities and accelerations of the `reference`, in rad, rad/s and
        rad/s^2 (m, m/s and m/s^2 if prismatic), and the `torque` commanded, N m (N), (r,) each.

        `applied` (r,) is the torque applied, N m (N), None where that is the one commanded; `estimate` (k,) is the
        controller's k parameter estimates, SI units, which may be left out only where k = 0. A sample with an array of
        another length or with NaN or infinity never stops a loop: it is left out and counted in the log's `faulty`.
        Nothing is raised.
        """
        row = self._sample
        try:
            given = (p, v, *reference, torque, torque if applied is None else applied, estimate)
            fits = [len(part) for part in given] == self._lengths  # type: ignore[arg-type]
            np.concatenate(given, out=row[1:])
            row[0] = time
        except (TypeError, ValueError):
            fits = False
        if fits and np.isfinite(row).all():
            self._rows[self.count % len(self._rows)] = row
            self.count += 1
        else:
            self.faulty += 1

    def rollout(self, complete: bool = True) -> Rollout:
        """The run so far, a `Rollout`, its oldest sample first; `complete` is True, the default, or False for a run
        that was cut off. Raises `InputError` where there are fewer than two samples or their times do not increase."""
        if self.count < 2:
            raise InputError(f"a run needs at least 2 samples, got {self.count} ({self.faulty} faulty)")
        first = self.count % len(self._rows) if self.lost else 0
        rows = np.roll(self._rows, -first, axis=0)[: min(self.count, len(self._rows))]
        r = self._dof
        p, v, rp, rv, ra, torque, applied = (rows[:, 1 + k * r : 1 + (k + 1) * r] for k in range(7))
        return Rollout.from_arrays(
            p,
            torque,
            rp,
            self.control_period,
            v=v,
            reference_v=rv,
            reference_a=ra,
            applied=applied,
            estimate=rows[:, 1 + 7 * r :],
            time=rows[:, 0],
            complete=complete,
            position_units=self._units,
        )

    def __enter__(self) -> RunLogger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.lost or self.faulty:
            text = f"of {self.count + self.faulty} samples, {self.lost} were overwritten and {self.faulty} left out"
            warnings.warn(f"log: {text}: `capacity` is {len(self._rows)}", LostSamplesWarning, stacklevel=2)
        if self._path is not None and self.count >= 2:
            self.rollout(complete=kind is None).save(self._path, self._joints)


def _validate_memory(size: int, capacity: int) -> None:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if size > SHARE_OF_MEMORY * memory:
        raise InputError(
            f"capacity: {capacity} samples take {size / 1e9:.3g} GB, and this computer has {memory / 1e9:.3g}: at most "
            f"{int(SHARE_OF_MEMORY * memory / size * capacity)} fit into half of that"
        )
