"""The text of one native function's instructions."""

from __future__ import annotations

from adaptctl.compilation.lanes import Lanes


class Instructions:
    """LLVM instructions of one function's body, as text: `memory` that is set aside first, then `lines`, in order.
    Numbers are in `lanes`, unless others are named."""

    def __init__(self, lanes: Lanes) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self.lanes = lanes

    def add(self, line: str) -> None:
        """Write an instruction."""
        self.lines.append(line)

    def reserve(self, name: str, size: int) -> str:
        """The name, as given, of a pointer to memory for `size` numbers."""
        lanes = self.lanes
        self.memory.append(f"{name} = alloca [{size} x {lanes.value}], align {max(lanes.alignment, 64)}")
        return name

    def load(self, name: str, pointer: str, k: int) -> str:
        """The name, as given, of the number in the k-th place after a pointer."""
        self.add(f"{name}.at = getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        self.add(f"{name} = load {self.lanes.value}, ptr {name}.at, align {self.lanes.size}")
        return name

    def store(self, pointer: str, k: int, value: str) -> None:
        """Write the store of a value into the k-th place after a pointer."""
        self.add(f"{pointer}.{k} = getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        self.add(f"store {self.lanes.value} {value}, ptr {pointer}.{k}, align {self.lanes.size}")
