"""Ranks of laws, with paired intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.contest.laws import PD_GRAVITY, TRUE_MODEL
from adaptctl.contest.resampling import median, median_interval

SIGNIFICANCE = 0.05
"""chance that some difference of mean ranks exceeds the critical one, if all laws are alike"""
ALL = "all"
"""condition of a row on all conditions"""
RATIO = "median ratio over runs of one robot, condition and seed"
RANK_COLUMNS = {
    "law": ("string", "", "law"),
    "condition": ("string", "", f"condition, or {ALL!r}"),
    "rank": ("double", "1", "mean rank over families and conditions, by the median over seeds; failures last"),
    "runs": ("int64", "1", "runs"),
    "failed": ("int64", "1", "runs that failed"),
    "error": ("double", "mrad (mm)", "median over runs that did not fail"),
    "error_2_s": ("double", "mrad (mm)", "median from 1.5 to 2.5 s"),
    "error_10_s": ("double", "mrad (mm)", "median from 10 to 11 s"),
    "error_20_s": ("double", "mrad (mm)", "median from 18 to 20 s"),
    "over_true": ("double", "1", f"over the true-model controller: {RATIO}"),
    "over_true_low": ("double", "1", "lower end of its 95 % interval"),
    "over_true_high": ("double", "1", "upper end of its 95 % interval"),
    "over_pd_gravity": ("double", "1", f"over PD with gravity: {RATIO}"),
    "over_pd_gravity_low": ("double", "1", "lower end of its 95 % interval"),
    "over_pd_gravity_high": ("double", "1", "upper end of its 95 % interval"),
    "return_time": ("double", "s", "median time to return after an event"),
    "unseen": ("double", "1", "median torque error on unseen motions, over the torque"),
    "torque": ("double", "1", "median RMS torque over the limits"),
    "torque_rate": ("double", "1/s", "median RMS change of the torques over the limits"),
    "saturated": ("double", "1", "median share of samples with a torque at its limit"),
    "operations": ("int64", "1", "floating-point operations of a control step, most of all robots"),
    "knows": ("string", "", "what the law may know"),
    "gains": ("string", "", "how the law got its gains"),
    "failure": ("string", "", "how the law fails, in a sentence"),
}
"""Kind, unit and meaning of each column of ranks.parquet."""
MEDIANS = (
    *("error", "error_2_s", "error_10_s", "error_20_s", "return_time"),
    *("unseen", "torque", "torque_rate", "saturated"),
)


class Interval(NamedTuple):
    """Value and the ends of its interval."""

    value: float
    low: float
    high: float


class OrdersCompared(NamedTuple):
    """Kendall's tau-b of two orders of laws, and pairs whose order is settled in both, and not the same."""

    tau_b: float
    reversed_pairs: list[tuple[str, str]]

    def __str__(self) -> str:
        turned = ", ".join(f"{a} and {b}" for a, b in self.reversed_pairs) or "none"
        return f"tau-b {self.tau_b:.2f}; settled pairs in another order: {turned}"


