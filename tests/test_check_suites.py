"""The check suites for users: ours pass, and each check catches the fault that it is there for."""

import itertools
import random

import casadi as ca
import numpy as np
import pytest

import tsmblocks as tsm
from tests.fuzz.targets import NEEDS, TARGETS
from tsmblocks.blocks import (
    Bias,
    Constant,
    Creep,
    FirstOrderLag,
    Gain,
    MotorTransferFunction,
    Product,
    Saturation,
    SecondOrderLag,
    Sine,
    Slack,
    Sum,
)
from tsmblocks.common.errors import DataError, ParameterError
from tsmblocks.effects import Effect, Trials, catalogue
from tsmblocks.files.shipped import shipped_names
from tsmblocks.model.block import REGISTRY, Block, Input, Output, Tape, block, option, parameter, state
from tsmblocks.testing import ChecksFailed, check_diagram, check_effect, check_reader
from tsmblocks.testing.diagram_checks import DIAGRAM_CHECKS
from tsmblocks.testing.effect_checks import EFFECT_CHECKS
from tsmblocks.testing.reader_checks import READER_CHECKS

SKIPPED = {"sampled_position_loop": ["the_step_is_short_enough"]}
"""An encoder in a loop: which count is read at an instant is a matter of rounding."""


def broken(check, *given, **options):
    """The names of the checks that fail."""
    with pytest.raises(ChecksFailed) as caught:
        check(*given, **options)
    assert all(caught.value.broken.values())
    return set(caught.value.broken)


# ---- ours


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: f"{e.name}-{e.variant}-{e.place}")
def test_every_effect_of_the_catalogue(effect):
    check_effect(effect)


@pytest.mark.parametrize("name", shipped_names())
def test_every_shipped_diagram(name):
    check_diagram(tsm.load(name), skip=SKIPPED.get(name, ()))


@pytest.mark.parametrize("ending", ["csv", "npz", "mat", "hdf5", "json", "jsonl", "xlsx", "parquet"])
def test_every_reader(ending, tmp_path):
    for package in NEEDS.get(ending, ()):
        pytest.importorskip(package)
    for k, (name, write) in enumerate(TARGETS[ending].good):
        folder = tmp_path / str(k)
        folder.mkdir()
        write(folder / name)
        check_reader(tsm.read, folder / name)


# ---- effects with one fault each


def sound(cls):
    """A documented block of this module, which files know for the time of a test."""
    cls.__doc__ = cls.__doc__ or "A block of a test.\n\n.. math:: y = f(u)\n"
    cls.source, cls.symbol = "definition", "f"
    return block(register=False)(cls)


@sound
class SquaredSize(Block):
    size: float = parameter(default=0.0, about="size, of which the square acts")
    u = Input("signal")
    y = Output("signal and an offset")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.size * ca.fabs(self.size))


@sound
class UnboundedTime(Block):
    share: float = parameter(default=0.0, about="what comes late")
    time: float = parameter(default=1.0, about="time constant, without bounds", unit="s")
    z: float = state(default=0.0, about="late")
    u = Input("signal")
    y = Output("signal")

    def derivatives(self, t, x, u):
        return dict(z=(u.u - x.z) / self.time)

    def outputs(self, t, x, u):
        return dict(y=u.u + self.share * x.z)


@sound
class StepFilter(Block):
    share: float = parameter(default=0.0, about="what comes late")
    m: float = state(default=0.0, about="mean of the last steps")
    u = Input("signal")
    y = Output("signal")

    def updates(self, t, x, u):
        return dict(m=0.98 * x.m + 0.02 * u.u)

    def outputs(self, t, x, u):
        return dict(y=u.u + self.share * x.m)


@sound
class Pushing(Block):
    level: float = parameter(default=0.0, about="friction of the wrong sign", at_least=0.0)
    u = Input("drive")
    x = Input("speed")
    y = Output("drive and what pushes")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.level * ca.sign(u.x))


@sound
class OtherUnit(Block):
    size: float = parameter(default=0.0, about="offset")
    u = Input("angle", unit="rad")
    y = Output("angle", unit="deg")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.size)


@block(register=False)
class Undocumented(Block):
    size: float = parameter(default=0.0, about="offset")
    u = Input("signal")
    y = Output("signal")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.size)


@sound
class UnknownToFiles(Block):
    size: float = parameter(default=0.0, about="offset")
    u = Input("signal")
    y = Output("signal")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.size)


