"""Wires: pins, feedback channels below or between the blocks, tracks between the columns, and all x coordinates."""

from __future__ import annotations

import math

import attrs

from tsmblocks.draw.graph import End, Graph, Loop, Net
from tsmblocks.draw.ordering import FLOOR, LOW, Link, Rows
from tsmblocks.draw.picture import GRID, RADIUS, SMALL, Arrow, text_width
from tsmblocks.draw.polylines import Piece
from tsmblocks.draw.shapes import BELOW, Outlines
from tsmblocks.draw.tracks import Trunk, arrange

BEFORE, AFTER, TRACK, PLAIN = 14, 22, 12, 40
"""Room left of the vertical wires of a gap, right of them, between two; width of a gap without any [pixels]."""

LANE = GRID
"""Distance from the middle of a circle at which each of two wires enters it from below [pixels]."""

Span = tuple[float, float]


@attrs.define(eq=False)
class Channel:
    """One feedback below its blocks: its height, the gaps between which it runs, and its blocks' columns.

    ``above`` and ``below`` are the room that the blocks in it take.
    """

    loop: Loop
    right: int
    left: int
    columns: tuple[int, ...]
    above: float
    below: float
    y: float = 0.0

    def meets(self, other: Channel) -> bool:
        """Whether both run below one column, or turn in one gap."""
        return other.left <= self.right and self.left <= other.right

    def fits(self, y: float, taken: list[Span]) -> bool:
        """Whether it keeps clear, at a height, of the heights that are taken."""
        up, down = max(GRID, self.above), GRID + self.below
        return all(high <= y - up or y + down <= low for low, high in taken)


@attrs.define(eq=False)
class Plan:
    """The state of the routing of a drawing: heights come first, then tracks, then x."""

    graph: Graph
    rows: Rows
    outlines: Outlines
    y: dict[str, float]
    channels: list[Channel] = attrs.field(factory=list)
    pin: dict[End, float] = attrs.field(factory=dict)
    rising: set[End] = attrs.field(factory=set)
    taken: dict[int, list[tuple[str, float, float]]] = attrs.field(factory=dict)
    trunks: list[list[Trunk]] = attrs.field(factory=list)
    x: dict[str, float] = attrs.field(factory=dict)
    cuts: list[float] = attrs.field(factory=list)
    track_x: list[list[float]] = attrs.field(factory=list)
    pieces: dict[Net, list[Piece]] = attrs.field(factory=dict)
    arrows: dict[Net, list[Arrow]] = attrs.field(factory=dict)

    def span(self, key: str) -> Span:
        """Heights that a key takes in its column."""
        size = self.outlines.size(key)
        return self.y[key] - size.above, self.y[key] + size.below

    def leaves(self, end: End) -> float:
        """Height at which a wire leaves a port, or goes on."""
        return self.y[end[0]] + self.outlines.offset(end, "out")

    def side(self, end: End) -> str:
        """The side on which a wire enters a port."""
        node = self.graph.nodes.get(end[0])
        return self.outlines.sides.get(end, "left") if node is not None and node.round else "left"

    def tracks(self, gap: int, net: Net) -> list[tuple[Trunk, float]]:
        """The vertical wires of a signal in a gap, with their x."""
        return [(t, self.track_x[gap][t.track]) for t in self.trunks[gap] if t.owner is net]


def routed(plan: Plan) -> Plan:
    """The plan with all coordinates and wires filled in."""
    _pins(plan, fed_back=False)
    _channels(plan)
    _pins(plan, fed_back=True)
    _lanes(plan)
    levels = [c.y for c in plan.channels]
    plan.trunks = [arrange(_trunks(plan, gap), levels) for gap in range(len(plan.rows.gaps))]
    _columns(plan)
    for net in plan.graph.nets:
        plan.pieces[net], plan.arrows[net] = [], []
    for gap, links in enumerate(plan.rows.gaps):
        _lead(plan, gap, links)
    for channel in plan.channels:
        _lead_back(plan, channel)
    return plan


# ---- heights


def _channels(plan: Plan) -> None:
    """Lead each feedback close below its own blocks where there is room, else below the columns it spans.

    Short ones come first, above long ones.
    """
    channels = sorted((_channel(plan, loop) for loop in plan.graph.loops), key=lambda c: (c.right - c.left, c.left))
    spans = [_spans(plan, column) for column in range(len(plan.rows.columns))]
    for channel in channels:
        blocks = [span for column in spans[channel.left : channel.right] for span in column]
        met = blocks + [(c.y - c.above, c.y + c.below) for c in plan.channels if c.meets(channel)]
        floor = _up(max(high for _, high in met)) + max(2 * GRID, channel.above)
        lowest = max(low for low, _ in blocks)
        ends = [channel.loop.nets[0].source, *channel.loop.nets[-1].back]
        highest = int(_up(max(plan.span(key)[1] for key, _ in ends))) + GRID
        heights = map(float, range(highest, int(lowest), GRID))  # below the blocks that it leaves and enters
        channel.y = next((y for y in heights if channel.fits(y, met)), floor)
        plan.channels.append(channel)


