"""The report of a diagnosis: its text to the letter, its page, its charts, its figures, the files that are written."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import html
import itertools
import json
import re

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.diagnoses import BACKLASH, DEG, LIMITS, NAMED, NOISE, NONE, NOTES, UNKNOWN, diagnosis, ranked, trace
from tests.pages import Page
from tsmblocks.blocks import Gain, Play
from tsmblocks.common.errors import TsmError
from tsmblocks.diagnosis import candidate_tables, verdict_text
from tsmblocks.diagnosis import presentation as showing
from tsmblocks.diagnosis.merged_notes import merged_notes
from tsmblocks.diagnosis.model_difference import difference, in_code
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.rejection import NOT_ACCEPTED
from tsmblocks.diagnosis.segment import InputNoiseRms, Quantity
from tsmblocks.diagnosis.shift_in_time import SHIFT_IN_TIME
from tsmblocks.html import charts, figures
from tsmblocks.html.pages import style
from tsmblocks.html.report import page
from tsmblocks.html.report_files import written

CSS = style("page.css")
TOLD = """\
NAMED. Unmodelled effect between x_in and x_out: a backlash gap (backlash on
offset.y -> x_out, gap width 1.000 ± 0.040 deg). Also possible: hysteresis. With
it, the error of x_out on held-out data falls from 0.520 to 0.104 deg rms (noise
floor 0.100), by 100 % of the variance above the noise floor.

backlash:
  gap width  1.000 ± 0.040 deg

Tendon sheath: a gain and an offset: 2 experiments

                     held-out              in-sample  in-sample
rms of x_out [deg]     before  + backlash     before      after
all                     0.520       0.104      0.500      0.100
full                    0.530       0.105      0.505     0.0914
half                    0.510       0.103      0.510      0.101
noise floor (given)     0.100

what predicts the residual of the base model:
- 90 % of the variance above the noise floor: the sign of the error depends on
  the direction.

changes from the fitted base model:
+ backlash = Play(half_width=0.00872665)
- offset => x_out
+ offset -> backlash.u
+ backlash => x_out
~ gain.gain  0.920 -> 0.910
~ offset.bias  0 -> 0.0100 deg

indistinguishable effects:
- backlash is indistinguishable from hysteresis with these data. To separate
  them: two amplitudes, minor loops, or an odd multisine.

simulated tracking of full, with the augmented model as the plant:
error [deg]                           peak to peak    rms
without compensation                          20.0   7.00
compensator from the base model               2.00  0.600
compensator from the augmented model          1.00  0.300

notes:
- all experiments: x_in was filtered with zero phase, cut-off 9.5–12 Hz (chosen
  from its spectrum); 0.06–0.061 deg rms was removed.
- half: x_in was held constant where it moves no more than its noise (3 % of the
  samples).
- the plant was started anew.
- Random seed 3; the search was completed.

Details, with --details or found.details(): noise floors, candidates, parameters
with intervals, detection limits, a script."""
DETAILS = """\
candidates, round 1 (* named, ~ indistinguishable from it; critical t: 2.0):
  candidate   on                 removes  new exp.    t
* backlash    offset.y -> x_out     98 %      98 %  9.5
~ hysteresis  offset.y -> x_out     98 %      98 %  9.5
  dead_time   offset.y -> x_out    < 0 %      10 %  9.5
Other candidates, screened out or with a smaller reduction: 1.

candidates, round 2 (none named; critical t: 2.0):
  candidate  on                 removes  new exp.    t
  dead_time  offset.y -> x_out     20 %      20 %  9.5

removes: share of the variance above the noise floor that is removed from
held-out time blocks (new exp.: whole experiments); < 0 %: the residual grows.
t: t-statistic of the reduction; critical t: value that the largest t of a round
exceeds by chance in 5 % of cases. The reduction also has to exceed that of
surrogate noise.

backlash, parameters of its block:
  half_width  0.500 ± 0.020 deg

detection limits of further effects:
  backlash  gap width 0.04 deg
  drift     rate 1e-05

not testable with these data:
- absorbed by parameters of the model: offset (acts as offset.bias, 1 deg per
  deg)
- not excited by these experiments: coulomb_friction

The errors reported are those of simulations from initial states estimated for
each experiment: found.start_states, and start_states in diagnosis.json;
found.diagrams has a diagram for each.

