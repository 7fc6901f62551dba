"""An identification as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from adaptctl.files import write_text
from adaptctl.identification import Identification
from adaptctl.recording.fact import Fact
from adaptctl.recording.identified.figures import drawings
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.trace import parameter_unit
from adaptctl.recording.units import torque_error_unit, typeset

HOME = "adaptctl.recording.identified"


def write_report(path: str | Path, found: Identification, figures: Mapping[str, Path]) -> None:
    """Write the report of an identification to the file `path`, whole or not at all: one HTML page that needs no other
    file. `figures` maps names of its drawings to PNG files, which go into the page; a drawing without a file is left
    out. Raises `FileError` where the page cannot be written, `OSError` where a PNG file cannot be read."""
    write_text(path, report(found, figures))


def report(found: Identification, figures: Mapping[str, Path]) -> str:
    """HTML, as text, of the report of an identification: outcome, errors of every joint, parameters with their
    deviations, figures. `figures` maps names of its drawings to PNG files, which go into the page; a drawing without a
    file is left out. Raises `OSError` where a PNG file cannot be read."""
    validation = found.validation
    joints = found.mechanism.primary_joints
    each = zip(joints, validation.joint_rms_errors, validation.joint_relative_errors, strict=True)
    return rendered(
        "report.html",
        HOME,
        found=found,
        validation=validation,
        verdict=verdict(found),
        facts=list(facts(found)),
        joints=[(j.name, f"{rms:.3g} {typeset(j.kind.effort_unit)}", f"{x:.1%}") for j, rms, x in each],
        consistency=consistency(found),
        parameters=list(_parameters(found)),
        loads=", ".join(f"{j.name} {x:.3f}" for j, x in zip(joints, found.load, strict=True) if x),
        equations=[str(equation) for equation in _equations(found)],
        components=components(found),
        unexcited=[c.words for c in found.unexcited],
        figures=embedded(drawings(found), figures),
    )


def verdict(found: Identification) -> str:
    """The outcome of an identification in a sentence: the root mean square error of the torques that it predicts, over
    all joints and over the rows of its validation. It is in "N·m", "N" where all joints are prismatic, or "N·m or N"
    where some are, and in percent of the measured torques. Nothing is raised."""
    validation = found.validation
    return (
        f"Predicts the torques of {validation.origin}, to {_rms_error(found)} over all joints, "
        f"{validation.relative_error:.1%} of what was measured."
    )


def _rms_error(found: Identification) -> str:
    return f"{found.validation.rms_error:.3g} {torque_error_unit(found.mechanism)}"


def consistency(found: Identification) -> str:
    """Sentences on whether rigid bodies can have an identification's parameters, with the names of links whose
    parameters no body can have, and on the cost of requiring it. The cost is by how many percent the root mean square
    torque residual of the fitted rows exceeds that of plain least squares. Nothing is raised."""
    wrong = found.mechanism.description.inconsistent_links
    cost = f"The training rows are fitted {found.misfit_ratio - 1.0:.1%} worse than by least squares without that."
    return (
        f"No body can have the parameters of {', '.join(wrong)}. {cost}"
        if wrong
        else (f"Every link is one that a rigid body can be, and the drives only take energy. {cost}")
    )


def components(found: Identification) -> str:
    """Sentence on model reduction (Sheu and Walker 1991, equation 23): how many of the essential components of an
    identification's inertial parameters, combinations of them that change energies, are enough to give the energy of
    the logs' motion to an error of 1 %. Nothing is raised."""
    return (
        f"Of the {found.space.rank} essential components of the parameters, {found.components} carry the energy of the "
        "logs' motion to 1 % (Sheu and Walker 1991, equation 23)."
    )


def facts(found: Identification) -> Iterator[Fact]:
    """Facts of an identification, each a `Fact`: a question that a reader asks first, and its answer in words, with
    units. They are the root mean square torque error over all joints ("N·m", "N" where all are prismatic, "N·m or N"
    where some are) and in percent of the measured torques, the number of fundamental (base) parameters, friction's
    terms, physical consistency, the number of combinations that the logs leave open, the weight (no unit) of the prior,
    the parameters in the robot's file, against the logs, and the filter's cut-off (Hz). Nothing is raised."""
    validation, settings = found.validation, found.choice.settings
    yield Fact("error on data not seen", _rms_error(found))
    yield Fact("of the measured torque", f"{validation.relative_error:.1%}")
    yield Fact("fundamental parameters", str(len(found.names)))
    yield Fact("friction", settings.friction.words.replace("_", " "))
    yield Fact("physically consistent", "no" if found.mechanism.description.inconsistent_links else "yes")
    yield Fact("combinations left open", str(len(found.unexcited)))
    yield Fact("weight of the prior", f"{settings.weight:g}")
    yield Fact("cut-off", f"{settings.cutoff:g} Hz")


def _parameters(found: Identification) -> Iterator[tuple[str, str, str, str]]:
    for name, value, deviation in zip(found.names, found.estimate, found.deviations, strict=True):
        yield name, typeset(parameter_unit(name, found.mechanism)), f"{value:.4g}", f"{deviation:.2g}"


def _equations(found: Identification) -> tuple[object, ...]:
    basis = found.model.basis
    return tuple(basis.equations()) if basis is not None else ()
