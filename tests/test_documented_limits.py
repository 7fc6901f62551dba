"""Limits that the documentation states are those of the code."""

from __future__ import annotations

import re
from math import log10
from pathlib import Path

from adaptctl import files
from adaptctl.codegen import exporting, live_arm
from adaptctl.compilation import llvm, object_cache, routine, sine
from adaptctl.contest import known
from adaptctl.control import leaky_integral, ringing
from adaptctl.control.adaptation import two_stage_filter
from adaptctl.control.excitation import torque_uncertainty
from adaptctl.control.gains import sampling_ratio
from adaptctl.description import pose, right_angles
from adaptctl.description.readers import entries, mjcf, xml_elements
from adaptctl.dynamics.loops import continuation, single_precision
from adaptctl.dynamics.recursion import drive
from adaptctl.experiments.contest import MAX_SAMPLES
from adaptctl.hardware import checks, force_sensor, loop, timing, torque_guard
from adaptctl.hardware.drive import MAX_ERROR, TOUCH_FORCE
from adaptctl.identifiability import certificate
from adaptctl.identification import (
    choice,
    complete_rows,
    contradictions,
    delay,
    estimator_comparison,
    filtered_dynamics,
    gathering,
    hypotheses,
    hypothesis_rows,
    instruments,
    late_stamps,
    listed_hypotheses,
    log_checks,
    long_logs,
    noise_choice,
    position_noise,
    report,
    springs,
    time_scale,
    torque_constants,
    uncertainty,
)
from adaptctl.identification.identify import HELD_OUT_SHARE
from adaptctl.logs import isolated, lerobot, on_disk, table, text
from adaptctl.simulation import integrator
from adaptctl.tuning import default_gains, feasible_gains, feasible_reference, learning_rule, verification
from adaptctl.tuning.tune import (
    SEARCH_DURATION,
    SEARCHED_ADAPTATION_RATIOS,
    SEARCHED_BANDWIDTHS,
    SEARCHED_SAMPLING_RATIOS,
)

ROOT = Path(__file__).parent.parent
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power(value: float) -> str:
    """A power of ten as pages write it: 10⁻⁵."""
    exponent = round(log10(value))
    assert float(f"1e{exponent}") == value
    return f"10{str(exponent).translate(RAISED)}"


def percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def any_of(values: tuple[float, ...]) -> str:
    *most, last = (f"{value:g}" for value in values)
    return f"{', '.join(most)} or {last}"


COUNTED = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
PARTS = {"a quarter": 0.25, "a fifth": 0.2, "a tenth": 0.1}


def counted(value: float) -> str:
    """A small whole number in words."""
    assert value == round(value)
    return COUNTED[round(value)]


def part(share: float) -> str:
    """A share in words."""
    (found,) = (words for words, own in PARTS.items() if abs(own - share) < 1e-12)
    return found