@sound
class Dice(Block):
    seed: int = option(default=0, about="ignored")
    u = Input("signal", unit="rad")
    w = Tape("numbers that differ from run to run")
    y = Output("signal and noise", unit="rad")

    def tapes(self, start, stop, name=""):
        return {"w": tsm.Samples(np.array([start, stop + 1.0]), np.random.default_rng().normal(size=2), "linear")}

    def outputs(self, t, x, u):
        return dict(y=u.u + u.w)


@sound
class Lorenz(Block):
    p: float = state(default=1.0, about="first")
    q: float = state(default=1.0, about="second")
    r: float = state(default=20.0, about="third")
    u = Input("signal", unit="rad")
    y = Output("signal and what doubles each error", unit="rad")

    def derivatives(self, t, x, u):
        p, q, r = 10 * (x.q - x.p), x.p * (28 - x.r) - x.q, x.p * x.q - 8 / 3 * x.r
        return dict(p=30 * p, q=30 * q, r=30 * r)

    def outputs(self, t, x, u):
        return dict(y=x.p + u.u)


@sound
class IdleCorner(Block):
    size: float = parameter(default=0.0, about="offset")
    corner: float = parameter(default=1.0, about="what matters from a million on")
    u = Input("signal")
    y = Output("signal and offset")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.size * (1 + ca.fmax(self.corner - 1e6, 0)))


@pytest.fixture(autouse=True)
def known_to_files(monkeypatch):
    for cls in (SquaredSize, UnboundedTime, StepFilter, Pushing, OtherUnit, Undocumented, Dice, Lorenz, IdleCorner):
        monkeypatch.setitem(REGISTRY, cls.__name__, cls)


def offset(**changes):
    """A sound effect, changed."""
    given = dict(
        name="offset",
        family="map",
        words="an offset",
        place="output",
        block=Bias(),
        null={"bias": 0.0},
        free=("bias",),
        trials=lambda scales: Trials({"bias": 0.1 * scales.wire.reach}),
    )
    return Effect(**{**given, **changes})


def sized(cls, **changes):
    """An effect of one size."""
    trials = {"trials": lambda scales: Trials({"size": 0.1 * scales.wire.reach})}
    return offset(**{"block": cls(), "null": {"size": 0.0}, "free": ("size",), **trials, **changes})


def late(cls, times, **changes):
    """An effect of which a share comes late."""
    shapes = times and (lambda s: ({times: 0.1 * s.shortest},))
    return offset(
        **{
            "block": cls(),
            "null": {"share": 0.0},
            "free": ("share", times) if times else ("share",),
            "trials": lambda s: Trials({"share": 0.2}, shapes(s) if shapes else ({},)),
            **changes,
        }
    )


EFFECTS = {
    "names_read_well": lambda: offset(words="An offset."),
    "null_passes_the_signal": lambda: offset(
        block=Saturation(low=-0.1, high=0.1),
        null={"high": 0.1, "low": -0.1},
        free=("high",),
        trials=lambda s: Trials({"high": 0.2 * s.wire.reach}),
    ),
    "trials_fit_the_block": lambda: offset(
        block=Slack(), null={"share": 0.0}, free=("share",), trials=lambda s: Trials({"share": max(0.5, s.wire.reach)})
    ),
    "trials_are_repeatable": lambda: offset(trials=lambda s: Trials({"bias": random.uniform(0.1, 0.2) * s.wire.reach})),
    "trials_show": lambda: offset(trials=lambda s: Trials({"bias": 1e-12 * s.wire.reach})),
    "every_free_parameter_matters": lambda: sized(
        IdleCorner, free=("size", "corner"), trials=lambda s: Trials({"size": 0.1 * s.wire.reach}, ({"corner": 1.0},))
    ),
    "a_small_size_is_seen": lambda: sized(SquaredSize, trials=lambda s: Trials({"size": 0.3 * np.sqrt(s.wire.reach)})),
    "trials_scale_with_the_signal": lambda: offset(trials=lambda s: Trials({"bias": 0.1})),
    "bounds_keep_it_finite": lambda: late(UnboundedTime, "time", settled=("z",)),
    "starts_where_the_signal_is": lambda: late(Creep, "time_constant"),
    "does_not_depend_on_the_step": lambda: late(StepFilter, "", settled=("m",)),
    "friction_takes_energy": lambda: offset(
        family="friction",
        place="brake",
        block=Pushing(),
        null={"level": 0.0},
        free=("level",),
        trials=lambda s: Trials({"level": 0.1 * s.wire.reach}),
    ),
    "both_sides_have_one_unit": lambda: sized(OtherUnit),
    "survives_a_file": lambda: sized(UnknownToFiles),
    "its_block_keeps_its_promises": lambda: sized(Undocumented),
}
ALSO = {"survives_a_file": {"its_block_keeps_its_promises"}, "trials_fit_the_block": {"trials_scale_with_the_signal"}}
"""Checks that the same fault breaks as well."""


