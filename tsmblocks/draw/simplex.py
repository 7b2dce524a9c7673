"""Integer positions that keep given distances and make the weighted sum of lengths smallest.

The network simplex of Gansner, Koutsofios, North and Vo, "A technique for drawing directed graphs"
(1993). It works on numbers only.
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

    def other(self, node: int) -> int:
        """The other end."""
        return self.head if self.tail == node else self.tail

    def slack(self, y: list[int]) -> int:
        """How much the distance is longer than it must be."""
        return y[self.head] - y[self.tail] - self.least


def positions(count: int, rules: list[Rule], start: list[int], pivots: int = 4000) -> list[int]:
    """Positions that keep all rules at the smallest total cost, from a ``start`` that keeps them.

    Every node must be tied to node 0 by rules. After ``pivots`` exchanges the positions reached so
    far are returned; they keep the rules, and are not optimal.
    """
    y = list(start)
    tree_rules: list[set[int]] = [set() for _ in range(count)]
    for k in _tight_tree(count, rules, y):
        tree_rules[rules[k].tail].add(k)
        tree_rules[rules[k].head].add(k)
    own_cost = [0] * count  # cost of moving one node down by 1
    for rule in rules:
        own_cost[rule.head] += rule.weight
        own_cost[rule.tail] -= rule.weight
    for _ in range(pivots):
        order, reached_by = _walk(rules, tree_rules)
        branch_cost = list(own_cost)
        for node in reversed(order[1:]):
            branch_cost[rules[reached_by[node]].other(node)] += branch_cost[node]
        # Saving by moving the branch behind a node; -n prefers the node with the lowest number among equals.
        gains = [(branch_cost[n] if rules[reached_by[n]].tail == n else -branch_cost[n], -n) for n in order[1:]]
        gain, node = max(gains, default=(0, 0))
        if gain <= 0:
            return y
        branch = {-node}
        for n in order[1:]:  # parents come first
            if rules[reached_by[n]].other(n) in branch:
                branch.add(n)
        _exchange(rules, y, tree_rules, reached_by[-node], branch)
    return y


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
                other = rules[k].other(node)
                if other in inside:
                    open_rules.pop(k, None)
                elif rules[k].slack(y) == 0:
                    tree.add(k)
                    inside.add(other)
                    fresh.append(other)
                else:
                    open_rules[k] = None
        open_rules = {k: None for k in open_rules if (rules[k].tail in inside) != (rules[k].head in inside)}
        if not open_rules:
            return tree
        nearest = min(open_rules, key=lambda k: (rules[k].slack(y), k))
        shift = rules[nearest].slack(y) * (1 if rules[nearest].head not in inside else -1)
        for node in inside:
            y[node] += shift
        fresh = [n for n in (rules[nearest].tail, rules[nearest].head) if n in inside]


def _walk(rules: list[Rule], tree_rules: list[set[int]]) -> tuple[list[int], list[int]]:
    """Nodes of the tree from node 0 on, parents first, and the rule by which each was reached."""
    order, reached_by = [0], [-1] * len(tree_rules)
    for node in order:
        for k in sorted(tree_rules[node]):
            if k != reached_by[node]:
                other = rules[k].other(node)
                reached_by[other] = k
                order.append(other)
    return order, reached_by


def _exchange(rules: list[Rule], y: list[int], tree_rules: list[set[int]], leaving: int, branch: set[int]) -> None:
    """Move a branch of the tree, which hangs on the rule ``leaving``, until another is tight, and hang it there."""
    down = rules[leaving].head in branch
    crossing = [k for k, r in enumerate(rules) if (r.tail in branch) == down and (r.head in branch) != down]
    entering = min(crossing, key=lambda k: rules[k].slack(y))
    shift = rules[entering].slack(y) if down else -rules[entering].slack(y)
    for node in branch:
        y[node] += shift
    for end in (rules[leaving].tail, rules[leaving].head):
        tree_rules[end].remove(leaving)
    for end in (rules[entering].tail, rules[entering].head):
        tree_rules[end].add(entering)
