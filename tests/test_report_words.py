"""What a report says to one who reads it for the first time: reasons, units, places, cautions, noise floors."""

import html
import json
import re

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tests.diagnoses import BACKLASH, DEG, LIMITS, NAMED, NONE, UNKNOWN, diagnosis, ranked
from tsmblocks.blocks import Play
from tsmblocks.common.tables import as_wide_as
from tsmblocks.data.noise_floor import Noise
from tsmblocks.diagnosis import presentation, verdict_text
from tsmblocks.diagnosis import text as text_of_diagnosis
from tsmblocks.diagnosis.cautions import cautions
from tsmblocks.diagnosis.detectable_sizes import limit_text
from tsmblocks.diagnosis.model_difference import difference, in_code
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.residual_location import words_for
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.segment import DetectionLimit, Quantity
from tsmblocks.diagnosis.settings import FloorParts
from tsmblocks.diagnosis.variants import VARIANT_WORDS, explained, parts_of
from tsmblocks.effects import catalogue
from tsmblocks.effects.catalogue import relatives
from tsmblocks.fitting.identifiability import Undetermined
from tsmblocks.fitting.text import estimate_cautions
from tsmblocks.html.report import page

ROWS = (
    ranked("backlash", 0.9, named=True, in_set=True),
    ranked("hysteresis", 0.9, in_set=True, why_not="indistinguishable"),
    ranked("resonance", 1.0, variant="parallel", why_not="ends at a bound (zeta)", at_bound=("zeta",)),
    ranked("jump", 0.3, variant="drive, separate sizes and times", why_not="not significant"),
    ranked("drift", 0.4, variant="separate sizes", why_not="not significant"),
)
SEEN = attrs.evolve(NAMED, ranking=ROWS)


def of(segment):
    return attrs.evolve(diagnosis(), segments=(segment,))


def test_candidates_come_in_the_order_of_what_they_removed_and_those_at_a_bound_are_among_them():
    with as_wide_as(80):
        text = of(SEEN).details()
    (table,) = [part for part in text.split("\n\n") if part.startswith("candidates, round 1")]
    names = [line[2:].split("  ")[0].strip() for line in table.splitlines()[2:7]]
    assert names[:4] == ["resonance (parallel)", "backlash", "hysteresis", "drift (separate sizes)"]
    assert names[4] == "jump (drive, separate sizes and times)"
    reasons = table[table.index("why not named:") : table.index("\nVariants:")].replace("\n  ", " ").splitlines()
    assert reasons == [
        "why not named:",
        "- ends at a bound (zeta): resonance (parallel)",
        "- not significant: drift (separate sizes), jump (drive, separate sizes and times)",
    ]


def test_a_wide_terminal_has_the_reasons_in_a_column():
    with as_wide_as(120):
        text = of(SEEN).details()
    (table,) = [part for part in text.split("\n\n") if part.startswith("candidates, round 1")]
    head, first, *_ = table.splitlines()[1:]
    assert head.endswith("  why not")
    assert first.split("  ")[-1] == "ends at a bound (zeta)"
    assert "why not named:" not in table


def test_variants_are_explained_once_below_the_table_in_which_they_are_first():
    later = attrs.evolve(SEEN, ranking=(*SEEN.ranking, *(attrs.evolve(r, round=2) for r in SEEN.ranking)))
    words = (
        "Variants: parallel: driven by the input and added to the output of the model; separate sizes: one size for "
        "each recording; drive: on the signal that drives the plant; separate sizes and times: one size, at one "
        "instant, for each recording."
    )
    with as_wide_as(100):
        first, second = (part for part in of(later).details().split("\n\n") if part.startswith("candidates, round"))
    assert words in " ".join(first.split())
    assert "Variants:" not in second
    shown = re.sub("<[^>]*>", "", page(of(later)))
    assert shown.count(words) == 1
    assert "Variants:" not in diagnosis().details()


@pytest.mark.parametrize("effect", [*catalogue(), *relatives()], ids=lambda one: f"{one.name} {one.variant}")
def test_every_variant_of_the_catalogue_is_explained(effect):
    """A variant has words, or its name is in the words of the effect."""
    row = attrs.evolve(SEEN.ranking[0], name=effect.name, variant=effect.variant, words=effect.words)
    said = explained([row], set())
    for part in parts_of(effect.variant):
        assert part in VARIANT_WORDS or part in effect.words
        assert f"{part}: {VARIANT_WORDS.get(part)}" in said or part in effect.words


