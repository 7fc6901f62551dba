"""Places where a mass may be added to an arm: the question that Sheu and Walker (1991) leave to future work."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.design import DesignStudy, DesignTask, added_mass, design_study
from adaptctl.design.bodies import CATALOGUE
from adaptctl.dynamics import load
from adaptctl.experiments.experiment import Experiment, setting
from adaptctl.recording import Progress, Result
from adaptctl.recording.result import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adaptctl.recording.drawing import Drawing

STAGE = "Costs of added mass"


@dataclass(frozen=True)
class AddedMassStudy(Experiment):
    """Experiment on where a mass may be added to an arm: how much a point mass, a gripper, a camera and a motor on
    every link change the arm's energy over random states, and where a mass makes it smaller; Sheu and Walker (1991)
    leave the question open.

    The setting `speed` is a multiple (no unit) of sqrt(g/L), in 1/s, g being gravity (m/s^2) and L (m) the largest
    distance from a joint to the next. The study also counts the fewest essential components (parts of the inertial
    parameters along the right singular vectors of the energies) whose energy is off by at most `energy_error` (%).
    Raises `InputError` at construction for a setting of the wrong type or out of its bounds, `NonFiniteError` for NaN
    or infinity.
    """

    name: ClassVar[str] = "added-mass"
    title: ClassVar[str] = "{robot}: where a mass may be added"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .xml, .toml)")
    mass: float = setting(1.0, "mass of the point that is added, kg", low=1e-3, high=1e3)
    speed: float = setting(0.25, "of the task's random states, over sqrt(g/L)", low=0.0, high=10.0)
    samples: int = setting(1000, "random states within the joints' limits", low=10, high=100_000)
    energy_error: float = setting(1.0, "at which components are counted, %", low=0.0, high=100.0)
    share: float = setting(0.2, "largest counterweight over its link's mass", low=0.0, high=10.0)

    def run(self, progress: Progress) -> Result:
        """Result of the study of added masses, a `Result`: its outcome in words, facts (questions with answers), an
        empty verdict, since no controller runs, and a function that writes summary, figures, recording and report into
        a folder that it is given. `progress(what, share)` is called with the step's name and the fraction done, 0 to 1.
        Raises `NotFoundError` for an unknown robot, `FileError` for a file that cannot be used, `InputError` for an arm
        whose energy does not vary, or that has linear constraints between its inertial parameters, `RankError` where
        its number of base parameters cannot be certified."""
        from adaptctl.design.report import facts, outcome_words

        study = self.study(progress)
        return Result(True, outcome_words(study), tuple(facts(study)), Verdict(), partial(self._write, study))

    def study(self, progress: Progress) -> DesignStudy:
        """Design study of the arm that `robot` names, a `DesignStudy`: effects of masses added to every link, optimal
        counterweights and removable parameters, over random states within the joints' limits. `progress(what, share)`
        is called with the step's name and the fraction done, 0 to 1. Raises `NotFoundError` for an unknown robot,
        `FileError` for a file that cannot be used, `InputError` for an arm whose energy does not vary, or that has
        linear constraints between its inertial parameters, `RankError` where its number of base parameters cannot be
        certified."""
        progress(STAGE, 0.0)
        task = DesignTask.within_limits(load(self.robot), self.samples, self.seed, self.speed)
        found = design_study(task, self.mass, share=self.share, percent=self.energy_error, seed=self.seed)
        progress(STAGE, 1.0)
        return found

    def _write(self, study: DesignStudy, folder: Any, progress: Progress) -> None:
        from adaptctl.design.files import Named, as_builtins, write_study

        title, shown = self.title.format(robot=study.task.mechanism.name), tuple(self._drawings(study))
        named = Named(self.name, title, seed=self.seed, drawings=shown)
        content = as_builtins(study) | {"experiment": self.name, "settings": asdict(self), "bodies": bodies(study)}
        write_study(folder, study, content, named, progress)

    def _drawings(self, study: DesignStudy) -> Iterator[Drawing]:
        from adaptctl.recording.drawing import Drawing

        yield Drawing(
            "bodies",
            "What common bodies cost on every link, their centre at the link's centre of mass.",
            partial(bodies_figure, study),
        )


def bodies(study: DesignStudy) -> dict[str, dict[str, float]]:
    """Relative changes (no unit, 0.1 for 10 % more) of an arm's energy when a gripper, a camera or a motor is added to
    one of its links, its centre of mass at the link's: a dict by the body's name of dicts by the link's. The energy,
    kinetic plus potential, is its root mean square about the mean over the states of `study`, a `DesignStudy` of the
    arm. Arguments are not checked; raises what `added_mass` raises, such as `RankError`."""
    links = [places.link for places in study.within]
    return {
        name: {
            link: added_mass(study.task, link, body(), study.task.center_of_mass(link)).energy_change for link in links
        }
        for name, body in CATALOGUE.items()
    }


def bodies_figure(study: DesignStudy) -> Figure:
    """Matplotlib figure, of bars, of the changes, %, of an arm's root mean square energy by a gripper, a camera and a
    motor on each of its links. `study`, a `DesignStudy`, has the arm and its states. Arguments are not checked; raises
    what `added_mass` raises, such as `RankError`."""
    from adaptctl.recording.drawing import run_color, sheet

    figure, found = sheet(2.8), bodies(study)
    axes = figure.subplots()
    for i, (name, changes) in enumerate(found.items()):
        place = np.arange(len(changes)) + 0.27 * (i - 1)
        axes.bar(place, 100.0 * np.array(list(changes.values())), 0.25, color=run_color(i).hex, label=name)
    axes.set_xticks(np.arange(len(study.within)), [places.link for places in study.within])
    axes.set_ylabel("change of the energy [%]")
    axes.legend(loc="upper left")
    return figure
