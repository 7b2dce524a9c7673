"""Fits and comparisons as text: tables of estimates and residuals, and remarks."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from tsmblocks.common import displayed_units, units
from tsmblocks.common.headings import heading
from tsmblocks.common.rounding import decimals, fixed, significant
from tsmblocks.common.tables import columns, line_width, listed, split_columns, table_width
from tsmblocks.common.views import no_view
from tsmblocks.data.noise_floor import method_text
from tsmblocks.fitting.above_noise import FAR, beyond_noise, factor_text
from tsmblocks.fitting.comparison import Comparison, Row, overall
from tsmblocks.fitting.holds import hold_text
from tsmblocks.fitting.identifiability import NO_INFLUENCE, UNCERTAIN
from tsmblocks.fitting.recorded_range import beyond_range
from tsmblocks.fitting.result import STATUS, Estimate, Fit
from tsmblocks.fitting.score import Differences

CLOSE = 0.95
"""Magnitude of a correlation from which two parameters are reported as hard to distinguish. Chosen."""
MOST = 5
"""Pairs of parameters that are listed; the rest is counted. Chosen."""
MOST_OF_STATES = 2
"""Combinations of initial states that are listed; the rest is counted. Chosen."""
MIN_FLIPPED = 2
"""Gains with another sign than they began with, from which there is a caution. Chosen: one may have been wrong."""
MAX_ROUNDING = 0.05
"""Share of a value that its rounding to the digits of its interval may change. Chosen: more misstates its size."""
OPEN = "?"
"""Mark of a number of parameters that the data do not determine."""
LEAST, EXACT = 3, 7
"""Significant digits of every value, and of the best known one. Chosen."""


# ---- a fit ---------------------------------------------------------------------------------------


def fit_text(fit: Fit) -> str:
    """The whole result as a terminal shows it."""
    tried = len(fit.searches)
    agree = f"; {fit.agreeing} of {tried} starts ended at this optimum" if tried > 1 else ""
    head = [fit.diagram.title] if fit.diagram.title else []
    head.append(textwrap.fill(f"{fit.method}: {STATUS[fit.status]}{agree}", line_width()))
    return "\n\n".join(
        ["\n".join(head), numbers(fit), residual_table(fit.differences), *_list("beware:", cautions(fit))]
    )


def numbers(fit: Fit) -> str:
    """The table of estimates: as many digits as the intervals leave, angles in degrees too."""
    return columns(estimate_rows(fit), left=(0, 4, 6))


def estimate_rows(fit: Fit, some: Iterable[Estimate] | None = None) -> list[tuple[str, ...]]:
    """The rows of the table of estimates (all, or some), the heading first.

    They hold name, value, interval, unit, in degrees, verdict.
    """
    rows: list[tuple[str, ...]] = [("parameter", "value", "95 % from", "to", "unit", "", "")]
    for e in fit.estimates if some is None else some:
        show = _digits(e.value, e.low, e.high)
        span = (show(e.low), show(e.high)) if np.isfinite(e.low) else ("", "")
        rows.append((e.name, _legible(e.value, show(e.value)), *span, e.unit, _in_degrees(e), e.verdict))
    return rows


def _legible(value: float, shown: str) -> str:
    """A value as it is shown to the digits of a wide interval, or with three digits where these hide its size."""
    return shown if abs(float(shown) - value) <= MAX_ROUNDING * abs(value) else f"{value:.3g}"


def residual_table(differences: Differences) -> str:
    """The table of residuals, in the units of the recordings."""
    return columns(residual_rows(differences), left=(0, 3))


def residual_rows(differences: Differences) -> list[tuple[str, ...]]:
    """The rows of the table of residuals, the heading first: signal, rms, largest, unit, fit, samples."""
    rows: list[tuple[str, ...]] = [("residual", "rms", "largest", "unit", "fit", "samples")]
    shown = [d.as_displayed() for d in differences]
    for d in shown:
        share = f"{d.fit_percent:.2f} %" if np.isfinite(d.fit_percent) else ""
        name, sizes = f"{d.experiment}, {d.output}", (significant(d.rms), significant(d.largest))
        rows.append((name, *sizes, d.unit, share, str(len(d.t))))
    if len(shown) > 1 and len({(d.output, d.unit) for d in shown}) == 1:
        n, largest = np.array([len(d.t) for d in shown]), max(d.largest for d in shown)
        rms = np.sqrt(n @ np.array([d.rms**2 for d in shown]) / n.sum())
        rows.append(
            (f"all, {shown[0].output}", significant(rms), significant(largest), shown[0].unit, "", str(n.sum()))
        )
    return rows


def cautions(fit: Fit) -> list[str]:
    """Cautions on the model, the estimates and the data, a sentence each: first what concerns all of them."""
    return [*beyond_noise(fit), *estimate_cautions(fit), *fit.notes, *beyond_range(fit)]


def flipped_gains(before: Mapping[str, float], after: Mapping[str, float]) -> list[str]:
    """A caution where several gains have changed their signs, as those in a row or in a loop may do together."""
    names = [k for k, value in after.items() if k.endswith(".gain") and before.get(k, 0.0) * value < 0]
    if len(names) < MIN_FLIPPED:
        return []
    return [
        f"{listed(names, len(names))} have changed their signs, which the outputs do not show: several gains in a row "
        "are determined only together. Keep those that are known (free)."
    ]


def _of_initial_value(fit: Fit, sentence: str) -> str:
    """A sentence on an unknown, which says so where that is the initial value of a state in an experiment."""
    name, _, rest = sentence.partition(" ")
    parameter, _, experiment = name.partition("@")
    if parameter not in {e.name.partition("@")[0] for e in fit.estimates if e.is_start and "@" in e.name}:
        return sentence
    return f"The initial value of {parameter}{experiment and f' in {experiment}'} {rest}"


def estimate_cautions(fit: Fit) -> list[str]:
    """Cautions on the estimates, a sentence each."""
    said = flipped_gains({e.name: e.start for e in fit.estimates}, {e.name: e.value for e in fit.estimates})
    if fit.agreeing == 1 and len(fit.searches) > 1:
        said.append(f"Only one of {len(fit.searches)} starts ended at this optimum: more starts may find a better one.")
    silent = [name for u in fit.undetermined if u.kind == NO_INFLUENCE for name in u.names]
    if silent:
        names = [*dict.fromkeys(_gathered([(name,) for name in silent]))]
        where = "there" if all(name not in silent for name in names) else "in these experiments"
        verb = "has" if len(names) == 1 else "have"
        said.append(f"{listed(names, len(names))} {verb} no influence on the outputs {where}.")
    said += _combinations(fit)
    uncertain = {u.names[0]: u.words for u in fit.undetermined if u.kind == UNCERTAIN}
    for name in dict.fromkeys(_gathered([(name,) for name in uncertain])):
        several = f"{name} is poorly determined: a confidence interval is wider than the value or its bounds."
        said.append(_of_initial_value(fit, uncertain.get(name, several)))
    said += [f"The fit ended at {name}: a better one may lie beyond it." for name in fit.active]
    pairs = [(a, b, c) for a, b, c in tangled(fit) if not any({a, b} <= {*u.names} for u in fit.undetermined)]
    strongest: dict[str, float] = {}
    for words, (*_, c) in zip(_gathered([(a, b) for a, b, _ in pairs]), pairs, strict=True):
        strongest.setdefault(words, c)
    said += [f"{words} are hard to distinguish (correlation {c:+.3f})." for words, c in [*strongest.items()][:MOST]]
    if len(strongest) > MOST:
        more = len(strongest) - MOST
        pairs_are = "is one more pair" if more == 1 else f"are {more} more pairs"
        said.append(f"So {pairs_are}, above a correlation of {CLOSE:g}.")
    return said


def _combinations(fit: Fit) -> list[str]:
    """A sentence for each combination that is not identifiable; of initial states a few, and how many more."""
    every = [u for u in fit.undetermined if u.kind not in (NO_INFLUENCE, UNCERTAIN)]
    started = [u for u in every if all("@" in name for name in u.names)]
    left_out = started[MOST_OF_STATES:]
    words = [u.words for u in every if u not in left_out]
    more = f"{len(left_out)} more combinations of initial states are indistinguishable with these data."
    return [*words, more] if left_out else words


def _gathered(groups: Sequence[tuple[str, ...]]) -> list[str]:
    """Each group of names in words: initial states of many experiments as one, which several groups then share."""
    found: dict[tuple[str, ...], list[str]] = {}
    split = [[name.partition("@") for name in group] for group in groups]
    own = [tuple(sorted(p for p, *_ in parts)) if len({e for *_, e in parts}) == 1 else () for parts in split]
    for key, parts in zip(own, split, strict=True):
        found.setdefault(key, []).append(parts[0][2])
    return [
        f"{listed(key)} in {len(found[key])} experiments ({listed(found[key], 2)})"
        if key and all(found[key]) and len(found[key]) > 2
        else listed(group)
        for key, group in zip(own, groups, strict=True)
    ]


def tangled(fit: Fit) -> list[tuple[str, str, float]]:
    """Pairs of parameters whose estimates move together, strongest first."""
    c, n = fit.correlation, len(fit.names)
    pairs = [(fit.names[j], fit.names[i], float(c[i, j])) for i in range(n) for j in range(i) if abs(c[i, j]) > CLOSE]
    return sorted(pairs, key=lambda p: -abs(p[2]))


def _digits(value: float, low: float, high: float) -> Callable[[float], str]:
    """How to show an estimate and its interval: to the second digit of its half width; four digits without interval."""
    size, half = float(np.nanmax(np.abs([value, low, high]))), (high - low) / 2
    if not (np.isfinite(half) and half > 0 and size > 0):
        return lambda value: f"{value:.{LEAST + 1}g}"
    first = int(np.floor(np.log10(size)))
    places = int(np.clip(decimals(value, half), LEAST - 1 - first, EXACT - 1 - first))
    if not -4 <= first < 6:
        return lambda value: f"{value:.{places + first}e}"
    return lambda value: fixed(value, max(places, 0))


def _in_degrees(e: Estimate) -> str:
    """An angle in degrees, as many digits as in its own unit; nothing for anything else."""
    if not e.unit or units.parse(e.unit) != units.parse("rad"):
        return ""
    value, low, high = np.degrees([e.value, e.low, e.high])
    return f"{_digits(value, low, high)(value)} deg"


# ---- a comparison --------------------------------------------------------------------------------


def comparison_text(comparison: Comparison) -> str:
    """The best model and the noise, the table of all, what could not be fitted, and what to beware of."""
    rows = ranking_rows(comparison)
    parts = _beside_noise(comparison)
    parts += ["\n".join(map(_bullet, comparison.notes))] if comparison.notes else []
    if rows[0][-1] == "":  # the remark of each row as a mark, for which there is room
        rows = [(row[0], f"{row[1]}{OPEN if row[-1] else ' ' * (k > 0)}", *row[2:-1]) for k, row in enumerate(rows)]
    if len(rows) > 1:
        key = f"\n{OPEN} some of them are not determined by these data" if any(OPEN in r[1] for r in rows) else ""
        parts.append(columns(rows) + key)
    parts += _list("could not be fitted:", [f"{row.name}: {row.fault}" for row in comparison if row.fit is None])
    doubts = [f"{row.name}: {text}" for row in comparison for text in row_doubts(row)]
    parts += _list("beware:", [*_simulated_differently(comparison), *doubts])
    return "\n\n".join(parts)


def _simulated_differently(comparison: Comparison) -> list[str]:
    """A caution on models whose inputs are taken otherwise between samples, as a file of a model may say."""
    said: dict[str, list[str]] = {}
    for row in comparison:
        if row.fit is not None:
            said.setdefault(f"hold={hold_text(row.fit.hold)}", []).append(row.name)
    if len(said) < 2:
        return []
    each = " and ".join(f"{listed(names)} with {how}" for how, names in said.items())
    return [f"the models differ in how inputs are taken between samples: {each}. Give one for all (hold=, --hold)."]


def ranking_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The rows of the table of models that could be fitted, the heading first: model, parameters, errors."""
    k, unit = for_people(comparison)
    whole = all(row.held_out is None for row in comparison)
    head = ("model", "parameters", heading("rms held-out", unit), heading("rms in-sample", unit))
    rows: list[tuple[str, ...]] = [(*head[:2], head[3]) if whole else head]
    vague = any(open_numbers(row.fit) for row in comparison if row.fit is not None)
    rows[0] += ("",) * vague
    for row in comparison:
        if row.train is not None and row.fit is not None:
            figure = significant(k * row.figure) if np.isfinite(row.figure) else "-"
            figures = [*([] if whole else [figure]), significant(k * row.train.rms)]
            said = ("not determined" if open_numbers(row.fit) else "",) * vague
            rows.append((row.name, str(row.parameters), *figures, *said))
    return rows