@dataclass(frozen=True, eq=False)
class Ranking:
    """Ranking of the rows of a contest, of L laws, R robots of F families, C conditions and S seeds."""

    rows: Sequence[dict[str, Any]]
    families: Mapping[str, str] = field(default_factory=dict)
    """Family of a robot; one that is not here is a family of its own."""
    error_unit: str = "mrad"
    """Unit of the errors: mrad, "mm" where all joints slide, "mrad or mm" where some do."""

    def _names(self, what: str) -> list[Any]:
        return list(dict.fromkeys(row[what] for row in self.rows))

    @cached_property
    def laws(self) -> list[str]:
        """Names of the laws."""
        return self._names("law")

    @cached_property
    def robots(self) -> list[str]:
        """Names of the robots."""
        return self._names("robot")

    @cached_property
    def conditions(self) -> list[str]:
        """Names of the conditions."""
        return self._names("condition")

    @cached_property
    def seeds(self) -> list[int]:
        """Seeds."""
        return self._names("seed")

    def values(self, column: str) -> Array:
        """Values (L, R, C, S) of a column; NaN of a run that failed."""
        axes = self.laws, self.robots, self.conditions, self.seeds
        place = [{name: k for k, name in enumerate(axis)} for axis in axes]
        found = np.full([len(axis) for axis in axes], np.nan)
        for row in self.rows:
            at = tuple(of[row[what]] for of, what in zip(place, ("law", "robot", "condition", "seed"), strict=True))
            found[at] = np.nan if row["reason"] else row[column]
        return found

    @cached_property
    def errors(self) -> Array:
        """Errors (L, R, C, S) by which laws are ranked, infinite of a run that failed."""
        found = self.values("error")
        return np.where(np.isnan(found), np.inf, found)

    @cached_property
    def family_names(self) -> list[str]:
        """Family (R,) of each robot."""
        return [self.families.get(robot, robot) for robot in self.robots]

    @cached_property
    def block_ranks(self) -> Array:
        """Ranks (L, F, C) from 1 in each block, a family of robots under a condition, by the median over seeds."""
        from scipy.stats import rankdata

        each, names = rankdata(np.median(self.errors, axis=-1), axis=0), np.array(self.family_names)
        families = [each[:, names == family].mean(axis=1) for family in dict.fromkeys(self.family_names)]
        return np.asarray(rankdata(np.stack(families, axis=1), axis=0))

    @cached_property
    def mean_ranks(self) -> Array:
        """Mean ranks (L,)."""
        return self.block_ranks.mean(axis=(1, 2))

    @property
    def order(self) -> list[str]:
        """Laws from the first to the last."""
        return [self.laws[k] for k in np.argsort(self.mean_ranks, kind="stable")]

    @property
    def critical_difference(self) -> float:
        """Difference of mean ranks that is significant for some pair (Nemenyi), blocks taken as independent."""
        from scipy.stats import studentized_range

        count, blocks = len(self.laws), self.block_ranks[0].size
        if count < 2:
            return float("nan")
        quantile = float(studentized_range.ppf(1.0 - SIGNIFICANCE, count, np.inf)) / np.sqrt(2.0)
        return float(quantile * np.sqrt(count * (count + 1) / (6.0 * blocks)))

    def over(self, law: str, other: str, condition: str = ALL) -> Interval:
        """Median ratio of the errors of two laws in equal runs, with its paired interval over seeds and families."""
        if other not in self.laws:
            return Interval(*[float("nan")] * 3)
        return Interval(*np.exp(median_interval(self._logs(law, other, condition), self.family_names)).tolist())

    def ratio(self, law: str, other: str, condition: str = ALL) -> float:
        """Median ratio of the errors of two laws in equal runs."""
        return float(np.exp(median(self._logs(law, other, condition).ravel())))

    def _logs(self, law: str, other: str, condition: str) -> Array:
        """Logarithms (R, C, S) of the ratios of two laws."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.log(self._of(law, condition)) - np.log(self._of(other, condition)))

    def _of(self, law: str, condition: str) -> Array:
        """Errors (R, C, S) of a law under a condition or all."""
        chosen = slice(None) if condition == ALL else [self.conditions.index(condition)]
        return self.errors[self.laws.index(law)][:, chosen]

    def table(self) -> list[dict[str, Any]]:
        """Rows of ranks.parquet: each law over all conditions from the first to the last, then under each."""
        return [self._row(law, condition) for condition in (ALL, *self.conditions) for law in self.order]

    def _row(self, law: str, condition: str) -> dict[str, Any]:
        rows = [row for row in self.rows if row["law"] == law and condition in (ALL, row["condition"])]
        sound = [row for row in rows if not row["reason"]]
        chosen = slice(None) if condition == ALL else self.conditions.index(condition)
        found: dict[str, Any] = {
            "law": law,
            "condition": condition,
            "rank": float(self.block_ranks[self.laws.index(law)][:, chosen].mean()),
            "runs": len(rows),
            "failed": len(rows) - len(sound),
            "operations": max(row["operations"] for row in rows),
            "knows": next((row["knows"] for row in rows if row["knows"]), ""),
            "gains": next((row["gains"] for row in rows if row["gains"]), ""),
            "failure": self.failure(law, condition),
        }
        found |= {name: median(row[name] for row in sound) for name in MEDIANS}
        for name, other in (("over_true", TRUE_MODEL), ("over_pd_gravity", PD_GRAVITY)):
            interval = self.over(law, other, condition)
            found |= {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
        return found

    def failure(self, law: str, condition: str = ALL) -> str:
        """Sentence on how a law fails."""
        rows = [row for row in self.rows if row["law"] == law and condition in (ALL, row["condition"])]
        wrong = [row for row in rows if row["reason"]]
        if not wrong:
            return "Does not fail." if condition != ALL else f"Does not fail{self._weakest(law)}."
        most, count = Counter(row["condition"] for row in wrong).most_common(1)[0]
        under = "" if condition != ALL or len(wrong) == len(rows) else f", {count} of them under {most}"
        first = next(row for row in wrong if row["condition"] == most)
        robot = f" ({first['robot']}, seed {first['seed']})"
        return f"Fails in {len(wrong)} of {len(rows)} runs{under}: {first['reason']}{robot}."

    def _weakest(self, law: str) -> str:
        other = TRUE_MODEL if TRUE_MODEL in self.laws and law != TRUE_MODEL else PD_GRAVITY
        ratios = {name: self.ratio(law, other, name) for name in self.conditions if other in self.laws}
        known = {name: ratio for name, ratio in ratios.items() if np.isfinite(ratio)}
        if not known or law == other:
            return ""
        worst = max(known, key=lambda name: known[name])
        return f"; weakest under {worst}, {known[worst]:.3g} times the error of {other}"

    def of_seeds(self, seeds: Iterable[int]) -> Ranking:
        """Ranking of the rows of some seeds."""
        chosen = set(seeds)
        return replace(self, rows=[row for row in self.rows if row["seed"] in chosen])

    def halves(self) -> OrdersCompared | None:
        """OrdersCompared of two halves of the seeds; None of one seed."""
        if len(self.seeds) < 2:
            return None
        return agreement(self.of_seeds(self.seeds[::2]), self.of_seeds(self.seeds[1::2]))


def agreement(one: Ranking, other: Ranking) -> OrdersCompared:
    """OrdersCompared of the orders of the same laws in two rankings, such as of two plants or halves of the seeds."""
    from scipy.stats import kendalltau

    laws = [law for law in one.laws if law in other.laws]
    ranks = [[each.mean_ranks[each.laws.index(law)] for law in laws] for each in (one, other)]
    pairs = [(a, b) for k, a in enumerate(laws) for b in laws[k + 1 :]]
    apart = [pair for pair in pairs if (one.ratio(*pair) - 1.0) * (other.ratio(*pair) - 1.0) < 0.0]
    turned = [pair for pair in apart if _settled(one, *pair) * _settled(other, *pair) < 0]
    return OrdersCompared(float(kendalltau(*ranks).statistic) if len(laws) > 1 else float("nan"), turned)


def _settled(ranking: Ranking, one: str, other: str) -> int:
    """-1 or 1 where the interval of the ratio of two laws is below or above 1, else 0."""
    _, low, high = ranking.over(one, other)
    return int(low > 1.0) - int(high < 1.0)
