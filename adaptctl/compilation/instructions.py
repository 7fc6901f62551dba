"""The text of one native function's instructions."""

from __future__ import annotations

from adaptctl.compilation.lanes import Lanes


class Instructions:
    """LLVM instructions of one function's body, as lines of text: `memory` has those that set aside memory, which come
    first, and `lines` all others, in order. A register, and a value in memory, holds as many numbers as `lanes`, the
    `Lanes` (count and precision), has lanes. Nothing is checked."""

    def __init__(self, lanes: Lanes) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self.lanes = lanes

    def add(self, line: str) -> None:
        """Append an instruction, the text `line`, as it is. Nothing is checked."""
        self.lines.append(line)

    def reserve(self, name: str, size: int) -> str:
        """Append, to the attribute `memory`, the instruction that sets aside memory for `size` values, each of one
        number for each SIMD lane (arms computed at once). `name` is the LLVM pointer to it, such as "%spare", and is
        returned. Nothing is checked."""
        self.memory.append(f"{name} = alloca [{size} x {self.lanes.value}], align {max(self.lanes.alignment, 64)}")
        return name

    def load(self, name: str, pointer: str, k: int) -> str:
        """Append the instructions that load a value, one number for each SIMD lane (arms computed at once), into the
        LLVM register of the given `name`, such as "%x3". It is read at index `k`, counted in such values, after a
        `pointer`, a register's name. Returns `name`. Nothing is checked."""
        self.add(f"{name}.at = getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        self.add(f"{name} = load {self.lanes.value}, ptr {name}.at, align {self.lanes.size}")
        return name

    def broadcast(self, name: str, pointer: str, k: int) -> str:
        """Append the instructions that load one number into every SIMD lane (arms computed at once) of the LLVM
        register of the given `name`. It is read at index `k`, counted in single numbers, after a `pointer`, a
        register's name. Returns `name`. Nothing is checked."""
        value, scalar, n = self.lanes.value, self.lanes.scalar, self.lanes.count
        self.add(f"{name}.at = getelementptr {scalar}, ptr {pointer}, i64 {k}")
        self.add(f"{name}.one = load {scalar}, ptr {name}.at, align {self.lanes.size}")
        self.add(f"{name}.first = insertelement {value} poison, {scalar} {name}.one, i32 0")
        self.add(f"{name} = shufflevector {value} {name}.first, {value} poison, <{n} x i32> zeroinitializer")
        return name

    def store(self, pointer: str, k: int, value: str) -> None:
        """Append the instructions that write a `value`, one number for each SIMD lane (arms computed at once), given by
        a register's name or a constant's text, into memory. It is written at index `k`, counted in such values, after a
        `pointer`, another register's name. Nothing is checked."""
        self.add(f"{pointer}.{k} = getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        self.add(f"store {self.lanes.value} {value}, ptr {pointer}.{k}, align {self.lanes.size}")

    def clear(self, pointer: str, size: int) -> None:
        """Append the instruction that writes zeros into memory at a `pointer`, a register's name: `size` values, each
        of one number for each SIMD lane (arms computed at once). Nothing is checked."""
        self.add(f"call void @llvm.memset.p0.i64(ptr {pointer}, i8 0, i64 {size * self.lanes.alignment}, i1 false)")
