"""Logs of arms whose parameters are known: a rich motion, its exact torques, and noise as drives have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from random_trees import random_chain
from scipy.signal import lfilter

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_pseudo_inertia, pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives, MotorEntry, Units


@dataclass(frozen=True, eq=False)
class Known:
    """A true mechanism, a wrong first guess of its links, and a log."""

    truth: Mechanism
    guess: Mechanism
    drives: Drives
    log: JointLog


def motion(dof: int, rng: np.random.Generator, duration: float, rate: float) -> tuple[Array, Array, Array, Array]:
    """Times, and positions, velocities, accelerations of five harmonics."""
    time = np.arange(round(duration * rate)) / rate
    order = np.arange(1, 6)[:, None, None]
    sine, cosine = rng.normal(size=(2, 5, dof, 1)) * 0.5 / order
    omega = 2.0 * np.pi * 0.15 * order
    s, c = np.sin(omega * time), np.cos(omega * time)
    p = (sine * s + cosine * c).sum(axis=0).T
    v = (omega * (sine * c - cosine * s)).sum(axis=0).T
    a = (-(omega**2) * (sine * s + cosine * c)).sum(axis=0).T
    return time, p, v, a


def guessed(tree: Mechanism, rng: np.random.Generator, spread: float = 0.3) -> Mechanism:
    """The links off at random, each still a body."""
    tens = []
    for link in tree.links:
        root = np.linalg.cholesky(pseudo_inertia(link.inertia))
        off = np.eye(4) + spread * rng.normal(size=(4, 4))
        tens.append(from_pseudo_inertia(root @ off @ off.T @ root.T))
    return tree.with_parameters(np.concatenate(tens))


def joint_drives(mechanism: Mechanism) -> Drives:
    """Joints measured themselves."""
    names = tuple(joint.name for joint in mechanism.primary_joints)
    motors = tuple(MotorEntry(name=name, position=f"p.{name}", torque=f"tau.{name}") for name in names)
    r = len(names)
    return Drives(names, np.eye(r), np.zeros(r), motors, "time", Units(1.0, 1.0, 1.0))


def known(
    seed: int, links: int = 3, noise: float = 0.03, colour: float = 0.9, duration: float = 20.0, rate: float = 500.0
) -> Known:
    """A random chain with rotors and friction; noise of so much of each torque, an autoregression of `colour`."""
    rng = np.random.default_rng(seed)
    tree = random_chain(seed, links)
    truth = tree.with_drives(Drive(0.3, 2.0, 1.5))
    time, p, v, a = motion(links, rng, duration, rate)
    torque = truth.inverse_dynamics(p, v, a)
    white = rng.normal(size=torque.shape)
    coloured = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white, axis=0)
    off = noise * np.sqrt(np.mean(torque**2, axis=0)) * coloured
    log = JointLog("synthetic", time, p + 1e-6 * rng.normal(size=p.shape), torque + off)
    return Known(truth, guessed(tree, rng), joint_drives(tree), log)