def _beside_noise(comparison: Comparison) -> list[str]:
    """The residual of the best model relative to the noise, and advice where it is large; empty if not known."""
    ratio, name = comparison.above_noise, comparison.best.name
    if not np.isfinite(ratio):
        return []
    k, unit = for_people(comparison)
    size = f"{k * comparison.noise:.3g} {unit}".rstrip()
    one = len(comparison) == 1
    error = f"The error of {name}" if one else f"{name} fits best: its error"
    text = f"{error} is {factor_text(ratio)} times the noise floor ({size} rms, "
    text += f"{method_text(comparison.noise_from)})."
    if ratio >= FAR:
        lacks = "Every model leaves more than noise: all of them lack an effect, or are simulated"
        if one:
            lacks = "It lacks an effect, or is simulated"
        text += f" {lacks} with the wrong hold or step. A diagnosis (tsm.diagnose, tsmblocks diagnose) searches for it."
    return [textwrap.fill(text, line_width(), break_on_hyphens=False)]


def open_numbers(fit: Fit) -> list[str]:
    """Numbers of a fit that its data do not determine, initial states last."""
    open_ = {name for u in fit.undetermined if u.kind != UNCERTAIN for name in u.names}
    return [e.name for e in sorted(fit.estimates, key=lambda e: e.is_start) if e.name in open_]