def test_a_variant_of_a_users_own_effect_is_explained_by_the_words_of_the_effect():
    row = attrs.evolve(SEEN.ranking[0], name="cushion", variant="rubber", words="a soft stop")
    assert explained([row], set()) == "Variants: rubber: a soft stop."


def test_the_page_has_for_every_candidate_its_reason_and_what_it_is():
    rows = (attrs.evolve(ROWS[0], words="a backlash gap"), *ROWS[1:])
    text = page(of(attrs.evolve(NAMED, ranking=rows)))
    table = text[text.index("named, or why not") :].split("</table>")[0]
    cells = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL) for row in table.split("<tr")[1:]]
    assert [row[4] for row in cells] == [
        "ends at a bound (zeta)",
        "named",
        "indistinguishable",
        "not significant",
        "not significant",
    ]
    assert cells[1][7] == "a backlash gap"


def test_where_nothing_is_above_the_noise_a_table_has_no_shares_of_it():
    line = "The error is within the noise: there is nothing above the noise floor to remove."
    within = attrs.evolve(NONE, ranking=tuple(attrs.evolve(r, share=np.nan, new=np.nan, named=False) for r in ROWS))
    with as_wide_as(100):
        text = of(within).details()
    assert re.search(r"\n~ backlash  +offset.y -> x_out +- +9.5", text)
    assert text.count(line) == 1
    shown = page(of(within))
    assert shown.count(line) == 1
    table = shown[shown.index("named, or why not") :].split("</table>")[0]
    assert "%" not in table
    some = attrs.evolve(within, ranking=(ROWS[-1], *within.ranking[:-1]))
    assert line not in of(some).details()
    assert line not in page(of(some))


def test_of_many_parameters_the_page_lists_some():
    values = {f"time@rec{k}": float(k) for k in range(9)}
    one = ranked("jump", 0.3, parameters=values, why_not="not significant")
    text = page(of(attrs.evolve(NAMED, ranking=(ROWS[0], one))))
    assert "time@rec4 4</span><br><small>and 4 more</small>" in text
    assert "time@rec5" not in text
    few = attrs.evolve(one, parameters=dict(list(values.items())[:6]))
    assert "time@rec5 5</span></td>" in page(of(attrs.evolve(NAMED, ranking=(ROWS[0], few))))


def test_the_best_of_an_unexplained_error_has_its_name_and_its_reason():
    rows = (ranked("dead_time", 0.24, why_not="not significant"), ranked("lag", 1.0, why_not="ends at a bound (time)"))
    text = verdict_text.verdict_sentence(attrs.evolve(UNKNOWN, ranking=rows))
    assert "the best, lag, removes 100 % of the variance above the noise floor (ends at a bound (time))." in text
    worse = attrs.evolve(UNKNOWN, ranking=(ranked("dead_time", -0.1),))
    assert "does not explain: none removes any of the variance above the noise floor." in verdict_text.verdict_sentence(
        worse
    )


def test_a_place_that_is_not_determined_is_said():
    effect = attrs.evolve(BACKLASH, also_possible=(), other_places=("x_in -> gain.u",))
    text = verdict_text.verdict_sentence(attrs.evolve(NAMED, effects=(effect,)))
    assert " The place of backlash is not determined: it explains as much on x_in -> gain.u. With it," in text
    both = (effect, attrs.evolve(effect, block="backlash_2"))
    text = verdict_text.verdict_sentence(attrs.evolve(NAMED, effects=both))
    assert f" The places of {effect.block} and backlash_2 are not determined: they explain as much on other" in text
    made = attrs.evolve(diagnosis(), effects=(effect,))
    assert json.loads(made.to_json())["effects"][0]["other_places"] == ["x_in -> gain.u"]


def test_the_parts_of_a_noise_floor_and_what_each_recording_shows_are_said_everywhere():
    (gap,) = NAMED.gaps
    own = {
        "full": Noise("x_out", "rad", 0.06 * DEG, None, "stand-still", 400, 190, 0.05 * DEG, 0.08 * DEG),
        "half": Noise("x_out", "rad", 0.05 * DEG, None, "high frequencies", 400, 100, 0.04 * DEG),
    }
    parts = FloorParts(0.06 * DEG, 0.05 * DEG, 0.08 * DEG, 0.08 * DEG, own)
    segment = attrs.evolve(NAMED, gaps=(attrs.evolve(gap, method="stand-still", parts=parts),))
    words = (
        "oise floor 0.0600 deg rms (95 %: 0.0500 to 0.0800), from stand-still: the noise while the mechanism stands "
        "still. The noise of the inputs adds 0.0800 deg rms to the simulated x_out: 0.100 deg rms together."
    )
    found = of(segment)
    with as_wide_as(200):
        text = found.details()
    assert f"n{words}" in text.replace("\n", " ")
    assert re.search(r"\nnoise of x_out alone \[deg\] +rms  95 % low +high  method\nfull +0.0600 +0.0500 +0.08", text)
    assert "\nhigh frequencies: fast noise only; slow noise is not included." in text
    shown = html.unescape(re.sub("<[^>]*>", "", page(found))).replace("\xa0", " ")
    assert f"N{words}" in shown
    assert "half0.05000.0400-high frequencies" in shown
    saved = json.loads(found.to_json())["gap"]["noise_floor_parts"]
    assert saved["recordings"]["half"]["high"] is None
    assert saved["from_inputs"] == pytest.approx(0.08 * DEG, rel=1e-5)


