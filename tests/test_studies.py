"""Studies: the numbers of single runs, the same bytes however the work is done, and nothing lost on the way."""

import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, RateLimit, Sine, Step, Sum
from tsmblocks.common.errors import DataError, RunError
from tsmblocks.studies import Normal, grid, latin_hypercube, monte_carlo, responses, study, sweep, table

FIG16 = "fig16_feedforward_feedback"
METRICS = {"error [deg]": "peak_to_peak(x_ref - x_out, after=2.5)", "effort": "rms(u)"}
SHORT = dict(stop=5.0, step=2e-3)


def lagged():
    return tsm.Diagram(
        title="lag",
        blocks={"step": Step(time=0.0), "gain": Gain(gain=2.0), "lag": FirstOrderLag(time_constant=1.0)},
        wires=["step -> gain -> lag"],
        outputs={"y": "lag"},
    )


def small(path=None, **more):
    """Ninety-six runs in lanes of thirty-two."""
    plan = latin_hypercube({"gain.gain": (0.5, 2.0), "lag.time_constant": Normal(1.0, 0.1)}, 96, seed=2)
    return study(lagged(), plan, {"last": "final(y)", "most": "highest(y)"}, stop=0.5, step=0.01, out=path, **more)


# ---- numbers


def test_metrics_are_the_closed_form():
    plan = grid({"gain.gain": [0.5, 1.0, 3.0], "lag.time_constant": [0.2, 1.0]})
    found = study(lagged(), plan, ["final(y)", "rise_time(y, 3)"], stop=2.0, step=1e-3)
    expected = plan["gain.gain"] * (1 - np.exp(-2.0 / plan["lag.time_constant"]))
    assert found["final(y)"] == pytest.approx(expected, rel=1e-9)
    assert np.isinf(found["rise_time(y, 3)"]).tolist() == [True, True, True, True, False, True]


def test_angles_are_printed_in_degrees_as_they_are_plotted():
    plan = grid({"motor.K": [2.0]})
    found = study(tsm.load("motor_linear"), plan, ["final(x)"], inputs={"u": 1.0}, stop=0.5, step=0.01)
    assert found.units["final(x)"] == "rad"
    (row,) = [line for line in str(found).splitlines() if line.startswith("final(x)")]
    assert row.startswith("final(x) [deg]  ")
    assert float(row.split()[2]) == pytest.approx(np.degrees(found["final(x)"][0]), rel=1e-3)


def test_every_run_is_what_a_run_alone_gives():
    diagram = tsm.load(FIG16)
    plan = monte_carlo({"pid.kp": (0.5, 2.0), "theta": Normal(4.4, 0.4)}, 5, seed=1)
    found = study(diagram, plan, METRICS, **SHORT)
    for k in range(5):
        run = tsm.simulate(diagram.with_parameters(plan.row(k)), **SHORT)
        alone = tsm.measure(run, METRICS)
        assert list(alone) == list(METRICS)
        assert list(found.row(k).values()) == pytest.approx([*plan.row(k).values(), *alone.values()], rel=1e-6)
        assert tsm.measure(tsm.simulate(found.at(k), **SHORT), METRICS) == alone


def test_a_number_that_follows_a_shared_one_goes_its_own_way_in_lanes():
    """The plant's theta is the compensator's in the file; here it alone varies."""
    from tsmblocks.studies.runner import grouped

    diagram = tsm.load(FIG16)
    plan = sweep({"tsm.theta": [4.0, 5.0], "pid.kp": [1.0]})
    found = study(diagram, plan, METRICS, **SHORT)
    assert found["tsm.theta"].tolist() == [4.382, 4.0, 5.0, 4.382]
    assert found.own["tsm.theta"] == 4.382
    alone = [
        tsm.measure(tsm.simulate(diagram.with_parameters(plan.row(k)), **SHORT), METRICS)["error [deg]"]
        for k in range(4)
    ]
    assert found["error"] == pytest.approx(alone, rel=1e-6)
    (group,) = grouped(diagram, dict(table({"tsm.theta": [4.0, 5.0]}).columns), SHORT)
    assert group.lanes == 2