def for_diagnosis(comparison: Comparison) -> str:
    """The model to diagnose: the best, or where the data do not determine it, the simplest that they determine."""

    def is_open(row: Row) -> bool:
        """Whether a parameter, initial states not counted, is not determined."""
        starts = {e.name for e in row.fit or () if e.is_start}
        return row.fit is None or not starts.issuperset(open_numbers(row.fit))

    determined = [row for row in comparison if not is_open(row) and np.isfinite(row.figure)]
    if not determined or not is_open(comparison.best):
        return comparison.best.name
    return min(determined, key=lambda row: row.parameters).name  # the better one of equals, which comes first


def by_file(found: Mapping[str, Comparison]) -> str:
    """A table of models and files, each fitted alone; the best of a file has a star."""
    k, unit = for_people(next(iter(found.values())))
    ranked = overall(found)
    best, least = ranked[0][0], [*(one.best.figure for one in found.values()), ranked[0][1]]
    rows = [["model", *(f"{name} " for name in (*found, "all"))]]
    for model, rms in ranked:
        figures = [next((row.figure for row in one if row.name == model), np.inf) for one in found.values()]
        pairs = zip((*figures, rms), least, strict=True)
        rows.append([model, *(significant(k * y) + "* "[y != low] if np.isfinite(y) else "- " for y, low in pairs)])
    text = columns(rows)
    if sum(2 + max(map(len, column)) for column in zip(*rows, strict=True)) > table_width():
        names, *figures_by_file = zip(*rows, strict=True)
        text = split_columns(
            [["file", *(f"{name} " for name in names[1:])], *([c[0].strip(), *c[1:]] for c in figures_by_file)]
        )
    what = "rms" if all(row.held_out is None for one in found.values() for row in one) else "rms held-out"
    said = [
        f"{best}, {name}: {words}"
        for name, one in found.items()
        for row in one
        if row.name == best
        for words in ([row.fault] if row.fit is None else row_doubts(row))
    ]
    title = f"{heading(what, unit)}, each file fitted separately; * marks the best"
    return "\n\n".join([title, text, *_list("beware:", said)])