def test_a_noise_floor_is_explained_by_what_it_contains():
    (gap,) = NAMED.gaps
    fast = attrs.evolve(gap, method="high frequencies", held_out=(0.52 * DEG, 0.3 * DEG))
    segment = attrs.evolve(NAMED, gaps=(fast,))
    assert (
        "That is 3.0 times the noise floor of 0.100 deg (from high frequencies: fast noise only; slow noise is not "
        "included), but no function of the recorded signals that was tried predicts it on held-out data: it is noise "
        "of that spectrum, or a model error of a form that was not tried."
    ) in verdict_text.verdict_sentence(segment)
    with as_wide_as(100):
        text = of(segment).details()
    assert text.startswith("noise floor from high frequencies: fast noise only")
    assert re.search(r"\nnoise floor \(high frequencies\) +0.100\n", str(of(segment)))
    assert "Noise floor 0.100 deg (from high frequencies: fast noise only; slow noise is not included)." in page(
        of(segment)
    )
    assert presentation.floor_text(gap) == "given"
    assert presentation.floor_text(attrs.evolve(fast, given="0.1 deg given")) == "0.1 deg given"


def test_the_share_removed_is_that_of_the_numbers_printed():
    left = attrs.evolve(NAMED.gaps[0], held_out=(0.52 * DEG, 0.17 * DEG))
    effect = attrs.evolve(BACKLASH, share_removed=1.0)
    text = verdict_text.verdict_sentence(attrs.evolve(NAMED, gaps=(left,), complete=False, effects=(effect,)))
    assert "falls from 0.520 to 0.170 deg rms (noise floor 0.100), by 93 % of the variance above the noise" in text
    assert "That is still 1.7 times the noise floor" in text


@pytest.mark.parametrize(
    ("value", "shown"),
    [(2980.4, "2980"), (52.01, "52.0"), (1234567.0, "1.23e+06"), (-45678.0, "-45700"), (1e-5, "1.00e-05")],
)
def test_numbers_are_written_as_engineers_write_them(value, shown):
    assert presentation.digits(value) == shown


def test_sizes_and_intervals_have_no_powers_of_ten_either():
    assert presentation.in_display_units(2980.4, "V") == "2980 V"
    assert presentation.with_interval(Quantity(2980.4, 2640.0, 3320.8, "V")) == "2980 ± 340 V"
    assert presentation.with_interval(Quantity(2.98e6, 2.64e6, 3.32e6, "V")) == "(2.98 ± 0.34)e6 V"


def test_detection_limits_in_the_file_are_those_of_the_text_and_have_their_units():
    kept = diagnosis().to_dict()
    assert kept["detection_limits"]["backlash"] == pytest.approx(0.02 * DEG, rel=1e-5)
    assert kept["detection_limit_sizes"] == {
        "backlash": {"name": "gap width", "value": 0.04, "unit": "deg"},
        "drift": {"name": "rate", "value": 1e-05, "unit": ""},
        "coulomb_friction": None,
        "offset": None,
    }
    (limits,) = [s["detection_limits"] for s in kept["segments"]]
    assert limits["backlash"]["unit"] == "rad"
    assert limit_text(LIMITS[0]) == "gap width 0.04 deg"
    assert limit_text(DetectionLimit("lag", "tau", -0.5, "s", "")) == "tau 0.5 s"


def test_the_noise_of_the_sensor_is_asked_for_in_the_words_of_the_command_and_of_python():
    high = attrs.evolve(NONE.gaps[0], held_out=(0.5 * DEG,), method="high frequencies", given="")
    steps = next_steps(attrs.evolve(NONE, gaps=(high,)))
    assert any("(--noise-floor, in Python noise_floor)" in one for one in steps)


# ---- cautions on initial states


