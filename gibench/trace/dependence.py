"""Which loads wait for which: a kernel's loads and the values that blocks hand on.

Nodes are the accesses of the tables (a of them) and, behind them, the phis through which loaded
values reach other blocks. What lies between them (arithmetic) costs nothing here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gibench.arrays import Longs

_NAME = r'%(?:"[^"]*"|[\w.$-]+)'
_RESULT = re.compile(rf"^\s*({_NAME}) = ")
_PHI_PAIR = re.compile(rf"\[ ([^,\]]+), ({_NAME}) \]")
_LABELS = re.compile(rf"label {_NAME}")


class Chains(NamedTuple):
    """The graph, as arrays that compiled code reads; lists of nodes lie in ``nodes``.

    Attributes:
        nodes: all lists, one behind another.
        address: where the list of what an access's address waits for begins, and its length (a, 2).
        batch: which of its block's batches a load belongs to (a,): loads of a batch are under way
            together.
        phis: where a block's ways into its phis begin, and behind them (b + 1,).
        phi_node: of every way, the phi.
        phi_from: of every way, the block that is left.
        phi_value: where the list of what the value waits for begins, and its length (ways, 2).
        control: of every block, what its branch waits for: begin and length (b, 2).
        barrier: whether a block has a barrier (b,).
        fence: barriers of its block that come before an access (a,).
        size: number of nodes, one entry.
    """

    nodes: Longs
    address: Longs
    batch: Longs
    phis: Longs
    phi_node: Longs
    phi_from: Longs
    phi_value: Longs
    control: Longs
    barrier: npt.NDArray[np.bool_]
    fence: Longs
    size: Longs


@dataclass
class BlockLines:
    """A block's instructions in order, each with the numbers of its accesses that load."""

    label: str
    lines: list[tuple[str, tuple[int, ...]]] = field(default_factory=list)


@dataclass
class _Graph:
    """What every value is made from: nodes, or other values."""

    loads: dict[str, tuple[int, ...]] = field(default_factory=dict)
    phis: dict[str, int] = field(default_factory=dict)
    made_from: dict[str, tuple[str, ...]] = field(default_factory=dict)
    known: dict[str, frozenset[int]] = field(default_factory=dict)

    def nodes_of(self, names: Iterable[str]) -> frozenset[int]:
        """The nodes that values wait for."""
        return frozenset().union(*(self._node(name) for name in names))

    def _node(self, name: str) -> frozenset[int]:
        stack = [name]
        while stack:
            top = stack[-1]
            if top in self.known:
                stack.pop()
            elif top in self.loads:
                self.known[top] = frozenset(self.loads[top])
            elif top in self.phis:
                self.known[top] = frozenset((self.phis[top],))
            else:
                parts = self.made_from.get(top, ())
                missing = [part for part in parts if part not in self.known]
                if missing:
                    stack += missing
                else:
                    self.known[top] = frozenset().union(*(self.known[part] for part in parts))
        return self.known[name]


def chains_of(blocks: Sequence[BlockLines], accesses: int) -> Chains:
    """The graph of a kernel.

    Args:
        blocks: in the tables' order.
        accesses: number of accesses of all of them.
    """
    places = {block.label: number for number, block in enumerate(blocks)}
    graph = _Graph()
    ways: list[list[tuple[str, int, str]]] = [[] for _ in blocks]
    for number, block in enumerate(blocks):
        for line, loads in block.lines:
            result = _RESULT.match(line)
            if result is None:
                continue
            name = result[1]
            if " = phi " in line:
                graph.phis[name] = accesses + len(graph.phis)
                for value, label in _PHI_PAIR.findall(line):
                    ways[number].append((name, places[label[1:].strip('"')], value.strip()))
            elif loads:
                graph.loads[name] = loads
            else:
                graph.made_from[name] = _operands(line[result.end() :])
    return _packed(blocks, graph, ways, accesses)


def _operands(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(re.findall(_NAME, _LABELS.sub("", text))))


def _packed(
    blocks: Sequence[BlockLines],
    graph: _Graph,
    ways: Sequence[Sequence[tuple[str, int, str]]],
    accesses: int,
) -> Chains:
    nodes: list[int] = []

    def put(found: Iterable[int]) -> tuple[int, int]:
        start = len(nodes)
        nodes.extend(sorted(found))
        return start, len(nodes) - start

    address = np.zeros((accesses, 2), np.int64)
    batch = np.zeros(accesses, np.int64)
    control = np.zeros((len(blocks), 2), np.int64)
    barrier = np.zeros(len(blocks), np.bool_)
    fence = np.zeros(accesses, np.int64)
    phis, phi_node, phi_from, phi_value = [0], [], [], []
    for number, block in enumerate(blocks):
        for name, left, value in ways[number]:
            phi_node.append(graph.phis[name])
            phi_from.append(left)
            phi_value.append(put(graph.nodes_of((value,)) if value.startswith("%") else ()))
        phis.append(len(phi_node))
        _levels(block, graph, batch)
        barriers = 0
        for line, loads in block.lines:
            barriers += "@pocl.barrier(" in line
            result = _RESULT.match(line)
            if loads:
                operands = _operands(line[result.end() :] if result else line)
                start = put(graph.nodes_of(operands))
                for access in loads:
                    address[access] = start
                    fence[access] = barriers
            if line.lstrip().startswith(("br i1", "switch ")):
                control[number] = put(graph.nodes_of(_operands(line)))
        barrier[number] = barriers > 0
    return Chains(
        nodes=np.array(nodes, np.int64),
        address=address,
        batch=batch,
        phis=np.array(phis, np.int64),
        phi_node=np.array(phi_node, np.int64),
        phi_from=np.array(phi_from, np.int64),
        phi_value=np.array(phi_value, np.int64).reshape(-1, 2),
        control=control,
        barrier=barrier,
        fence=fence,
        size=np.array([accesses + len(graph.phis)], np.int64),
    )


def _levels(block: BlockLines, graph: _Graph, batch: Longs) -> None:
    """Number a block's loads by the batch that they are under way with: a load is one batch behind
    those of its block that its address needs, and behind a barrier; a compiler brings the others
    forward.
    """
    mine: dict[int, int] = {}
    least = 0
    for line, loads in block.lines:
        if "@pocl.barrier(" in line:
            least = max(mine.values(), default=-1) + 1
        if loads:
            result = _RESULT.match(line)
            needs = graph.nodes_of(_operands(line[result.end() :] if result else line))
            level = max([least, *(mine[node] + 1 for node in needs if node in mine)])
            for access in loads:
                mine[access] = batch[access] = level
