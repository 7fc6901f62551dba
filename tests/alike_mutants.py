"""Mutants of samples that no test can tell from the code."""

from __future__ import annotations

ALIKE = {
    "adaptctl/control/adaptation/symmetric.py::_solver.symmetric_solve 1 -> 2": "one more column, which nothing reads",
    "adaptctl/identification/hypothesis_rows.py::HypothesisRows._equation "
    "found.is_native(MOTIONS * mechanism.dof * len(self.position)) -> pass": "rows are the same, compiled or not",
    "adaptctl/identifiability/tree_null_space.py::<module> 6 -> 7": (
        "parameters that are passed on span the same, reduced or not"
    ),
    "adaptctl/identifiability/regrouping.py::Regrouping.leaves_more_than 1.0 -> 2.0 (again 2)": (
        "diagonals are at least 1, and tolerances far below a half"
    ),
    "adaptctl/identifiability/proof/arithmetic.py::ranks 1 -> 2 (again 3)": "what is left of a last row is not read",
    "adaptctl/simulation/transmission.py::_fastest -np.diag(springs) -> +np.diag(springs)": (
        "motors that are counted the other way round have the same eigenvalues"
    ),
    "adaptctl/simulation/references.py::_wrong "
    "np.median(np.abs(stated - slope), axis=0) > DERIVATIVE_TOLERANCE * scale + 1e-06 -> "
    "np.median(np.abs(stated - slope), axis=0) >= DERIVATIVE_TOLERANCE * scale + 1e-06": (
        "no slope misses by the tolerance to the last bit"
    ),
    "adaptctl/contest/ranking.py::Ranking.failure 1 -> 2": "the first of the two most common is the most common",
    "adaptctl/scalars/scalar.py::logarithm 2.0 ** bit -> 2.0 * bit": "smaller powers take the rest away again",
    "adaptctl/design/task.py::DesignTask.torques -1 -> +1": "of two axes the last is the second",
    "adaptctl/dynamics/array_equations.py::_rows -1 -> +1 (again 1)": "what has the shape is broadcast to itself",
    "adaptctl/identifiability/proof/joint_frames.py::_axis_frame abs(along) > precision.length * length -> "
    "abs(along) >= precision.length * length": "no offset is the tolerance to the last bit",
    "adaptctl/dynamics/loops/assembly.py::_validate_fit share > 1e-06 -> share >= 1e-06": "as above",
    "adaptctl/dynamics/loops/continuation.py::Continuation._closed "
    "self._gap(found) < CLOSURE_TOLERANCE -> self._gap(found) <= CLOSURE_TOLERANCE": "as above",
    "adaptctl/dynamics/loops/continuation.py::Continuation.validate_regular "
    "regularity[worst] >= MIN_REGULARITY -> regularity[worst] > MIN_REGULARITY": "as above",
    "adaptctl/description/readers/mujoco_model.py::_rank 1e-300 -> 2e-300": (
        "a spectrum of zeros is divided by anything but zero"
    ),
    "adaptctl/identification/rate_change.py::<module> 17 -> 18": "rows that are compared at a time",
    "adaptctl/identification/rate_change.py::_bend clear > CLEAR -> clear >= CLEAR": (
        "no change is twice another to the last bit"
    ),
    "adaptctl/identification/consistent_estimate.py::consistent_estimates np.arange(len(some)) < prior.tens.size -> "
    "np.arange(len(some)) <= prior.tens.size": "one more column without rows, whose estimate is zero",
    "adaptctl/identification/rate_change.py::_bend 1.0 -> 2.0": "a joint at rest moves no way, whatever divides it",
    "adaptctl/identification/held_out.py::_predicted 1 -> 2": "known torques are one column, whose factor is the first",
    "adaptctl/identification/mujoco_bodies.py::MujocoBodies.write 10 -> 11": "of zeros the first ten are read",
    "adaptctl/identification/loaded_fit.py::_minimum change < LEAST_CHANGE -> change <= LEAST_CHANGE": (
        "no change is the least to the last bit"
    ),
    "adaptctl/control/transitions.py::FadeIn.__post_init__ 0.0 -> 1.0": "a reference has one shape at all times",
    "adaptctl/identifiability/chosen_columns.py::_kept_against_the_order apart <= READING -> apart < READING": (
        "no diagonal of a factor is the tolerance to the last bit"
    ),
    "adaptctl/control/excitation/excitation_trajectory.py::<module> 10 -> 11": "one more reference for comparison",
    "adaptctl/simulation/references.py::ReferencesOfMany.start 1 -> 2": "a second time, whose point nothing reads",
    "adaptctl/simulation/references.py::ReferencesOfMany.of 1 -> 2": "the same reference again, which nothing reads",
    "adaptctl/simulation/simulate.py::<module> False -> True": "code that is made for one run computes the same",
    "adaptctl/simulation/summaries.py::summed 0.5 -> 1.0 (again 1)": "joints have whole numbers",
    "adaptctl/simulation/effects/effect.py::JointEffect.resistance absolute(x) > MIN_SECANT_SPEED -> "
    "absolute(x) >= MIN_SECANT_SPEED": "the slope of friction at the slowest speed is that at its negative",
    "adaptctl/logs/joint_states_cdr.py::_Layout.of place - BODY -> place + BODY": "modulo 8, as the body begins at 4",
    "adaptctl/logs/joint_states_cdr.py::_Layout.decoded BODY + 8 -> BODY - 8": "only the first four bytes are read",
    "adaptctl/logs/joint_states_cdr.py::<module> 8 -> 9 (again 1)": "layouts that are forgotten are found again",
    "adaptctl/dynamics/loops/continuation.py::Continuation.follow 1 -> 2 (again 2)": "NumPy takes -2 for -1 in a shape",
    "adaptctl/dynamics/inverse_kinematics.py::<module> 4 -> 5": "one more step at the goal moves nothing",
    "adaptctl/dynamics/inverse_kinematics.py::Tip.joints 1 -> 2 (again 3)": "as above",
    "adaptctl/description/right_angles.py::_pose np.abs(pose.rotation - rounded).max() < tolerance -> "
    "np.abs(pose.rotation - rounded).max() <= tolerance": "no rotation misses by the tolerance to the last bit",
    "experiments/replication/semi_direct_drive.py::table12 1 -> 2": "the first draw is looked at, of one or of two",
    "adaptctl/logs/parquet.py::<module> 2 ** 20 -> 2 * 20": "bytes that are read at a time",
    "adaptctl/logs/parquet.py::read_arrow False -> True": "threads read the same",
    "adaptctl/control/excitation/measure.py::persistent_excitation 0 -> 1": "a window of one sample is too short too",
    "adaptctl/simulation/references.py::warn_of_derivatives -1 -> +1": "times rise",
    "adaptctl/dynamics/loops/continuation.py::Continuation._gap -1 -> +1": "the last axis of two is the second",
    "adaptctl/dynamics/loops/dyad.py::_across np.cross(normal, first) + 0.0 -> np.cross(normal, first) - 0.0": (
        "the sign of a zero is not kept"
    ),
    "adaptctl/dynamics/loops/assembly.py::_closed 0.0 -> 1.0": "a hundred steps instead of a few: slower alone",
    "adaptctl/dynamics/loops/posture.py::factored 0 -> 1": "columns are of one length",
    "adaptctl/identifiability/priority.py::suggestion 1 -> 2": "of two that are close the first is taken, the closest",
    "experiments/sheu_walker_1991.py::chosen 1 -> 2": "of two names that are close the first is taken, the closest",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2": "two samples per product",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2 (again 1)": "NumPy takes -2 for -1 in a shape",
    "adaptctl/control/excitation/excitation_trajectory.py::_gram 1 -> 2 (again 2)": "NumPy takes -2 for -1 in a shape",
    "adaptctl/control/adaptation/prior_ranges.py::PriorRanges._range -1 -> +1": (
        "a name has a dot, and of the two parts about its last dot the last is the second"
    ),
    "adaptctl/dynamics/loops/continuation.py::Continuation.surely_regular "
    "side * determinant(block) > 0.0 -> side * determinant(block) >= 0.0": (
        "where the determinant is zero no inverse is within any bound"
    ),
    "adaptctl/identifiability/certification.py::residual_singular_values 1e-300 -> 2e-300": (
        "a spectrum of zeros is divided by anything but zero"
    ),
    "adaptctl/dynamics/loops/assembly.py::_dependent_rank 1e-300 -> 2e-300": (
        "a column of zeros is divided by anything but zero"
    ),
    "adaptctl/dynamics/loops/continuation.py::Continuation.follow -1 -> +1 (again 5)": (
        "of two axes the last is the one after the first"
    ),
    "adaptctl/identifiability/chosen_columns.py::_kept_against_the_order 1.0 -> 2.0": (
        "diagonals of orthonormal vectors' factor are at most 1, and tolerances below"
    ),
    "adaptctl/identifiability/proof/exact_geometry.py::_as_in_file 0.0 -> 1.0": (
        "an axis along z has any yaw: its sine of tilt is exactly zero"
    ),
    "experiments/replication/puma560.py::combination sign(term[:-1]) * (1.0 if mark == '+' else -1.0) -> "
    "sign(term[:-1]) / (1.0 if mark == '+' else -1.0)": "by one or minus one",
    "experiments/replication/puma560.py::figure1 max(forms, worst) < 1e-12 -> max(forms, worst) <= 1e-12": (
        "no difference is its bound to the last bit"
    ),
    "experiments/replication/puma560.py::figure3 value > puma[:, s].max() -> value >= puma[:, s].max()": (
        "no drawn error is a printed number to the last bit"
    ),
    "adaptctl/design/simplifications.py::_least_mass short(0.0) * short(places.mass) -> "
    "short(0.0) / short(places.mass)": "signs alone count",
    "experiments/replication/semi_direct_drive.py::section53 max(len(generic.relations), len(equal.relations)) <= 3 -> "
    "max(len(generic.relations), len(equal.relations)) < 3": "there are ten relations of one arm, and six of the other",
    "adaptctl/tuning/verification.py::measures 0.0 -> 1.0": "a run that is not finite has an infinite error anyway",
    "adaptctl/tuning/feasible_reference.py::_scaled_to_limits asked > allowed -> asked >= allowed": (
        "no torque is its limit to the last bit"
    ),
    "adaptctl/tuning/feasible_reference.py::_scaled_to_limits "
    "scale[over].min() > MIN_AMPLITUDE_SHARE -> scale[over].min() >= MIN_AMPLITUDE_SHARE": (
        "no product of 0.7 and 0.95 is a twentieth"
    ),
    "adaptctl/contest/measures.py::measured time[-1] + time[1] - time[0] -> time[-1] + time[1] + time[0]": (
        "runs begin at 0 s"
    ),
    "adaptctl/contest/ranking.py::agreement 1.0 -> 2.0": (
        "ratios are within their intervals, which are looked at where ratios are apart"
    ),
    "adaptctl/contest/ranking.py::agreement (one.ratio(*pair) - 1.0) * (other.ratio(*pair) - 1.0) < 0.0 -> "
    "(one.ratio(*pair) - 1.0) * (other.ratio(*pair) - 1.0) <= 0.0": "ratios of 1 are within their intervals",
    "envs/rendering.py::intersect distance > 0.0 -> distance >= 0.0": "no eye is on a part to the last bit",
    "envs/rendering.py::intersect height > 0.0 -> height >= 0.0": "no ray meets the rim of an end to the last bit",
    "adaptctl/logs/on_disk.py::_mapped os.fstat(file.fileno()).st_size < size -> "
    "os.fstat(file.fileno()).st_size <= size": ("a file that is made as long as it is stays as it is"),
    "adaptctl/logs/text.py::_long Path(path).stat().st_size < on_disk.LARGE -> "
    "Path(path).stat().st_size <= on_disk.LARGE": ("a file is the same, read whole or by batches"),
    "adaptctl/logs/on_disk.py::is_large 8 * columns * rows >= LARGE -> 8 * columns * rows > LARGE": (
        "columns are the same, in memory or on disk"
    ),
    "adaptctl/control/adaptation/payload_test.py::PayloadTest._is_a_body "
    "gained > -MAX_LOSS * maximum(before, 0.0) - slack -> gained >= -MAX_LOSS * maximum(before, 0.0) - slack": (
        "no estimated inertia is a share of another one to the last bit"
    ),
    "adaptctl/dynamics/loops/continuation.py::Continuation.follow 0 -> 1": "of no configuration a step changes nothing",
    "adaptctl/simulation/run.py::Rollout._figure 1 -> 2 (again 5)": "lines of a joint have its color in each panel",
    "adaptctl/logs/text.py::_kind pa.types.is_string(kind) or pa.types.is_time(kind) -> "
    "pa.types.is_string(kind) and pa.types.is_time(kind)": "columns without numbers are read once more in any case",
    "adaptctl/contest/trial.py::_torques 0.1 -> 0.2 (again 1)": "any measurements tell if a law uses the links",
    "adaptctl/contest/trial.py::<module> 3 -> 4": "as above: four steps tell what three do",
    "adaptctl/compilation/batch.py::batch MIN_STREAMED_BYTES // 8 -> MIN_STREAMED_BYTES * 8": (
        "arrays of any size have the same numbers, written past the cache or not"
    ),
    "adaptctl/compilation/batch.py::batch 8 -> 9": "as above: a ninth less or more of a size",
    "adaptctl/logs/text.py::<module> 20 -> 21": "a file is the same, read by one MB or by two at a time",
    "adaptctl/recording/compared_folders.py::_common_unit 0 -> 1": "of two units or more that are all the same",
    "adaptctl/files.py::replacing True -> False": "that a file is missing is among the errors that are passed over",
    "adaptctl/recording/trace.py::_tables 0 -> 1 (again 1)": "columns are all as long as the second",
    "adaptctl/recording/finished_trace.py::<module> 1000000 -> 1000001": "no run has one sample more than a million",
    "adaptctl/recording/vector.py::Sheet 1 -> 2": "no marks are in no rows, of however many columns",
    "adaptctl/recording/live.py::reachable 0.1 -> 0.2": "a viewer that starts is asked less often",
    "adaptctl/hardware/udp_plant.py::begun (ahead := (due - time.perf_counter())) > 0.0 -> "
    "(ahead := (due - time.perf_counter())) >= 0.0": "to wait for no time is not to wait",
    "adaptctl/logs/joint_states_cdr.py::<module> 1024 -> 1025": "tables are the same, by how many messages at a time",
    "adaptctl/recording/vector_marks.py::Axis.ticks 1e-09 -> 2e-09 (again 1)": (
        "ends of an axis are whole steps but for round-off, or far from it"
    ),
    "envs/gain_tuning.py::GainRange.gains within > 0.0 -> within >= 0.0": "any factor to the power of zero is one",
    "envs/contact.py::beside 0 -> 1": "a ball has one size",
    "envs/contact.py::beside 0 -> 1 (again 1)": "a ball has one size",
    "envs/contact.py::beside 0 -> 1 (again 2)": "links have inertias of their own, beside which no shape's mass counts",
    "envs/video.py::VideoRecorder._write False -> True": "clips of images have no sound to write",
    "adaptctl/dynamics/loops/continuation.py::Continuation.progress 1 -> 2 (again 2)": (
        "a step after the last is of no configuration"
    ),
    "adaptctl/design/simplifications.py::by_symmetry "
    "np.abs(solved) < ZERO_COEFFICIENT -> np.abs(solved) <= ZERO_COEFFICIENT": (
        "no coefficient is 1e-11 to the last bit"
    ),
    "adaptctl/dynamics/loops/continuation.py::BatchContinuation.followed 1.0 -> 2.0": "signs alone count",
    "adaptctl/dynamics/loops/continuation.py::BatchContinuation.followed_alone 1.0 -> 2.0": "as above",
    "adaptctl/codegen/c_program.py::CProgram._piece 0 -> 1": "the first piece has the first two operations",
    "adaptctl/identifiability/regrouping.py::_alike "
    "abs(abs(a) - abs(b)) <= EQUAL_COEFFICIENT_TOLERANCE * abs(b) -> "
    "abs(abs(a) - abs(b)) < EQUAL_COEFFICIENT_TOLERANCE * abs(b)": "coefficients differ by round-off or far more",
    "adaptctl/codegen/initialisation.py::start_of PROBE_DISTANCE * np.linspace(0.5, 1.0, law.dof) -> "
    "PROBE_DISTANCE / np.linspace(0.5, 1.0, law.dof)": "any positions aside tell what depends on them",
    "adaptctl/codegen/initialisation.py::start_of 0.5 -> 1.0": "as above",
    "adaptctl/codegen/initialisation.py::start_of 1.0 -> 2.0": "as above",
    "adaptctl/tuning/verification.py::verifications farthest >= MAX_ERROR -> farthest > MAX_ERROR": (
        "no error is its bound to the last bit"
    ),
    "adaptctl/tuning/feasible_reference.py::<module> 1e-06 -> 2e-06": (
        "the step of a slope, along which a descent is rounded to three digits"
    ),
    "adaptctl/compilation/stepper.py::Ensemble.run 0 -> 1": "no steps are a number that is checked once more",
    "adaptctl/compilation/stepper.py::_form 1 -> 2": "members and lanes say how many blocks there are",
    "adaptctl/scalars/scalar.py::logarithm 0.0 -> 1.0 (again 5)": "what is on no side of zero is zero or no number",
    "adaptctl/codegen/wasm_module.py::WasmModule._sincos 1 -> 2": "an argument beside the angle has no use",
    "adaptctl/recording/vector.py::Sheet._legend 1 -> 2": "steps through no marks are none, however long",
    "adaptctl/sweeps/search.py::search 1e+300 -> 2e+300": "errors are below both, and runs that failed above them",
    "adaptctl/design/counterweights.py::_Search.fewest count > 0 -> count >= 0": (
        "no design has fewer components than none"
    ),
    "adaptctl/design/report.py::_components_figure errors > 1e-08 -> errors >= 1e-08": (
        "no error is a hundred-millionth of a percent to the last bit"
    ),
    "adaptctl/hardware/trossen_robot.py::TrossenRobot.__init__ 0.0 -> 1.0": "clocks have run for longer than a second",
    "adaptctl/recording/skeleton.py::skeleton np.linalg.norm(farthest - tip) > MIN_LENGTH -> "
    "np.linalg.norm(farthest - tip) >= MIN_LENGTH": "no frame is so far away to the last bit",
    "envs/rendering.py::Renderer._paint 1.5 -> 3.0": "more of the picture is looked through for the same solid",
    "experiments/replication/puma560.py::table6 1 -> 2": "NumPy takes -2 for -1 in a shape",
}
"""Mutants that mean the same as the code, by their keys, and why no test can tell them from it."""
