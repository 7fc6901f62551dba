"""Mutants of samples that no test can tell from the code."""

from __future__ import annotations

ALIKE = {
    "adaptctl/control/excitation/measure.py::persistent_excitation 0 -> 1": "a window of one sample is too short too",
    "adaptctl/simulation/references.py::warn_of_derivatives -1 -> +1": "times rise",
    "adaptctl/dynamics/loops/continuation.py::Continuation._gap -1 -> +1": "the last axis of two is the second",
    "adaptctl/dynamics/loops/dyad.py::_across np.cross(normal, first) + 0.0 -> np.cross(normal, first) - 0.0": (
        "the sign of a zero is not kept"
    ),
    "adaptctl/dynamics/loops/assembly.py::_closed 0.0 -> 1.0": "a hundred steps instead of a few: slower alone",
    "adaptctl/dynamics/loops/posture.py::factored 0 -> 1": "columns are of one length",
    "adaptctl/control/adaptation/concurrent_learning.py::ConcurrentLearning._equations 1 -> 2 (again 1)": (
        "of a sample that is too long no more is taken than there are columns"
    ),
    "adaptctl/identifiability/priority.py::suggestion 1 -> 2": "of two that are close the first is taken, the closest",
    "adaptctl/identifiability/tree/unobservable_inertia.py::_functionals_at_zero 0 -> 1 (again 1)": (
        "a row of zeros spans what no row spans"
    ),
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2": "two samples per product",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2 (again 1)": "NumPy takes -2 for -1 in a shape",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2 (again 2)": "NumPy takes -2 for -1 in a shape",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram "
    "SMALL_PRODUCT // (rows * k * k) -> SMALL_PRODUCT * (rows * k * k)": "one product instead of many: slower alone",
    "adaptctl/control/adaptation/prior_ranges.py::PriorRanges._range -1 -> +1": (
        "a name has a dot, and of the two parts about its last dot the last is the second"
    ),
    "adaptctl/control/guards.py::SafetyFilter.law stopped > 0.5 -> stopped >= 0.5": "a mark is 0 or 1",
    "adaptctl/control/controller.py::_columns 1 -> 2": "NumPy takes -2 for -1 in a shape",
    "adaptctl/control/gains/workspace.py::position_range 1 -> 2": "NumPy takes -2 for -1 in a shape",
    "adaptctl/dynamics/loops/continuation.py::Continuation.surely_regular "
    "side * determinant(block) > 0.0 -> side * determinant(block) >= 0.0": (
        "where the determinant is zero no inverse is within any bound"
    ),
    "adaptctl/identifiability/certification.py::residual_singular_values 1e-300 -> 2e-300": (
        "a spectrum of zeros is divided by anything but zero"
    ),
    "adaptctl/identifiability/proof/digits.py::<module> 26 -> 27": "one more term of the series is below the last bit",
    "adaptctl/identifiability/proof/simplest.py::_near x > 0.0 -> x >= 0.0": "zero never comes here",
    "adaptctl/control/gains/error_feedback.py::ErrorFeedback.is_cascade "
    "1.0 - 1.0 / self.damping_ratio ** 2 >= -ROUNDING - self.bandwidth * self.period -> "
    "1.0 - 1.0 / self.damping_ratio ** 2 > -ROUNDING - self.bandwidth * self.period": (
        "no ratio is meant to be at the allowance for round-off exactly"
    ),
    "adaptctl/dynamics/loops/assembly.py::_dependent_rank 1e-300 -> 2e-300": (
        "a column of zeros is divided by anything but zero"
    ),
    "adaptctl/dynamics/loops/continuation.py::Continuation.follow -1 -> +1 (again 5)": (
        "of two axes the last is the one after the first"
    ),
    "adaptctl/identifiability/fundamental_basis.py::_kept_against_the_order 1.0 -> 2.0": (
        "diagonals of orthonormal vectors' factor are at most 1, and tolerances below"
    ),
    "adaptctl/identifiability/proof/exact_geometry.py::_as_in_file 0.0 -> 1.0": (
        "an axis along z has any yaw: its sine of tilt is exactly zero"
    ),
    "adaptctl/identifiability/proof/field_energies.py::energy_changes 0.0 -> 1.0 (again 2)": (
        "changes are against any fixed position of a sliding joint"
    ),
    "adaptctl/identifiability/regrouping.py::Regrouping.determined "
    "self.bound <= LARGEST_CONDITION -> self.bound < LARGEST_CONDITION": "the condition is never above its bound",
    "adaptctl/identifiability/tree/unobservable_inertia.py::<module> 5 -> 6": "A^5 is a sum of lower powers",
}
"""Mutants that mean the same as the code, by their keys, and why no test can tell them from it."""
