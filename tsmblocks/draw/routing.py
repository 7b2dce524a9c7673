"""Wires: pins, feedback channels below or between the blocks, tracks between the columns, and all x coordinates."""

from __future__ import annotations

from collections.abc import Mapping

import attrs

from tsmblocks.draw.graph import End, Graph, Loop, Net
from tsmblocks.draw.ordering import FLOOR, Link, Rows
from tsmblocks.draw.picture import GRID, RADIUS, SMALL, Arrow, text_width
from tsmblocks.draw.polylines import Piece
from tsmblocks.draw.shapes import port_offset, size
from tsmblocks.draw.tracks import Trunk, arrange

BEFORE, AFTER, TRACK, PLAIN = 14, 22, 12, 40
"""Room left of the vertical wires of a gap, right of them, between two; width of a gap without any [pixels]."""


@attrs.define(eq=False)
class Channel:
    """One feedback below its blocks: its height, the gaps between which it runs, and its blocks' columns.

    ``above`` and ``below`` are the room that the blocks in it take.
    """

    loop: Loop
    right: int
    left: int
    y: float = 0.0
    columns: tuple[int, ...] = ()
    above: float = 0.0
    below: float = 0.0

    def meets(self, other: Channel) -> bool:
        """Whether both run below one column, or turn in one gap."""
        return other.left <= self.right and self.left <= other.right


@attrs.define(eq=False)
class Plan:
    """The state of the routing of a drawing: heights come first, then tracks, then x."""

    graph: Graph
    rows: Rows
    sides: Mapping[End, str]
    y: dict[str, float]
    notes: Mapping[End, str] = attrs.field(factory=dict)
    channels: list[Channel] = attrs.field(factory=list)
    pin: dict[End, float] = attrs.field(factory=dict)
    rising: set[End] = attrs.field(factory=set)
    taken: dict[int, list[tuple[float, float]]] = attrs.field(factory=dict)
    trunks: list[list[Trunk]] = attrs.field(factory=list)
    x: dict[str, float] = attrs.field(factory=dict)
    track_x: list[list[float]] = attrs.field(factory=list)
    pieces: dict[Net, list[Piece]] = attrs.field(factory=dict)
    arrows: dict[Net, list[Arrow]] = attrs.field(factory=dict)


def routed(plan: Plan) -> Plan:
    """The plan with all coordinates and wires filled in."""
    _pins(plan, fed_back=False)
    _channels(plan)
    _pins(plan, fed_back=True)
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
    graph = plan.graph
    for loop in graph.loops:
        column = graph.column[loop.nets[0].source[0]]
        left = min(graph.column[key] for key, _ in loop.nets[-1].back)
        plan.channels.append(Channel(loop, column + 1, left))
    plan.channels.sort(key=lambda c: (c.right - c.left, c.left))
    spans = [_spans(plan, column) for column in range(len(plan.rows.columns))]
    done: list[Channel] = []
    for channel in plan.channels:
        _seat(channel)
        sizes = [size(graph.nodes[k], plan.sides) for k in channel.loop.blocks]
        channel.above, channel.below = (
            max([0.0, *heights]) for heights in ([_up(s.above) for s in sizes], [s.below for s in sizes])
        )
        blocks = [span for column in spans[channel.left : channel.right] for span in column]
        met = blocks + [(c.y - c.above, c.y + c.below) for c in done if c.meets(channel)]
        floor = _up(max(high for _, high in met)) + max(2 * GRID, channel.above)
        lowest = max(low for low, _ in blocks)
        channel.y = next((y for y in _between(plan, channel, lowest) if _fits(channel, y, met)), floor)
        done.append(channel)


def _between(plan: Plan, channel: Channel, lowest: float) -> list[float]:
    """Heights below the blocks that a feedback leaves and enters, the closest first, down to ``lowest``."""
    keys = [channel.loop.nets[0].source[0], *(key for key, _ in channel.loop.nets[-1].back)]
    own = max(plan.y[key] + size(plan.graph.nodes[key], plan.sides).below for key in keys)
    return [float(y) for y in range(int(_up(own)) + GRID, int(lowest), GRID)]


def _fits(channel: Channel, y: float, spans: list[tuple[float, float]]) -> bool:
    """Whether a feedback at a height keeps clear of the heights that are taken."""
    up, down = max(GRID, channel.above), GRID + channel.below
    return all(high <= y - up or y + down <= low for low, high in spans)