def test_what_a_sweep_leaves_open_is_the_diagrams_own():
    found = study(lagged(), sweep({"gain.gain": [1, 3], "lag.time_constant": [0.5]}), "final(y)", stop=1.0)
    assert found["gain.gain"].tolist() == [2, 1, 3, 2]
    assert found["lag.time_constant"].tolist() == [1, 1, 1, 0.5]
    low, high = found.influence("final(y)")["gain.gain"]
    assert (low, high) == pytest.approx((0.5 * found["final(y)"][0], 1.5 * found["final(y)"][0]))


def test_options_vary_too_and_shape_their_own_equations():
    blocks = {"sine": Sine(amplitude=2.0, frequency=1.0, phase=1.0), "slow": RateLimit()}
    diagram = tsm.Diagram(title="slow", blocks=blocks, wires=["sine -> slow"], outputs={"y": "slow"})
    plan = {"slow.start": ["input", "last"], "slow.rising": [2.0, 4.0]}
    found = study(diagram, plan, "integral(y, before=0.2)", stop=1.0)
    alone = [tsm.measure(tsm.simulate(found.at(k), stop=1.0), "integral(y, before=0.2)") for k in range(4)]
    assert found["integral(y, before=0.2)"] == pytest.approx([one["integral(y, before=0.2)"] for one in alone])
    assert found["slow.start"].tolist() == ["input", "input", "last", "last"]
    only = study(diagram, {"slow.start": ["last", "input"]}, "integral(y, before=0.2)", stop=1.0)
    alone = [tsm.measure(tsm.simulate(only.at(k), stop=1.0), "integral(y, before=0.2)") for k in range(2)]
    assert only["integral(y, before=0.2)"] == pytest.approx([one["integral(y, before=0.2)"] for one in alone])


def of(*values):
    """Results with one metric of such values."""
    runs = np.arange(len(values))
    return tsm.studies.Results(
        "d",
        "table",
        len(values),
        runs,
        {"p": runs.astype(float)},
        {"m": np.array(values)},
        {"m": ""},
        {"m": "m"},
        {"p": 0.0},
    )


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_quantiles_are_the_usual_ones(values):
    found = of(*values, np.nan).quantiles("m")
    assert list(found.values()) == pytest.approx(
        np.quantile(values, [0, 0.05, 0.5, 0.95, 1]).tolist(), rel=1e-9, abs=1e-6
    )
    assert (found["lowest"], found["highest"]) == (min(values), max(values))
    assert found["lowest"] <= found["5 %"] <= found["median"] <= found["95 %"] <= found["highest"]


INF = np.inf


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ([1.0, 2.0], [1.0, 1.05, 1.5, 1.95, 2.0]),
        ([3.0], [3.0] * 5),
        ([1.0, INF], [1.0, INF, INF, INF, INF]),
        ([1.0, 2.0, INF], [1.0, 1.1, 2.0, INF, INF]),
        ([-INF, 1.0, 2.0], [-INF, -INF, 1.0, 1.9, 2.0]),
        ([-INF, INF], [-INF, -INF, INF, INF, INF]),
        ([INF, INF, np.nan], [INF] * 5),
        ([*map(float, range(20)), INF], [0.0, 1.0, 10.0, 19.0, INF]),
    ],
)
def test_quantiles_take_what_never_comes_as_later_than_all(values, wanted):
    assert list(of(*values).quantiles("m").values()) == pytest.approx(wanted)


def test_a_run_that_runs_away_is_told_and_left_out():
    loop = {"sum": Sum(signs="+-"), "lag": FirstOrderLag(), "gain": Gain()}
    wires = ["sum -> gain -> lag", "lag -> sum.minus"]
    diagram = tsm.Diagram(
        title="loop", blocks={"step": Step(time=0.0), **loop}, wires=[*wires, "step -> sum.plus"], outputs={"y": "lag"}
    )
    found = study(diagram, {"gain.gain": [1.0, -1e4, 3.0]}, "final(y)", stop=5.0, step=0.01)
    assert found.failed.tolist() == [False, True, False]
    assert found.best("final(y)")["gain.gain"] == 1.0
    assert "1 run has a metric that is no number" in str(found)
    assert found.to_dict()["failed"] == 1


