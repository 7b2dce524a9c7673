"""Blocks with one fault each and the promises that must catch it, so that no check weakens unnoticed."""

import inspect
import math

import casadi as ca
import numpy as np
import pytest

from tsmblocks.blocks.function import function_block
from tsmblocks.common.errors import BlockError, EquationError
from tsmblocks.model.block import REGISTRY, Block, Input, Output, Samples, State, Tape, block, option, parameter, state
from tsmblocks.testing import PROMISES, BrokenPromise, broken_promises, checks_for

FAULTS = []


def fault(*names):
    """Enter a block into the table of faults, with the promises that must catch it."""

    def enter(cls):
        FAULTS.append((cls, set(names)))
        return cls

    return enter


def known(cls):
    """A sound frame around one fault: documented, and a block that no file knows yet."""
    cls.__doc__ = cls.__doc__ or "Something that is wrong in one way.\n\n.. math:: y = f(u)\n"
    cls.source = cls.__dict__.get("source", "definition")
    cls.symbol = cls.__dict__.get("symbol", "f")
    return block(register=False)(cls)


@pytest.fixture(autouse=True)
def known_to_files(monkeypatch):
    """For the time of a test, files know these blocks."""
    for cls in [*(cls for cls, _ in FAULTS), Good, stiffening]:
        if cls is not UnknownToFiles:
            monkeypatch.setitem(REGISTRY, cls.__name__, cls)


@fault("closes_an_algebraic_loop")
@known
class FineStair(Block):
    u = Input("signal")
    y = Output("the signal in stairs so fine that it rises, whose derivative is zero")

    def outputs(self, t, x, u):
        return dict(y=1e-10 * ca.floor(1e10 * u.u))


# ---- the ten of the style guide


@fault("finite_everywhere", "slopes_are_finite")
@known
class OverflowingSlope(Block):
    a: float = parameter(default=0.9, about="slope while loading")
    b: float = parameter(default=0.95, about="slope while unloading")
    u = Input("rate")
    y = Output("slope")

    def outputs(self, t, x, u):
        e2v = ca.exp(2 * u.u)
        return dict(y=(self.a * e2v + self.b) / (e2v + 1))


@fault("every_parameter_matters")
@known
class FrozenParameter(Block):
    gain: float = parameter(default=2.0, about="gain")
    offset: float = parameter(default=1.0, about="offset")
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=self.fields()["gain"].default * u.u + self.offset)


@fault("slopes_are_finite")
@known
class RootAtRest(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=ca.sqrt(ca.fabs(u.u)))


@fault("equations_cover_what_is_declared")
@known
class StateWithoutRate(Block):
    z: float = state(default=0.0, about="memory")
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=x.z + u.u)


@fault("equations_cover_what_is_declared")
@known
class PythonIf(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u if u.u > 0 else 0.0)


@fault("equations_cover_what_is_declared")
@known
class PythonMathematics(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=math.tanh(u.u))


@fault("finite_everywhere", "slopes_are_finite", "floats_and_symbols_agree")
@known
class PowerOfSigned(Block):
    n: float = parameter(default=1.0217, about="exponent", above=1.0)
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u**self.n)


@fault("floats_and_symbols_agree", "closes_an_algebraic_loop")
@known
class HiddenMemory(Block):
    seen = [0]
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        self.seen[0] += 1
        return dict(y=u.u + self.seen[0])


@fault("documented")
@known
class PortWithoutWords(Block):
    u = Input("")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("is_a_value", "survives_a_file")
@known
class LambdaInside(Block):
    law: object = option(default=lambda u: 2 * u, about="any function")
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=self.law(u.u))


# ---- words


@fault("documented")
@known
class NoSentence(Block):
    """y = f(u)

    .. math:: y = f(u)
    """

    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("documented")
@known
class NoEquation(Block):
    """A sentence and no equation."""

    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("documented")
@known
class NoSource(Block):
    source = ""
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("documented")
@known
class SymbolTooWide(Block):
    symbol = "a long story in a box"
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("units_are_known", "survives_a_file", "closes_an_algebraic_loop")
@known
class UnknownUnit(Block):
    u = Input("in", unit="radd")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("units_are_known")
@known
class UnitOfNoPort(Block):
    limit: float = parameter(default=1.0, about="limit", unit="?v")
    u = Input("in", unit="?u")
    y = Output("out", unit="?u")

    def outputs(self, t, x, u):
        return dict(y=ca.fmin(u.u, self.limit))


