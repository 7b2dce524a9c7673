"""Structures in MAT files, of both kinds: what dSPACE and Simulink write, and plain ones."""

import numpy as np
import pytest
from scipy.io import savemat

from tsmblocks.common.errors import DataError
from tsmblocks.data import read
from tsmblocks.data.structures import OBJECT, signals_of, tree_of_mat

T = np.arange(60) / 50
X, Y = np.sin(T), np.cos(T)


def struct_array(*items):
    """A MATLAB array of structures, as savemat takes it."""
    array = np.empty((1, len(items)), dtype=[(k, object) for k in items[0]])
    for k, item in enumerate(items):
        array[0, k] = tuple(item.values())
    return array


def save_hdf5(path, variables):
    """A file of version 7.3: values by columns, arrays of structures and cells by references, text as numbers."""
    h5py = pytest.importorskip("h5py", reason="the extra [data] brings it")
    with h5py.File(path, "w", userblock_size=512) as file:
        store = file.create_group("#refs#")

        def reference(value):
            return put(store, f"r{len(store)}", value).ref

        def put(group, name, value):
            if isinstance(value, dict):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, item in value.items():
                    put(made, key, item)
                return made
            if isinstance(value, list):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                for key in value[0]:
                    column = np.array([[reference(item[key])] for item in value], dtype=h5py.ref_dtype)
                    made.create_dataset(key, data=column, dtype=h5py.ref_dtype)
                return made
            kind = "char" if isinstance(value, str) else "double"
            data = np.array([[ord(c)] for c in value], dtype="u2") if kind == "char" else np.atleast_2d(value).T
            if not data.size:
                made = group.create_dataset(name, data=np.zeros(2, dtype="u8"))
                made.attrs["MATLAB_empty"] = 1
            else:
                made = group.create_dataset(name, data=data)
            made.attrs["MATLAB_class"] = np.bytes_(kind)
            return made

        for name, value in variables.items():
            put(file, name, value)
    raw = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + raw[512:])


def save_old(path, variables):
    def packed(value):
        if isinstance(value, list):
            return struct_array(*[{k: packed(v) for k, v in item.items()} for item in value])
        return {k: packed(v) for k, v in value.items()} if isinstance(value, dict) else value

    savemat(path, {k: packed(v) for k, v in variables.items()})


@pytest.fixture(params=[save_old, save_hdf5], ids=["v5", "v7.3"])
def mat(request, tmp_path):
    def make(**variables):
        path = tmp_path / "a.mat"
        request.param(path, variables)
        return path

    return make


def refusal(path, **options):
    with pytest.raises(DataError) as error:
        read(path, **options)
    return str(error.value)


# ---- dSPACE ControlDesk


def recording(**more):
    return dict(
        X=dict(Name="", Type="Double", Data=T, Unit="s", Raster="HostService"),
        Y=[
            dict(Name='"Model Root"/"x_in"/"Out1"', Type="Double", Data=X, Unit="rad", XIndex=1.0),
            dict(Name='"Model Root"/"x_out"/"Out1"', Type="Double", Data=Y, Unit="", XIndex=1.0),
        ],
        Capture=dict(SamplingPeriod=0.02, Downsampling=1.0),
        **more,
    )


def test_a_recording_of_controldesk(mat):
    record = read(mat(rec_001=recording()))
    assert record.names == ("x_in", "x_out")
    assert (record.unit("x_in"), record.unit("x_out")) == ("rad", "")
    np.testing.assert_array_equal(record.t, T)
    np.testing.assert_array_equal(record["x_in"], X)
    np.testing.assert_array_equal(record["x_out"], Y)
    assert record.notes == ()


def test_a_recording_with_one_signal(mat):
    whole = recording()
    path = mat(rec=dict(X=whole["X"], Y=whole["Y"][0]))
    assert read(path).names == ("Model Root/x_in/Out1",)
    np.testing.assert_array_equal(read(path, map={"x_in": "x_in/Out1"})["x_in"], X)


