"""Experiments, one file each: settings whose fields become flags, and a function from them to a result."""

from __future__ import annotations

from difflib import get_close_matches
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from adaptctl.errors import NotFoundError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from adaptctl.experiments.experiment import Experiment

__all__ = ["EXPERIMENTS", "GROUP", "RENAMED", "Entry", "find", "offered"]


class Entry(NamedTuple):
    """Entry of the list of built-in experiments, with all that is needed to choose one without importing it: `name`, as
    the command line takes it, such as "two-arms"; `summary`, one line of words; `module`, the full name of the Python
    module that defines the experiment's class; and `kind`, the name of that class. Nothing is checked at
    construction."""

    name: str
    summary: str
    module: str
    kind: str


EXPERIMENTS = (
    Entry(
        "puma560-adaptive",
        "The PUMA 560 learns to track from knowing nothing, on 36 parameters found from energies",
        "adaptctl.experiments.puma560_adaptive",
        "Puma560Adaptive",
    ),
    Entry(
        "semi-direct-drive-adaptive",
        "The semi-direct-drive arm does so through its closed loop, on 26 parameters",
        "adaptctl.experiments.semi_direct_drive_adaptive",
        "SemiDirectDriveAdaptive",
    ),
    Entry(
        "two-arms",
        "Two PUMAs hold one rod, a mechanism with a loop of twelve links, and learn its 70 parameters",
        "adaptctl.experiments.two_arms",
        "TwoArms",
    ),
    Entry(
        "adaptation-laws",
        "Every adaptation law and every control law from one rough model of an arm, on a motion that excites it",
        "adaptctl.experiments.adaptation_laws",
        "AdaptationLaws",
    ),
    Entry(
        "payload-drop",
        "A payload picked up and dropped in mid-motion: how long each law takes to recover",
        "adaptctl.experiments.payload_drop",
        "PayloadDrop",
    ),
    Entry(
        "friction",
        "Joints that rub: friction learned as parameters, and friction ignored",
        "adaptctl.experiments.friction",
        "FrictionInJoints",
    ),
    Entry(
        "saturation",
        "Motors too weak for a payload, for a while: adaptation frozen while they saturate, and not",
        "adaptctl.experiments.saturation",
        "Saturation",
    ),
    Entry(
        "reduced-model",
        "The PUMA 560 tracks while its controller carries only some of its essential components",
        "adaptctl.experiments.reduced_model",
        "ReducedModelTracking",
    ),
    Entry(
        "added-mass",
        "Where a mass may be added to an arm: what a point, a gripper, a camera and a motor cost on every link",
        "adaptctl.experiments.added_mass",
        "AddedMassStudy",
    ),
    Entry(
        "counterweight",
        "An arm before and after counterweights, in closed loop, with all parameters and with ten components",
        "adaptctl.experiments.counterweight",
        "CounterweightedTracking",
    ),
    Entry(
        "task-space",
        "A tool follows a path in the world: control of the tool against control of the joints",
        "adaptctl.experiments.task_space",
        "TaskSpaceTracking",
    ),
    Entry(
        "noise-and-delay",
        "Encoders, delay, lag and weak motors, and nothing that excites: which laws drift",
        "adaptctl.experiments.noise_and_delay",
        "NoiseAndDelay",
    ),
    Entry(
        "stable-bandwidth",
        "Elastic joints: up to which bandwidth each law stays stable, over their stiffness",
        "adaptctl.experiments.stable_bandwidth",
        "StableBandwidth",
    ),
    Entry(
        "adaptive",
        "The same for any arm: a built-in robot or a file of yours",
        "adaptctl.experiments.adaptive",
        "AdaptiveTracking",
    ),
    Entry(
        "two-plants",
        "One law on two plants, adaptctl's and MuJoCo: how far they are apart, and why",
        "adaptctl.experiments.two_plants",
        "TwoPlants",
    ),
    Entry(
        "identify-then-adapt",
        "A real arm's log gives the first estimate: adaptation from it, from the URDF and from zero",
        "adaptctl.experiments.identify_then_adapt",
        "IdentifyThenAdapt",
    ),
    Entry(
        "energy-differences",
        "Energy differences as an estimator on a real log: exact in theory, and what they amplify",
        "adaptctl.experiments.energy_differences",
        "EnergyDifferences",
    ),
    Entry(
        "export-check",
        "Every law exported as C, built by the compilers that are here, and run on ticks recorded from Python",
        "adaptctl.experiments.export_check",
        "ExportCheck",
    ),
    Entry(
        "sheu-walker-1991",
        "Every table and figure of the paper behind all this, with a verdict; and its two arms in closed loop",
        "adaptctl.experiments.sheu_walker_1991",
        "SheuWalker1991",
    ),
)


RENAMED = {
    "serial-versus-graph": "experiment run sheu-walker-1991 --only serial-versus-graph",
}
"""Commands that answer what experiments of these names answered."""
GROUP = "adaptctl.experiments"
"""Entry points of this group name classes of experiments."""


def offered() -> dict[str, EntryPoint]:
    """Entry points of installed packages in the group "adaptctl.experiments", a mapping from their names: each names
    the class of an experiment that a package provides. No package is imported here; nothing is raised."""
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group=GROUP)}


def find(name: str) -> type[Experiment]:
    """Class of the built-in experiment called `name`, such as "two-arms", a subclass of `Experiment`; its module is
    imported here. Raises `NotFoundError`, with the names that exist, for an unknown name."""
    names = [entry.name for entry in EXPERIMENTS]
    if name in RENAMED:
        raise NotFoundError(f"experiment {name} is now: adaptctl {RENAMED[name]}")
    if name not in names:
        close = get_close_matches(name, names, n=1, cutoff=0.4)
        guess = f" (did you mean {close[0]!r}?)" if close else ""
        raise NotFoundError(f"unknown experiment {name!r}{guess}; experiments: {', '.join(names)}")
    entry = EXPERIMENTS[names.index(name)]
    kind: type[Experiment] = getattr(import_module(entry.module), entry.kind)
    return kind