STATED = [
    ("concepts", f"smoothed below {drive.COULOMB_SMOOTHING_SPEED} rad/s"),
    ("concepts", f"this gap is at least {power(certificate.MIN_GAP)}"),
    ("concepts", f"at least {power(certificate.MIN_SINGULAR_VALUE_RATIO)}, and if"),
    ("concepts", f"close to round-off, below {power(certificate.MAX_RESIDUAL_SINGULAR_VALUE)} of $"),
    ("concepts", f"within round-off of such a value ({power(right_angles.EXACT_RIGHT_ANGLE)} rad"),
    ("control", f"parameters above {percent(torque_uncertainty.OPEN_SHARE)} of a torque limit"),
    ("concepts", f"A value above {sampling_ratio.MAX_SAMPLING_RATIO} is refused"),
    ("concepts", f"in steps of at most {continuation.MAX_PRIMARY_STEP} rad"),
    ("concepts", f"Mechanisms of more than {routine.MAX_COMPILED_LINKS} links run the same equations in Python"),
    ("compilation", f"Routines of more than {llvm.MAX_WHOLE_EXPRESSIONS:,} operations are compiled in pieces"),
    ("compilation", f"Above {routine.MAX_COMPILED_LINKS} links nothing is compiled"),
    ("compilation", f"up to $2^{{{sine.DOUBLE.farthest.hex().rpartition('p+')[2]}}}$ rad"),
    ("compilation", f"The cache holds {object_cache.MAX_CACHE_BYTES // 2**20} MiB"),
    ("compilation", f"A process keeps the first {object_cache.MAX_RESULTS_IN_PROCESS} results."),
    ("export", f"more than {power(single_precision.MAX_CLOSURE_GAP)} m or rad"),
    ("export", f"above {exporting.MAX_STACK_BYTES // 1024} kB it is refused"),
    ("export", f"If the loop needs more than {live_arm.MAX_MODULE_BYTES // 1000} kB"),
    (
        "discrete_adaptation",
        f"below $-{-ringing.ALARM_CORRELATION}$ for {ringing.MIN_PERIODS} steps it sets the flag `ringing`",
    ),
    ("discrete_adaptation", f"below $-{-ringing.BRAKE_CORRELATION}$ it brakes"),
    ("discrete_adaptation", f"moving averages over {ringing.AVERAGING_PERIODS} steps"),
    ("adaptation", f"a filter of {two_stage_filter.SLIDING_CUTOFF:.0f} rad/s"),
    ("adaptation", f"{learning_rule.SPEED_NOISE:g} rad/s. The second"),
    ("adaptation", f"It is at least {percent(learning_rule.FRICTION_ERROR_SHARE)} of"),
    ("adaptation", rf"$\rho T$ is at most {leaky_integral.MAX_RATE}, of late"),
    ("simulation", f"would exceed {MAX_SAMPLES:,}."),
    ("robots", f"at most {entries.MAX_LINKS} moving links, {entries.MAX_BODIES:,} bodies"),
    ("robots", f"{entries.MAX_GEOMS:,} geoms, {xml_elements.MAX_ELEMENTS:,} elements"),
    ("robots", f"an element depth of {xml_elements.MAX_DEPTH}"),
    (
        "robots",
        f"of {xml_elements.MAX_NAME_CHARACTERS} characters and numbers of {xml_elements.MAX_NUMBERS_CHARACTERS:,} in",
    ),
    ("robots", f"with {mjcf.MAX_MESH_SECONDS} s and {mjcf.MAX_MESH_MEMORY / 2**30:g} GiB"),
    ("robots", f"frames farther apart than 1e{log10(pose.MAX_LENGTH):.0f} m"),
    ("robots", f"beyond 1e{log10(xml_elements.MAX_MAGNITUDE):.0f}"),
    ("robots", f"within {power(right_angles.ROUNDED_ANGLE)} rad of a multiple of 90°"),
    ("robots", f"keys of {files.MAX_KEY_PARTS} parts, {files.MAX_TOML_BYTES / 2**20:g} MiB of TOML"),
    ("robots", f"TOML or {files.MAX_BYTES / 2**20:g} MiB of anything else"),
    ("contest", f"with each link {percent(known.WRONG_SHARE)} lighter or heavier than in the file"),
    ("switch_it_on", f"off by more than {percent(checks.GRAVITY_SHARE)} of a torque limit"),
    ("switch_it_on", f"({percent(checks.MEASURED_SHARE)} against a measured torque)"),
    ("switch_it_on", f"beyond {percent(torque_guard.RATE_SHARE)} of the robot's limit"),
    ("switch_it_on", f"a force of {TOUCH_FORCE:g} N (`touch_force`)"),
    (
        "switch_it_on",
        f"silent, or {1e3 * force_sensor.MAX_AGE:g} ms late, for more than {force_sensor.MAX_LOST} periods",
    ),
    ("switch_it_on", f"above {MAX_ERROR} rad (`max_error`)"),
    ("switch_it_on", f"more than {loop.BLIND} periods in a row | the robot's own stop"),
    ("switch_it_on", f"more than {percent(timing.TOLERANCE)} off"),
    ("switch_it_on", f"more than {loop.LATE} late periods in a row"),
    ("switch_it_on", f"sinks by {1e3 * loop.SAG:g} mrad within {1e3 * loop.SAG_TIME:g} ms of their release"),
    ("identification", f"with {isolated.MEMORY / 2**30:g} GB of memory and {isolated.TIME:g} s"),
    ("identification", f"Parquet files of more than {on_disk.LARGE / 2**20:g} MB"),
    (
        "identification",
        f"at most {table.MAX_ROWS:,} rows, {table.MAX_COLUMNS:,} columns and {table.MAX_NUMBERS:,} numbers",
    ),
    ("identification", f"file of at most {table.MAX_BYTES / 2**30:g} GiB; a text with blanks"),
    ("identification", f"between its numbers at most {text.MAX_SPACED / 2**30:g} GiB"),
    ("identification", f"a data set of LeRobot {lerobot.MAX_FILES:,} files"),
    ("identification", f"at most {percent(choice.MAX_MISFIT_RATIO - 1.0)} over that of least squares"),
    ("identification", f"the last {percent(HELD_OUT_SHARE)} of each of the others"),
    ("identification", f"a window in each of {choice.NUM_BLOCKS} blocks"),
    ("identification", f"rows take more than {long_logs.LONG / 2**20:g} MB"),
    ("identification", f"at least {choice.MIN_CUTOFF:.0f} Hz. Cut-offs"),
    ("identification", f"smoothed at 20 to {choice.MAX_CUTOFF:.0f} Hz"),
    ("identification", f"Joints slower than {percent(choice.SLOW_CANDIDATES[0])} of their peak speed"),
    (
        "identification",
        f"from {choice.WEIGHT_CANDIDATES[0]:.0e} to {choice.WEIGHT_CANDIDATES[-1]:.0f}. It may".replace("e-0", "e-"),
    ),
    ("identification", f"left out better by {percent(choice.MIN_IMPROVEMENT)}, as on"),
    ("identification", f"better so by {100.0 * choice.MIN_WEIGHT_IMPROVEMENT:g} %"),
    ("identification", f"that lasts** {any_of(noise_choice.TIMES)} s"),
    ("identification", f"must be {1.0 / noise_choice.MOST_SHARE:.0f} times as long"),
    ("identification", f"such that {uncertainty.INTERVAL} of them"),
    ("identification", f"more than {100.0 * position_noise.MAX_NOISE_SHARE:g} % of the squares"),
    ("identification", f"below {instruments.WEAK_INSTRUMENT:.0f} it is weak"),
    ("identification", f"predicted below {percent(report.WELL)}, roughly"),
    ("identification", f"predicted below {percent(report.ROUGHLY)}, poorly"),
    ("identification", f"at least {1e3 * delay.LEAST_DELAY:.0f} ms and"),
    ("identification", f"a centre with one of {100.0 * torque_constants.MAX_CENTER_DEVIATION:.0f} cm"),
    ("identification", f"the same filter of {choice.COMPARISON_CUTOFF:.0f} Hz"),
    ("identification", f"numbers at most {complete_rows.MAX_BRIDGED_PERIODS:.0f} periods apart"),
    ("identification", f"(a mass with a deviation of {part(torque_constants.MAX_DEVIATION)},"),
    ("identification", f"are {counted(1.0 / late_stamps.MAX_ROUGHNESS)} times smoother without"),
    ("identification", f"{counted(gathering.BAND_CUTOFF_RATIO)} times the frequency below which"),
    ("identification", f"below which {percent(filtered_dynamics.BAND_SHARE)} of the square"),
    ("identification", "Cut-offs of {}, {} and {} times the band".format(*map(counted, choice.CUTOFF_RATIOS))),
    ("identification", f"smoothed at {gathering.MIN_MOTION_CUTOFF:.0f} to"),
    ("identification", f"a standard error over {counted(choice.NUM_FOLDS)} groups of blocks"),
    ("identification", f"are exceeded by {percent(choice.OTHER_ROBOT_RATIO - 1.0)} even so"),
    ("identification", f"deviations over {counted(uncertainty.NEARLY_TOLD)} times as large"),
    ("identification", f"whose error is within {percent(hypotheses.ALIKE - 1.0)} of its own"),
    ("identification", f"asks as much of {counted(listed_hypotheses.JOINTS)} joints' errors"),
    ("identification", f"by a jackknife of {counted(time_scale.BLOCKS)} blocks"),
    (
        "identification",
        f"that is {counted(time_scale.SURE)} deviations and {part(time_scale.LEAST_SCALE - 1.0)} from 1",
    ),
    ("identification", f"refused above {listed_hypotheses.SMALL_ANGLE} rad ({listed_hypotheses.SMALL_SHIFT} m)"),
    ("identification", f"scale of a torque, beyond a factor of {listed_hypotheses.LEAST_SCALE:.0f} |"),
    ("identification", f"within {100.0 * log_checks.DEAD_SHARE:g} % of the largest joint's range"),
    ("identification", f"or others for up to {log_checks.LONGEST_RUN} rows"),
    ("identification", f"leaves more than {percent(contradictions.POOR)} of the torques"),
    ("identification", f"With less than {gathering.SHORT_DURATION:.0f} s of motion"),
    ("identification", f"all slopes are below {1.0 / hypothesis_rows.OTHER_SIDE} and alike"),
    ("identification", f"links need {part(hypothesis_rows.LARGE)} or more of the largest torque"),
    ("identification", f"up to {counted(delay.MOST_PERIODS)} periods of the motion's band"),
    ("identification", f"is more than {counted(delay.SURE)} deviations away"),
    ("identification", f"and {part(delay.LEAST_PERIODS)} of a sampling period"),
    ("identification", f"up to {part(springs.MAX_TORQUE_SHARE)} of the joint's torque"),
    ("identification", f"torques on its last {percent(estimator_comparison.HELD_OUT_SHARE)}"),
    ("identification", f"prior_weight={estimator_comparison.PRIOR_WEIGHT}, ..."),
    ("tuning", f"initial error $e_j$ ({feasible_gains.MAX_INITIAL_ERROR} rad or m"),
    ("tuning", rf"${feasible_gains.ACCELERATION_SHARE}\,\tau_j / M_{{jj}}$"),
    ("tuning", rf"$K_j \le {feasible_gains.DAMPING_TORQUE_SHARE}\,\tau_j"),
    ("tuning", f"{feasible_reference.MAX_AMPLITUDE} rad. A joint may need"),
    ("tuning", f"A joint may need {percent(feasible_reference.TORQUE_SHARE)} of its torque limit"),
    ("tuning", "One sinusoid per joint, {} to {} Hz".format(*feasible_reference.FREQUENCIES)),
    ("tuning", f"up to {percent(feasible_reference.MAX_TORQUE_SHARE)}. The amplitude"),
    ("tuning", f"up to {integrator.MAX_EXPLICIT_SUBSTEPS} steps per period"),
    ("tuning", rf"$\Lambda_j = \min({default_gains.DEFAULT_BANDWIDTH:.0f},"),
    ("tuning", f"is at most {default_gains.DEFAULT_SAMPLING_RATIO} along the"),
    ("tuning", f"what the torque limit corrects at {feasible_gains.MIN_BANDWIDTH:.0f} 1/s"),
    ("tuning", f"the bandwidth ({any_of(SEARCHED_BANDWIDTHS)} 1/s)"),
    ("tuning", f"the damping number ({any_of(SEARCHED_SAMPLING_RATIOS)})"),
    ("tuning", f"the adaptation number ({any_of(SEARCHED_ADAPTATION_RATIOS)})"),
    ("tuning", f"for {verification.OTHER_DURATION} s from {verification.OTHER_STARTS} starts"),
    ("tuning", f"are run for {SEARCH_DURATION:.0f} s each"),
    ("tuning", f"link errors of {percent(verification.LINK_ERROR)}, and other link errors"),
    ("tuning", f"of runs of {verification.DURATION:.0f} s"),
    ("tuning", f"no error exceeded {verification.MAX_ERROR:.0f} rad"),
    ("tuning", f"at most {percent(verification.MAX_LIMITED_SHARE)} of the second half"),
]


def test_stated_limits_are_those_of_the_code() -> None:
    texts = {page: (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") for page, _ in STATED}
    assert [(page, words) for page, words in STATED if words not in re.sub(r"\s+", " ", texts[page])] == []
