"""Texts of a C package."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jinja2
import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.codegen.c_function import CNumber, Kind, sine_source
from adaptctl.codegen.c_program import CProgram, Signature, helpers
from adaptctl.codegen.closed_loop_check import RecordedTick, first_torque
from adaptctl.codegen.gain_rules import GainRule, gain_rules
from adaptctl.codegen.initialisation import start_of
from adaptctl.codegen.interface import ARGUMENTS, Brake, Field, Interface, status_bits
from adaptctl.compilation.graph import Op
from adaptctl.compilation.sine import sine_for
from adaptctl.dynamics.loops.continuation import MAX_LOST_GAP
from adaptctl.dynamics.loops.single_precision import MAX_CLOSURE_GAP
from adaptctl.version import __version__

SPDX = "BSD-3-Clause"
TOLERANCE: Mapping[Kind, float] = {"double": 1e-11, "float": 1e-3}
"""of test vectors, relative to the largest torque, for fused operations or single precision"""
BRAKING = "damping within the torque limits, or 0 for a joint without a valid speed, damping and limit"
"""words for the torque of a brake"""


class CPackage:
    """C package of a controller."""

    def __init__(self, interface: Interface, name: str, kind: Kind) -> None:
        self.interface, self.name, self.kind = interface, name, kind
        self.number = CNumber(kind, interface.names_of_constants())
        self.start = start_of(interface, MAX_LOST_GAP if kind == "double" else MAX_CLOSURE_GAP)
        self.program = CProgram(name, self.number)
        self.memory = tuple(field for field in interface.memory if field.size)
        self.stack = 0

    def files(self, ticks: Sequence[RecordedTick], last_state: Any) -> dict[str, str]:
        """Contents of the C files by name."""
        estimate = self.interface.estimate
        leaves = dict(zip((f.name for f in self.interface.memory), self.interface.memory_of(last_state), strict=True))
        recorded = {
            "ticks": [self._tick(tick) for tick in ticks],
            "start": self._array(ticks[0].p),
            "tolerance": f"{TOLERANCE[self.kind]:g}",
            "last_estimate": self._plain(leaves[estimate.name]) if estimate else "",
        }
        if self.interface.applied:
            held = 0.5 * ticks[-1].torque
            recorded |= {
                "held": self._array(held),
                "from_held": self._plain(first_torque(self.interface, ticks[0], held)),
            }
        return {
            f"{self.name}.h": self.filled("controller.h"),
            f"{self.name}.c": self.filled("controller.c"),
            f"{self.name}.hpp": self.filled("controller.hpp"),
            "CMakeLists.txt": self.filled("CMakeLists.txt"),
            f"test_{self.name}.c": self.filled("test.c"),
            "vectors.h": self.filled("vectors.h", **recorded),
            "example.c": self.filled("example.c", center=self._array(np.asarray(ticks[0].reference.p))),
        }

    @cached_property
    def functions(self) -> str:
        """C functions of the law and the initial state."""
        name, start = self.name, self.start
        law = self.program.source(self.interface.law, self._law_signature())
        texts, self.stack = [law.text], law.stack
        on_arrays = {} if start.more is None else {"started": (start.more, ["q"])}
        if start.walk is not None:
            on_arrays |= {"closed": (start.walk.step, ["p", "q"]), "regular": (start.walk.regular, ["q"])}
        for what, (routine, given) in on_arrays.items():
            signature = self.program.on_arrays(routine, f"{name}_{what}", given)
            texts.append(self.program.source(routine, signature).text)
        helping = [helpers(name, self.program.operations)]
        if self.program.operations & {Op.SIN, Op.COS}:
            helping.insert(0, sine_source(name, self.number))
        return "\n".join([*(text for text in helping if text), *texts])

    @cached_property
    def hash(self) -> str:
        """First 16 digits of a SHA-256 of functions, state and flags."""
        starts = [field.name + str(field.dimensions) + self._array(field.values) for field in self.memory]
        text = "\n".join([self.functions, *starts, str(self.interface.flags), str(self.start.configurations)])
        return hashlib.sha256(text.encode()).hexdigest()[:16].upper()

    @cached_property
    def rules(self) -> tuple[GainRule, ...]:
        """Rules for the gains, in their order."""
        return gain_rules(self.interface.controller, self.interface.gains)

    @property
    def state_bytes(self) -> int:
        """Size in bytes of one arm's state in C."""
        numbers = max(sum(field.size for field in self.memory), 1)
        return 16 + -(-2 * numbers * self.number.size // 8) * 8

    @cached_property
    def _content(self) -> dict[str, Any]:
        interface, law = self.interface, self.interface.controller
        fields, flags = interface.memory, interface.flags
        return {
            "name": self.name,
            "P": self.name.upper(),
            "title": title(interface),
            "version": __version__,
            "spdx": SPDX,
            "scalar": self.kind,
            "suffix": self.number.suffix,
            "zero": self.number.constant(0.0),
            "constant": self.number.constant,
            "values": self._values,
            "bits_type": f"uint{8 * self.number.size}_t",
            "exponent": "UINT64_C(0x7FF0000000000000)" if self.kind == "double" else "UINT32_C(0x7F800000)",
            "exponent_one": "UINT64_C(0x0010000000000000)" if self.kind == "double" else "UINT32_C(0x00800000)",
            "last_bit": 8 * self.number.size - 1,
            "joints": interface.joints,
            "reference_size": law.reference_size,
            "reference_in_joints": interface.follows_joints,
            "period": repr(interface.control_period),
            "hash": self.hash,
            "bits": status_bits(interface),
            "memory": self.memory,
            "gains": interface.gains,
            "estimate": interface.estimate,
            "guarded": interface.guarded,
            "applied": interface.applied,
            "brake": interface.brake and self._brake(interface.brake),
            "brake_text": BRAKING if interface.brake else "zero",
            "flags": list(map(_Mark, (f.name for f in fields[len(fields) - len(flags) :]), map(str.upper, flags))),
            "configurations": [fields[k] for k in self.start.configurations],
            "computed": [fields[k] for k in self.start.computed],
            "more": self.start.more,
            "walk": self._walk(),
            "functions": self.functions,
            "rules": [self._told_rule(rule) for rule in self.rules],
        }

    def filled(self, template: str, **more: Any) -> str:
        """Text of a template filled for this controller."""
        return filled(template, **self._content, **more)

    def _walk(self) -> dict[str, Any] | None:
        walk = self.start.walk
        if walk is None:
            return None
        return {"home": walk.home, "home_text": self._array(walk.home), "primary": walk.primary, "looped": walk.looped}

    def _brake(self, brake: Brake) -> list[dict[str, Any]]:
        """Numbers of the brake: gains in force where the law reads them, else constants."""
        given = {field.name for field in self.interface.gains}
        rows = (("stop_damping", "damping", brake.damping), ("torque_limits", "most", brake.limit))
        return [
            {"name": name, "short": short, "told": Field(name, values), "tunable": name in given}
            for name, short, values in rows
        ]

    def _told_rule(self, rule: GainRule) -> dict[str, Any]:
        first = rule.field.place(0)
        return {
            "field": rule.field,
            "pointer": f"&gains->{first}",
            "sign": ">" if rule.positive else "" if rule.signed else ">=",
            "infinite": rule.infinite,
            "most": None if rule.most is None else self._array(rule.most.ravel()),
            "bounds": rule.bounds,
        }

    def _law_signature(self) -> Signature:
        """Signature of the law on the C structures."""
        name, restrict = self.name, f"{self.name.upper()}_RESTRICT"
        fields, gains = self.interface.memory, _gain_places(self.interface.all_gains)
        parameters = (
            f"const {name}_memory *{restrict} memory", f"const {name}_gains *{restrict} gains",
            f"const {name}_real *{restrict} p", f"const {name}_real *{restrict} v",
            f"const {name}_reference *{restrict} reference", f"{name}_memory *{restrict} next",
            f"{name}_real *{restrict} torque",
        )  # fmt: skip

        def given(part: int, k: int) -> str:
            if part < 2:
                return f"{'pv'[part]}[{k}]"
            if part < 5:
                return f"reference->{'pva'[part - 2]}[{k}]"
            if part < 5 + len(fields):
                return f"memory->{fields[part - 5].place(k)}"
            return f"gains->{gains[k]}"

        def place(part: int, k: int) -> str:
            return f"torque[{k}]" if part == 0 else f"next->{fields[part - 1].place(k)}"

        def before(part: int, k: int) -> tuple[int, int] | None:
            return (part + len(ARGUMENTS) - 1, k) if part else None

        return Signature(f"{name}_law", parameters, given, place, before)

    def _values(self, field: Field) -> str:
        if not field.values.shape:
            return self.number.constant(float(field.values))
        flat = field.values.ravel().tolist()
        texts = [f"{self.number.constant(x)}{_comment(field.label(k))}" for k, x in enumerate(flat)]
        if field.values.ndim == 1:
            return "{ " + ", ".join(texts) + " }"
        width = field.values.shape[-1]
        rows = ["{ " + ", ".join(texts[k : k + width]) + " }" for k in range(0, len(texts), width)]
        return "{ " + ", ".join(rows) + " }"

    def _array(self, values: Array) -> str:
        return "{ " + ", ".join(map(self.number.constant, np.ravel(values).tolist())) + " }"

    def _plain(self, values: Array) -> str:
        return "{ " + ", ".join(map(CNumber("double", {}).constant, np.ravel(values).tolist())) + " }"

    def _tick(self, tick: RecordedTick) -> dict[str, Any]:
        return {
            "p": self._array(tick.p),
            "v": self._array(tick.v),
            "reference": [self._array(part) for part in tick.reference],
            "torque": self._plain(tick.torque),
            "status": tick.status,
        }


class _Mark(NamedTuple):
    field: str
    bit: str


def title(interface: Interface) -> str:
    """Title such as "SlotineLi, guarded for puma560, every 0.001 s"."""
    law = type(interface.innermost).__name__ + (", with safety limits" if interface.guarded else "")
    arm = interface.mechanism.name if interface.mechanism else f"{interface.controller.dof} joints"
    printable = "".join(c if c.isprintable() and c not in "*/\\" else " " for c in arm)
    return f"{law} for {printable}, every {interface.control_period:g} s"


def filled(template: str, **content: object) -> str:
    """Text of a template filled with variables."""
    return _environment().get_template(f"{template}.jinja").render(**content)


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("adaptctl.codegen", "templates"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # C, not HTML
    )


def _comment(label: str) -> str:
    return f" /* {label} */" if label else ""


def _gain_places(fields: Iterable[Field]) -> list[str]:
    """C texts of the law's gains."""
    return [field.place(k) for field in fields for k in range(field.size)]


def readme(package: CPackage) -> str:
    """README, in Markdown, of an exported C `package`."""
    return package.filled(
        "README.md",
        flops=package.interface.law.operations.flops,
        state_bytes=package.state_bytes,
        stack=package.stack,
        far=f"{sine_for(package.number.precision).farthest:.0f}",
    )
