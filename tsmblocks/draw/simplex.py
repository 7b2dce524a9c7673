"""Integer positions that keep given distances and make the weighted sum of lengths smallest.

The network simplex of Gansner, Koutsofios, North and Vo, "A technique for drawing directed graphs"
(1993). It knows only numbers.
"""

from __future__ import annotations

import attrs


@attrs.frozen
class Rule:
    """``y[head] - y[tail]`` must be at least ``least``, and costs ``weight`` for each unit."""

    tail: int
    head: int
    least: int
    weight: int


def positions(count: int, rules: list[Rule], start: list[int], pivots: int = 4000) -> list[int]:
    """Positions that keep all rules at the smallest total cost, from a ``start`` that keeps them.

    Every node must be tied to node 0 by rules. After ``pivots`` exchanges the positions reached so
    far are returned; they keep the rules, and are only less good.
    """
    y = list(start)
    tree = _tight_tree(count, rules, y)
    pull = [0] * count  # cost of moving one node down by 1
    for rule in rules:
        pull[rule.head] += rule.weight
        pull[rule.tail] -= rule.weight
    for _ in range(pivots):
        order, via = _walk(count, rules, tree)
        total = list(pull)
        for node in reversed(order[1:]):
            total[_other(rules[via[node]], node)] += total[node]
        gains = [(total[n] if rules[via[n]].tail == n else -total[n], -n) for n in order[1:]]
        gain, node = max(gains, default=(0, 0))
        if gain <= 0:
            return y
        _exchange(rules, y, tree, via, order, -node)
    return y


def _other(rule: Rule, node: int) -> int:
    return rule.head if rule.tail == node else rule.tail


def _slack(rule: Rule, y: list[int]) -> int:
    return y[rule.head] - y[rule.tail] - rule.least


def _tight_tree(count: int, rules: list[Rule], y: list[int]) -> set[int]:
    """Rules without slack that span all nodes; ``y`` is shifted until there are enough."""
    touching: list[list[int]] = [[] for _ in range(count)]
    for k, rule in enumerate(rules):
        touching[rule.tail].append(k)
        touching[rule.head].append(k)
    tree, inside, fresh = set[int](), {0}, [0]
    open_rules = dict[int, None]()
    while True:
        while fresh:
            node = fresh.pop()
            for k in touching[node]:
                other = _other(rules[k], node)
                if other in inside:
                    open_rules.pop(k, None)
                elif _slack(rules[k], y) == 0:
                    tree.add(k)
                    inside.add(other)
                    fresh.append(other)
                else:
                    open_rules[k] = None
        open_rules = {k: None for k in open_rules if (rules[k].tail in inside) != (rules[k].head in inside)}
        if not open_rules:
            return tree
        nearest = min(open_rules, key=lambda k: (_slack(rules[k], y), k))
        shift = _slack(rules[nearest], y) * (1 if rules[nearest].head not in inside else -1)
        for node in inside:
            y[node] += shift
        fresh = [n for n in (rules[nearest].tail, rules[nearest].head) if n in inside]


def _walk(count: int, rules: list[Rule], tree: set[int]) -> tuple[list[int], list[int]]:
    """Nodes of the tree from node 0 on, parents first, and the rule by which each was reached."""
    touching: list[list[int]] = [[] for _ in range(count)]
    for k in sorted(tree):
        touching[rules[k].tail].append(k)
        touching[rules[k].head].append(k)
    order, via, seen = [0], [-1] * count, {0}
    for node in order:
        for k in touching[node]:
            other = _other(rules[k], node)
            if other not in seen:
                seen.add(other)
                via[other] = k
                order.append(other)
    return order, via


def _exchange(rules: list[Rule], y: list[int], tree: set[int], via: list[int], order: list[int], node: int) -> None:
    """Move the branch that hangs on ``node`` until another rule becomes tight, and hang it there."""
    branch = {node}
    for other in order:
        if via[other] >= 0 and _other(rules[via[other]], other) in branch and other != node:
            branch.add(other)
    down = rules[via[node]].head == node
    best, entering = None, -1
    for k, rule in enumerate(rules):
        leaves = (rule.tail in branch and rule.head not in branch) if down else (
            rule.head in branch and rule.tail not in branch)  # fmt: skip
        if leaves and (best is None or _slack(rule, y) < best):
            best, entering = _slack(rule, y), k
    for other in branch:
        y[other] += (best or 0) if down else -(best or 0)
    tree.remove(via[node])
    tree.add(entering)
