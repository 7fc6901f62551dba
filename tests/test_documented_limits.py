"""Limits that the documentation states are those of the code."""

from __future__ import annotations

import re
from math import log10
from pathlib import Path

from adaptctl.codegen import exporting, live_arm
from adaptctl.compilation import kernel, llvm, object_cache, sine
from adaptctl.control import ringing
from adaptctl.control.gains import hold
from adaptctl.description import pose, transforms
from adaptctl.description.readers import entries, xml_elements
from adaptctl.dynamics.loops import continuation, single_precision
from adaptctl.dynamics.recursion import drive
from adaptctl.experiments.contest import MANY
from adaptctl.identifiability import certificate
from adaptctl.identification import choice
from adaptctl.identification.identify import HELD_OUT
from adaptctl.simulation import integrator
from adaptctl.tuning import carried_gains, verification, workable_reference
from adaptctl.tuning.tune import SEARCHED

ROOT = Path(__file__).parent.parent
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power(value: float) -> str:
    """A power of ten as pages write it: 10⁻⁵."""
    exponent = round(log10(value))
    assert float(f"1e{exponent}") == value
    return f"10{str(exponent).translate(RAISED)}"


def percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


STATED = [
    ("concepts", f"fades below {drive.SLOW} rad/s"),
    ("concepts", f"that gap is at least {power(certificate.SMALLEST_GAP)}"),
    ("concepts", f"at least {power(certificate.SMALLEST_SINGULAR_VALUE)}, and the same"),
    ("concepts", f"near round-off, below {power(certificate.LARGEST_LEFTOVER)} of"),
    ("concepts", f"no more than round-off ({power(certificate.EXACT)} rad"),
    ("concepts", f"and more than {hold.LARGEST_SAMPLED_GAIN}"),
    ("concepts", f"in steps of at most {continuation.LARGEST_STEP} rad"),
    ("concepts", f"Mechanisms of more than {kernel.LARGEST_COMPILED} links run the same equations in Python"),
    ("compilation", f"routines of more than {llvm.LONGEST:,} operations are compiled in pieces"),
    ("compilation", f"Above {kernel.LARGEST_COMPILED} links nothing is compiled"),
    ("compilation", f"up to $2^{{{sine.DOUBLE.farthest.hex().rpartition('p+')[2]}}}$ rad"),
    ("compilation", f"{object_cache.LIMIT // 2**20} MiB are kept"),
    ("compilation", f"A process keeps its first {object_cache.MOST}."),
    ("export", f"more than {power(single_precision.OPEN)} m or rad"),
    ("export", f"it is refused above {exporting.MOST_STACK // 1024} kB"),
    ("export", f"whose loop takes more than {live_arm.MOST // 1000} kB"),
    ("discrete_adaptation", f"below $-{-ringing.ALARM}$ for {ringing.LASTING} ticks it marks `ringing`"),
    ("discrete_adaptation", f"below $-{-ringing.BRAKE}$ it brakes"),
    ("discrete_adaptation", f"moving averages over {ringing.SPAN} ticks"),
    ("simulation", f"more than {MANY:,}."),
    ("robots", f"more than {entries.MOST_LINKS} links that move, {entries.MOST_BODIES:,} bodies"),
    ("robots", f"{entries.MOST_GEOMS:,} geoms, {xml_elements.MOST_ELEMENTS:,} elements"),
    ("robots", f"elements {xml_elements.DEEPEST} deep"),
    ("robots", f"frames farther apart than 1e{log10(pose.LARGEST_LENGTH):.0f} m"),
    ("robots", f"beyond 1e{log10(xml_elements.LARGEST):.0f}"),
    ("robots", f"within {power(transforms.WITHIN)} rad of a multiple of 90°"),
    ("identification", f"at most {percent(choice.ALLOWED_MISFIT - 1.0)} more root mean square"),
    ("identification", f"the last {percent(HELD_OUT)} of the others"),
    ("identification", f"one filter of {choice.JUDGED_AT:.0f} Hz"),
    ("tuning", f"initial error $e_j$ ({carried_gains.LARGEST_ERROR} rad or m"),
    ("tuning", rf"${carried_gains.ACCELERATION_SHARE}\,\tau_j / M_{{jj}}$"),
    ("tuning", rf"$K_j \le {carried_gains.FIRST_SHARE}\,\tau_j"),
    ("tuning", f"{workable_reference.AMPLITUDE} rad. A joint that asks"),
    ("tuning", "One sinusoid a joint, {} to {} Hz".format(*workable_reference.FREQUENCIES)),
    ("tuning", f"at most {percent(workable_reference.HIGHEST)}. Where it still asks"),
    ("tuning", f"in up to {integrator.MOST} steps a period"),
    ("tuning", f"are run for {SEARCHED:.0f} s each"),
    ("tuning", f"links {percent(verification.LINKS_OFF)} off, and links otherwise"),
    ("tuning", f"of runs of {verification.DURATION:.0f} s"),
    ("tuning", f"no error passed {verification.ASTRAY:.0f} rad"),
    ("tuning", f"at most {percent(verification.CLIPPED)} of the second half"),
]


def test_stated_limits_are_those_of_the_code() -> None:
    texts = {page: (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") for page, _ in STATED}
    assert [(page, words) for page, words in STATED if words not in re.sub(r"\s+", " ", texts[page])] == []
