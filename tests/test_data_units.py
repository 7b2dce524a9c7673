"""Units that a file does not tell: told with a name or by the column, and what a signal without one is taken for."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import DataError
from tsmblocks.data import Record, from_pandas, read
from tsmblocks.data.missing_units import assumed_units, how_to_map, likely_unit, refuse_doubtful
from tsmblocks.data.spellings import other_spelling


@pytest.fixture
def file(tmp_path):
    def make(text):
        path = tmp_path / "measured.csv"
        path.write_text(text)
        return path

    return make


def refused(path, **options):
    with pytest.raises(DataError) as error:
        read(path, **options)
    return str(error.value)


TOLD = "t [s], x_in [deg]\n0, 1.5\n1, 2.5\n2, 3.5\n3, 4.5\n"

BARE = "Time,Motor pos,Tip pos\n0,10,1\n1,20,2\n2,30,3\n3,40,4\n"
NAMED = {"x_in [deg]": "Motor pos", "x_out": "Tip pos"}


@pytest.mark.parametrize(
    "told",
    [
        dict(map=NAMED),
        dict(map={"x_in (deg)": "Motor pos", "x_out": "Tip pos"}),
        dict(map={"x_in": "Motor pos", "x_out": "Tip pos"}, units={"x_in": "deg"}),
        dict(map={"x_in": "Motor pos", "x_out": "Tip pos"}, units={"Motor pos": "deg"}),  # by its column
        dict(map=NAMED, units={"x_in": "deg"}),  # twice the same
        dict(map=NAMED, only=["x_in", "x_out"]),
    ],
    ids=str,
)
def test_a_unit_is_told_with_the_name_or_by_the_column(file, told):
    record = read(file(BARE), **told)
    assert (record.names, dict(record.units)) == (("x_in", "x_out"), {"x_in": "deg"})
    np.testing.assert_array_equal(record["x_in"], [10, 20, 30, 40])
    frame = pytest.importorskip("pandas").read_csv(file(BARE))
    again = from_pandas(frame, **told)
    assert (again.names, dict(again.units)) == (record.names, dict(record.units))


def test_units_by_name_and_by_column_when_names_are_exchanged(file):
    path = file("t,a,b\n0,1,5\n1,2,6\n2,3,7\n3,4,8\n")
    record = read(path, map={"a": "b", "b": "a"}, units={"a": "deg"})
    assert (dict(record.units), list(record["a"])) == ({"a": "deg"}, [5, 6, 7, 8])


def test_the_heading_of_a_column_is_a_name_for_it(file):
    path = file(TOLD)
    assert read(path, map={"angle": "x_in [deg]"}).unit("angle") == "deg"
    assert refused(path, map={"angle": "x_in [rad]"}).endswith(
        "'angle' is mapped to column 'x_in [rad]', and the file gives it in deg. To give the unit, write it with "
        "the name: map={'angle [rad]': 'x_in'}, or --map 'angle [rad]=x_in'."
    )
    assert refused(file(BARE), map={"x_in": "Motor pos [deg]"}).endswith(
        "'x_in' is mapped to column 'Motor pos [deg]', and the file gives it no unit. To give the unit, write it with "
        "the name: map={'x_in [deg]': 'Motor pos'}, or --map 'x_in [deg]=Motor pos'."
    )


@pytest.mark.parametrize(
    ("told", "message"),
    [
        (dict(map=NAMED, units={"x_in": "rad"}), "'x_in' is given two units, rad and deg."),
        (
            dict(map={"x": "Motor pos", "x [deg]": "Tip pos"}),
            "'x' is mapped to two columns, 'Motor pos' and 'Tip pos'.",
        ),
        (
            dict(map=NAMED, units={"Motor": "deg"}),
            "a unit is given for 'Motor', which is not read. Known here: Time, x_in, x_out.",
        ),
        (
            dict(only=["x_in"]),
            "there is no column 'x_in'. Known here: Motor pos, Tip pos. If it has another name "
            "there, map it: map={'x_in [deg]': 'COLUMN'}, or --map 'x_in [deg]=COLUMN'.",
        ),
    ],
    ids=str,
)
def test_what_is_told_twice_or_of_nothing_is_refused(file, told, message):
    path = file(BARE)
    assert refused(path, **told) == f"{path}: {message}"


def test_where_columns_have_units_the_way_to_map_one_needs_none(file):
    path = file(TOLD)
    assert refused(path, only=["x_out"]).endswith(
        "Known here: x_in. If it has another name there, map it: map={'x_out': 'COLUMN'}, or --map 'x_out=COLUMN'."
    )


# ---- what nobody told


T = np.arange(100) / 10
WANTED = {"x_in": "rad", "x_out": "rad", "u": "V", "count": "", "missing": "rad"}


def said(size, **told):
    signals = {"x_in": size * np.sin(T), "x_out": np.cos(T), "u": 100 * T, "count": T}
    return assumed_units(Record("run", T, signals, told), WANTED)


def test_what_signals_without_a_unit_are_taken_for():
    assert said(1.0) == [
        "x_in and x_out have no unit and are taken to be in rad.",
        "u has no unit and is taken to be in V.",
    ]
    assert said(500.0, x_in="deg", x_out="mrad", u="mV") == []


def test_angles_of_many_turns_are_probably_degrees():
    with pytest.raises(DataError) as told:
        refuse_doubtful("a.csv", Record("run", T, {"x_in": -45 * np.sin(T), "x_out": T, "u": 100 * T}, {}), WANTED)
    assert str(told.value) == (
        "a.csv: x_in has no unit and reaches 45, which in rad would be 7.16 turns: it is probably in deg. "
        "Give the unit: units={'x_in': 'deg'}, or 'rad' where that is meant."
    )
    for size, units in ((12.5, {}), (-45.0, {"x_in": "deg"}), (-45.0, {"x_in": "rad"})):  # two turns: nothing strange
        refuse_doubtful("a.csv", Record("run", T, {"x_in": size * np.sin(T)}, units), WANTED)


@pytest.mark.parametrize(("bare", "heading"), [(True, "x [deg]"), (False, "x")])
def test_how_a_column_is_mapped(file, bare, heading):
    words = how_to_map("x", bare=bare)
    assert words == f"map={{'{heading}': 'COLUMN'}}, or --map '{heading}=COLUMN'"
    record = read(file("t,COLUMN\n0,1\n1,2\n2,3\n3,4\n"), **eval(f"dict({words.partition(', or')[0]})"))
    assert (record.names, record.unit("x")) == (("x",), "deg" if bare else "")


# ---- other spellings


def test_an_optional_signal_in_another_spelling_is_noted(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,u,Theta M,theta-x\n" + "".join(f"{k},{k},{k},{k}\n" for k in range(9)), encoding="utf-8")
    found = read(path, only=["u"], also=["theta_m", "q"])
    assert found.names == ("u",)
    assert found.notes == (
        "there is no 'theta_m', and 'Theta M' is not used. To use it, map it: map={'theta_m': 'Theta M'}, or "
        "--map 'theta_m=Theta M'.",
    )
    mapped = read(path, only=["u"], also=["theta_m"], map={"theta_m": "Theta M"})
    assert (mapped.names, mapped.notes) == (("u", "theta_m"), ())


def test_an_optional_signal_under_a_similar_name_is_noted_and_a_used_one_is_not(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,motor,joint_angle\n" + "".join(f"{k},{k},{k}\n" for k in range(9)), encoding="utf-8")
    (note,) = read(path, only=["motor"], also=["joint", "motor_2"]).notes
    assert note.startswith("there is no 'joint', and 'joint_angle' is not used. To use it, map it: map={'joint': ")
    plant = tsm.Diagram(blocks={"gain": tsm.blocks.Gain()}, inputs={"motor": "gain.u"}, outputs={"joint": "gain"})
    both = plant.rewire(outputs={"joint": "gain", "y": "gain"})
    record = tsm.Record("r", range(50), {"motor": range(50), "joint_angle": range(50), "y": range(50)}, {})
    assert any("'joint_angle' is not used" in text for text in tsm.fit(both, record, starts=1).notes)


@pytest.mark.parametrize("others", [("Theta", "THETA"), ("theta_m_2",), ("eta",)])
def test_no_other_spelling_is_guessed_where_it_is_not_clear(others):
    assert other_spelling("theta", others) == ""


@pytest.mark.parametrize(
    ("unit", "other"), [("rad", "deg"), ("rad/s", "deg/s"), ("V", "mV"), ("m/s", "mm/s"), ("Pa", "kPa"), ("1", "1")]
)
def test_the_unit_in_which_a_signal_may_be_recorded_is_one_of_its_quantity(unit, other):
    assert likely_unit(unit) == other