def test_a_recording_with_two_time_axes(mat):
    """The axis with most signals is read; the others are told."""
    whole = recording()
    slow = dict(Name="", Type="Double", Data=T[::2], Unit="s", Raster="slow")
    late = dict(Name="temperature", Type="Double", Data=T[::2], Unit="K", XIndex=2.0)
    path = mat(rec=dict(X=[whole["X"], slow], Y=[*whole["Y"], late]))
    record = read(path)
    assert len(record.names) == 2
    assert record.notes == ("Left out, being on another time axis than rec: rec.",)
    named = [
        {k: v for k, v in y.items() if k != "XIndex"} | {"Raster": r}
        for y, r in zip([*whole["Y"], late], ("HostService", "slow", "HostService"), strict=True)
    ]
    named[1]["Data"], named[2]["Data"] = Y[::2], X
    assert read(mat(rec=dict(X=[whole["X"], slow], Y=named))).names == ("Model Root/x_in/Out1", "temperature")


def test_brackets_of_array_elements_are_not_units(mat):
    whole = recording()
    for k, y in enumerate(whole["Y"]):
        y["Name"] = f"Model Root/force[{k}]"
    assert read(mat(rec=whole)).names == ("force_0", "force_1")


# ---- Simulink


def test_structure_with_time(mat):
    both = dict(
        time=T[:, None],
        signals=[
            dict(values=X[:, None], dimensions=1.0, label="x_in", blockName="m/Scope"),
            dict(values=np.column_stack([X, Y]), dimensions=2.0, label="", blockName="m/Scope"),
        ],
        blockName="m/Scope",
    )
    record = read(mat(simout=both))
    assert record.names == ("x_in", "simout_2_1", "simout_2_2")
    np.testing.assert_array_equal(record.t, T)
    np.testing.assert_array_equal(record["simout_2_2"], Y)


def test_structures_on_the_same_time_are_read_together(mat):
    def one(values, label):
        return dict(time=T[:, None], signals=dict(values=values[:, None], dimensions=1.0, label=label))

    record = read(mat(a=one(X, ""), b=one(Y, "x_out"), tout=T[:, None], extra=2 * X, gain=3.0))
    assert record.names == ("a", "x_out", "extra")
    np.testing.assert_array_equal(record["x_out"], Y)
    other = dict(time=T[:30, None], signals=dict(values=X[:30, None], dimensions=1.0, label="y"))
    assert read(mat(a=one(X, "x"), b=other)).notes == ("Left out, being on another time axis than a: b.",)


def test_structure_without_time_needs_a_step(mat):
    path = mat(simout=dict(time=np.empty((0, 0)), signals=dict(values=X[:, None], dimensions=1.0, label="x_in")))
    np.testing.assert_array_equal(read(path, step=0.02)["x_in"], X)
    assert refusal(path) == (
        f"{path}: no column is named t or time. Map t to the column that holds the time (there are x_in): "
        "map={'t': 'COLUMN'}, or --map 't=COLUMN'. Or give the step of the rows in s (step=…, or --sampling)."
    )


def test_structure_of_a_timeseries(mat):
    made = dict(Name="x_in", Time=T[:, None], Data=X[:, None], DataInfo=dict(Units="deg"))
    record = read(mat(ts=made))
    assert (record.names, record.unit("x_in")) == (("x_in",), "deg")
    frames = dict(Time=T[:, None], Data=np.stack([[X], [Y]]).transpose(0, 1, 2))  # a 2 by 1 matrix at each instant
    two = read(mat(ts=frames))
    assert two.names == ("ts_1", "ts_2")
    np.testing.assert_array_equal(two["ts_2"], Y)


def test_arrays_and_a_matrix_beside_the_time(mat):
    record = read(mat(tout=T[:, None], yout=np.column_stack([X, Y])))
    assert record.names == ("yout_1", "yout_2")
    np.testing.assert_array_equal(record["yout_2"], Y)


def test_to_file_writes_rows(mat):
    record = read(mat(ans=np.vstack([T, X, Y])), columns="t, x_in [rad], x_out [rad]")
    np.testing.assert_array_equal(record["x_out"], Y)


# ---- plain structures, groups


def test_plain_structures(mat):
    path = mat(run=dict(t=T[:, None], x_in=X[:, None], about=dict(who="me", k=2.0)))
    record = read(path)
    assert record.names == ("x_in",)
    assert read(path, map={"t": "run/t", "y": "run/x_in"}).names == ("y",)