def _up(value: float) -> float:
    """The next line of the grid."""
    return -(-value // GRID) * GRID


def _spans(plan: Plan, column: int) -> list[tuple[float, float]]:
    """Heights taken in a column: by its blocks, and by wires that pass it or enter it."""
    found = []
    for key in plan.rows.columns[column]:
        whole = None if key.startswith("~") else size(plan.graph.nodes[key], plan.sides)
        above, below = (whole.above, whole.below) if whole else (GRID, GRID)
        found.append((plan.y[key] - above, plan.y[key] + below))
    pins = [plan.pin[a.right] for a in plan.rows.gaps[column] if a.right in plan.pin]
    return [*found, *zip(pins, pins, strict=True), (0.0, 0.0)]


def _seat(channel: Channel) -> None:
    """Spread the blocks of a feedback over the columns it runs below, from right to left."""
    first = channel.left + 1 if channel.right - channel.left > len(channel.loop.blocks) else channel.left
    free, count = range(first, channel.right), len(channel.loop.blocks)
    channel.columns = tuple(free[len(free) * (2 * k + 1) // (2 * count)] for k in reversed(range(count)))


def _out_y(plan: Plan, end: End) -> float:
    node = plan.graph.nodes.get(end[0])
    return plan.y[end[0]] + (port_offset(node, end[1], "out", plan.sides) if node else 0.0)


def _pins(plan: Plan, fed_back: bool) -> None:
    """Heights at which wires enter the columns; a circle is entered from as high or low as its wire comes.

    Wires ahead come first, since the channels of the feedback are led below them.
    """
    for column, links in enumerate(plan.rows.gaps[:-1]):
        for link in links:
            node, end = plan.graph.nodes.get(link.right[0]), link.right
            if end[0] == FLOOR or (link.left[0] == FLOOR) != fed_back:
                continue
            middle = plan.y[end[0]]
            plan.pin[end] = middle + (port_offset(node, end[1], "in", plan.sides) if node else 0.0)
            side = plan.sides.get(end, "left")
            if node is None or not node.round or side == "left":
                continue
            start = _floor(plan, link) if fed_back else _out_y(plan, link.left)
            beyond = start <= plan.pin[end] if side == "top" else start >= plan.pin[end]
            reach = (min(start, middle), max(start, middle))
            if beyond and _is_clear(plan, column, node.key, reach):
                plan.taken.setdefault(column, []).append(reach)
                plan.pin[end] = start
                if fed_back:
                    plan.rising.add(end)


def _floor(plan: Plan, link: Link) -> float:
    """Height of the channel by which a feedback link comes."""
    return next(c.y for c in plan.channels if c.loop.nets[-1] is link.net and link.right in link.net.back)


def _is_clear(plan: Plan, column: int, key: str, reach: tuple[float, float]) -> bool:
    """Whether a wire may run up or down the middle of a column to the circle ``key``."""
    low, high = reach
    for other in plan.rows.columns[column]:
        y = plan.y[other]
        if other.startswith("~") and y in reach:
            return False
        if not other.startswith("~") and other != key:
            whole = size(plan.graph.nodes[other], plan.sides)
            if low < y + whole.below and y - whole.above < high:
                return False
    seated = any(column in c.columns and c.y <= high for c in plan.channels)
    return not seated and all(high <= a or b <= low for a, b in plan.taken.get(column, ()))


def _trunks(plan: Plan, gap: int) -> list[Trunk]:
    """The vertical wires that the signals need in a gap."""
    found: dict[Net, Trunk] = {}
    for link in plan.rows.gaps[gap]:
        if link.right in plan.rising and link.left[0] == FLOOR:
            continue
        trunk = found.setdefault(link.net, Trunk(link.net, [], []))
        if link.left[0] != FLOOR and not trunk.left:
            trunk.left.append(_out_y(plan, link.left))
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


def _label_room(net: Net) -> float:
    """Width of the text on a wire behind its source."""
    text = note(net)
    return text_width(text, SMALL) + (20 if net.tapped else 12) if text else 0.0


def note(net: Net) -> str:
    """The text on a wire: the outputs read off it, and its value."""
    names = ", ".join(net.outputs) if net.tapped else ""
    return " = ".join(filter(None, (names, net.note)))


def _columns(plan: Plan) -> None:
    """Find x of columns, nodes and tracks, from left to right."""
    graph, x = plan.graph, 0.0
    for gap, trunks in enumerate(plan.trunks):
        count = max((t.track + 1 for t in trunks), default=0)
        label = 0.0
        if gap:
            for net in graph.nets:
                if graph.column.get(net.source[0], -1) == gap - 1:
                    edge = plan.x[net.source[0]] + size(graph.nodes[net.source[0]], plan.sides).width / 2
                    label = max(label, edge + _label_room(net) - x)
        last = gap == len(plan.rows.columns)
        start = x + max(label, BEFORE if gap else 0.0)
        plan.track_x.append([start + TRACK * k for k in range(count)])
        x = start + TRACK * max(count - 1, 0)
        if not last:
            x += AFTER if count else PLAIN - BEFORE if gap else 0
        if last:
            break
        x = _column(plan, gap, x)


def _column(plan: Plan, column: int, x: float) -> float:
    """Place one column from ``x`` on; its right edge."""
    graph = plan.graph
    keys = [k for k in plan.rows.columns[column] if not k.startswith("~")]
    sizes = {k: size(graph.nodes[k], plan.sides) for k in keys}
    pairs = [pair for c in plan.channels for pair in zip(c.loop.blocks, c.columns, strict=True)]
    seated = [key for key, place in pairs if place == column]
    half = [size(graph.nodes[k], plan.sides).left + _label_room(_leaving(plan, k)) for k in seated]
    left = max([s.left for s in sizes.values()] + half, default=0.0)
    right = max([s.right for s in sizes.values()] + half, default=0.0)
    for key in [*plan.rows.columns[column], *seated]:
        plan.x[key] = x + left
        if key in sizes and graph.nodes[key].shape == "terminal":
            plan.x[key] = x + left + right - 4 if key.startswith(">") else x + 4
    return x + left + right


def _leaving(plan: Plan, key: str) -> Net:
    return next(net for net in plan.graph.nets if net.source[0] == key)


# ---- wires


def _right_edge(plan: Plan, key: str) -> float:
    node = plan.graph.nodes.get(key)
    return plan.x[key] + (size(node, plan.sides).width / 2 if node else 0.0)


def _tracks_of(plan: Plan, gap: int, net: Net) -> list[tuple[Trunk, float]]:
    return [(t, plan.track_x[gap][t.track]) for t in plan.trunks[gap] if t.owner is net]


def _lead(plan: Plan, gap: int, links: list[Link]) -> None:
    """Draw what the links of one gap need between its two columns."""
    for net in dict.fromkeys(link.net for link in links):
        trunks, pieces = _tracks_of(plan, gap, net), plan.pieces[net]
        mine = [link for link in links if link.net is net]
        for trunk, x in trunks:
            pieces.append((x, trunk.low, x, trunk.high))
        if len(trunks) == 2:
            free = next(y for y in trunks[0][0].right if y in trunks[1][0].left)
            pieces.append((trunks[0][1], free, trunks[1][1], free))
        lefts = [link.left for link in mine if link.left[0] != FLOOR]
        edge = _right_edge(plan, lefts[0][0]) if lefts else 0.0
        if lefts and trunks:
            y = _out_y(plan, lefts[0])
            pieces.append((edge, y, next(x for t, x in trunks if y in t.left), y))
        for link in mine:
            if link.right[0] != FLOOR and link.right not in plan.rising:
                y = plan.pin[link.right]
                _enter(plan, net, link.right, next((x for t, x in trunks if y in t.right), edge))


def _enter(plan: Plan, net: Net, end: End, x: float) -> None:
    """Lead a wire from ``x`` in the gap, at the height of its pin, into a port or on to the next gap."""
    node, y, pieces = plan.graph.nodes.get(end[0]), plan.pin[end], plan.pieces[net]
    middle = plan.x[end[0]]
    side = plan.sides.get(end, "left") if node is not None and node.round else "left"
    if node is None:
        pieces.append((x, y, middle, y))
    elif side == "left":
        edge = middle - size(node, plan.sides).width / 2
        pieces.append((x, y, edge, y))
        plan.arrows[net].append(Arrow(edge, y, 1, 0))
    else:
        down = 1 if side == "top" else -1
        edge = plan.y[end[0]] - down * RADIUS
        pieces += [(x, y, middle, y), (middle, y, middle, edge)]
        plan.arrows[net].append(Arrow(middle, edge, 0, down))


def _lead_back(plan: Plan, channel: Channel) -> None:
    """Draw a feedback along its channel, through its blocks, up to where it ends."""
    loop, y = channel.loop, channel.y
    x = next(x for t, x in _tracks_of(plan, channel.right, loop.nets[0]) if y in t.left)
    for net, key in zip(loop.nets, loop.blocks, strict=False):
        half = size(plan.graph.nodes[key], plan.sides).width / 2
        plan.pieces[net].append((x, y, plan.x[key] + half, y))
        plan.arrows[net].append(Arrow(plan.x[key] + half, y, -1, 0))
        x = plan.x[key] - half
    last = loop.nets[-1]
    for key, port in last.back:
        if (key, port) in plan.rising:
            end = plan.x[key]
            _enter(plan, last, (key, port), x)
        else:
            end = next(at for t, at in _tracks_of(plan, plan.graph.column[key], last) if y in t.right)
        plan.pieces[last].append((x, y, end, y))


def stub(net: Net) -> float:
    """Length of the wire of a signal without receivers that has a text."""
    return text_width(note(net), SMALL) + 8
