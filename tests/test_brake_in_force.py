"""The brake of exported code where the law gives no torque: within the gains in force, not those of the export."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from c_compiler import build, said
from every_law import GAIN, guarded, slotine_li

import adaptctl
from adaptctl.control import ReferencePoint, SafetyFilter

BRAKED = """#include "arm.h"
#include <math.h>
#include <stdio.h>
static void brake(const arm_gains *gains)
{
    static arm_state state;
    static const arm_reference reference;
    const arm_real p[3] = { 0 }, v[3] = { 1, 50, (arm_real)INFINITY };
    arm_real torque[3];
    (void)arm_step(&state, gains, p, v, &reference, torque);
    printf("%g %g %g\\n", (double)torque[0], (double)torque[1], (double)torque[2]);
}
int main(void)
{
    const arm_real limits[] = { 40, 1, (arm_real)INFINITY, -1, (arm_real)NAN };
    const arm_real dampings[] = { 4, (arm_real)INFINITY, -4, (arm_real)NAN };
    unsigned k;
    int j;
    arm_gains gains = arm_default_gains;
    for (k = 0; k < 5; k++) {
        for (j = 0; j < 3; j++) { gains.torque_limits[j] = limits[k]; }
        brake(&gains);
    }
    gains = arm_default_gains;
    for (k = 0; k < 4; k++) {
        for (j = 0; j < 3; j++) { gains.stop_damping[j] = dampings[k]; }
        brake(&gains);
    }
    return 0;
}
"""


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_the_brake_keeps_to_gains_in_force_and_gives_nothing_where_these_are_none(tmp_path: Path, scalar: str) -> None:
    law = guarded(slotine_li(GAIN), torque=30.0, stop_damping=[2.0, 2.0, 2.0])
    done = adaptctl.export(law, tmp_path / "arm", name="arm", scalar=scalar)
    (done.directory / "braked.c").write_text(BRAKED)
    given = [[float(x) for x in line.split()] for line in said(build(done.directory, "braked.c", "arm.c")).splitlines()]
    limits = [[-2, -40, 0], [-1, -1, 0], [-2, -100, 0], [0, 0, 0], [0, 0, 0]]
    dampings = [[-4, -30, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    np.testing.assert_array_equal(given, limits + dampings)


@pytest.mark.parametrize("angle", [1.1e6, -1.1e6, 1e16, 1e300])
def test_python_brakes_too_where_an_angle_is_too_far_for_the_exported_sine(angle: float) -> None:
    law, v = SafetyFilter(slotine_li(GAIN), stop_damping=2.0), np.array([1.0, -2.0, 0.5])
    point = ReferencePoint(np.zeros(3), np.zeros(3), np.zeros(3))
    torque, state = law.step(law.init(np.zeros(3), v), np.array([0.1, angle, 0.2]), v, point)
    assert state.flags.stopped[0] == 1.0
    np.testing.assert_array_equal(torque, -2.0 * v)
    torque, state = law.step(law.init(np.zeros(3), v), np.array([0.1, 1.04e6, 0.2]), v, point)
    assert state.flags.stopped[0] == 0.0


def test_lowered_torque_limits_take_effect_at_the_rate_limits() -> None:
    law = SafetyFilter(slotine_li(GAIN), 20.0, 2000.0, control_period=1e-3)
    zero = np.zeros(3)
    point = ReferencePoint(np.ones(3), zero, zero)
    state = law.init(zero, zero, torque=[18.0, -18.0, 18.0])
    lowered, sizes = law.tuned({"torque_limits": np.full(3, 2.0)}), []
    for _ in range(12):
        torque, state = lowered.step(state, zero, zero, point)
        sizes.append(np.abs(torque).max())
    np.testing.assert_allclose(sizes[:8], np.arange(16.0, 0.0, -2.0), atol=1e-12)
    assert max(sizes[8:]) <= 2.0