def test_a_group_is_chosen(mat):
    path = mat(a=dict(t=T, x=X), b=dict(t=T[:30], x=Y[:30]))
    record = read(path, group="b")
    assert (record.name, record.names, len(record)) == ("a b", ("x",), 30)
    np.testing.assert_array_equal(record["x"], Y[:30])
    assert refusal(path, group="c") == f"{path}: there is no group 'c'. Known here: a, b."
    assert read(path).notes == ("Left out, being of another length than a/t (60): b/t (30), b/x (30).",)


def test_the_end_of_a_path_will_do_where_it_is_the_only_one(mat):
    path = mat(a=dict(t=T, x=X, y=Y), b=dict(x=Y))
    assert read(path, only=["y"]).names == ("y",)
    assert read(path, map={"u": "y"}).names == ("a/x", "u", "b/x")
    assert refusal(path, map={"u": "x"}) == (
        f"{path}: 'u' is mapped to column 'x', but 2 columns end like that: a/x, b/x."
    )
    assert refusal(path, map={"u": "z"}).startswith(f"{path}: 'u' is mapped to column 'z', which is not there.")


def test_objects_of_matlab_are_refused_with_the_way_out(tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra [data] brings it")
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        made = file.create_dataset("ts", data=np.arange(6, dtype="u4"))
        made.attrs["MATLAB_class"], made.attrs["MATLAB_object_decode"] = np.bytes_("timeseries"), 3
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    assert refusal(path) == (
        f"{path}: it holds objects of MATLAB (ts), such as timeseries, which only MATLAB can read. Save their numbers "
        "there: t = x.Time; x_in = x.Data; save('file.mat', 't', 'x_in')."
    )


def test_objects_of_matlab_of_version_5():
    from scipy.io.matlab import MatlabOpaque

    opaque = MatlabOpaque(np.zeros(1, dtype=[("s0", "O"), ("s1", "O"), ("s2", "O"), ("arr", "O")]))
    assert tree_of_mat(opaque) is OBJECT
    found = signals_of({"ts": OBJECT, "x": X})
    assert list(found.arrays) == ["x"]
    assert found.notes == ("Left out, being objects of MATLAB: ts.",)


def test_cells_and_arrays_of_structures(tmp_path):
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = X[:, None], Y[:, None]
    path = tmp_path / "a.mat"
    savemat(path, {"t": T, "c": cells, "s": struct_array({"x": X, "who": "me"}, {"x": Y, "who": "you"}), "n": "text"})
    assert read(path).names == ("c_1", "c_2", "s_1/x", "s_2/x")
    h5py = pytest.importorskip("h5py", reason="the extra [data] brings it")
    path = tmp_path / "b.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["#refs#/a"], file["#refs#/b"] = T, X, Y
        made = file.create_dataset("c", data=[file["#refs#/a"].ref, file["#refs#/b"].ref], dtype=h5py.ref_dtype)
        made.attrs["MATLAB_class"] = np.bytes_("cell")
    np.testing.assert_array_equal(read(path)["c_2"], Y)


def test_structures_without_end_are_left():
    tree = {"x": X}
    for _ in range(50):
        tree = {"inner": tree}
    assert signals_of(tree).arrays == {}


def test_a_time_series_by_rows_and_one_without_samples(tmp_path):
    series = dict(Time=T, Data=np.stack([X, Y]), DataInfo=dict(Units="deg"))
    nothing = dict(Name="nothing", Time=T, Data=np.empty((0, 0)), DataInfo=dict(Units=""))
    savemat(tmp_path / "a.mat", dict(angles=series, other=nothing))
    found = read(tmp_path / "a.mat")
    assert found.names == ("angles_1", "angles_2")
    np.testing.assert_allclose(found["angles_2"], Y)


def test_a_matrix_by_rows_with_as_many_names(tmp_path):
    savemat(tmp_path / "a.mat", dict(log=np.stack([T, X, Y])))
    found = read(tmp_path / "a.mat", columns=["t", "x_in", "x_out"])
    np.testing.assert_allclose(found["x_out"], Y)
