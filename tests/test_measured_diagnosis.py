"""Measured machines diagnosed: what the literature says is missing is named first, and unseen data are foretold.

Each example runs with a few candidates; ``-m slow`` runs it as it stands, with the whole catalogue.
"""

import contextlib
import io
import re
import runpy
import sys
from functools import partial
from pathlib import Path

import pytest

import tsmblocks as tsm

SLOW_NEEDS = ["diagnosis", "diagrams/tendon_sheath_*", "examples/2[2-5]_*"]
FOLDER = Path(__file__).parents[1] / "examples"
WHOLE = pytest.param(None, marks=pytest.mark.slow, id="whole catalogue")


def said_by(name, effects):
    """What an example prints, run by itself, with some ``effects`` as candidates, and the names it leaves behind."""
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patched, contextlib.redirect_stdout(said):
        patched.setattr(sys, "argv", [name])
        if effects is not None:
            patched.setattr(tsm, "diagnose", partial(tsm.diagnose, effects=effects))
        found = runpy.run_path(str(FOLDER / name))
    return said.getvalue(), found


def numbers(text):
    return [float(x) for x in re.findall(r"\d+\.\d+", text)]


def few(*effects):
    """A fixture's parameters: some effects, and the whole catalogue."""
    return dict(scope="module", params=[pytest.param(effects, id=f"{len(effects)} effects"), WHOLE])


@pytest.fixture(**few("backlash", "creep"))
def sheath(measured, request):
    return said_by("22_tendon_sheath_diagnosed.py", request.param)[0]


@pytest.fixture(**few("coulomb_friction", "asymmetric_friction", "presliding_friction"))
def axis(measured, request):
    return said_by("23_emps_diagnosed.py", request.param)


@pytest.fixture(**few("overflow", "saturation"))
def tanks(measured, request):
    return said_by("24_tanks.py", request.param)


@pytest.fixture(**few("odd_nonlinearity", "rate_limit"))
def oscillator(measured, request):
    return said_by("25_silverbox.py", request.param)


def rows(sheath, model):
    """Bend, rms before and after (fitted, held out, second cycle), the names, and what else the first may be."""
    part = next(p for p in sheath.split("\n\n") if p.strip().startswith(model))
    return [
        (int(bend), numbers(figures), names.split(", "), also)
        for bend, figures, names, also in re.findall(
            r"^ *(\d+) deg +([\d. >-]+)\n +missing: (.*)\n +the first may also be: (.*)$", part, re.M
        )
    ]


def test_a_gap_is_named_first_on_every_bend_and_foretells_the_second_cycle(sheath):
    found = rows(sheath, "tendon_sheath_linear")
    assert [bend for bend, _, _, _ in found] == [0, 60, 120, 180, 240]
    known = [1.12, 1.36, 1.25, 0.95, 0.75]  # play fitted by earlier work, on the first of the rows that repeat a time
    for (_, (before, after, held_before, held_after, *later), names, _), best in zip(found, known, strict=True):
        assert names[0] == "backlash"
        assert after <= best
        assert held_after < 1.4 < 6.0 < before < held_before
        assert later[1] < 1.25 < 7.0 < later[0]


def test_the_model_of_the_paper_lacks_the_flat_tops_of_a_gap(sheath, request):
    """A gap with rounded corners takes the place of its loop, or is indistinguishable from what does."""
    found = rows(sheath, "tendon_sheath_asymmetric")
    whole = request.node.callspec.params["sheath"] is None
    assert [bend for bend, _, _, _ in found] == [0, 120]
    for _, (before, after, held_before, held_after), names, also in found:
        assert names[0].endswith("hysteresis" if whole else "backlash")
        assert not whole or "hysteresis" in (names[0], *also.split(", "))
        assert after < before / 2
        assert held_after < held_before / 2


def test_the_axis_rubs_as_published(axis):
    said, found = axis
    assert [e.name for e in found["found"].effects][:2] == ["coulomb_friction", "asymmetric_friction"]
    base, augmented = (numbers(line) for line in re.findall(r"^(?:base|augmented) .*$", said, re.M))
    assert base == pytest.approx([17.12, 17.14, 16.48], abs=0.05)
    strokes, second, pulses = augmented
    assert strokes < 3.11  # published for asymmetric friction, fitted to both strokes
    assert second < 3.11
    assert pulses < 4.3  # published for symmetric friction: 5.98


def test_friction_of_the_axis_is_the_published_one(axis):
    """In the diagram it stands as an acceleration; times the mass it is the force."""
    known = axis[1]["found"].augmented.parameters
    level = sum(known[k] for k in known if k in ("coulomb_friction.friction.level", "presliding_friction.level.gain"))
    assert level * known["mass.value"] == pytest.approx(20.4, abs=0.6)


def test_the_tanks_run_over_first(tanks):
    said, found = tanks
    effects = found["found"].effects
    assert [(e.name, e.family) for e in effects[:2]] == [("overflow", "vessel")] * 2
    assert "inflow" in found["found"].augmented.blocks  # what is spilt above is caught below
    before, after = numbers("".join(re.findall(r"validation, \w+: [\d.]+\n", said)))
    assert before == pytest.approx(0.589, abs=0.002)
    assert after < 0.27  # published: linear 0.75, black boxes 0.33 to 0.45


def test_a_cubic_spring_is_named_first_and_foretells_the_arrow(oscillator):
    said, found = oscillator
    first = found["found"].effects[0]
    assert (first.name, first.words) == ("odd_nonlinearity", "a cubic spring")
    before, after = numbers(re.search(r"arrow(.*)\(", said)[1])
    assert before == pytest.approx(14.18, abs=0.05)
    assert after < 0.45  # published: 2.4 to 2.8 mV
