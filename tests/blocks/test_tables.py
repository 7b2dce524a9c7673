"""Lookup tables against numpy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator, make_interp_spline

import tsmblocks as tsm
from tests.blocks.helpers import Bench, assert_sound, refuses, value
from tsmblocks.blocks.linear import FirstOrderLag
from tsmblocks.blocks.sources import Sine
from tsmblocks.blocks.tables import LookupTable, LookupTable2D
from tsmblocks.simulation.sensitivities import sensitivities

NUMBERS = np.linspace(-3, 3, 121)
SHAPES = [(4, 4), (5, 4), (7, 6), (4, 12)]
KINDS = [(k, o) for k in ("linear", "cubic") for o in ("hold", "extend")]


def random_table(shape, **options):
    rng = np.random.default_rng(shape)
    x, y = (np.cumsum(rng.uniform(0.1, 1.0, n)) - 0.3 * n for n in shape)
    return LookupTable2D(points1=x, points2=y, values=rng.normal(size=shape), **options)


def random_points(table, count=60, beyond=1.0):
    rng = np.random.default_rng(3)
    ends = [(p[0] - beyond, p[-1] + beyond) for p in (table.points1, table.points2)]
    return [tuple(rng.uniform(*e) for e in ends) for _ in range(count)]


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("outside", ["hold", "extend"])
def test_sound(interpolation, outside):
    assert_sound(LookupTable(interpolation=interpolation, outside=outside))
    assert_sound(LookupTable2D(interpolation=interpolation, outside=outside))
    if interpolation == "linear":
        assert_sound(LookupTable(points=(0, 1), values=(0, 1), outside=outside))


def test_lines_through_points():
    points, values = (-1.0, 0.0, 0.5, 2.0), (3.0, -1.0, 0.0, 0.5)
    held = LookupTable(points=points, values=values)
    extended = LookupTable(points=points, values=values, outside="extend")
    for u in NUMBERS:
        inside = np.interp(u, points, values)
        assert value(held, u=u)["y"] == pytest.approx(inside, abs=1e-14)
        beyond = 3 - 4 * (u + 1) if u < -1 else 0.5 + (u - 2) / 3 if u > 2 else inside
        assert value(extended, u=u)["y"] == pytest.approx(beyond, abs=1e-14)
    line = LookupTable(points=(0, 1), values=(1, 3), outside="extend")
    assert value(line, u=-5.0)["y"] == -9
    assert value(line, u=5.0)["y"] == 11


@pytest.mark.parametrize("count", [4, 5, 9])
def test_a_smooth_curve_is_the_spline_of_scipy(count):
    rng = np.random.default_rng(count)
    points, values = np.cumsum(rng.uniform(0.1, 1.0, count)), rng.normal(size=count)
    expected = make_interp_spline(points, values)
    held = LookupTable(points=points, values=values, interpolation="cubic")
    extended = held.replace(outside="extend")
    for u in np.linspace(points[0] - 1, points[-1] + 1, 97):
        edge = np.clip(u, points[0], points[-1])
        tangent = expected(edge) + expected(edge, 1) * (u - edge)
        assert value(held, u=u)["y"] == pytest.approx(expected(edge), abs=1e-12)
        assert value(extended, u=u)["y"] == pytest.approx(tangent, abs=1e-12)
    for at in points[1:-1]:  # where pieces meet, too
        assert slopes(extended, at)[0] == pytest.approx(float(expected(at, 1)), abs=1e-11)


def slopes(table, *at):
    """Derivatives of the output with respect to the inputs."""
    bench = Bench(table)
    return bench.slopes(0.0, [], list(at), bench.p0).full()[0, : len(at)]


@pytest.mark.parametrize("shape", [(2, 2), (3, 2), *SHAPES])
@pytest.mark.parametrize("outside", ["hold", "extend"])
def test_lines_over_a_grid_are_those_of_scipy(shape, outside):
    table = random_table(shape, outside=outside)
    grid = (table.points1, table.points2)
    expected = RegularGridInterpolator(grid, table.values, bounds_error=False, fill_value=None)
    for x, y in random_points(table):
        at = (
            (x, y) if outside == "extend" else tuple(np.clip(v, p[0], p[-1]) for v, p in zip((x, y), grid, strict=True))
        )
        assert value(table, u1=x, u2=y)["y"] == pytest.approx(float(expected(at)), abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_smooth_surface_is_the_spline_of_scipy(shape):
    held = random_table(shape, interpolation="cubic")
    extended = held.replace(outside="extend")
    made = RectBivariateSpline(held.points1, held.points2, held.values, s=0)
    for x, y in random_points(held):
        a, b = (np.clip(v, p[0], p[-1]) for v, p in ((x, held.points1), (y, held.points2)))
        f, fx, fy, fxy = (made(a, b, dx=i, dy=j)[0, 0] for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
        assert value(held, u1=x, u2=y)["y"] == pytest.approx(f, abs=1e-12)
        plane = f + fx * (x - a) + fy * (y - b) + fxy * (x - a) * (y - b)
        assert value(extended, u1=x, u2=y)["y"] == pytest.approx(plane, abs=1e-11)
        expected = (fx + fxy * (y - b), fy + fxy * (x - a))
        assert slopes(extended, x, y) == pytest.approx(expected, abs=1e-10)
        assert slopes(held, x, y) == pytest.approx((fx * (a == x), fy * (b == y)), abs=1e-11)


@pytest.mark.parametrize(("interpolation", "outside"), KINDS)
def test_a_surface_passes_through_its_values(interpolation, outside):
    table = random_table((5, 4), interpolation=interpolation, outside=outside)
    for x, row in zip(table.points1, table.values, strict=True):
        for y, z in zip(table.points2, row, strict=True):
            assert value(table, u1=x, u2=y)["y"] == pytest.approx(z, abs=1e-13)


def surface(**options):
    return tsm.Diagram(
        title="surface",
        blocks=dict(
            a=Sine(amplitude=2.0, frequency=0.7, offset=1.5),
            b=Sine(amplitude=2.5, frequency=0.31, offset=2.0),
            table=LookupTable2D(**options),
            lag=FirstOrderLag(time_constant=0.3),
        ),
        wires=["a -> table.u1", "b -> table.u2", "table -> lag"],
        outputs={"y": "lag"},
    )


@pytest.mark.parametrize(("interpolation", "outside"), KINDS)
def test_every_way_to_run_gives_the_same(interpolation, outside):
    d = surface(interpolation=interpolation, outside=outside)
    run = tsm.simulate(d, stop=2.0, step=0.01)
    assert np.abs(run["y"]).max() > 0.1
    assert tsm.simulate(d, stop=2.0, step=0.01, backend="casadi")["y"] == pytest.approx(run["y"], abs=1e-13)
    batch = tsm.simulate_batch(d, {"table.values[0][1]": [0.0, 0.7]}, stop=2.0, step=0.01)
    assert batch["y"][0] == pytest.approx(run["y"], abs=1e-13)


@pytest.mark.parametrize(("interpolation", "outside"), KINDS)
def test_derivatives_by_values_and_points(interpolation, outside):
    d, by = surface(interpolation=interpolation, outside=outside), 1e-6
    places = {"table.values[3][2]": ("values", 3, 2), "table.points1[2]": ("points1", 2)}
    found = sensitivities(d, list(places), stop=2.0, step=0.01).jacobian[:, 0]
    for k, name in enumerate(places):
        at = leaf(d.blocks["table"], places[name])
        high, low = (tsm.simulate(d, stop=2.0, step=0.01, parameters={name: at + h})["y"] for h in (by, -by))
        assert np.abs(found[:, k]).max() > 1e-3
        assert found[:, k] == pytest.approx((high - low) / (2 * by), abs=1e-6)


def leaf(block, place):
    found = getattr(block, place[0])
    for k in place[1:]:
        found = found[k]
    return found


def test_a_linear_model_takes_the_slopes_of_the_surface():
    table = random_table((5, 4), interpolation="cubic", outside="extend")
    made = RectBivariateSpline(table.points1, table.points2, table.values, s=0)
    d = tsm.Diagram(title="alone", blocks=dict(t=table), inputs=dict(x="t.u1", y="t.u2"), outputs=dict(z="t"))
    at = (table.points1[2], table.points2[1])  # where pieces meet
    found = tsm.linearize(d, at=tsm.trim(d, inputs=dict(zip("xy", at, strict=True)))).D
    assert found == pytest.approx(np.array([[made(*at, dx=1)[0, 0], made(*at, dy=1)[0, 0]]]), abs=1e-11)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_fit_finds_the_values(interpolation):
    truth = surface(interpolation=interpolation)
    run = tsm.simulate(truth, stop=10.0, step=0.01)
    names = ["table.values[0][0]", "table.values[3][1]"]
    begun = truth.with_parameters(dict.fromkeys(names, 1.0))
    record = tsm.Record("truth", run.t, {"y": run["y"]}, {})
    fitted = tsm.fit(begun, record, free=names)
    assert [fitted.values[n] for n in names] == pytest.approx([0.0, 3.0], abs=1e-6)


def test_in_a_file():
    d = surface(interpolation="cubic", values=np.arange(16.0).reshape(4, 4))
    assert "[12.0, 13.0, 14.0, 15.0]" in tsm.dumps(d)
    assert tsm.loads(tsm.dumps(d)) == d


def test_refuses_what_does_not_go_together():
    for points, values in (((0, 1), (1,)), ((0,), (1,))):
        refuses(
            "LookupTable needs one value for each point and at least two points, "
            f"got {len(points)} points and {len(values)} values.",
            LookupTable,
            points=points,
            values=values,
        )
    refuses(
        "LookupTable.points must increase, but points[1]=2 and points[2]=1.",
        LookupTable,
        points=(0, 2, 1),
        values=(0, 1, 2),
    )
    refuses(
        "LookupTable.outside is 'extnd', which is not a choice. Did you mean 'extend'? "
        "It is: extrapolation beyond the points.",
        LookupTable,
        outside="extnd",
    )
    refuses(
        "LookupTable: 'cubic' needs at least four points, got 3. Add some, or take 'linear'.",
        LookupTable,
        points=(0, 1, 2),
        values=(0, 1, 2),
        interpolation="cubic",
    )


def test_refuses_a_grid_that_is_none():
    grid = dict(points1=(0, 1, 2), points2=(0, 1), values=((0, 1), (2, 3), (4, 5)))
    assert LookupTable2D(**grid).values[2] == (4.0, 5.0)
    shape = "LookupTable2D.values must be 3 rows (one for each of points1) of 2 numbers (one for each of points2), got "

    def refused(message, **changes):
        refuses(message, LookupTable2D, **{**grid, **changes})

    transposed = "2 rows of 3. Rows and columns seem to be exchanged: transpose the values."
    refused(shape + transposed, values=((0, 2, 4), (1, 3, 5)))
    refused(shape + "2 rows of 2.", values=((0, 1), (2, 3)))
    refused(shape + "3 rows of 1 and 2.", values=((0, 1), (2, 3), (4,)))
    refused("LookupTable2D.values must be rows, such as [[0, 1], [2, 3]], got (0.0, 1.0, 2.0).", values=(0.0, 1.0, 2.0))
    refused("LookupTable2D.points1 must increase, but points1[1]=1 and points1[2]=1.", points1=(0, 1, 1))
    refused("LookupTable2D.points2 needs at least two, got 1.", points2=(0,), values=((0,), (1,), (2,)))
    refused(
        "LookupTable2D: 'cubic' needs at least four points1, got 3. Add some, or take 'linear'.", interpolation="cubic"
    )
    refused(
        "LookupTable2D.values[1][0] must be a number, got nan. It is: outputs there, as rows: one for each of points1.",
        values=((0, 1), (np.nan, 3), (4, 5)),
    )
