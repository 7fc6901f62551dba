"""Parameters from energy differences: one scalar equation a window of time, without accelerations.

What the torques do in a window is what the energy rises by and friction takes (Sheu and Walker 1991, section 2.2;
Gautier and Khalil 1988):  integral tau'v dt = [E(t + T) - E(t)] D + (integral v'Y_f dt) friction. It is exact, and the
theory of this package rests on it. As an estimator it is poor: r torques are one number a window, and what the torques
are off by is amplified five to 35 times as much as by the momenta's r equations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.preparation import filtered

OVERLAPPING = 10
"""Windows that begin within the length of one."""


def by_energy(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, window: float, columns: NDArray[np.int64]
) -> Array:
    """The parameters (P,), SI units, of a `mechanism` by least squares on energy differences over windows of time. The
    work of the joint torques in a window is the rise of the kinetic plus potential energy, plus friction's losses, both
    linear in the P parameters.

    `motions` are the smoothed motions of logs, `window` is the windows' length (s), `columns` (c,) are the zero-based
    indices, among the mechanism's `parameter_names`, of the c parameters that are fitted; the others are zero. A motion
    shorter than a window is left out. No accelerations are needed. The scaled matrix of energy differences is factored
    itself (singular values): normal equations would lose all digits. Raises `ValueError` for empty `motions`,
    `InputError` for motions of another number of joints, `SingularityError` near a singularity of kinematic loops.
    """
    H, work = energy_rows(motions, mechanism, window)
    own = H[:, columns]
    size = np.linalg.norm(own, axis=0)
    size[size == 0.0] = 1.0
    x = np.zeros(H.shape[1])
    x[columns] = np.linalg.lstsq(own / size, work)[0] / size
    return x


def energy_rows(motions: Sequence[SmoothMotion], mechanism: Mechanism, window: float) -> tuple[Array, Array]:
    """Energy differences H (n, P) of a `mechanism` over n windows of time, and the joint torques' work (n,), J, in
    them, a pair, so that H D = work for its P parameters D (P,). H is in J per SI unit of each parameter, in the order
    of the mechanism's `parameter_names`; a friction parameter's column has the energy that this friction dissipates in
    the window.

    `motions` are the smoothed motions of logs, `window` is the windows' length (s); a new window begins about every
    tenth of it, in the order of time, one motion after the other. A motion shorter than a window has no rows. Raises
    `ValueError` for empty `motions`, `InputError` for motions of another number of joints, `SingularityError` near a
    singularity of kinematic loops.
    """
    parts = [_of_motion(motion, mechanism, window) for motion in motions]
    return np.concatenate([H for H, _ in parts]), np.concatenate([work for _, work in parts])


def _of_motion(motion: SmoothMotion, mechanism: Mechanism, window: float) -> tuple[Array, Array]:
    """Integrals by the trapezium rule at the motion's rate."""
    p, v = motion.position, motion.velocity
    energy = mechanism.energy_regressor(p, v)
    friction = range(mechanism.num_energy_parameters, len(mechanism.parameter_names))
    rubbing = mechanism.torque_regressor(p, v, np.zeros_like(v), friction)
    power = np.einsum("nj,njf->nf", v, rubbing)
    energy[:, mechanism.num_energy_parameters :] = _integral(power, motion.rate)
    work = _integral(np.sum(v * _torque(motion), axis=-1)[:, None], motion.rate)[:, 0]
    length = max(1, round(window * motion.rate))
    starts = np.arange(0, len(p) - length, max(1, length // OVERLAPPING))
    return energy[starts + length] - energy[starts], work[starts + length] - work[starts]


def _torque(motion: SmoothMotion) -> Array:
    """The mean of those around each of the motion's samples: integrals take out what is faster."""
    log, count = motion.log, len(motion.position)
    around = 2 * (motion.every // 2) + 1
    kernel = np.full(around, 1.0 / around)
    whole = filtered(log.torque, kernel)
    return whole[motion.first - len(kernel) // 2 :: motion.every][:count]


def _integral(values: Array, rate: float) -> Array:
    """Integral (n, c) of samples (n, c) from the first to each, by the trapezium rule; `rate` in Hz."""
    steps = 0.5 * (values[1:] + values[:-1]) / rate
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