def test_every_check_of_an_effect_has_a_faulty_example():
    assert set(EFFECTS) == set(EFFECT_CHECKS)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_faulty_effect_is_caught(name):
    assert broken(check_effect, EFFECTS[name]()) == {name} | ALSO.get(name, set())


def test_a_sound_effect_of_ones_own_passes():
    check_effect(offset())
    check_effect(late(Creep, "time_constant", settled=("late",)))


# ---- readers with one fault each

T = np.arange(0.0, 2.0, 0.01)


def rows(path):
    """A sound reader of lines of two numbers, which others spoil."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            values = np.array([[float(v) for v in line.split()] for line in file])
        if values.ndim != 2 or values.shape[1] != 2 or not np.isfinite(values).all():
            raise ValueError("two finite numbers are expected in each line")
        order = np.argsort(values[:, 0])
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: {error}") from None
    return tsm.Record("rows", values[order, 0], {"x": values[order, 1]}, {"x": "rad"})


def changed(**changes):
    """A reader whose record has other fields."""

    def reader(path):
        good = rows(path)
        fields = dict(name=good.name, t=good.t, signals=good.signals, units=good.units)
        return tsm.Record(**{**fields, **{k: make(good) for k, make in changes.items()}})

    return reader


count = itertools.count()


def counted(path):
    good, k = rows(path), next(count)
    return tsm.Record(good.name, good.t, {"x": good["x"] + k}, good.units)


def left_open(path):
    if not str(path).endswith("rows.txt"):
        return rows(path)
    made = rows(path)
    open(path, encoding="utf-8").read(1)  # noqa: SIM115 - the fault
    return made


def not_caught(error):
    def reader(path):
        try:
            return rows(path)
        except DataError as said:
            missing = "No such file" in str(said)
            if missing == (error is FileNotFoundError):
                raise error(str(said)) from None
            raise

    return reader


def with_gap(good):
    values = np.array(good["x"])
    values[3] = np.nan
    return {"x": values}


def of_its_folder(path):
    good = rows(path)
    return good if "copy" not in str(path) else tsm.Record("rows", good.t, {"y": good["x"]}, {"y": "rad"})


READERS = {
    "gives_a_record": lambda path: {"t": rows(path).t},
    "times_are_seconds_that_increase": changed(t=lambda good: good.t[::-1]),
    "signals_are_named_without_units": changed(
        signals=lambda good: {"x [rad]": good["x"]}, units=lambda good: {"x [rad]": "rad"}
    ),
    "units_are_known": changed(units=lambda good: {"x": "furlongs"}),
    "samples_are_numbers_or_filled": changed(signals=with_gap),
    "reads_the_same_again": counted,
    "reads_a_copy_elsewhere": of_its_folder,
    "leaves_the_file_alone": left_open,
    "says_what_is_missing": not_caught(FileNotFoundError),
    "refuses_spoilt_files": not_caught(ValueError),
    "survives_a_file": changed(signals=lambda good: {"x": good["x"], "t": good.t}),
}


def good_rows(tmp_path):
    path = tmp_path / "rows.txt"
    path.write_text("\n".join(f"{t:.2f} {np.sin(t):.6f}" for t in T))
    return path


def test_every_check_of_a_reader_has_a_faulty_example():
    assert set(READERS) == set(READER_CHECKS)


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("name", READERS)
def test_a_faulty_reader_is_caught(name, tmp_path):
    assert name in broken(check_reader, READERS[name], good_rows(tmp_path))


def test_a_sound_reader_of_ones_own_passes(tmp_path):
    check_reader(rows, good_rows(tmp_path))


# ---- diagrams with one fault each


def plant(**changes):
    """A sound diagram, changed."""
    given = dict(
        title="a plant",
        blocks=dict(motor=MotorTransferFunction(), lag=FirstOrderLag(time_constant=0.1)),
        wires=["motor.y -> lag"],
        inputs={"u": "motor.u"},
        outputs={"x": "lag"},
    )
    return tsm.Diagram(**{**given, **changes})


def through(part, **more):
    """A diagram with a block behind the motor."""
    blocks = dict(motor=MotorTransferFunction(), part=part, **more)
    return plant(blocks=blocks, wires=["motor.y -> part.u"], outputs={"x": "part"})


DIAGRAMS = {
    "says_what_it_is": lambda: plant(title=""),
    "inputs_have_units": lambda: plant(
        blocks=dict(lag=FirstOrderLag(time_constant=0.1)), wires=[], inputs={"u": "lag"}
    ),
    "survives_a_file": lambda: through(UnknownToFiles()),
    "runs_the_same_again": lambda: through(Dice()),
    "the_step_is_short_enough": lambda: plant(
        blocks=dict(
            motor=MotorTransferFunction(),
            one=Constant(),
            ring=SecondOrderLag(omega=400.0, zeta=0.02),
            all=Sum(signs="++"),
        ),
        wires=["one -> ring -> all.plus1", "motor.y -> all.plus2"],
        outputs={"x": "all"},
    ),
    "backends_agree": lambda: through(Lorenz()),
    "every_input_matters": lambda: plant(
        blocks=dict(
            motor=MotorTransferFunction(), none=Constant(value=0.0), part=Product(), own=Sine(), all=Sum(signs="++")
        ),
        wires=["motor.y -> part.u1", "none -> part.u2", "part -> all.plus1", "own -> all.plus2"],
        outputs={"x": "all"},
    ),
    "outputs_move": lambda: plant(
        blocks=dict(motor=MotorTransferFunction(), c=Constant(value=2.0)), wires=[], outputs={"x": "motor.y", "c": "c"}
    ),
    "nothing_is_idle": lambda: plant(
        blocks=dict(motor=MotorTransferFunction(), lag=FirstOrderLag(time_constant=0.1), extra=Gain()),
        wires=["motor.y -> lag, extra"],
    ),
}  # fmt: skip


def test_every_check_of_a_diagram_has_a_faulty_example():
    assert set(DIAGRAMS) == set(DIAGRAM_CHECKS)


@pytest.mark.parametrize("name", DIAGRAMS)
def test_a_faulty_diagram_is_caught(name):
    more = {
        "backends_agree": {"the_step_is_short_enough"},
        "runs_the_same_again": {"survives_a_file", "backends_agree"},
    }
    assert broken(check_diagram, DIAGRAMS[name]()) == {name} | more.get(name, set())


def test_a_sound_diagram_of_ones_own_passes_and_unused_values_are_idle():
    check_diagram(plant())
    assert broken(check_diagram, plant(values={"theta": 5.0})) == {"nothing_is_idle"}


# ---- what is asked of the suites themselves


def test_checks_can_be_skipped_by_name():
    effect = offset(trials=lambda s: Trials({"bias": 0.1}))
    check_effect(effect, skip=["trials_scale_with_the_signal"])
    with pytest.raises(ParameterError, match=r"no check 'trial_show'\. Did you mean 'trials_show'\?"):
        check_effect(effect, skip=["trial_show"])
    with pytest.raises(ParameterError, match="skip is a list of names"):
        check_effect(effect, skip="trials_show")


def test_all_faults_are_in_one_message():
    with pytest.raises(ChecksFailed) as caught:
        check_effect(offset(words="An offset.", trials=lambda s: Trials({"bias": 0.1})))
    assert set(caught.value.broken) == {"names_read_well", "trials_scale_with_the_signal"}
    assert str(caught.value).startswith("effect 'offset' fails 2 checks:\n  names_read_well: ")


@pytest.mark.parametrize("check", [check_effect, check_diagram])
def test_anything_else_is_refused(check):
    with pytest.raises(ParameterError, match="got 3"):
        check(3)


def test_a_reader_needs_a_function_and_a_file(tmp_path):
    with pytest.raises(ParameterError, match="a reader is a function"):
        check_reader("tsm.read", good_rows(tmp_path))
    with pytest.raises(DataError, match="there is no file"):
        check_reader(rows, tmp_path / "none.txt")
