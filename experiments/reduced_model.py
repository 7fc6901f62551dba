"""Tracking with controllers that carry only some of the arm's essential components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Subspace
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import ADAPTATION_OFF, Found
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import (
    FundamentalBasis,
    ReducedModel,
    Reduction,
    essential_space,
    reduce,
    states_within_limits,
)
from adaptctl.recording import ControllerRun, Finding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adaptctl.recording.drawing import Drawing

ADAPTIVE, FIXED = "adaptive", "fixed"


@dataclass(frozen=True)
class ReducedModelTracking(Puma560Adaptive):
    """Experiment on tracking with reduced models: adaptive controllers whose models have only the s essential
    components of the parameters with the most energy, as in Table 3 of Sheu and Walker (1991).

    Essential components are the parts alpha_j v_j, alpha_j being numbers, of the P inertial parameters along
    orthonormal directions v_j (P,), those that change energies, sorted by the energy that they make over sampled
    states. For each count s in `components`, Slotine and Li's law adapts s numbers from zero, along the first s of the
    v_j; and, with adaptation off, uses the first s components of the true parameters. Raises `InputError` at
    construction for settings of the wrong type or out of their bounds, and for a `damping`, `center`, `amplitude` or
    `frequency`, which are inherited, that has not one number a joint, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "reduced-model"
    title: ClassVar[str] = "{robot}: adapting only the essential components that carry the energy"

    components: tuple[int, ...] = setting(
        (36, 34, 30, 25, 10), "how many components each controller carries, the subject first", symbol="s", low=1
    )
    samples: int = setting(
        101, "states within the joints' limits over which energies are compared", low=10, high=10_000
    )

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how well a controller tracks whose
        model has only those essential components (parts of the parameters along the directions that change energies)
        that make the most energy."""
        return (
            "Sheu and Walker sort the components of the essential parameters by the energy that each carries, and "
            "tell how little energy is lost when only the first s are kept. Here the controller carries only these: "
            "it adapts s numbers from zero, or holds the true values of the first s components. The order needs the "
            "true parameters and the sampled states; the values are learned. Every controller drives the same "
            f"environment from the same seed, and starts {self.initial_error:g} rad off in every joint."
        )

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: for each count s in `components` one that adapts s numbers from zero, along the s directions of
        parameters that make most energy, the first being the experiment's subject; for each s one with adaptation off
        and the true values along these; then one with adaptation off and zeros. `basis`, a `FundamentalBasis`, has the
        k fundamental (base) parameters. Raises `InputError` for an arm with friction, a count above the arm's k, or one
        given twice, `GainError` for gains too large for the control period, `RankError` where k cannot be certified."""
        model, reduction, space_basis = ReducedModel(mechanism, basis), *self._reduction(mechanism)
        self._require_counts(mechanism, model, len(reduction.weights))

        nothing = np.zeros(len(model.columns))
        directions = model.regrouping @ space_basis[:, reduction.order]
        gain = self._gain(mechanism, space_basis[:, reduction.order])

        def contender(name: str, label: str, knows: str, first: Array, law: Subspace | None = None) -> Contender:
            return Contender.of(name, label, knows, self.slotine_li(model, law, first))

        found = []
        for s in self.components:
            law = Subspace(gain[:s], directions[:, :s])
            found.append(contender(f"{ADAPTIVE}-{s}", f"Adapting {s}", "nothing", nothing, law))
        for s in self.components:
            first = model.regrouping @ reduction.parameters(s)
            found.append(contender(f"{FIXED}-{s}", f"True {s}", f"{s} components", first))
        return [*found, contender(ADAPTATION_OFF, "Adaptation off", "nothing", nothing)]

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the energy error, %, with each number
        of essential components (parts of the parameters along the directions that make most energy) kept, as in Table 3
        of Sheu and Walker (1991), and each run's RMS tracking error of all joints in the last two seconds, mrad (mm),
        left out for a shorter run. `outcome`, an `Outcome`, has the runs; `basis` is not used. Nothing is checked."""
        errors = self._reduction(outcome.mechanism)[0].percent_errors
        for s in self.components:
            yield Finding(f"energy_error.{s}", float(errors[s]), "%", f"energy error of {s} components (equation 23)")
        for run in outcome.runs:
            if (error := run.final_rms_error) is not None:
                unit, meaning = error_unit(outcome.mechanism), f"{run.label}: RMS error, last 2 s"
                yield Finding(f"final_rms_error.{run.name}", 1e3 * error, unit, meaning)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentence for the report, never None here, with three RMS tracking errors of all joints in the last two
        seconds, mrad (mm): of the controller that adapts the most essential components (parts of the parameters along
        the directions that make most energy), of that which adapts the fewest, and of that which uses the true values
        of the fewest with adaptation off; a dash for a missing error. `found` has the findings by name; `outcome`, with
        the runs, is not used. Nothing is checked."""
        least, most, unit = min(self.components), max(self.components), error_unit(outcome.mechanism)
        few, many = (found.text(f"final_rms_error.{ADAPTIVE}-{s}") for s in (least, most))
        return (
            f"Adapting {most} components from zero, the controller ends at {many} {unit} of tracking error; adapting "
            f"{least}, at {few} {unit}, and holding the true values of these {least}, at "
            f"{found.text(f'final_rms_error.{FIXED}-{least}')} {unit}."
        )

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over one figure for the report, a `Drawing` (name, caption and function that draws it): tracking
        errors, mrad (mm), and energy errors, %, over the number of essential components (parts of the parameters along
        the directions that make most energy) in a controller's model. `outcome`, an `Outcome`, has the runs; `basis` is
        not used. Nothing is checked."""
        from adaptctl.recording.drawing import Drawing

        errors = self._reduction(outcome.mechanism)[0].percent_errors
        yield Drawing(
            "components",
            "Tracking error over the last two seconds, and the energy error of Sheu and Walker's equation 23, by the "
            "number of components that the controller carries.",
            partial(error_by_count, self.components, outcome.runs, errors, error_unit(outcome.mechanism)),
        )

    def _reduction(self, mechanism: Mechanism) -> tuple[Reduction, Array]:
        """Model reduction over states within the limits, and V1 (P, k)."""
        space = essential_space(
            mechanism, seed=self.seed, states=states_within_limits(mechanism, self.samples, self.seed)
        )
        return reduce(space, mechanism, components=space.rank), space.basis

    def _gain(self, mechanism: Mechanism, basis: Array) -> Array:
        """Gains (k,): the rate times the variance of each v_j'D, the parameters' prior ranges being independent."""
        return np.asarray(self.rate * (basis.T**2 @ self.ranges.of(mechanism.parameter_names) ** 2))

    def _require_counts(self, mechanism: Mechanism, model: ReducedModel, rank: int) -> None:
        if model.regrouping.shape[1] != mechanism.energetic:
            raise InputError(f"robot: {mechanism.name} has friction, which carries no energy: use an arm without")
        wrong = [s for s in self.components if s > rank]
        if wrong:
            raise InputError(f"components: {mechanism.name} has {rank} essential parameters, got {wrong[0]}")
        if len(set(self.components)) < len(self.components):
            raise InputError("components: expected each at most once")


def error_by_count(
    counts: tuple[int, ...], runs: tuple[ControllerRun, ...], percent_errors: Array, unit: str = "mrad"
) -> Figure:
    """Matplotlib figure of errors, on logarithmic scales, over the number of essential components (parts of the
    parameters along the directions that make most energy) in a controller's model: the RMS tracking errors of all
    joints in the last two seconds of the `runs`, in thousandths of rad (m if prismatic), as `unit`, "mrad" by default,
    says; and the energy errors `percent_errors` (k + 1,), %, with 0 to k components; `counts` are the numbers of
    components that were run, and runs are taken by name, "adaptive-10" or "fixed-10" for 10 of them; runs that are
    missing or shorter have no point. Nothing is checked."""
    from adaptctl.recording.drawing import MUTED, run_color, sheet

    figure = sheet(3.6)
    axes = figure.subplots()
    found = {run.name: run.final_rms_error for run in runs}
    for i, (kind, label) in enumerate(((ADAPTIVE, "adapted from zero"), (FIXED, "true values held"))):
        drawn = {s: 1e3 * error for s in sorted(counts) if (error := found.get(f"{kind}-{s}")) is not None}
        axes.semilogy(list(drawn), list(drawn.values()), "o-", color=run_color(i).hex, label=label)
    off = found.get(ADAPTATION_OFF)
    if off is not None:
        axes.axhline(1e3 * off, color=MUTED.hex, linestyle=(0, (4, 3)), label="adaptation off, nothing known")
    axes.set_xlabel("components")
    axes.set_ylabel(f"RMS tracking error [{unit}]")
    energy = axes.twinx()
    every = np.arange(1, len(percent_errors))
    energy.semilogy(every[:-1], percent_errors[1:-1], color=run_color(2).hex, linewidth=1.2)
    energy.set_ylabel("energy error [%]", color=run_color(2).hex)
    energy.grid(visible=False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure
