"""Lookup tables in one and two dimensions: lines or smooth curves through given points."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from tsmblocks.blocks.shared import check_increasing
from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.model.block import Block, Input, Output, block, option, parameter

Rows = tuple[tuple[float, ...], ...]
"""A matrix: one tuple of numbers for each row."""
DEGREE = 3
"""Degree of the smooth curves: the lowest whose curvature has no jumps."""
BEYOND = "extrapolation beyond the points"
CURVE = "lines between the points, or a smooth curve"


@block
class LookupTable(Block):
    r"""Interpolation between given points, by lines or by a smooth curve.

    .. math:: y = \sum_i c_i \, b_i(u)

    With ``interpolation="linear"`` each :math:`b_i` consists of two lines, from 1 at its own point to 0 at the points
    beside it, and the :math:`c_i` are the values. With "cubic" they are cubic B-splines, and with the :math:`c_i` the
    curve passes through the values: the one cubic spline without a knot at the second and the last but one point, as
    SciPy and MATLAB draw it. It needs four points, and may overshoot where values jump.

    Beyond the points the last value holds; with ``outside="extend"`` the line, or the tangent of the curve, continues.
    """

    source = "definition; de Boor, A Practical Guide to Splines (2001), chapters IX and XIII"
    symbol = "table"

    points: tuple[float, ...] = parameter(default=(-1.0, -0.2, 0.2, 1.0), about="inputs, increasing", unit="?u")
    values: tuple[float, ...] = parameter(default=(-0.8, 0.0, 0.0, 0.8), about="outputs there", unit="?y")
    interpolation: str = option(default="linear", about=CURVE, choices=("linear", "cubic"))
    outside: str = option(default="hold", about=BEYOND, choices=("hold", "extend"))
    u = Input("any signal", unit="?u")
    y = Output("value on the lines", unit="?y")

    def check(self) -> None:
        if len(self.points) != len(self.values) or len(self.points) < 2:
            raise ParameterError(
                "LookupTable needs one value for each point and at least two points, "
                f"got {len(self.points)} points and {len(self.values)} values."
            )
        _check_points(self, "points")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        weights = _weights(self, self.points, ca.vertcat(*self.values))
        return dict(y=ca.dot(weights, _basis(self, u.u, self.points)))


@block
class LookupTable2D(Block):
    r"""Interpolation between values given on a grid of two inputs, by lines or by a smooth surface.

    .. math:: y = \sum_i \sum_j c_{ij} \, a_i(u_1) \, b_j(u_2)

    ``values`` has a row for each of ``points1``, and in it a number for each of ``points2``. With
    ``interpolation="linear"`` each :math:`a_i` and :math:`b_j` consists of two lines, from 1 at its own point to 0 at
    the points beside it, and the :math:`c_{ij}` are the values: bilinear interpolation. With "cubic" they are cubic
    B-splines, and with the :math:`c_{ij}` the surface passes through the values: along both inputs the cubic spline
    without a knot at the second and the last but one point, as SciPy draws it. It needs four points each way, and may
    overshoot where values jump.

    Beyond the grid the value at its nearest edge holds; with ``outside="extend"`` the lines, or the tangents of the
    surface, continue. Derivatives are exact, at a corner of two lines the mean of both. Each step reads all values:
    with a thousand it takes some 5 µs.
    """

    source = "definition; de Boor, A Practical Guide to Splines (2001), chapters IX, XIII and XVII"
    symbol = "table 2-D"

    points1: tuple[float, ...] = parameter(default=(0.0, 1.0, 2.0, 3.0), about="inputs u1, increasing", unit="?u")
    points2: tuple[float, ...] = parameter(default=(0.0, 1.0, 2.0, 4.0), about="inputs u2, increasing", unit="?v")
    values: Rows = parameter(
        default=((0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 3.0, 4.0), (0.0, 3.0, 4.0, 4.0)),
        about="outputs there, as rows: one for each of points1",
        unit="?y",
    )
    interpolation: str = option(default="linear", about=CURVE, choices=("linear", "cubic"))
    outside: str = option(default="hold", about=BEYOND, choices=("hold", "extend"))
    u1 = Input("any signal, along which rows follow", unit="?u")
    u2 = Input("any signal, along a row", unit="?v")
    y = Output("value on the surface", unit="?y")

    def check(self) -> None:
        for name in ("points1", "points2"):
            if len(getattr(self, name)) < 2:
                raise ParameterError(f"LookupTable2D.{name} needs at least two, got {len(getattr(self, name))}.")
            _check_points(self, name)
        _check_rows(self.values, len(self.points1), len(self.points2))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        values = ca.vertcat(*(ca.horzcat(*row) for row in self.values))
        columns = _weights(self, self.points1, values)
        weights = _weights(self, self.points2, columns.T).T
        return dict(y=ca.bilin(weights, _basis(self, u.u1, self.points1), _basis(self, u.u2, self.points2)))


def _check_points(table: Any, name: str) -> None:
    """Raise ParameterError unless the points increase, and are enough for a smooth curve."""
    check_increasing(table, name)
    count = len(getattr(table, name))
    if table.interpolation == "cubic" and count <= DEGREE:
        owner = type(table).__name__
        raise ParameterError(f"{owner}: 'cubic' needs at least four {name}, got {count}. Add some, or take 'linear'.")


def _check_rows(values: Any, rows: int, columns: int) -> None:
    """Raise ParameterError unless the values are as many rows of as many numbers."""
    if any(not isinstance(row, tuple) for row in values):
        raise ParameterError(f"LookupTable2D.values must be rows, such as [[0, 1], [2, 3]], got {in_words(values)}.")
    lengths = [len(row) for row in values]
    if lengths != [columns] * rows:
        turned = lengths == [rows] * columns
        raise ParameterError(
            f"LookupTable2D.values must be {rows} rows (one for each of points1) of {columns} numbers (one for each "
            f"of points2), got {len(values)} rows of {' and '.join(map(str, sorted(set(lengths))))}."
            + (" Rows and columns seem to be exchanged: transpose the values." if turned else "")
        )


def _basis(table: Any, u: Any, points: Any) -> Any:
    """A column with a function of the input for each point: some weighted sum of them interpolates."""
    extend = table.outside == "extend"
    if table.interpolation == "linear":
        return ca.vertcat(*_hats(u, points, extend))
    first, last, knots = points[0], points[-1], _knots(len(points))
    inside = ca.fmin(ca.fmax(u, first), last)
    made = _splines(inside, _hats(inside, [points[k] for k in knots[DEGREE:-DEGREE]], True), points)
    if extend:  # along the tangents, which only the outer two at each end have
        before = ca.fmin(u - first, 0.0) * DEGREE / (points[knots[DEGREE + 1]] - first)
        after = ca.fmax(u - last, 0.0) * DEGREE / (last - points[knots[-DEGREE - 2]])
        made[0], made[1] = made[0] - before, made[1] + before
        made[-1], made[-2] = made[-1] + after, made[-2] - after
    return ca.vertcat(*made)


def _hats(u: Any, points: Any, extend: bool) -> list[Any]:
    """Lines from 1 at each point to 0 at its neighbours; with ``extend`` the outer lines continue."""
    shares, intervals = [], len(points) - 1  # of each interval, the share that lies behind the input
    for k, (a, b) in enumerate(pairwise(points)):
        share = (u - a) / (b - a)
        if not (extend and k == 0):
            share = ca.fmax(share, 0.0)
        if not (extend and k == intervals - 1):
            share = ca.fmin(share, 1.0)
        shares.append(share)
    return [left - right for left, right in pairwise([1.0, *shares, 0.0])]


def _knots(count: int) -> list[int]:
    """Numbers of the points that are knots: the ends as often as the degree asks, not the points beside them."""
    return [0] * (DEGREE + 1) + list(range(2, count - 2)) + [count - 1] * (DEGREE + 1)


def _splines(u: Any, hats: list[Any], points: Any) -> list[Any]:
    """Cubic B-splines of an input, from the lines over its knots: the recursion of Cox and de Boor."""
    knots = _knots(len(points))
    made = [*[0.0] * (DEGREE - 1), *hats, *[0.0] * (DEGREE - 1)]
    for degree in range(2, DEGREE + 1):
        parts = [
            0.0 if isinstance(one, float) and one == 0.0 else one * (u - points[a]) / (points[b] - points[a])
            for one, a, b in zip(made, knots, knots[degree:], strict=False)  # where knots coincide it is 0
        ]
        made = [parts[k] + (made[k + 1] - parts[k + 1]) for k in range(len(made) - 1)]
    return made


def _weights(table: Any, points: Any, values: Any) -> Any:
    """Factors on the functions of ``_basis`` whose sum then passes through the values: a row, or a number, for each."""
    if table.interpolation == "linear":
        return values
    matrix, made, count = [_row(k, points) for k in range(len(points))], ca.vertsplit(values), len(points)
    for k in range(count):  # elimination in the order of the rows is stable: no minor of this matrix is negative
        for below in range(k + 1, min(k + DEGREE, count)):
            factor = matrix[below][k] / matrix[k][k]
            for column in range(k + 1, min(k + DEGREE, count)):
                matrix[below][column] = matrix[below][column] - factor * matrix[k][column]
            made[below] = made[below] - factor * made[k]
    for k in reversed(range(count)):
        after = range(k + 1, min(k + DEGREE, count))
        made[k] = (made[k] - sum(matrix[k][j] * made[j] for j in after)) / matrix[k][k]
    return ca.vertcat(*made)


def _row(k: int, points: Any) -> list[Any]:
    """The B-splines at one of the points."""
    knots = _knots(len(points))[DEGREE:-DEGREE]
    right = next(n for n, knot in enumerate(knots[1:], 1) if knot >= k)
    a, b = points[knots[right - 1]], points[knots[right]]
    share = 1.0 if knots[right] == k else 0.0 if knots[right - 1] == k else (points[k] - a) / (b - a)
    hats: list[Any] = [0.0] * len(knots)
    hats[right - 1], hats[right] = 1.0 - share, share
    return _splines(points[k], hats, points)