def test_inputs_drive_every_run():
    diagram = tsm.Diagram(title="gain", blocks={"gain": Gain()}, inputs={"x": "gain"}, outputs={"y": "gain"})
    t = np.linspace(0, 1, 101)
    found = study(diagram, {"gain.gain": [1.0, 2.0]}, "highest(y)", inputs={"x": (t, np.sin(t))}, step=0.01)
    assert found["highest(y)"] == pytest.approx([np.sin(1), 2 * np.sin(1)])


# ---- the same bytes


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "whole.csv"
    small(path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def facts(tmp_path_factory):
    path = tmp_path_factory.mktemp("facts") / "s.csv"
    small(path)
    return (path.parent / "s.study.json").read_bytes()


def written(path, content, facts):
    """A file of results as a kill or a hand leaves it, and the facts of its study beside it."""
    path.write_bytes(content)
    path.with_suffix(".study.json").write_bytes(facts)


def test_any_reader_of_tables_reads_the_file(tmp_path):
    pd = pytest.importorskip("pandas")
    diagram = tsm.load(FIG16)
    found = study(diagram, {"pid.kp": [1.0, 2.0]}, METRICS, **SHORT, out=tmp_path / "s.csv")
    frame = found.to_pandas()
    assert list(frame) == ["pid.kp", "error [deg]", "effort"]  # names as they were asked
    assert frame.attrs["units"] == {"error [deg]": "deg", "effort": "V"}
    read = pd.read_csv(tmp_path / "s.csv", index_col="run")
    assert list(read) == ["pid.kp", "error [deg]", "effort [V]"]
    np.testing.assert_array_equal(read, frame)
    again = tsm.read_study(tmp_path / "s.csv")
    pd.testing.assert_frame_equal(again.to_pandas(), frame)
    np.testing.assert_array_equal(again["error [deg]"], again["error"])


@settings(max_examples=25, deadline=None)
@given(cut=st.floats(0.0, 1.0), order=st.randoms(use_true_random=False))
def test_a_killed_study_goes_on_and_ends_with_the_same_bytes(whole, facts, tmp_path_factory, cut, order):
    """Cut off anywhere behind the heading, rows in any order: as a kill leaves it."""
    heading, *rows = whole.splitlines(keepends=True)
    order.shuffle(rows)
    path = tmp_path_factory.mktemp("cut") / "cut.csv"
    body = b"".join(rows)
    written(path, heading + body[: int(cut * len(body))], facts)
    small(path)
    assert path.read_bytes() == whole
    assert path.with_suffix(".study.json").read_bytes() == facts


def test_only_what_is_missing_is_run(whole, facts, tmp_path):
    path = tmp_path / "some.csv"
    lines = whole.splitlines(keepends=True)
    written(path, b"".join(lines[:51]), facts)
    seen = []
    small(path, progress=lambda done, count: seen.append((done, count)))
    assert seen == [(50, 96), (96, 96)]
    small(path, progress=lambda done, count: seen.append((done, count)))
    assert seen[2:] == [(96, 96)]


def test_ctrl_c_keeps_what_is_done(whole, tmp_path, monkeypatch):
    monkeypatch.setattr("tsmblocks.studies.runner.BATCHES_PER_THREAD", 1)

    def stop(done, _):
        if done >= 32:
            raise KeyboardInterrupt

    found = small(tmp_path / "s.csv", threads=1, progress=stop)
    assert (found.status, len(found), found.count) == ("interrupted", 32, 96)
    again = tsm.read_study(tmp_path / "s.csv")
    assert (again.status, len(again)) == ("interrupted", 32)
    assert np.array_equal(again["last"], found["last"])
    assert small(tmp_path / "s.csv").status == "complete"
    assert (tmp_path / "s.csv").read_bytes() == whole


def test_threads_and_executors_change_nothing(whole, tmp_path):
    for name, how in (("one", {"threads": 1}), ("three", {"threads": 3})):
        small(tmp_path / f"{name}.csv", **how)
    with ThreadPoolExecutor(1) as pool:
        small(tmp_path / "pool.csv", executor=pool)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        small(tmp_path / "processes.csv", executor=pool)
    for path in tmp_path.glob("*.csv"):
        assert path.read_bytes() == whole, path.name


def test_a_worker_that_dies_loses_nothing(whole, tmp_path, monkeypatch):
    path = tmp_path / "s.csv"
    monkeypatch.setattr("tsmblocks.studies.runner.LANE_GROUPS_PER_PIECE", 1)
    monkeypatch.setattr("tsmblocks.studies.runner.MAX_SUBMITTED", 1)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:

        def kill(done, _):
            if done >= 32:
                for process in list(pool._processes.values()):
                    process.kill()
                    process.join()

        with pytest.raises(
            RunError,
            match=r"a worker process ended before its runs did \(.*\)\. \d+ of 96 "
            r"runs are in .*s\.csv; the same call continues from there\.",
        ):
            small(path, executor=pool, progress=kill)
    assert 32 <= len(tsm.read_study(path)) < 96
    small(path)
    assert path.read_bytes() == whole


def test_a_process_killed_half_way_is_gone_on_with(whole, tmp_path):
    """Killed without warning while it writes; what it wrote counts."""
    path = tmp_path / "s.csv"
    code = (
        "import time, tests.test_studies as t, tsmblocks.studies.runner as r; r.BATCHES_PER_THREAD = 1; "
        f"t.small({str(path)!r}, threads=1, progress=lambda *_: time.sleep(0.3))"
    )
    child = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[1])
    try:
        until = time.monotonic() + 60
        while (not path.exists() or len(path.read_bytes().splitlines()) < 33) and time.monotonic() < until:
            time.sleep(0.02)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    assert 32 <= len(tsm.read_study(path)) < 96
    small(path)
    assert path.read_bytes() == whole