def pieces(count, samples=40):
    """Short recordings of a lag with noise: their initial states are hardly determined."""
    rng = np.random.default_rng(0)
    t = np.arange(samples) * 0.01
    made = {}
    for k in range(count):
        u = np.sin(3 * t + k)
        y = u + 0.5 * rng.standard_normal(samples)
        made[f"rec1#{k + 1}"] = tsm.Record(f"rec1#{k + 1}", t, {"u": u, "y": y}, {"u": "1", "y": "1"})
    return made


@pytest.fixture(scope="module")
def lag_fit():
    lag = tsm.Diagram(blocks={"lag": tsm.blocks.FirstOrderLag()}, inputs={"u": "lag.u"}, outputs={"y": "lag.y"})
    return tsm.fit(lag, pieces(6), start_states=True, starts=1)


def undetermined(*names):
    return Undetermined(
        "combination", names, (1.0,) * len(names), 1e-4, f"{' and '.join(names)} are indistinguishable."
    )


def test_cautions_on_many_initial_states_are_one(lag_fit):
    lone = attrs.evolve(lag_fit, undetermined=())
    few = [undetermined(f"lag.value@rec1#{k}", f"lag.value@rec1#{k + 1}") for k in (1, 2)]
    assert cautions(attrs.evolve(lone, undetermined=tuple(few)), {}) == [
        "The initial value of lag.value is poorly determined in 3 of the 6 pieces."
    ]
    mixed = undetermined("lag.time_constant", "lag.value@rec1#5")
    many = attrs.evolve(lone, undetermined=(*few, mixed), active=("the lower bound of lag.value@rec1#2 (0)",))
    assert cautions(many, {}) == [
        "lag.time_constant and some initial states are determined only together.",
        "The initial value of lag.value is poorly determined in 3 of the 6 pieces.",
    ]
    two = attrs.evolve(lone, undetermined=(mixed, *(undetermined(f"lag.value@rec1#{k}") for k in (2, 5))))
    worse = attrs.evolve(two, active=("the lower bound of lag.value@rec1#2 (0)",))
    assert cautions(worse, {})[1:] == [
        "The initial value of lag.value is poorly determined in piece 2 of rec1 and piece 5 of rec1."
    ]
    pairs = tuple(undetermined(f"lag.value@rec1#{k}", f"lag.value@rec1#{k + 1}") for k in (1, 3, 5))
    (said,) = cautions(attrs.evolve(many, undetermined=pairs), {})
    assert said == "The initial value of lag.value is poorly determined in each of the 6 pieces."


def test_correlations_are_those_of_the_effects(lag_fit):
    """Each throttle had four lines on its own parameters, which do not bear on the verdict."""
    lone = attrs.evolve(lag_fit, undetermined=())
    shared = [k for k, name in enumerate(lone.names) if "@" not in name]
    covariance = np.diag(np.diag(lone.covariance))
    first, second = shared[:2]
    covariance[first, second] = covariance[second, first] = 0.99 * np.sqrt(
        covariance[first, first] * covariance[second, second]
    )
    close = attrs.evolve(lone, covariance=covariance)
    words = "lag.gain and lag.time_constant are hard to distinguish (correlation +0.990)."
    assert words in estimate_cautions(close)
    assert words not in cautions(close, {})
    assert words in cautions(close, {"lag": None})


def test_cautions_on_initial_states_of_whole_recordings_name_these(lag_fit):
    def renamed(text):
        return text.replace("rec1#", "run")

    estimates = tuple(attrs.evolve(e, name=renamed(e.name)) for e in lag_fit.estimates)
    records = {renamed(name): record for name, record in lag_fit.records.items()}
    vague = tuple(undetermined("lag.value@run1", f"lag.value@run{k}") for k in (2, 3, 4))
    fit = attrs.evolve(lag_fit, estimates=estimates, records=records, undetermined=vague)
    assert cautions(fit, {}) == [
        "The initial value of lag.value is poorly determined in 4 of the 6 experiments (run1, run2 and 2 more)."
    ]


def test_parameters_and_cautions_of_several_parts_name_the_part(lag_fit):
    own = attrs.evolve(lag_fit, undetermined=(), active=("the upper bound of lag.time_constant (1)",))
    parts = [attrs.evolve(NONE, name=name, fit=own) for name in ("u -> y", "y -> z")]
    both, alone = diagnosis(*parts), diagnosis(parts[0])
    assert re.findall("^(beware.*):$", str(both), re.MULTILINE) == ["beware in u -> y", "beware in y -> z"]
    assert re.findall("^(fitted parameters of .*):$", both.details(), re.MULTILINE) == [
        "fitted parameters of the diagram in u -> y",
        "fitted parameters of the diagram in y -> z",
    ]
    assert "\nbeware:\n" in str(alone)
    assert "\nfitted parameters of the diagram:\n" in alone.details()


