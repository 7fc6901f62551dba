"""Parameters from energy differences over windows of time, without accelerations (Gautier and Khalil 1988)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.preparation import filtered

# The work of the torques in a window is the rise of the energy and friction's loss (Sheu and Walker 1991, section 2.2):
# integral tau'v dt = [E(t + T) - E(t)] D + (integral v'Y_f dt) friction. It is exact, but as an estimator it amplifies
# errors of torques 5 to 35 times as much as the filtered equations of motion, since r torques become one number.

# Windows that begin within the length of one.
WINDOW_OVERLAP = 10


def by_energy(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, window: float, columns: NDArray[np.int64]
) -> Array:
    """Parameters (P,) in SI units by least squares on energy differences over windows of `window` s."""
    H, work = energy_rows(motions, mechanism, window)
    own = H[:, columns]
    size = np.linalg.norm(own, axis=0)
    size[size == 0.0] = 1.0
    x = np.zeros(H.shape[1])
    x[columns] = np.linalg.lstsq(own / size, work)[0] / size
    return x


def energy_rows(motions: Sequence[SmoothMotion], mechanism: Mechanism, window: float) -> tuple[Array, Array]:
    """Energy differences (n, P) over n windows, and the work (n,) in J of the joint torques in them."""
    parts = [_of_motion(motion, mechanism, window) for motion in motions]
    return np.concatenate([H for H, _ in parts]), np.concatenate([work for _, work in parts])


def _of_motion(motion: SmoothMotion, mechanism: Mechanism, window: float) -> tuple[Array, Array]:
    p, v = motion.position, motion.velocity
    energy = mechanism.energy_regressor(p, v)
    friction = range(mechanism.num_energy_parameters, len(mechanism.parameter_names))
    rubbing = mechanism.torque_regressor(p, v, np.zeros_like(v), friction)
    power = np.einsum("nj,njf->nf", v, rubbing)
    energy[:, mechanism.num_energy_parameters :] = _integral(power, motion.rate)
    work = _integral(np.sum(v * _torque(motion), axis=-1)[:, None], motion.rate)[:, 0]
    length = max(1, round(window * motion.rate))
    starts = np.arange(0, len(p) - length, max(1, length // WINDOW_OVERLAP))
    return energy[starts + length] - energy[starts], work[starts + length] - work[starts]


def _torque(motion: SmoothMotion) -> Array:
    """Means of the torques around each of the motion's samples: integrals take out what is faster."""
    log, count = motion.log, len(motion.position)
    around = 2 * (motion.every // 2) + 1
    kernel = np.full(around, 1.0 / around)
    whole = filtered(log.torque, kernel)
    return whole[motion.first - len(kernel) // 2 :: motion.every][:count]


def _integral(values: Array, rate: float) -> Array:
    steps = 0.5 * (values[1:] + values[:-1]) / rate
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