# ---- equations


@fault("equations_cover_what_is_declared")
@known
class OutputLeftOut(Block):
    u = Input("in")
    y = Output("out")
    z = Output("other")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("equations_cover_what_is_declared")
@known
class BranchOnParameter(Block):
    gain: float = parameter(default=2.0, about="gain")
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=self.gain * u.u if self.gain > 0 else 0.0)


@fault("equations_cover_what_is_declared")
@known
class VectorOutput(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=ca.vertcat(u.u, u.u))


@fault("every_state_matters")
@known
class StateNobodyReads(Block):
    z: float = state(default=0.0, about="integral")
    u = Input("in")
    y = Output("out")

    def derivatives(self, t, x, u):
        return dict(z=u.u - x.z)

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("every_state_matters")
@known
class StatesThatReadEachOtherOnly(Block):
    a: float = state(default=0.0, about="one")
    b: float = state(default=0.0, about="other")
    u = Input("in")
    y = Output("out")

    def derivatives(self, t, x, u):
        return dict(a=u.u - x.b, b=x.a)

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("every_parameter_matters")
@known
class StartThatIsIgnored(Block):
    z0: float = parameter(default=1.0, about="start of the lag")
    u = Input("in")
    y = Output("out")

    @property
    def states(self):
        return {"z": State(0.0, "the lag")}

    def derivatives(self, t, x, u):
        return dict(z=u.u - x.z)

    def outputs(self, t, x, u):
        return dict(y=x.z)


@fault("every_input_matters")
@known
class InputNobodyReads(Block):
    u = Input("in")
    v = Input("its rate")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


@fault("floats_and_symbols_agree", "closes_an_algebraic_loop")
@known
class RandomOutput(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u + np.random.default_rng().normal())


@fault("floats_and_symbols_agree")
@known
class AnotherWayForNumbers(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=2 * u.u if isinstance(u.u, ca.SX) else 2 * u.u + 1e-6)


@fault("finite_everywhere", "slopes_are_finite", "floats_and_symbols_agree")
@known
class SineOverItself(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=ca.sin(u.u) / u.u)


@fault("slopes_are_finite")
@known
class SlopeOfExponent(Block):
    """Finite at zero, and so is its slope in u; in n it is the logarithm of zero.

    .. math:: y = |u|^n
    """

    n: float = parameter(default=2.0, about="exponent", above=1.0)
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=ca.fabs(u.u) ** self.n)


@fault("fits_a_page")
@known
class TooLong(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        y = u.u
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        y = y + 1
        return dict(y=y)


# ---- values


@fault("refuses_bad_numbers")
@known
class TakesAnything(Block):
    gain: float = parameter(default=2.0, about="gain", above=0.0)
    u = Input("in")
    y = Output("out")

    def __attrs_post_init__(self):
        pass  # and so nothing is checked

    def outputs(self, t, x, u):
        return dict(y=self.gain * u.u)


@fault("is_a_value")
@known
class TableInside(Block):
    table: object = option(default={"a": 1.0}, about="something that can be changed in place")
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=self.table["a"] * u.u)


@fault("works_as_it_comes")
@known
class RefusesItsDefaults(Block):
    low: float = parameter(default=1.0, about="lower limit")
    high: float = parameter(default=-1.0, about="upper limit")
    u = Input("in")
    y = Output("out")

    def check(self):
        if self.low >= self.high:
            raise BlockError(f"RefusesItsDefaults needs low < high, got low={self.low:g}, high={self.high:g}.")

    def outputs(self, t, x, u):
        return dict(y=ca.fmin(ca.fmax(u.u, self.low), self.high))


@fault("tapes_are_supplied")
@known
class TapeThatIsMissing(Block):
    w = Tape("noise")
    y = Output("noise")

    def outputs(self, t, x, u):
        return dict(y=u.w)


@fault("tapes_are_supplied")
@known
class TapeThatIsNeverTheSame(Block):
    w = Tape("noise")
    y = Output("noise")

    def tapes(self, start, stop, name=""):
        t = np.arange(start, stop + 0.1, 0.1)
        return {"w": Samples(t, np.random.default_rng().normal(size=len(t)), "zero")}

    def outputs(self, t, x, u):
        return dict(y=u.w)