class Losing(ThreadPoolExecutor):
    """Loses what it is given at first, as a cluster does with a machine that goes."""

    def __init__(self, times):
        super().__init__(1)
        self.times, self.seen = times, {}

    def submit(self, function, runs, *more):
        key = tuple(runs.runs)
        self.seen[key] = self.seen.get(key, 0) + 1
        if self.seen[key] <= self.times:
            return super().submit(self.lost)
        return super().submit(function, runs, *more)

    @staticmethod
    def lost():
        raise ValueError("not enough values to unpack (expected 3, got 2)")


@pytest.mark.parametrize("times", [1, 2])
def test_a_piece_that_was_lost_on_the_way_is_run_again(times, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("tsmblocks.studies.runner.LANE_GROUPS_PER_PIECE", 1)
    with Losing(times) as pool:
        small(tmp_path / "s.csv", executor=pool)
    assert set(pool.seen.values()) == {times + 1}
    assert (tmp_path / "s.csv").read_bytes() == whole


def test_an_error_that_comes_again_and_again_counts(tmp_path):
    with Losing(3) as pool, pytest.raises(ValueError, match="not enough values"):
        small(tmp_path / "s.csv", executor=pool)


class Silent(Executor):
    """Takes ten seconds for a piece, by a clock of its own; of one piece it loses copies without a word."""

    def __init__(self, monkeypatch, lost):
        self.now, self.lost, self.given = 0.0, lost, []
        monkeypatch.setattr("tsmblocks.studies.runner.LANE_GROUPS_PER_PIECE", 1)
        monkeypatch.setattr("tsmblocks.studies.runner.monotonic", lambda: self.now)
        monkeypatch.setattr("tsmblocks.studies.runner.wait", self.wait)

    def submit(self, function, runs, *more):
        copies = [first for first, _ in self.given].count(runs.runs[0])
        self.given.append((int(runs.runs[0]), self.now))
        future = Future()
        if runs.runs[0] != 32 or copies >= self.lost:
            future.set_result(function(runs, *more))
        return future

    def wait(self, waiting, timeout, return_when):
        done, _ = found = wait(waiting, timeout=0, return_when=return_when)
        assert done or timeout is not None, "it would wait for ever"
        self.now += 10.0 if done else timeout + 1e-6
        return found


@pytest.mark.parametrize("lost", [1, 2])
def test_a_piece_that_never_ends_is_given_again(lost, whole, tmp_path, monkeypatch):
    """And only that one, after four times as long as any other took."""
    pool = Silent(monkeypatch, lost)
    small(tmp_path / "s.csv", executor=pool)
    first, *again = [at for run, at in pool.given if run == 32]
    assert (first, again) == (0.0, pytest.approx([50.0, 90.0][:lost], abs=1e-3))
    assert [run for run, _ in pool.given if run != 32] == [0, 64]
    assert (tmp_path / "s.csv").read_bytes() == whole


@pytest.mark.filterwarnings("default")
def test_many_machines_by_dask(whole, tmp_path, monkeypatch):
    """A cluster of two worker processes; one is killed half-way, and nothing is lost."""
    distributed = pytest.importorskip("distributed", reason="needs Dask: pip install 'tsmblocks[dask]'")
    import dask

    monkeypatch.setattr("tsmblocks.studies.runner.LANE_GROUPS_PER_PIECE", 1)
    monkeypatch.setattr("tsmblocks.studies.runner.MIN_OVERDUE_TIME", 1.0)
    calm = {"distributed.scheduler.allowed-failures": 10, "distributed.comm.retry.count": 2}
    with (
        dask.config.set(calm),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        small(tmp_path / "quiet.csv", executor=client.get_executor())
        pids, killed = list(client.run(os.getpid).values()), []

        def kill(done, _):
            if done >= 32 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        small(tmp_path / "killed.csv", executor=client.get_executor(), progress=kill)
    gc.collect()  # sockets that the cluster leaves open are closed here, and not in some other test
    assert killed
    for name in ("quiet", "killed"):
        assert (tmp_path / f"{name}.csv").read_bytes() == whole


def test_another_study_is_not_gone_on_with(whole, facts, tmp_path):
    path = tmp_path / "s.csv"
    written(path, whole, facts)
    plan = {"gain.gain": [1.0]}
    for more, said in (
        ({"stop": 1.0}, "its title is lag, and not other"),
        ({"title": "lag"}, "its runs is 96, and not 1"),
    ):
        more = {"stop": 0.5, "step": 0.01, "title": "other", **more}
        with pytest.raises(DataError) as found:
            study(lagged(), plan, {"last": "final(y)", "most": "highest(y)"}, out=path, **more)
        assert str(found.value) == (
            f"{path} holds another study: {said}. Name another file, or remove that one to start again."
        )
    assert path.read_bytes() == whole


@pytest.mark.parametrize("changed", ["diagram", "plan", "metrics", "step", "inputs", "method"])
def test_whatever_changes_the_results_makes_another_study(changed, tmp_path):
    diagram = tsm.Diagram(
        title="gain",
        blocks={"gain": Gain(), "lag": FirstOrderLag()},
        wires=["gain -> lag"],
        inputs={"x": "gain"},
        outputs={"y": "lag"},
    )
    asked = dict(
        diagram=diagram,
        plan={"gain.gain": [1.0, 2.0]},
        metrics="final(y)",
        step=0.01,
        stop=1.0,
        inputs={"x": 1.0},
        method="rk4",
    )
    other = dict(
        diagram=diagram.with_parameters({"lag.time_constant": 2.0}),
        plan={"gain.gain": [1.0, 3.0]},
        metrics="mean(y)",
        step=0.02,
        inputs={"x": 2.0},
        method="heun",
    )
    study(**asked, out=tmp_path / "s.csv")
    study(**asked, out=tmp_path / "s.csv")
    with pytest.raises(DataError, match="holds another study"):
        study(**{**asked, changed: other[changed]}, out=tmp_path / "s.csv")


@pytest.mark.parametrize("changed", ["order of metrics", "heading", "parameter", "metric", "run", "digits"])
def test_a_file_changed_by_hand_is_not_gone_on_with(changed, whole, facts, tmp_path):
    path = tmp_path / "s.csv"
    heading, *rows = whole.decode().splitlines(keepends=True)
    if changed == "order of metrics":
        written(path, whole, facts)
        with pytest.raises(DataError, match="holds another study: its metrics is"):
            small_in_another_order(path)
        return
    cells = rows[3].split(",")
    if changed == "heading":
        heading = heading.replace("last", "lost")
    else:
        place = {"parameter": 1, "metric": 3, "run": 0, "digits": 0}[changed]
        cells[place] = {"parameter": "9.5", "metric": "much", "run": "999", "digits": "\u0663"}[changed]
        rows[3] = ",".join(cells)
    written(path, (heading + "".join(rows)).encode(), facts)
    with pytest.raises(DataError) as found:
        small(path)
    said = {"heading": "the heading has been changed", "digits": "the first being the number of a run"}
    assert said.get(changed, "has been changed") in str(found.value)


def small_in_another_order(path):
    plan = latin_hypercube({"gain.gain": (0.5, 2.0), "lag.time_constant": Normal(1.0, 0.1)}, 96, seed=2)
    return study(lagged(), plan, {"most": "highest(y)", "last": "final(y)"}, stop=0.5, step=0.01, out=path)


def test_blocks_of_ones_own_are_told_apart_by_their_equations(tmp_path):
    def made(power):
        @tsm.function_block(units={"u": "1", "y": "1"}, about={"u": "in", "k": "factor", "y": "out"})
        def bent(u, k=1.0):
            """A curve.

            .. math:: y = k u^n
            """
            return k * u**power

        blocks = {"s": Sine(amplitude=1.0, frequency=1.0, phase=1.0), "b": bent()}
        return tsm.Diagram(title="own", blocks=blocks, wires=["s -> b"], outputs={"y": "b"})

    before = dict(tsm.block.__globals__["REGISTRY"])
    try:
        study(made(3), {"b.k": [1.0]}, "rms(y)", stop=1.0, out=tmp_path / "s.csv")
        registry = tsm.block.__globals__["REGISTRY"]
        for name in set(registry) - set(before):
            del registry[name]
        with pytest.raises(DataError, match="holds another study: its diagram has other blocks, wires or numbers"):
            study(made(2), {"b.k": [1.0]}, "rms(y)", stop=1.0, out=tmp_path / "s.csv")
    finally:
        registry = tsm.block.__globals__["REGISTRY"]
        for name in set(registry) - set(before):
            del registry[name]


# ---- what can be read off


def test_the_pareto_front_is_what_no_run_beats():
    rng = np.random.default_rng(0)
    found = study(lagged(), table({"gain.gain": rng.uniform(1, 2, 60)}), ["final(y)"], stop=0.2, step=0.01)
    a, b = rng.uniform(size=(2, 60))
    found = tsm.studies.Results("t", "table", 60, found.runs, {}, {"a": a, "b": b}, {}, {}, {})
    front = set(found.pareto("a", "b"))
    for k in range(60):
        beaten = np.any((a <= a[k]) & (b <= b[k]) & ((a < a[k]) | (b < b[k])))
        assert (k in front) == (not beaten)


def test_influence_is_the_slope_of_a_line():
    plan = latin_hypercube({"gain.gain": (1.0, 3.0), "lag.time_constant": (0.9, 1.1)}, 200, seed=0)
    found = study(lagged(), plan, "final(y)", stop=20.0, step=0.02)
    made = found.influence("final(y)")
    assert list(made) == ["gain.gain", "lag.time_constant"]
    assert made["gain.gain"] == pytest.approx((1.1, 2.9), abs=0.02)
    assert np.ptp(made["lag.time_constant"]) < 0.01


def test_results_read_back_are_the_same(tmp_path):
    made = small(tmp_path / "s.csv")
    again = tsm.read_study(tmp_path / "s.csv")
    assert made.to_pandas().equals(again.to_pandas())
    assert str(made) == str(again)
    assert made.to_dict() == again.to_dict()
    assert made.best("last", largest=True)["run"] == int(np.argmax(made["last"]))
    with pytest.raises(RunError, match="no diagram of run 3: the diagram is not in the file"):
        again.at(3)


def test_responses_are_the_signals_of_each_run():
    plan = {"gain.gain": [1.0, 2.0, 4.0]}
    found = responses(lagged(), plan, stop=2.0, step=0.01, every=10)
    assert found["y"].shape == (3, 21)
    assert found["y"] == pytest.approx(np.outer([1, 2, 4], 1 - np.exp(-found.t)), abs=1e-8)
    with pytest.raises(RunError, match=r"the responses have no signal 'x'\. Known here: y\."):
        found["x"]


# ---- what goes wrong


LINE = {"gain.gain": [1.0]}
REFUSED = {
    "parameter": (dict(plan={"gain.gian": [1.0]}), "gain: Gain has no parameter 'gian'. Did you mean 'gain'?"),
    "swept parameter": (
        dict(plan=sweep({"gain.gian": [1.0]})),
        "diagram 'lag' has no parameter 'gain.gian'. Did you mean 'gain.gain'?",
    ),
    "refused by its block": (
        dict(plan={"lag.time_constant": [1.0, 0.5, -2.0]}),
        "set 2 of the batch: lag: FirstOrderLag.time_constant must lie in (0, inf), got -2.",
    ),
    "a word for a number": (
        dict(plan={"gain.gain": ["much"]}),
        "'gain.gain' is a number, and the plan gives it 'much'.",
    ),
    "a word among numbers": (
        dict(plan={"gain.gain": [1, "a", 2.0]}),
        "'gain.gain' is a number, and the plan gives it 'a'.",
    ),
    "a switch among numbers": (
        dict(plan={"gain.gain": [1, True]}),
        "'gain.gain' is a number, and the plan gives it True.",
    ),
    "a metric's unit": (
        dict(metrics={"err [degg]": "rise_time(y, 1)"}),
        "metric 'err': 'degg' is not a unit known here. Did you mean 'deg'?",
    ),
    "a metric in another unit": (
        dict(metrics={"err [deg]": "rise_time(y, 1)"}),
        "metric 'err': 's' does not convert to 'deg'.",
    ),
    "the end of a name": (
        dict(plan={"gain": [1.0]}),
        "diagram 'lag' has no parameter 'gain'. Did you mean 'gain.gain' or 'lag.gain'?",
    ),
    "the end of a swept name": (
        dict(plan=sweep({"time_constant": [1.0]})),
        "diagram 'lag' has no parameter 'time_constant'. Did you mean 'lag.time_constant'?",
    ),
    "metric": (dict(metrics="rms(z)"), "metric: there is no signal 'z'. Known here: t, y, gain.y, lag.value, lag.y,"),
    "no metric": (dict(metrics=None), "no metrics are given, and the diagram has no 'x_ref' with 'x_out', and no 'u'."),
    "no instant": (
        dict(metrics="rms(y, after=7)"),
        "metric 'rms(y, after=7)': no instant of the run lies between 7 and inf s; it is from 0 to 1 s.",
    ),
    "a metric's name": (
        dict(metrics={"gain.gain": "rms(y)"}),
        "'gain.gain' is a parameter of the plan, so no metric can have that name.",
    ),
    "several diagrams": (
        dict(diagram={"a": lagged()}),
        "study runs one diagram; for several, make one study each: "
        "{name: study(one, plan, metrics) for name, one in diagrams.items()}.",
    ),
    "plan": (
        dict(plan=[1, 2]),
        "a plan is made by grid, sweep, latin_hypercube, monte_carlo or table of "
        "tsmblocks.studies, or is a mapping from parameters to values, got [1, 2].",
    ),
    "file": (dict(out="results.xls"), "'results.xls' must end in .csv: results are kept in a table."),
    "folder": (dict(out="nowhere/results.csv"), "'nowhere/results.csv' cannot be written: there is no such folder."),
    "progress": (dict(progress=3), "progress must be a function of done and of, got 3."),
    "threads": (dict(threads=-1), "threads must be a whole number of at least 1, got -1."),
    "executor": (dict(executor=5), "executor is one of concurrent.futures, or Dask's get_executor(), got 5."),
    "no path": (dict(out=5), "out is the path of a .csv file, got 5."),
    "a metric called run": (
        dict(metrics={"run": "rms(y)"}),
        "no metric can be called 'run': the number of a run has that name.",
    ),
    "a metric of two lines": (
        dict(metrics={"a\nb": "rms(y)"}),
        "no metric can be called 'a\\nb': it cannot be printed.",
    ),
    "a sweep of options": (
        dict(
            diagram=tsm.Diagram(title="o", blocks={"r": RateLimit()}, inputs={"u": "r"}, outputs={"y": "r"}),
            plan=sweep({"r.start": [1.0]}),
        ),
        "'r.start' is an option, and a sweep changes numbers. Use grid for it.",
    ),
    "input": (dict(inputs={"x": 1.0}), "diagram 'lag' has no input 'x'."),
    "diagram": (dict(diagram="lag"), "only a diagram can be run, got 'lag'. Load it first: tsmblocks.load('lag')."),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_studied(name):
    asked, said = REFUSED[name]
    with pytest.raises(tsm.TsmError) as found:
        study(**{**dict(diagram=lagged(), plan=LINE, metrics="rms(y)", stop=1.0, step=0.01), **asked})
    assert str(found.value).startswith(said), str(found.value)


FACTS = b'{"format": 1, "runs": 2, "parameters": {"%s": 1}, "units": {}, "title": "t", "kind": "grid", "metrics": {}}'
BROKEN = {
    (b"run,a\n1,2\n", None): ("s.csv: this is not a file of results of a study: there is no s.study.json beside it."),
    (b"run,a\n1,2\n", b""): ("s.study.json: this does not describe a study."),
    (b"run,a\n", b'{"format": 1}'): ("s.study.json: facts of the study are missing."),
    (b"run,a\n", b'{"format": 1, "runs": 2, "parameters": {}, "units": {}, "title": "", "kind": "", "metrics": 3}'): (
        "s.study.json: facts of the study are missing."
    ),
    (b"run,a\n", FACTS % b"b"): ("s.csv:1: the heading does not have the parameters and metrics of s.study.json."),
    (b"run,a\n0,1\nx,2\n", FACTS % b"a"): (
        "s.csv:3: 2 columns are expected, the first being the number of a run; got 'x,2'."
    ),
}


@pytest.mark.parametrize("content", BROKEN)
def test_files_that_hold_no_results(content, tmp_path):
    rows, facts = content
    (tmp_path / "s.csv").write_bytes(rows)
    if facts is not None:
        (tmp_path / "s.study.json").write_bytes(facts)
    with pytest.raises(DataError) as found:
        tsm.read_study(tmp_path / "s.csv")
    assert str(found.value) == f"{tmp_path}/{BROKEN[content]}"


def test_a_function_cannot_be_sent_to_another_process():
    diagram = tsm.Diagram(title="gain", blocks={"gain": Gain()}, inputs={"x": "gain"}, outputs={"y": "gain"})
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool,
        pytest.raises(RunError, match="work for another process must be pickled, and this cannot be"),
    ):
        study(diagram, {"gain.gain": [1.0]}, "rms(y)", stop=1.0, inputs={"x": lambda t: t}, executor=pool)


def test_results_of_nothing_finite():
    found = tsm.studies.Results(
        "t",
        "table",
        1,
        np.array([0]),
        {"a": np.array([1.0])},
        {"m": np.array([np.nan])},
        {"m": ""},
        {"m": "rms(y)"},
        {},
    )
    for call, said in (
        (lambda: found.best("m"), "no run of the study has a finite 'm'."),
        (lambda: found.influence("m"), "'m' is finite in 0 runs; the influences of its parameters take 3 at least."),
        (lambda: found.pareto("m"), "a Pareto front takes two metrics at least."),
        (lambda: found["n"], "the study has no 'n'. Known here: a, m."),
    ):
        with pytest.raises(RunError) as error:
            call()
        assert str(error.value) == said
    assert "nan" in str(found)
