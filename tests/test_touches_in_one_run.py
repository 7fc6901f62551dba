"""Pushes and loads in one run, with one setting: a PUMA 560 in MuJoCo with 2 kg that it is not told of."""

from __future__ import annotations

from typing import Any

import numpy as np
from nightly import nightly

import adaptctl
from adaptctl.envs.contact import TOOL, ContactEnv, beside, joint_path
from adaptctl.experiments.contact import Contact
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import HandPush
from adaptctl.simulation.effects import Payload

PERIOD = 1e-3
SUDDEN, RAMPED, TAKEN, DROPPED, END = 10.0, 30.0, 50.0, 70.0, 80.0
BODY = ("body_mass", "body_ipos", "body_iquat", "body_inertia")


@nightly
def test_pushes_leave_no_trace_and_loads_are_learned() -> None:
    """20 N for 5 s, sudden and within 2 s, and then 2 kg more, unannounced and, when dropped, announced."""
    asked = Contact(scene="air", duration=END)
    arm, held = asked.mechanism(), Payload(4.0, np.array(TOOL))
    heavier = asked.arm.with_parameters(held.added_to(asked.arm.inertial_parameters, len(asked.arm.links) - 1))
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    law: Any = asked.contenders(arm, basis)[0].controller
    side = [0.0, 20.0, 0.0]
    pushes = HandPush(side, SUDDEN, 5.0), HandPush(side, RAMPED, 5.0, rise=2.0)
    plant: Any = ContactEnv(arm, scene="air", pushes=pushes, duration=END).plant
    model, path, scene = ReducedModel(arm, basis), joint_path(arm, END, "air"), plant._scene._model
    loads = [[getattr(one, name)[-1].copy() for name in BODY] for one in (scene, beside(heavier, "air", 1e4))]
    true = [model.fundamental_parameters, model.regrouping @ heavier.inertial_parameters]
    scale, now = np.sqrt(np.diag(asked.tuning.adaptation_gain_for(model))), 0
    body = plant.init(path(0.0).p, path(0.0).v)
    state, off, wrong = law.init(body.p, body.v), [], []
    for k in range(round(END / PERIOD)):
        if k in (round(TAKEN / PERIOD), round(DROPPED / PERIOD)):
            now = 1 - now
            for name, values in zip(BODY, loads[now], strict=True):
                getattr(scene, name)[-1] = values
            if now == 0:
                state = state._replace(law_state=law.adaptation.expect_payload(state.law_state))
        torque, state = law.step(state, body.p, body.v, path(PERIOD * k))
        body = plant.step(body, torque)
        off.append(np.linalg.norm(body.p - path(PERIOD * (k + 1)).p))
        wrong.append(np.linalg.norm((state.estimate - true[now]) / scale))

    def error(start: float) -> float:
        return float(np.sqrt(np.mean(np.square(off[round(start / PERIOD) : round((start + 2.0) / PERIOD)]))))

    def parameters(time: float) -> float:
        return float(wrong[round(time / PERIOD)] / np.linalg.norm((law.initial - true[0]) / scale))

    for start in (SUDDEN, RAMPED):
        assert error(start + 5.0) < 1e-4
        assert error(start + 5.0 + 3.0) < 1.5 * error(start - 2.0)
        assert parameters(start + 19.0) < 3.0 * parameters(start - 0.01)
    for start in (TAKEN, DROPPED):
        assert parameters(start + 5.0) < 2e-3
        for later in (3.0, 6.0):
            assert error(start + later) < 1.5 * error(SUDDEN - 2.0)