in a script:
  import tsmblocks as tsm
  from tsmblocks.blocks import Play

  diagram = tsm.load('tendon_sheath_linear')
  diagram = diagram.with_parameters({
      'gain.gain': 0.91,
      'offset.bias': 0.00017453292519943296,
  })
  diagram = diagram.insert('backlash', Play(half_width=0.008726646259971648), after='offset.y')

  # recordings: the diagnosed records by experiment, as tsm.read returns them
  start_states = {
      'full': {'backlash.m': 0.1},
      'half': {'backlash.m': -0.2},
  }
  for name, record in recordings.items():
      made = record.conditioned(['x_in'])
      print(tsm.score(diagram, {name: made}, parameters=start_states[name], outputs=['x_out'], step=0.01, hold='auto'))"""


# ---- in words


def test_a_diagnosis_is_told_in_this_order():
    assert str(diagnosis()) == TOLD
    assert diagnosis().details() == DETAILS


def test_of_many_experiments_a_summary_has_those_with_the_largest_errors():
    (gap,) = NAMED.gaps
    many = {f"run{k:02}": (0.5 * DEG, (0.1 + 0.01 * (7 * k % 20)) * DEG) for k in range(20)}
    segment = attrs.evolve(NAMED, gaps=(attrs.evolve(gap, experiments=many),))
    table = next(part for part in str(diagnosis(segment)).split("\n\n") if "rms of x_out [deg]" in part)
    shown = re.findall("^run(..)", table, re.MULTILINE)
    assert shown == [f"{k:02}" for k in range(20) if 7 * k % 20 >= 10]
    assert table.endswith("\n10 more experiments have smaller errors.")
    whole = next(part for part in diagnosis(segment).details().split("\n\n") if "rms of x_out [deg]" in part)
    assert re.findall("^run(..)", whole, re.MULTILINE) == [f"{k:02}" for k in range(20)]


def test_sizes_that_could_have_been_seen_are_in_the_summary_where_nothing_was_found():
    none = diagnosis(attrs.evolve(NONE, limits=NAMED.limits))
    assert "detection limits:" in str(none)
    assert "smallest detectable" not in none.details()
    assert "smallest detectable" not in str(diagnosis())


def test_the_verdict_unknown_says_where_it_is_and_how_little_is_explained():
    assert verdict_text.verdict_sentence(UNKNOWN) == (
        "Unmodelled effect between x_in and x_out that the one effect tried does not explain: the best, dead_time, "
        "removes 24 % of the variance above the noise floor. The error of x_out on held-out data is 0.520 deg rms, its "
        "noise floor 0.100. Of the variance above the noise floor, 93 % is predicted from the recorded signals on held-out data."
    )


def test_the_verdict_none_says_how_close_the_noise_is():
    assert verdict_text.verdict_sentence(NONE) == (
        "No unmodelled effect between x_in and x_out is detectable with these data. The error of x_out on held-out data "
        "is 0.103 deg rms, its noise floor 0.100. There is a small residual above the noise floor, too small to name "
        "an effect with these data."
    )
    assert verdict_text.verdict_sentence(attrs.evolve(NONE, excess=0.01)).endswith("its noise floor 0.100.")


def test_outliers_are_no_slow_noise():
    """Without them the residual is within the noise, or so many times as large."""
    (gap,) = NONE.gaps
    wide = attrs.evolve(gap, held_out=(0.25 * DEG,), method="high frequencies", outliers=0.84)
    within = attrs.evolve(NONE, gaps=(wide,))
    assert wide.rest == pytest.approx(0.1 * DEG)
    assert verdict_text.verdict_sentence(within).endswith(
        "is 0.250 deg rms, its noise floor 0.100. Outliers hold 84 % of its mean square; the rest is within the noise."
    )
    assert "not all of the residual" not in verdict_text.verdict_sentence(within)
    assert not next_steps(within)
    above = attrs.evolve(NONE, gaps=(attrs.evolve(wide, held_out=(0.5 * DEG,)),))
    said = verdict_text.verdict_sentence(above)
    assert "Without outliers, which hold 84 % of its mean square, it is 2 times the noise floor (from" in said
    assert said.endswith("are indistinguishable.")


def test_no_coordinate_is_reported_when_none_predicts_the_residual():
    said = verdict_text.verdict_sentence(attrs.evolve(UNKNOWN, where=()))
    assert said.endswith("93 % is predicted from the recorded signals on held-out data.")


def test_what_nothing_predicts_is_irregular_and_what_would_tell_is_said():
    said = attrs.evolve(UNKNOWN, irregular=True, predictable=(0.0, 0.0))
    irregular = "is irregular: no function of the recorded signals that was tried predicts it"
    assert irregular in verdict_text.verdict_sentence(said)
    removes = tuple(attrs.evolve(one, share=0.98) for one in said.ranking)  # by an effect that could not be named
    told = verdict_text.verdict_sentence(attrs.evolve(said, ranking=removes))
    assert "irregular" not in told
    assert "The residual is too large for noise." in told
    assert next_steps(said)[0].startswith("Record twice with the same inputs")
    assert next_steps(NAMED) == []


@pytest.mark.parametrize(("method", "advised"), [("high frequencies", True), ("repeats", False)])
def test_a_repeat_is_advised_where_there_is_none(method, advised):
    (gap,) = NONE.gaps
    slow = attrs.evolve(gap, method=method, held_out=(0.2 * DEG,))
    steps = next_steps(attrs.evolve(NONE, gaps=(slow,)))
    assert any(step.startswith("Record twice with the same inputs") for step in steps) is advised
    assert any(step.startswith("Give the noise of the sensor") for step in steps)


def test_a_factor_that_varies_has_two_readings_and_its_residual_is_compared_with_the_noise():
    (gap,) = NAMED.gaps
    small = attrs.evolve(gap, held_out=(0.52 * DEG, 1.03 * NOISE))
    where = "the acceleration of x_out (output), by a factor that varies within about 3.8 s"
    said = attrs.evolve(NAMED, complete=False, irregular=True, varies_with=where, gaps=(small,))
    first, *others = next_steps(said)
    assert first == (
        "The residual of x_out (1.03 times the noise floor) has a part in proportion to the acceleration of x_out "
        "(output), by a factor that varies within about 3.8 s. Either a parameter varies over that time, or the model "
        "lacks a nonlinearity or has one of another form."
    )
    assert [step.split(" ")[0] for step in others] == ["Record", "Compare"]
    assert next_steps(attrs.evolve(said, filtered=("x_in",))) == [
        first,
        *others,
        "Filtering of x_in may leave a residual of that size as well: compare with --no-condition, in Python "
        "condition=False.",
    ]
    unknown = attrs.evolve(said, verdict="unknown", effects=(), ranking=(ranked("dead_time", 0.24),))
    assert f"The residual has a part in proportion to {where}." in verdict_text.verdict_sentence(unknown)


@pytest.mark.parametrize(("coefficient", "words"), [(5e-5, "leads the model by about 0.05"), (-0.012, "lags behind")])
def test_a_residual_in_proportion_to_the_speed_is_one_of_the_time_stamps(coefficient, words):
    shift = attrs.evolve(
        ranked("rate_dependence", 0.85), parameters={"coefficient": coefficient, "exponent": 1.0}, why_not=SHIFT_IN_TIME
    )
    (step,) = (one for one in next_steps(attrs.evolve(UNKNOWN, ranking=(shift,))) if "time stamps" in one)
    assert words in step
    assert "(85 % of the variance above the noise floor)" in step
    small = attrs.evolve(UNKNOWN, ranking=(attrs.evolve(shift, share=0.3),))
    assert not any("time stamps" in one for one in next_steps(small))


def test_an_experiment_whose_error_is_far_from_all_others_is_looked_at_alone():
    (gap,) = NONE.gaps
    some = {"a": (0.1,), "b": (0.12,), "c": (0.33,)}
    (step,) = next_steps(attrs.evolve(NONE, gaps=(attrs.evolve(gap, experiments=some),)))
    assert step.startswith("Examine c separately: its error of x_out is 3.0 times that of the other experiments, so")
    large = attrs.evolve(gap, experiments=some, noise_floor=0.02)
    (step,) = next_steps(attrs.evolve(NONE, gaps=(large,)))[:1]
    assert "so it excites most of what is missing, or it differs (a parameter, a load, a sensor)." in step
    both = (large, attrs.evolve(large, output="force"))
    (step,) = next_steps(attrs.evolve(NONE, gaps=both))[:1]
    assert step.startswith(
        "Examine c separately: its errors of x_out and force are 3.0 and 3.0 times those of the other "
    )
    for calm in ({"a": (0.1,), "c": (0.33,)}, {**some, "c": (0.17,)}, {**some, "b": (0.3,)}):
        assert next_steps(attrs.evolve(NONE, gaps=(attrs.evolve(gap, experiments=calm),))) == []


def test_several_segments_are_told_apart_with_those_that_miss_something_first():
    motor = attrs.evolve(NONE, name="r -> u, x_in", inputs=("r",), outputs=("u", "x_in"))
    text = str(diagnosis(motor, NAMED))
    assert text.index("NAMED. ") < text.index("NONE. No unmodelled effect between r and u, x_in")
    assert text.index("== r -> u, x_in ==") < text.index("== x_in -> x_out ==")
    assert "detection limits in r -> u, x_in:" in text


def test_two_effects_of_one_name_are_told_by_their_blocks():
    second = attrs.evolve(BACKLASH, block="backlash_2", wire="backlash.y -> x_out", also_possible=())
    found = verdict_text.verdict_sentence(attrs.evolve(NAMED, effects=(BACKLASH, second)))
    assert found.startswith(
        "Unmodelled effects between x_in and x_out: a backlash gap (backlash on offset.y -> x_out, gap width 1.000 ± "
        "0.040 deg) and a backlash gap (backlash as block backlash_2 on backlash.y -> x_out, gap width 1.000 ± 0.040 "
        "deg). Also possible: hysteresis"
    )


def test_the_output_furthest_above_its_noise_is_the_one_told():
    (gap,) = NAMED.gaps
    other = attrs.evolve(gap, output="u", unit="V", noise_floor=0.01, held_out=(2.0, 0.02), train=(2.0, 0.02))
    assert "the error of u on held-out data falls from 2.00 to 0.0200 V rms." in verdict_text.verdict_sentence(
        attrs.evolve(NAMED, gaps=(gap, other))
    )
    two = verdict_text.verdict_sentence(attrs.evolve(NAMED, gaps=(gap, other)))
    assert "The error of x_out falls from 0.520 to 0.104 deg rms (noise floor 0.100)." in two
    worse = attrs.evolve(gap, held_out=gap.held_out[::-1])
    assert "The error of x_out grows" not in verdict_text.verdict_sentence(attrs.evolve(NAMED, gaps=(worse, other)))
    bare = attrs.evolve(NAMED, gaps=(attrs.evolve(other, unit=""),))
    assert "falls from 2.00 to 0.0200 rms." in verdict_text.verdict_sentence(bare)


def test_a_share_of_the_error_above_the_noise_floor_needs_such_an_error():
    below = attrs.evolve(NAMED.gaps[0], held_out=(0.099 * DEG, 0.09 * DEG))
    text = verdict_text.verdict_sentence(attrs.evolve(NAMED, gaps=(below,)))
    assert "falls from 0.0990 to 0.0900 deg rms (noise floor 0.100)." in text


@pytest.mark.parametrize(
    ("left", "changes", "word"),
    [
        (0.12, {}, "Named"),
        (0.19, {}, "Named, rest unexplained"),
        (0.19, {"complete": False}, "Named, incomplete"),
        (0.19, {"noise_of_inputs": (InputNoiseRms("x_in", 0.01, "V", 0.02),)}, "Named"),
        (0.19, {"verdict": "unknown", "complete": False}, "Unknown"),
    ],
)
def test_the_word_says_whether_the_rest_is_explained(left, changes, word):
    """A rest of several times the floor was plain Named where nothing predicted it, and false names looked sure."""
    gap = attrs.evolve(NAMED.gaps[0], held_out=(0.4 * DEG, left * DEG))
    assert verdict_text.verdict_word(attrs.evolve(NAMED, gaps=(gap,), **changes)) == word


@pytest.mark.parametrize(
    ("left", "changes", "said"),
    [
        (0.12, {}, ()),
        (0.19, {}, ("Record twice with the same inputs", "Give the noise of the sensor")),
        (0.19, {"complete": False, "stopped": True}, ("Let the search run to its end", "Give the noise of the sensor")),
        (0.9, {"complete": False, "stopped": True}, ("Let the search run to its end",)),
    ],
)
def test_what_to_do_next_beside_what_was_named(left, changes, said):
    """No next step was given where a repeat, or the noise of the sensor, would explain the residual."""
    gap = attrs.evolve(NAMED.gaps[0], held_out=(1.0 * DEG, left * DEG), method="high frequencies")
    steps = next_steps(attrs.evolve(NAMED, gaps=(gap,), **changes))
    assert [step.startswith(begins) for step, begins in zip(steps, said, strict=True)] == [True] * len(said)


def test_a_compensator_that_does_no_better_is_explained():
    found = diagnosis()
    assert found.consequence is not None
    worse = attrs.evolve(found, consequence=attrs.evolve(found.consequence, words="It cannot jump."))
    assert "\n\nIt cannot jump.\n" in str(worse)
    assert "<p>It cannot jump.</p>" in page(worse)
    none = attrs.evolve(found, consequence=None, no_consequence="It was not tracked.")
    assert none.details().endswith("\n\nConsequence for control: It was not tracked.")
    assert "It was not tracked." not in str(none)
    assert "Consequence for control</h2><p>It was not tracked.</p>" in page(none)


def test_what_is_left_after_all_that_was_named_is_told():
    left = attrs.evolve(NAMED.gaps[0], held_out=(0.52 * DEG, 0.17 * DEG))
    more = attrs.evolve(NAMED, gaps=(left,), complete=False, predictable=(0.9, 0.4))
    predicted = "though the recorded signals predict 40 % of its mean square."
    words = (
        f"That is still 1.7 times the noise floor: a residual that none of the 4 effects tried explains, {predicted}"
    )
    assert words in verdict_text.verdict_sentence(more)
    assert verdict_text.verdict_sentence(more).startswith(
        "The named effects do not explain the whole residual. Unmodelled effect between"
    )
    small = attrs.evolve(NAMED.ranking[0], round=2, named=False, name="dead_zone", why_not=NOT_ACCEPTED)
    with_small = verdict_text.verdict_sentence(attrs.evolve(more, ranking=(*NAMED.ranking, small)))
    assert (
        "That is still 1.7 times the noise floor. dead_zone would remove 98 % of the rest; it is not named, since a "
        "slightly wrong form of backlash may leave as much." in with_small
    )
    first = tuple(r for r in NAMED.ranking if r.round == 1)
    assert f"a residual that was not examined further, {predicted}" in verdict_text.verdict_sentence(
        attrs.evolve(more, ranking=first)
    )
    slow = verdict_text.verdict_sentence(attrs.evolve(NAMED, gaps=(left,)))
    assert (
        "falls from 0.520 to 0.170 deg rms. That is 1.7 times the noise floor of 0.100 deg (given), but no function "
        "of the recorded signals that was tried predicts it on held-out data: it is noise of that spectrum, or a model error "
        "of a form that was not tried."
    ) in slow
    assert "still" not in verdict_text.verdict_sentence(NAMED)


def test_an_interrupted_search_says_so():
    said = str(diagnosis(status="interrupted"))
    assert said.startswith("SEARCH INTERRUPTED. NAMED")
    assert "- Random seed 3; interrupted; these are the results until then.\n" in said


def test_lines_fit_a_terminal_but_for_code():
    lines = str(diagnosis()).split("\n")
    assert [line for line in lines if len(line) > 80 and not line.startswith("  ")] == []


@pytest.mark.parametrize(
    ("share", "shown"),
    [(0.976, "98 %"), (1.27, "100 %"), (0.0, "0 %"), (-0.004, "0 %"), (-5.0, "< 0 %"), (float("nan"), "")],
)
def test_shares_in_percent(share, shown):
    assert verdict_text.percent(share) == shown


def test_one_experiment_says_nothing_of_new_ones():
    assert np.isnan(candidate_tables.share_across_experiments(ranked("drift", 0.5), 1))
    assert candidate_tables.share_across_experiments(ranked("drift", 0.5, across=4.0), 2) == pytest.approx(0.2)


def test_notes_of_several_experiments_are_gathered():
    assert merged_notes(NOTES, ("full", "half"))[0] == (
        "all experiments: x_in was filtered with zero phase, cut-off 9.5–12 Hz (chosen from its spectrum); "
        "0.06–0.061 deg rms was removed."
    )
    small = [
        f"{name}: y was cut off at 3 Hz; {rms} V rms was removed." for name, rms in (("a", "4.1e-05"), ("b", "0.003"))
    ]
    assert merged_notes(small, ("a", "b")) == [
        "all experiments: y was cut off at 3 Hz; 4.1e-05–0.003 V rms was removed."
    ]
    same = ["a: kept 3 of 5.", "b: kept 3 of 5.", "other: kept 3 of 5."]
    days = [f"{name}: Zeit was read as seconds since 2026-11-{day} 14:03:07." for name, day in (("a", 22), ("b", 23))]
    assert merged_notes(days, ("a", "b")) == [
        "all experiments: Zeit was read as seconds since 2026-11-22 14:03:07 to 2026-11-23 14:03:07."
    ]
    assert merged_notes(same, ("a", "b", "c")) == ["a and b: kept 3 of 5.", "other: kept 3 of 5."]


@pytest.mark.parametrize(
    ("quantity", "shown"),
    [
        (Quantity(0.00872665, 0.0085, 0.00895, "rad"), "0.500 ± 0.013 deg"),
        (Quantity(1234.0, 1200.0, 1268.0, "V"), "1234 ± 34 V"),
        (Quantity(123400.0, 120000.0, 126800.0, "V"), "(1.234 ± 0.034)e5 V"),
        (Quantity(2.0, -np.inf, np.inf, ""), "2 (not determined)"),
        (Quantity(2.0, 2.0, 2.0, "s"), "2 s"),
        (Quantity(0.17453292519943295, 0.1, 0.25, "rad/s"), "0.175 ± 0.075 rad/s"),
    ],
)
def test_numbers_with_intervals(quantity, shown):
    assert showing.with_interval(quantity) == shown


# ---- what is shown


def test_pieces_of_an_experiment_are_put_together():
    pieces = (trace("full#1", 0.8), trace("full#2", 0.8, piece=8.0), trace("half", 0.4))
    whole, other = showing.output_traces(attrs.evolve(NAMED, traces=pieces), "x_out")
    assert (whole.experiment, other.experiment) == ("full", "half")
    assert np.array_equal(whole.t, np.concatenate([pieces[0].t, pieces[1].t]))
    assert len(whole.excess) == len(pieces[0].excess) + len(pieces[1].excess)
    assert showing.output_traces(NAMED, "u") == ()


def test_strips_scale_the_excess_by_what_is_left():
    one = trace("full", 0.8)
    rows = showing.strips(one)
    inside = (one.t >= rows[3, 0]) & (one.t <= rows[3, 1])
    left = np.mean((one.after - one.measured)[inside] ** 2)
    assert rows[3, 3] == pytest.approx(left / NOISE**2, rel=1e-12)
    assert rows[:, 2].min() > 10
    assert 0.4 < rows[:, 3].min() < rows[:, 3].max() < 2


def test_a_profile_shows_the_error_that_is_there():
    found = showing.profile(NAMED, "x_out", "direction")
    assert found is not None
    assert found.x.tolist() == [-1.0, 1.0]
    assert found.before == pytest.approx([-0.5 * DEG, 0.5 * DEG], abs=0.05 * DEG)
    assert found.explained == pytest.approx([-0.5 * DEG, 0.5 * DEG], abs=0.03 * DEG)
    assert np.abs(found.after).max() < 4 * found.error_after.max()
    assert found.unit == ""
    assert found.error_unit == "rad"


def test_standard_errors_of_a_profile_are_those_of_white_noise():
    parts = tuple(trace(f"e{k}", 0.8, seed=k) for k in range(40))
    found = showing.profile(attrs.evolve(NAMED, traces=parts), "x_out", "direction")
    assert found is not None
    assert found.error_after == pytest.approx(NOISE / np.sqrt(8000), rel=0.3)


def test_the_unit_of_a_coordinate_follows_from_the_motion():
    units = {k: showing.profile(NAMED, "x_out", k).unit for k in ("position", "speed", "session time")}
    assert units == {"position": "rad", "speed": "rad/s", "session time": "s"}


def test_the_axis_of_a_coordinate_with_a_sign_says_so():
    assert showing.profile(NAMED, "x_out", "speed").coordinate == "speed"
    signed = showing.profile(NAMED, "x_out", "time since reversal")
    assert signed.x.min() < 0
    assert signed.coordinate == "signed time since reversal"


def test_too_few_blocks_say_nothing_of_how_sure_a_mean_is():
    short = attrs.evolve(trace("full", 0.8), excess=np.array([[0.0, 8.0, 20.0]]))
    found = showing.profile(attrs.evolve(NAMED, traces=(short,)), "x_out", "direction")
    assert found is not None
    assert np.isnan(found.error_before).all()
    assert found.before == pytest.approx([-0.5 * DEG, 0.5 * DEG], abs=0.05 * DEG)


def test_a_coordinate_that_does_not_vary_makes_no_profile():
    assert showing.profile(attrs.evolve(NAMED, traces=NAMED.traces[:1]), "x_out", "experiment") is None


# ---- the difference of two diagrams


def test_a_diagram_does_not_differ_from_itself():
    sheath = tsm.load("tendon_sheath_symmetric")
    assert difference(sheath, sheath).lines == []


def test_what_was_added_is_what_goes_when_it_is_taken_back():
    before = tsm.load("tendon_sheath_symmetric")
    after = before.insert("gap", Play(half_width=0.1), before="tsm.x").with_parameters({"tsm.n": 2.0})
    there, back = difference(before, after), difference(after, before)
    assert there.lines == [
        ("+", "gap = Play(half_width=0.1)"),
        ("-", "x_in -> tsm.x"),
        ("+", "x_in -> gap.u"),
        ("+", "gap -> tsm.x"),
        ("~", "tsm.n  1.02 -> 2.00"),
    ]
    assert (back.added, back.removed) == (there.removed, there.added)
    assert (back.wires_added, back.wires_removed) == (there.wires_removed, there.wires_added)
    assert [(c.before, c.after) for c in back.parameters] == [(c.after, c.before) for c in there.parameters]


def test_a_block_that_is_replaced_under_its_name_is_a_change():
    before = tsm.Diagram(
        title="a gap behind a gain",
        blocks={"scale": Gain(gain=3.0), "gap": Play(half_width=0.1)},
        wires=["scale -> gap"],
        inputs={"u": "scale.u"},
        outputs={"y": "gap"},
    )
    after = before.replace("gap", Gain(gain=2.0)).with_parameters({"scale.gain": 4.0})
    assert difference(before, after).lines == [
        ("-", "gap = Play(half_width=0.1)"),
        ("+", "gap = Gain(gain=2)"),
        ("~", "scale.gain  3.00 -> 4.00"),
    ]


def test_blocks_in_code_make_the_same_blocks():
    from tsmblocks import blocks

    for block in (Play(half_width=0.25), Gain(), blocks.LookupTable(points=(0.0, 1.0), values=(2.0, 3.0))):
        assert eval(in_code(block), vars(blocks).copy()) == block


# ---- the page


EVERY = {
    "named": diagnosis(),
    "unknown": diagnosis(UNKNOWN),
    "none": diagnosis(NONE),
    "two": diagnosis(attrs.evolve(NONE, name="r -> u"), NAMED),
    "interrupted": diagnosis(NONE, status="interrupted", notes=()),
}


@pytest.mark.parametrize("name", EVERY)
def test_a_page_is_whole_and_fetches_nothing(name):
    text = page(EVERY[name])
    found = Page(text)
    assert found.open == []
    assert found.fetched == []
    assert [one for one in found.links if not one.startswith("#")] == ["diagnosis.json", "augmented.toml"]
    assert not found.seen & {"script", "iframe", "img", "object"}
    assert all('rel="icon" href="data:' in one for one in re.findall("<link[^>]*>", text))
    assert "url(" not in text
    assert "@import" not in text
    assert set(re.findall(r"https?://[^\"' )<]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_parts_of_a_diagram_have_an_arrow_in_their_headings():
    headings = re.findall(r"<h3[^>]*>(.*?)</h3>", page(EVERY["two"]))
    assert "r\xa0→\xa0u" in [html.unescape(one) for one in headings]
    assert not [one for one in headings if "&gt;" in one]


def test_a_page_has_its_parts_in_this_order():
    assert Page(page(diagnosis())).heads == [
        "What the model lacks",
        "Error before and after",
        "Where model and data disagree",
        "The diagram with the named effects",
        "Consequence for control",
        "Notes",
        "Candidate effects",
        "Detection limits",
        "In a script",
        "Data and settings",
    ]
    assert Page(page(EVERY["none"])).heads == [
        "Error and noise floor",
        "Model and data",
        "The diagram",
        "Notes",
        "Candidate effects",
        "Detection limits",
        "In a script",
        "Data and settings",
    ]


def test_the_page_begins_with_the_verdict():
    text = page(diagnosis())
    body = text[text.index("<body>") :]
    assert body.index("gap width") < body.index("<svg") < body.index("Candidate effects</h2>")
    assert '<div class="verdict named"><p><b class="word">Named.</b> Unmodelled effect between x_in and x_out' in body


def test_the_page_says_what_it_rests_on():
    text = page(diagnosis())
    rows = re.findall(
        r"<tr><th scope=\"row\" class=\"l\">(.*?)</th><td class=\"l\">(.*?)</td></tr>",
        text[text.rindex("Data and settings") :],
    )
    assert rows == [
        ("tsmblocks", "0.1.0"),
        ("diagram", "tendon_sheath_linear, Tendon sheath: a gain and an offset"),
        ("full", "full.csv: x_in [deg], x_out [deg]; 400 samples, 0.02 s apart"),
        ("half", "x_in [deg], x_out [deg]; 400 samples, 0.02 s apart"),
        ("noise floor", "x_out 0.1 deg (given)"),
        ("seed", "3"),
    ]


def test_nothing_is_drawn_of_a_model_that_there_is_not():
    same = tuple(attrs.evolve(one, after=one.before) for one in NAMED.traces)
    text = page(diagnosis(attrs.evolve(NONE, traces=same)))
    assert 'class="line after"' in text
    assert 'class="line before' not in text
    assert 'class="fill before"' not in text
    assert "with the reported effects" not in text
    words = re.sub(r"<[^>]*>", " ", text[text.index("<body>") :]).split()
    assert "before" not in words[: words.index("Candidate")]


def test_the_verdict_is_in_the_same_words_everywhere():
    incomplete = attrs.evolve(NAMED, complete=False, predictable=(0.9, 0.4))
    for segment, word in ((NAMED, "Named"), (incomplete, "Named, incomplete"), (UNKNOWN, "Unknown"), (NONE, "None")):
        made = diagnosis(segment)
        assert str(made).startswith(f"{word.upper()}. ")
        assert f'<b class="word">{word}.</b>' in page(made)
        assert f'<b class="word">{word}.</b>' in made._repr_html_()
        assert made.verdict == word.partition(",")[0].lower()
        assert "NAMED" not in str(made) or segment.effects


def test_an_effect_that_was_named_is_not_listed_as_one_that_cannot_be_detected():
    blind = [attrs.evolve(one, name=BACKLASH.name) if one.value is None else one for one in NAMED.limits]
    assert "not testable" in diagnosis(NAMED).details()
    assert "not testable" not in diagnosis(attrs.evolve(NAMED, limits=tuple(blind))).details()


def test_how_many_effects_were_tried_is_said_and_the_others_are_a_next_step():
    from tsmblocks.effects import catalogue

    alone = attrs.evolve(NAMED, effects=(attrs.evolve(BACKLASH, also_possible=()),))
    assert "None of the 3 other effects tried fits as well." in verdict_text.verdict_sentence(alone)
    few = attrs.evolve(alone, ranking=alone.ranking[:2])
    assert "The one other effect tried does not fit as well." in verdict_text.verdict_sentence(few)
    one = attrs.evolve(alone, ranking=alone.ranking[:1])
    assert "No other effect was tried." in verdict_text.verdict_sentence(one)
    assert diagnosis(NAMED).to_dict()["effects_tried"] == 4
    count = len({e.name for e in catalogue()} - {m.name for m in LIMITS} - {"dead_time"})
    assert f"Try the other {count} effects of the catalogue as well" in next_steps(UNKNOWN)[0]
    every = tuple(attrs.evolve(LIMITS[0], name=e.name) for e in catalogue())
    assert not any("Try the other" in step for step in next_steps(attrs.evolve(UNKNOWN, limits=every)))
    assert next_steps(attrs.evolve(UNKNOWN, limits=every))


def test_what_was_added_is_highlighted_in_the_second_diagram():
    text = page(diagnosis())
    marked = tsm.to_svg(diagnosis().augmented, highlight=["backlash"])
    plain = tsm.to_svg(diagnosis().base)
    assert text.index(plain) < text.index(marked)


def test_effects_that_are_not_excited_are_grey():
    row, absorbed = re.findall(r'<tr class="blind">(.*?)</tr>', page(diagnosis()))
    assert "coulomb_friction" in row
    assert "not excited by these experiments" in row
    assert "reversals of the motion" in row
    assert "absorbed by offset.bias, 1 deg per deg" in absorbed


def test_names_cannot_change_the_page():
    bad = '<b>&"x'
    gap = attrs.evolve(NAMED.gaps[0], experiments={bad: (0.01, 0.002)})
    odd = attrs.evolve(NAMED, gaps=(gap,), traces=(trace(bad, 0.8),))
    text = page(diagnosis(odd, experiments=(bad,), notes=(f"{bad}: odd.",), diagram=bad))
    assert Page(text).open == []
    assert "<b>&" not in text
    assert "&lt;b&gt;&amp;" in text


def test_a_page_of_eight_long_experiments_stays_small():
    names = [f"e{k}" for k in range(8)]
    gap = attrs.evolve(NAMED.gaps[0], experiments=dict.fromkeys(names, (0.01, 0.002)))
    traces = tuple(trace(name, 0.8, n=2500, seed=k) for k, name in enumerate(names))
    text = page(diagnosis(attrs.evolve(NAMED, gaps=(gap,), traces=traces), experiments=tuple(names)))
    assert len(text.encode()) < 1_500_000


def test_what_was_measured_shows_on_both_sides_of_the_models_drawn_over_it():
    wide, model = (
        float(re.search(rf"{kind}{{[^}}]*stroke-width:([.\d]+)", CSS)[1]) for kind in (".line.measured", ".line")
    )
    assert wide > 2 * model
    drawn = re.findall(r'class="line (\w+)', figures.signals_chart(trace("slow", 0.8), 100))
    assert drawn == ["measured", "before", "after"]  # what is drawn later lies on top


# ---- charts


signals = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300).map(np.array)


@given(signals, st.integers(2, 60))
def test_thinned_signals_keep_their_extremes(y, count):
    t = np.arange(len(y)) * 0.1
    kept_t, kept = charts.thinned(t, y, count)
    assert len(kept) <= max(count, 2)
    assert np.all(np.diff(kept_t) > 0)
    assert (kept.min(), kept.max()) == (y.min(), y.max())
    assert np.array_equal(kept, y[np.searchsorted(t, kept_t)])


@pytest.mark.parametrize(("seed", "length"), [(0, 50), (1, 180), (2, 400)])
def test_a_loop_is_drawn_within_a_pixel_of_itself(seed, length):
    rng, phase = np.random.default_rng(seed), np.linspace(0, 11.0, length)
    x, y = np.sin(phase), np.sin(phase + 0.3) + 0.02 * rng.standard_normal(length)
    frame = charts.Frame(0, 0, 300, 150, (-1.0, 1.0), (-1.1, 1.1))
    kept = np.column_stack(charts.traced(frame, x, y, length))
    corners = [int(np.flatnonzero((x == a) & (y == b))[0]) for a, b in kept]
    assert corners == sorted(corners)
    assert (corners[0], corners[-1]) == (0, length - 1)
    for a, b in itertools.pairwise(corners):
        for k in range(a, b + 1):
            ends = [(frame.across(x[i]), frame.up(y[i])) for i in (a, b, k)]
            (ax, ay), (bx, by), (px, py) = ((float(u), float(v)) for u, v in ends)
            share = np.clip(((px - ax) * (bx - ax) + (py - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2), 0, 1)
            assert np.hypot(px - ax - share * (bx - ax), py - ay - share * (by - ay)) <= charts.TOLERANCE + 1e-9
    few = charts.traced(frame, x, y, 20)[0]
    assert 2 <= len(few) <= 20


@given(st.floats(-100, 100), st.floats(1e-3, 1e5), st.integers(3, 8))
def test_ticks_are_even_few_and_inside(low, size, most):
    high = low + size
    found = charts.ticks(low, high, most)
    assert len(found) <= most + 1
    assert all(low - 1e-6 * size <= v <= high + 1e-6 * size for v in found)
    if len(found) > 2:
        steps = np.diff(found)
        assert np.allclose(steps, steps[0], rtol=1e-6)
        assert round(steps[0] / 10 ** np.floor(np.log10(steps[0] * 1.0001)), 6) in (1, 2, 5, 10)


@given(signals)
def test_a_range_holds_its_signals_with_room(y):
    low, high = charts.spread(y)
    assert low < y.min() <= y.max() < high or (y.min() == y.max() and low < high)
    assert charts.spread(y, zero=True)[0] <= 0 <= charts.spread(y, zero=True)[1]


def test_a_line_breaks_where_a_number_is_missing():
    frame = charts.Frame(0, 0, 100, 100, (0.0, 4.0), (0.0, 1.0))
    drawn = charts.line(frame, np.arange(5.0), np.array([0.0, 0.5, np.nan, 0.5, 1.0]), "before")
    assert drawn == '<path class="line before" d="M0 100 25 50M75 50 100 0"/>'


def test_bars_are_as_long_as_their_numbers():
    text = page(diagnosis())
    bars = re.findall(
        rf'<rect class="fill (before|after)" x="([\d.]+)" y="[\d.]+" width="([\d.]+)" height="{figures.BAR}"', text
    )
    lengths = np.array([float(width) for _, _, width in bars])
    values = [0.52, 0.104, 0.53, 0.105, 0.51, 0.103]
    assert [kind for kind, _, _ in bars] == ["before", "after"] * 3
    assert lengths / lengths[0] == pytest.approx(np.array(values) / values[0], abs=0.002)


# ---- files


@pytest.mark.parametrize("name", EVERY)
def test_three_files_are_written_and_can_be_read_again(name, tmp_path):
    found = EVERY[name]
    assert written(found, tmp_path / "a" / "b") == tmp_path / "a" / "b"
    folder = tmp_path / "a" / "b"
    assert sorted(p.name for p in folder.iterdir()) == ["augmented.toml", "diagnosis.json", "report.html"]
    assert json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")) == found.to_dict()
    assert tsm.load(folder / "augmented.toml") == found.augmented
    assert (folder / "report.html").read_text(encoding="utf-8") == page(found)


def test_the_same_diagnosis_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        diagnosis().save(tmp_path / name)
    for name in ("augmented.toml", "diagnosis.json", "report.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "found").write_text("mine")
    with pytest.raises(TsmError) as told:
        written(diagnosis(), tmp_path / "found")
    assert str(told.value) == (
        f"'{tmp_path / 'found'}' is a file; name a folder for diagnosis.json, augmented.toml and report.html."
    )
    assert (tmp_path / "found").read_text() == "mine"


# ---- figures


@pytest.fixture
def plots():
    pytest.importorskip("matplotlib")
    from tsmblocks import plots

    return plots


@pytest.mark.parametrize("name", EVERY)
def test_a_diagnosis_is_one_figure_with_a_row_for_each_segment(name, plots, tmp_path):
    figure = plots.plot_diagnosis(EVERY[name])
    assert len(figure.axes) == 4 * len(EVERY[name].segments)
    figure.savefig(tmp_path / "found.svg")
    assert (tmp_path / "found.svg").stat().st_size > 1000


def test_bars_of_the_gap_are_drawn_in_degrees_on_axes_of_ones_own(plots):
    from matplotlib.figure import Figure

    own = Figure().subplots()
    assert plots.plot_gap(diagnosis(), own) is own.figure
    widths = [bar.get_width() for bar in own.containers[0]]
    assert widths == pytest.approx([0.52, 0.53, 0.51])
    (noise,) = (line.get_xdata()[0] for line in own.lines)
    assert noise == pytest.approx(0.1)
    assert own.get_xlabel() == "rms of x_out on held-out data [deg]"


def test_what_is_left_can_be_drawn_for_any_experiment(plots):
    figure = plots.plot_disagreement(diagnosis(), "half")
    before = next(line for line in figure.axes[0].lines if line.get_label() == "before")
    one = NAMED.traces[1]
    assert before.get_ydata() == pytest.approx((one.measured - one.before) / DEG)
    with pytest.raises(TsmError) as told:
        plots.plot_disagreement(diagnosis(), "hlaf")
    assert str(told.value) == "there is no experiment 'hlaf' in this diagnosis. Did you mean 'half'?"


def test_the_loop_shows_the_stretch_that_was_worst_and_no_legend_lies_on_the_residual(plots):
    figure = plots.plot_diagnosis(diagnosis())
    _, _, loop, _ = figure.axes
    one = NAMED.traces[0]
    (before,) = (line for line in loop.lines if line.get_label() == "before")
    assert 3 * len(one.t) // 16 <= len(before.get_xdata()) <= 7 * len(one.t) // 16
    assert loop.get_title(loc="left").endswith(" s")
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend.get_window_extent().y1 < min(panel.get_window_extent().y0 for panel in figure.axes)
    assert not any(panel.get_legend() for panel in figure.axes)


def test_the_error_along_a_coordinate_says_when_there_is_none(plots):
    figure = plots.plot_coordinate(EVERY["none"])
    assert [text.get_text() for text in figure.axes[0].texts] == ["no coordinate predicts the residual"]
    assert plots.plot_coordinate(diagnosis()).axes[0].get_xlabel() == "direction"


def test_the_report_says_what_to_do_next(tmp_path):
    page = (diagnosis(UNKNOWN).save(tmp_path) / "report.html").read_text(encoding="utf-8")
    assert "<b>Next:</b>" in page
    assert "Compare other structures of the model" in page
    assert "Compare other structures of the model" in diagnosis(UNKNOWN)._repr_html_()
