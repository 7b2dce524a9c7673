"""Which connections are feedback, and in which column each block stands. It has names and edges only."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

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
        if len(group) == 1:
            continue
        choices: list[tuple[int, int, set[Edge]]] = []
        for entry in _entries(group, rest, rank)[:MOST_TRIED]:
            back = _opened(group, rest, rank, entry)
            choices.append((_length(group, rest, back, shown), len(choices), back))
        found |= min(choices)[2]
    return found


def _ranks(nodes: list[str], edges: list[Edge], joins: Collection[str]) -> Ranks:
    after = successors(nodes, edges)
    fed = {v for _, v in edges}
    steps = {n: 0 for n in nodes if n not in fed}
    line = list(steps)
    for node in line:
        for other in after[node]:
            if other not in steps:
                steps[other] = steps[node] + 1
                line.append(other)
    return {n: (steps.get(n, len(nodes)), n not in joins, k) for k, n in enumerate(nodes)}


def successors(nodes: Iterable[str], edges: Iterable[Edge]) -> dict[str, list[str]]:
    """Followers of each node, in order."""
    after: dict[str, list[str]] = {n: [] for n in nodes}
    for u, v in edges:
        after[u].append(v)
    return after


def groups(nodes: list[str], edges: Iterable[Edge]) -> list[list[str]]:
    """Strongly connected groups (nodes on common loops), each in the order of ``nodes``.

    Kosaraju's algorithm, with a stack of its own so that long chains do not end the recursion.
    """
    inside = set(nodes)
    edges = [(u, v) for u, v in edges if u in inside and v in inside]
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
    place = {n: k for k, n in enumerate(nodes)}
    found, taken = [], set[str]()
    for root in reversed(finished):
        group, line = [], [root]
        while line:
            node = line.pop()
            if node not in taken:
                taken.add(node)
                group.append(node)
                line += before[node]
        if group:
            found.append(sorted(group, key=place.__getitem__))
    return found


def _entries(group: list[str], edges: list[Edge], rank: Ranks) -> list[str]:
    inside = set(group)
    fed = {v for u, v in edges if v in inside and u not in inside}
    return sorted(fed or inside, key=rank.__getitem__)


def _opened(group: list[str], edges: list[Edge], rank: Ranks, entry: str) -> set[Edge]:
    """Edges that must go for the group to have no loop, when it is entered at ``entry``."""
    back = set[Edge]()
    inside = set(group)
    edges = [(u, v) for u, v in edges if u in inside and v in inside]
    work = [(group, entry)]
    while work:
        part, first = work.pop()
        members = set(part)
        back |= {(u, v) for u, v in edges if v == first and u in members}
        rest = [e for e in edges if e not in back and e[0] in members and e[1] in members]
        work += [(g, _entries(g, rest, rank)[0]) for g in groups(part, rest) if len(g) > 1]
    return back


def _length(group: list[str], edges: list[Edge], back: set[Edge], shown: Collection[str]) -> int:
    """How much wire there is when ``back`` is drawn backwards; a shown block that goes on costs extra."""
    inside = set(group)
    near = [e for e in edges if e not in back and (e[0] in inside or e[1] in inside)]
    nodes = list(dict.fromkeys(n for e in near for n in e))
    column = columns(nodes, near)
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
    waiting = {n: len(before[n]) for n in nodes}
    line = [n for n in nodes if not waiting[n]]
    column: dict[str, int] = {}
    for node in line:
        column[node] = max([first(node), *(column[n] + 1 for n in before[node])])
        for other in after[node]:
            waiting[other] -= 1
            if not waiting[other]:
                line.append(other)
    for node in reversed(line):
        if len(after[node]) > len(before[node]) and node not in fixed:
            column[node] = min(column[n] for n in after[node]) - 1
    return column