def _channel(plan: Plan, loop: Loop) -> Channel:
    """A feedback with its blocks spread over the columns it runs below, from right to left; not yet its height."""
    right = plan.graph.column[loop.nets[0].source[0]] + 1
    left = min(plan.graph.column[key] for key, _ in loop.nets[-1].back)
    count = len(loop.blocks)
    free = range(left + 1 if right - left > count else left, right)
    columns = tuple(free[len(free) * (2 * k + 1) // (2 * count)] for k in reversed(range(count)))
    sizes = [plan.outlines.size(key) for key in loop.blocks]
    above, below = max([0.0, *(_up(s.above) for s in sizes)]), max([0.0, *(s.below for s in sizes)])
    return Channel(loop, right, left, columns, above, below)


def _up(value: float) -> float:
    """The next line of the grid."""
    return -(-value // GRID) * GRID


def _spans(plan: Plan, column: int) -> list[Span]:
    """Heights taken in a column: by its blocks, and by wires that pass it or enter it."""
    pins = [plan.pin[a.right] for a in plan.rows.gaps[column] if a.right in plan.pin]
    return [*map(plan.span, plan.rows.columns[column]), *zip(pins, pins, strict=True), (0.0, 0.0)]


def _pins(plan: Plan, fed_back: bool) -> None:
    """Heights at which wires enter the columns; a circle is entered from as high or low as its wire comes.

    Wires ahead come first, since the channels of the feedback are led below them.
    """
    for column, links in enumerate(plan.rows.gaps[:-1]):
        for link in links:
            end, middle = link.right, plan.y.get(link.right[0], 0.0)
            if end[0] == FLOOR or (link.left[0] == FLOOR) != fed_back:
                continue
            plan.pin[end] = middle + plan.outlines.offset(end, "in")
            side = plan.side(end)
            if side == "left":
                continue
            start = _floor(plan, link) if fed_back else plan.leaves(link.left)
            beyond = start <= plan.pin[end] if side == "top" else start >= plan.pin[end]
            reach = (min(start, middle), max(start, middle))
            if beyond and _is_clear(plan, column, end[0], reach):
                plan.taken.setdefault(column, []).append((end[0], *reach))
                plan.pin[end] = start
                if fed_back:
                    plan.rising.add(end)


def _lanes(plan: Plan) -> None:
    """Where two feedbacks enter a circle from below: the one that comes from further right enters on the right."""
    for node in plan.graph.nodes.values():
        pair = [(node.key, port) for port in node.ins if plan.outlines.sides.get((node.key, port)) in BELOW]
        if len(pair) == 2:
            # Rising wires come from the right, the higher first; others come from the left, the lower first.
            pair.sort(key=lambda end: plan.pin[end] if end in plan.rising else LOW - plan.pin[end])
            plan.outlines.lanes.update(zip(pair, (LANE, -LANE), strict=True))


def _floor(plan: Plan, link: Link) -> float:
    """Height of the channel by which a feedback link comes."""
    return next(c.y for c in plan.channels if c.loop.nets[-1] is link.net and link.right in link.net.back)


def _is_clear(plan: Plan, column: int, key: str, reach: Span) -> bool:
    """Whether a wire may run up or down the middle of a column to the circle ``key``."""
    low, high = reach
    for other in plan.rows.columns[column]:
        top, bottom = plan.span(other)
        if plan.y[other] in reach if other.startswith("~") else other != key and low < bottom and top < high:
            return False
    seated = any(column in c.columns and c.y <= high for c in plan.channels)
    return not seated and all(k == key or high <= a or b <= low for k, a, b in plan.taken.get(column, ()))


def _trunks(plan: Plan, gap: int) -> list[Trunk]:
    """The vertical wires that the signals need in a gap."""
    found: dict[Net, Trunk] = {}
    for link in plan.rows.gaps[gap]:
        if link.right in plan.rising and link.left[0] == FLOOR:
            continue
        trunk = found.setdefault(link.net, Trunk(link.net, [], []))
        if link.left[0] != FLOOR and not trunk.left:
            trunk.left.append(plan.leaves(link.left))
        if link.right[0] != FLOOR:
            trunk.right.append(plan.pin[link.right])
    for channel in plan.channels:
        first, last = channel.loop.nets[0], channel.loop.nets[-1]
        if channel.right == gap:
            found[first].left.append(channel.y)
        if any(plan.graph.column[k] == gap and (k, p) not in plan.rising for k, p in last.back):
            found[last].right.append(channel.y)
    return list(found.values())


# ---- widths


def note(net: Net) -> str:
    """The text on a wire: the outputs read off it, and its value."""
    names = ", ".join(net.outputs) if net.tapped else ""
    return " = ".join(filter(None, (names, net.note)))


def _label_room(net: Net) -> float:
    """Width of the text on a wire behind its source."""
    text = note(net)
    return text_width(text, SMALL) + (20 if net.tapped else 12) if text else 0.0


def _columns(plan: Plan) -> None:
    """Find x of columns, nodes and tracks, from left to right."""
    x = 0.0
    for gap, trunks in enumerate(plan.trunks):
        count = max((t.track + 1 for t in trunks), default=0)
        before = [net for net in plan.graph.nets if plan.graph.column.get(net.source[0]) == gap - 1]
        labels = [_right_edge(plan, net.source[0]) + _label_room(net) - x for net in before]
        x += max([BEFORE if gap else 0.0, *labels])
        if 0 < gap < len(plan.rows.columns):
            plan.cuts.append(x - BEFORE / 4)  # here are nothing but wires that run across
        plan.track_x.append([x + TRACK * k for k in range(count)])
        if gap < len(plan.rows.columns):
            x += TRACK * max(count - 1, 0)
            x = _column(plan, gap, x + (AFTER if count else PLAIN - BEFORE if gap else 0))


def _column(plan: Plan, column: int, x: float) -> float:
    """Place one column from ``x`` on; its right edge."""
    keys = plan.rows.columns[column]
    pairs = [pair for c in plan.channels for pair in zip(c.loop.blocks, c.columns, strict=True)]
    seated = [key for key, place in pairs if place == column]
    leaving = {net.source[0]: net for net in reversed(plan.graph.nets)}
    half = [plan.outlines.size(key).left + _label_room(leaving[key]) for key in seated]
    left = max([plan.outlines.size(key).left for key in keys] + half, default=0.0)
    right = max([plan.outlines.size(key).right for key in keys] + half, default=0.0)
    for key in (*keys, *seated):
        plan.x[key] = x + left
        if key in plan.graph.nodes and plan.graph.nodes[key].shape == "terminal":
            plan.x[key] = x + left + right - 4 if key.startswith(">") else x + 4
    return x + left + right


# ---- wires


def _right_edge(plan: Plan, key: str) -> float:
    return plan.x[key] + plan.outlines.size(key).width / 2


def _lead(plan: Plan, gap: int, links: list[Link]) -> None:
    """Draw what the links of one gap need between its two columns."""
    for net in dict.fromkeys(link.net for link in links):
        trunks, pieces = plan.tracks(gap, net), plan.pieces[net]
        mine = [link for link in links if link.net is net]
        for trunk, x in trunks:
            pieces.append((x, trunk.low, x, trunk.high))
        if len(trunks) == 2:
            free = next(y for y in trunks[0][0].right if y in trunks[1][0].left)
            pieces.append((trunks[0][1], free, trunks[1][1], free))
        lefts = [link.left for link in mine if link.left[0] != FLOOR]
        edge = _right_edge(plan, lefts[0][0]) if lefts else 0.0
        if lefts and trunks:
            y = plan.leaves(lefts[0])
            pieces.append((edge, y, next(x for t, x in trunks if y in t.left), y))
        for link in mine:
            if link.right[0] != FLOOR and link.right not in plan.rising:
                y = plan.pin[link.right]
                _enter(plan, net, link.right, next((x for t, x in trunks if y in t.right), edge))


def _enter(plan: Plan, net: Net, end: End, x: float) -> None:
    """Lead a wire from ``x`` in the gap, at the height of its pin, into a port or on to the next gap."""
    y, middle, side = plan.pin[end], plan.x[end[0]], plan.side(end)
    if side == "left":
        edge = middle - plan.outlines.size(end[0]).width / 2
        plan.pieces[net].append((x, y, edge, y))
        if end[0] in plan.graph.nodes:
            plan.arrows[net].append(Arrow(edge, y, 1, 0))
    else:
        down = 1 if side == "top" else -1
        lane = plan.outlines.lanes.get(end, 0.0)
        at, edge = middle + lane, plan.y[end[0]] - down * math.sqrt(RADIUS**2 - lane**2)
        plan.pieces[net] += [(x, y, at, y), (at, y, at, edge)]
        plan.arrows[net].append(Arrow(at, edge, 0, down))


def _lead_back(plan: Plan, channel: Channel) -> None:
    """Draw a feedback along its channel, through its blocks, up to where it ends."""
    loop, y = channel.loop, channel.y
    x = next(x for t, x in plan.tracks(channel.right, loop.nets[0]) if y in t.left)
    for net, key in zip(loop.nets, loop.blocks, strict=False):
        edge = _right_edge(plan, key)
        plan.pieces[net].append((x, y, edge, y))
        plan.arrows[net].append(Arrow(edge, y, -1, 0))
        x = plan.x[key] - plan.outlines.size(key).width / 2
    last = loop.nets[-1]
    for end in last.back:
        if end in plan.rising:
            goal = plan.x[end[0]] + plan.outlines.lanes.get(end, 0.0)
            _enter(plan, last, end, x)
        else:
            goal = next(at for t, at in plan.tracks(plan.graph.column[end[0]], last) if y in t.right)
        plan.pieces[last].append((x, y, goal, y))


def stub(net: Net) -> float:
    """Length of the wire of a signal without receivers that has a text."""
    return text_width(note(net), SMALL) + 8