def row_doubts(row: Row) -> list[str]:
    """Cautions on a fitted model of a comparison, briefly."""
    if row.fit is None:
        return []
    said = [row.fault] if row.fault else []
    said += [] if row.fit.status == "converged" else [f"{STATUS[row.fit.status]}."]
    names = open_numbers(row.fit)
    return [*said, f"the data do not determine {listed(names)}."] if names else said


def for_people(comparison: Comparison) -> tuple[float, str]:
    """Factor and unit in which people read the errors of a comparison: that of the recordings."""
    k, shown = displayed_units.display_unit(comparison.unit)
    return k, "of the spread" if comparison.is_share else shown


# ---- sentences -----------------------------------------------------------------------------------


def _list(heading: str, sentences: Iterable[str]) -> list[str]:
    """A part of a text: sentences under a heading; none without sentences."""
    bullets = [_bullet(text) for text in sentences]
    return ["\n".join([heading, *bullets])] if bullets else []


def _bullet(text: str) -> str:
    """A sentence in lines that fit a terminal, after a dash; no percent sign stands alone."""
    wrapper = textwrap.TextWrapper(
        line_width(), initial_indent="- ", subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return wrapper.fill(text.replace(" %", "\xa0%")).replace("\xa0", " ")


# ---- views ---------------------------------------------------------------------------------------

view = functools.singledispatch(no_view)
view.register(Comparison, comparison_text)
view.register(Fit, fit_text)


@view.register
def differences_text(differences: Differences) -> str:
    """The title, and the table of residuals."""
    return "\n\n".join(filter(None, [differences.title, residual_table(differences)]))