@fault("survives_a_file")
@known
class UnknownToFiles(Block):
    u = Input("in")
    y = Output("out")

    def outputs(self, t, x, u):
        return dict(y=u.u)


# ---- sound ones


@block(register=False)
class Good(Block):
    r"""Stiffening spring behind a lag.

    .. math:: \dot z = (u - z) / T, \qquad y = k z + k_3 z^3
    """

    source = "Duffing (1918)"
    symbol = "k z + k₃ z³"

    k: float = parameter(default=1.0, about="linear stiffness", unit="N/m", at_least=0.0)
    k3: float = parameter(default=0.3, about="cubic stiffness", unit="N/m^3")
    time_constant: float = parameter(default=0.1, about="time constant of the lag", unit="s", above=0.0)

    u = Input("stretch wanted", unit="m")
    y = Output("force", unit="N")
    z: float = state(default=0.0, about="stretch", unit="m")

    def derivatives(self, t, x, u):
        return dict(z=(u.u - x.z) / self.time_constant)

    def outputs(self, t, x, u):
        return dict(y=self.k * x.z + self.k3 * x.z**3)


@function_block(register=False, units={"u": "rad", "y": "rad"})
def stiffening(u, k=0.3):
    """The output grows with the cube of the input."""
    return k * u**3


def instance(cls):
    """A block of the class, though it refuses its own defaults."""
    try:
        return cls()
    except BlockError:
        return cls(low=-1.0, high=1.0)


@pytest.mark.parametrize(("cls", "names"), FAULTS, ids=lambda v: getattr(v, "__name__", ""))
def test_the_fault_is_caught(cls, names):
    found = broken_promises(instance(cls))
    assert names <= set(found)
    said = [text for name, text in found.items() if name in names]
    assert all(cls.__name__ in text or "block.u" in text for text in said)


@pytest.mark.parametrize(("cls", "names"), FAULTS, ids=lambda v: getattr(v, "__name__", ""))
def test_no_promise_is_broken_that_the_fault_leaves_whole(cls, names):
    """A block whose equations can be formed breaks only the promises named; otherwise all that need them."""
    found = set(broken_promises(instance(cls)))
    formed = "equations_cover_what_is_declared" not in found
    assert found == names or not formed


@pytest.mark.parametrize("check", [*checks_for(Good()), *checks_for(Good(k3=-2.0)), *checks_for(stiffening())], ids=str)
def test_a_sound_block_keeps_every_promise(check):
    check()


def test_every_promise_catches_something():
    assert set().union(*(names for _, names in FAULTS)) == set(PROMISES)


def test_a_broken_promise_is_said_in_words():
    check = next(c for c in checks_for(RootAtRest()) if c.name == "slopes_are_finite")
    with pytest.raises(BrokenPromise) as caught:
        check()
    assert str(caught.value) == "a derivative of RootAtRest y.y is not finite at x=[], u=[0.]."


def test_the_length_of_a_class_typed_at_a_prompt_is_not_checked():
    source = inspect.getsource(Good).partition("\n")[2]  # without its decorator
    scope = {**globals(), "__name__": __name__}
    exec(compile(source, "<stdin>", "exec"), scope)
    typed = block(register=False)(scope["Good"])()
    with pytest.raises(OSError, match="could not get source code"):
        inspect.getsource(type(typed).outputs)
    assert "fits_a_page" not in broken_promises(typed)


# ---- what cannot even be declared


def test_a_default_outside_its_own_bounds_is_refused_where_it_is_declared():
    with pytest.raises(BlockError, match=r"the default of Wrong\.gain must lie in \(0, inf\), got -1\."):

        @block(register=False)
        class Wrong(Block):
            gain: float = parameter(default=-1.0, about="gain", above=0.0)


def test_a_block_whose_ports_collide_is_refused_where_it_is_read():
    @block(register=False)
    class Wrong(Block):
        y = Output("out")

        @property
        def inports(self):
            return {"y": Input("in")}

        def outputs(self, t, x, u):
            return dict(y=u.y)

    with pytest.raises(BlockError, match=r"^broken_promises takes a block, got the class Wrong: write Wrong\(\).$"):
        broken_promises(Wrong)
    found = broken_promises(Wrong())
    assert "Wrong.y is used twice" in found["equations_cover_what_is_declared"]
    with pytest.raises(EquationError):
        raise EquationError(found["equations_cover_what_is_declared"])