def test_cautions_come_before_the_errors(lag_fit):
    at = attrs.evolve(lag_fit, undetermined=(), active=("the upper bound of lag.time_constant (1)",))
    shown = page(diagnosis(attrs.evolve(NAMED, fit=at)))
    assert shown.index("ended at the upper bound of lag.time_constant") < shown.index("Error before and after</h2>")
    two = page(diagnosis(attrs.evolve(NAMED, fit=at), attrs.evolve(NONE, name="r -> u", fit=at)))
    assert two.count("Beware in x_in") == two.count("Beware in r") == 1


def test_a_bound_that_was_reached_is_said_in_plain_words(lag_fit):
    at = attrs.evolve(lag_fit, undetermined=(), active=("the upper bound of lag.time_constant (1)",))
    assert estimate_cautions(at) == [
        "The fit ended at the upper bound of lag.time_constant (1): a better one may lie beyond it."
    ]


def test_a_script_has_the_step_without_the_rounding_of_time_stamps():
    found = diagnosis()
    rounded = dict.fromkeys(found.simulated.steps, 0.00799999999999912)
    lines = "\n".join(script_lines(attrs.evolve(found, simulated=attrs.evolve(found.simulated, steps=rounded))))
    assert ", step=0.008, " in lines
    rounded["half"] = 0.0040000000000003
    lines = "\n".join(script_lines(attrs.evolve(found, simulated=attrs.evolve(found.simulated, steps=rounded))))
    assert "step={'full': 0.008, 'half': 0.004}[name]" in lines


def test_initial_states_are_no_changes_to_a_diagram():
    before = tsm.load("tendon_sheath_play").with_parameters({"play.m": 0.1, "play.half_width": 0.2})
    after = before.with_parameters({"play.m": 0.3, "play.half_width": 0.25})
    after = after.insert("gap", Play(half_width=0.1, m=0.05), before="x_out")
    found = difference(before, after)
    assert [one.name for one in found.parameters] == ["play.half_width"]
    assert found.added == {"gap": "Play(half_width=0.1)"}
    assert in_code(after.blocks["gap"]) == "Play(half_width=0.1, m=0.05)"


@pytest.mark.parametrize(
    ("text", "of_a_motion", "of_a_voltage"),
    [
        ("the error depends on the position", "the error depends on the position", "the error depends on u"),
        ("the error depends on the speed", "the error depends on the speed", "the error depends on the rate of u"),
        ("position", "position", "u"),
        ("acceleration", "acceleration", "second derivative of u"),
        ("with the sign of the direction", "with the sign of the direction", "with the sign of the direction of u"),
        ("session time", "time", "time"),
    ],
)
def test_coordinates_of_a_voltage_are_not_called_those_of_a_motion(text, of_a_motion, of_a_voltage):
    assert words_for(text, "u", "deg") == words_for(text, "u", "mm") == words_for(text, "", "") == of_a_motion
    assert words_for(text, "u", "ticks") == words_for(text, "u", "1") == of_a_motion
    assert words_for(text, "u", "V") == of_a_voltage


def test_long_names_in_headings_are_broken_after_an_underscore_and_never_cut():
    headings, long = text_of_diagnosis._headings, ["before", "+ position_ripple", "+ jump"]
    assert headings(long, 40) == ([long], True)
    assert headings(long, 30) == ([["", "+ position_", ""], ["before", "ripple", "+ jump"]], True)
    assert headings(long, 20)[1] is False
    short = ["held-out before", "+ dead_zone", "in-sample after"]
    assert headings(short, 36) == ([["held-out", "", "in-sample"], ["before", "+ dead_zone", "after"]], True)


def test_a_round_that_was_repeated_beside_effects_that_were_named_later_says_so():
    def heading(wire):
        rows = [attrs.evolve(r, wire=wire) if r.round == 1 and r.named else r for r in NAMED.ranking]
        effects = (*NAMED.effects, attrs.evolve(NAMED.effects[0], name="drift", block="drift"))
        text = of(attrs.evolve(NAMED, ranking=tuple(rows), effects=effects)).details()
        return next(line for line in text.splitlines() if line.startswith("candidates, round 1"))

    assert heading("play.y -> drift.u").endswith("; beside the effects named later):")
    assert "beside" not in heading("drifting.y -> x_out")
