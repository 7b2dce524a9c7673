"""Which connections are feedback, and in which column each block stands. It has names and edges only."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from graphlib import TopologicalSorter

Edge = tuple[str, str]
Ranks = Mapping[str, tuple[int, bool, int]]
"""Steps from the nearest source, whether it is not a sum, index in the list: the smallest is entered first."""
MOST_TRIED = 12
"""Entries of a group of loops that are tried. Chosen: beyond these the picture hardly changes."""


def feedback(nodes: list[str], edges: list[Edge], joins: Collection[str], shown: Collection[str]) -> set[Edge]:
    """The edges to be drawn backwards, so that the rest has a direction.

    A group of loops is entered where it is fed from outside, and what leads back to that entry is
    feedback. Of several entries the one with fewest and shortest wires is taken; ``joins`` (sums)
    come first, and the blocks in ``shown`` (seen from outside) rather stand last.
    """
    found = {(u, v) for u, v in edges if u == v}
    rest = [e for e in edges if e not in found]
    rank = _ranks(nodes, rest, joins)
    for group in groups(nodes, rest):
        if len(group) > 1:
            choices = [_opened(group, rest, rank, entry) for entry in _entries(group, rest, rank)[:MOST_TRIED]]
            lengths = [_length(group, rest, back, shown) for back in choices]
            found |= choices[lengths.index(min(lengths))]
    return found


def _ranks(nodes: list[str], edges: list[Edge], joins: Collection[str]) -> Ranks:
    fed = {v for _, v in edges}
    steps = distances(successors(nodes, edges), [n for n in nodes if n not in fed])
    return {n: (steps.get(n, len(nodes)), n not in joins, k) for k, n in enumerate(nodes)}


def distances(after: Mapping[str, list[str]], starts: Iterable[str]) -> dict[str, int]:
    """Steps from the nearest of ``starts`` to each node that can be reached."""
    steps = dict.fromkeys(starts, 0)
    line = list(steps)
    for node in line:
        for other in after[node]:
            if other not in steps:
                steps[other] = steps[node] + 1
                line.append(other)
    return steps


def successors(nodes: Iterable[str], edges: Iterable[Edge]) -> dict[str, list[str]]:
    """Followers of each node, in order."""
    after: dict[str, list[str]] = {n: [] for n in nodes}
    for u, v in edges:
        after[u].append(v)
    return after


def _within(nodes: Iterable[str], edges: Iterable[Edge]) -> list[Edge]:
    inside = set(nodes)
    return [(u, v) for u, v in edges if u in inside and v in inside]


def groups(nodes: list[str], edges: Iterable[Edge]) -> list[list[str]]:
    """Strongly connected groups (nodes on common loops), each in the order of ``nodes``.

    Kosaraju's algorithm, with a stack of its own so that long chains do not end the recursion.
    """
    edges = _within(nodes, edges)
    after, before = successors(nodes, edges), successors(nodes, [(v, u) for u, v in edges])
    finished: list[str] = []
    seen = set[str]()
    for root in nodes:
        stack = [(root, iter(after[root]))] if root not in seen else []
        seen.add(root)
        while stack:
            node, followers = stack[-1]
            fresh = next((n for n in followers if n not in seen), None)
            if fresh is None:
                finished.append(stack.pop()[0])
            else:
                seen.add(fresh)
                stack.append((fresh, iter(after[fresh])))
    root_of: dict[str, str] = {}
    for root in reversed(finished):
        line = [root]
        while line:
            node = line.pop()
            if node not in root_of:
                root_of[node] = root
                line += before[node]
    found: dict[str, list[str]] = {}
    for node in nodes:
        found.setdefault(root_of[node], []).append(node)
    return list(found.values())


def _entries(group: list[str], edges: list[Edge], rank: Ranks) -> list[str]:
    inside = set(group)
    fed = {v for u, v in edges if v in inside and u not in inside}
    return sorted(fed or inside, key=rank.__getitem__)


def _opened(group: list[str], edges: list[Edge], rank: Ranks, entry: str) -> set[Edge]:
    """Edges that must go for the group to have no loop, when it is entered at ``entry``."""
    back = set[Edge]()
    edges = _within(group, edges)
    work = [(group, entry)]
    while work:
        part, first = work.pop()
        inside = _within(part, edges)
        back |= {(u, v) for u, v in inside if v == first}
        rest = [e for e in inside if e not in back]
        work += [(g, _entries(g, rest, rank)[0]) for g in groups(part, rest) if len(g) > 1]
    return back


def _length(group: list[str], edges: list[Edge], back: set[Edge], shown: Collection[str]) -> int:
    """How much wire there is when ``back`` is drawn backwards; a shown block that goes on costs extra."""
    inside = set(group)
    near = [e for e in edges if e not in back and (e[0] in inside or e[1] in inside)]
    column = columns(list(dict.fromkeys(n for e in near for n in e)), near)
    forward = {u for u, v in near if u in inside and v in inside}
    return sum(column[v] - column[u] for u, v in near) + 2 * len(back) + 2 * len(forward.intersection(shown))


def columns(
    nodes: list[str], edges: Iterable[Edge], first: Callable[[str], int] = lambda _: 0, fixed: Collection[str] = ()
) -> dict[str, int]:
    """The column of each node: one more than the last that feeds it, at least ``first(node)``.

    What has more followers than feeders then moves right as far as it can, unless ``fixed``.
    """
    edges = list(dict.fromkeys(edges))
    after, before = successors(nodes, edges), successors(nodes, [(v, u) for u, v in edges])
    sorter = TopologicalSorter(dict.fromkeys(nodes, ()))
    for u, v in edges:
        sorter.add(v, u)
    column: dict[str, int] = {}
    for node in sorter.static_order():
        column[node] = max([first(node), *(column[n] + 1 for n in before[node])])
    for node in reversed(column):
        if len(after[node]) > len(before[node]) and node not in fixed:
            column[node] = min(column[n] for n in after[node]) - 1
    return column
