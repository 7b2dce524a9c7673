"""The recordings and the base of a part of a diagram, prepared for the search: filters, holds, pieces, noise floors."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import attrs

from tsmblocks.common.interpolation import AUTO, Hold, hold_of_each, is_held
from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import few
from tsmblocks.data import Record
from tsmblocks.data.conditioning import all_conditioned
from tsmblocks.diagnosis.arguments import Request
from tsmblocks.diagnosis.commands import (
    NO_COMMANDS,
    ROUGH_DISTANCE,
    Commands,
    OtherCommands,
    commands_instead,
    confirmed,
    confirmed_by_fit,
    found_commands,
)
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.initial_states import refine_memories, reset_idle_memories
from tsmblocks.diagnosis.input_noise import InputNoise, NoiseByInput, errors_of_noise, input_noise, noise_by_input
from tsmblocks.diagnosis.input_spectrum import ErrorsOfInputs
from tsmblocks.diagnosis.model import Model, ModelSettings, ProgressCallback, calibrate, nearest, with_accurate_step
from tsmblocks.diagnosis.noise_at_rest import without_motion_at_rest
from tsmblocks.diagnosis.noise_floor import NoiseFloors, fast_noise_of_residuals, lowered_noise_floors, noise_floors
from tsmblocks.diagnosis.partition import (
    MAX_GROWN_ERROR,
    MAX_WHOLE_ERROR,
    MIN_GROWTH,
    ROUGH_ERROR,
    SHORTEST_PIECE,
    Part,
    has_lasting_memory,
    piece_lengths,
    split_into_pieces,
    total_delay,
    within_windows,
)
from tsmblocks.diagnosis.signs import with_signs
from tsmblocks.diagnosis.wrong_readings import without_wrong_readings
from tsmblocks.fitting.held_inputs import CLEAR, MAX_DISTANCE
from tsmblocks.fitting.holds import common_holds, hold_notes, in_one_word, resolved_holds
from tsmblocks.simulation.compiled import equations

DELAY = "delay"
"""The family of effects that delay, as a hold does."""
MAX_ERROR_SHARE = 0.7
"""Residual with held inputs over that without [rms], at most. Chosen: half of the mean square; a gap that is missing
delays as well, and a hold takes less than that off."""
SHARP_DISTANCE, SHARP_CLEAR = 0.1, 10.0
"""Distance of the share of a hold from 1, and that share in its standard deviations, at which it is a hold and nothing
else that delays: of a gap the share may be anything. Chosen."""
FAR_DISTANCE = 0.15
"""The same distance beside a residual that is far above the noise. Chosen: a force that is held is 0.88 there."""
MAX_SURE_ERROR = 4.0
"""Mean square of a residual [that of the noise] up to which what the outputs show of a hold is hardly due to the model
error that is left. Chosen: twice the noise."""
MAX_ERROR_GROWTH = 1.3
"""Residual of a base with commands that a model with effects showed over that without [rms], at most. Chosen: where the
effect that is missing is large they change little, and where it is small the right ones leave no more."""


@attrs.frozen(eq=False)
class Prepared:
    """A part of a diagram, its base fitted to recordings that are prepared for it.

    ``raw`` are the ``records`` before noise of the inputs in ``filtered`` was removed, both in pieces where the
    simulation restarts. ``commands`` are the inputs that the outputs showed to be commands; no more of them are looked
    for where they are ``settled``. ``input_noise`` is what noise of the inputs adds to the outputs;
    where residuals are whitened beside it, ``plain`` is the same without. ``noises`` is that noise by recording.
    """

    part: Part
    request: Request
    records: Mapping[str, Record]
    raw: Mapping[str, Record]
    settings: ModelSettings
    floors: NoiseFloors
    base: Model
    filtered: tuple[str, ...]
    commands: Commands
    notes: tuple[str, ...]
    input_noise: InputNoise
    noises: NoiseByInput
    plain: Prepared | None = None
    settled: bool = False

    @functools.cached_property
    def errors_of_inputs(self) -> ErrorsOfInputs:
        """What errors of noisy inputs change in the outputs of the base."""
        return ErrorsOfInputs(errors_of_noise(self.base, self.noises))

    def check(self, model: Model) -> None:
        """Raise OtherCommands where a model shows inputs to be commands, beyond those that are known.

        Beside a residual that is far above the noise the evidence has to be sharp: what is missing may delay as well.
        """
        sharp = (FAR_DISTANCE, SHARP_CLEAR) if model.mean_square > MAX_SURE_ERROR else ()
        if found := confirmed_by_fit(model, self.commands_of(model, *sharp)):
            raise OtherCommands(self.commands.joined(found))

    def check_named(self, base: Model, named: FittedCandidate) -> None:
        """Raise OtherCommands where the hold of an input explains as much as a delay that was named beside ``base``."""
        if self.settled or named.candidate.effect.family != DELAY:
            return
        if found := commands_instead(base, named.model, self.may_be_held):
            raise OtherCommands(self.commands.joined(found))

    @property
    def request_of_next_part(self) -> Request:
        """The request with the recordings as they are known now: an output may be an input of the next part."""
        return attrs.evolve(self.request, wrong_readings=())

    @property
    def may_be_held(self) -> set[str]:
        """The inputs whose hold was not given, and is not known."""
        given = hold_of_each(self.request.settings.hold, list(self.request.diagram.inports))
        return {k for k, hold in given.items() if hold == AUTO and k not in self.commands.held}

    def commands_of(self, model: Model, distance: float = MAX_DISTANCE, clear: float = CLEAR) -> Commands:
        """The inputs that the outputs show to be commands, beyond those that are known."""
        if self.settled:
            return NO_COMMANDS
        given = self.request.diagram.inports.keys()  # of the whole: those that join two parts were measured
        likely = () if clear > CLEAR else _held_inputs(self.part, self.request.records).keys()
        return found_commands(model, self.raw, given & {*self.filtered}, self.may_be_held, distance, likely, clear)

    def error(self, beside: InputNoise) -> float:
        """The geometric mean of the residuals of the outputs, in their units, beside noise of the inputs."""
        rms = self.base.residual_rms_beside(beside.whitening)
        return math.exp(sum(math.log(max(self.floors.sigma[k] * v, 1e-300)) for k, v in rms.items()) / len(rms))


def prepared(part: Part, request: Request, progress: ProgressCallback, commands: Commands = NO_COMMANDS) -> Prepared:
    """The recordings prepared and the base fitted; ``commands`` are those that are known already.

    Wrong readings that the base shows have no weight in what follows.
    """
    found = _with_commands(part, request, progress, commands)
    records, notes = without_wrong_readings(found.base, request.records)
    if notes:
        request = attrs.evolve(request, records=records, wrong_readings=(*request.wrong_readings, *notes))
        found = _with_commands(part, request, progress, commands)
    if more := found.commands_of(found.base, ROUGH_DISTANCE):
        other = prepared(part, request, progress, commands.joined(more))
        doubtful = more.held and found.commands_of(found.base, SHARP_DISTANCE, SHARP_CLEAR).held != more.held
        before, after = (one.error(found.input_noise) for one in (found, other))
        enough = other.base.mean_square <= MAX_SURE_ERROR and after < MAX_ERROR_SHARE * before
        if (enough or not doubtful) and after < before and confirmed(other.base, found.base.setup):
            return other
    return found


def prepared_again(ready: Prepared, commands: Commands, progress: ProgressCallback) -> Prepared:
    """Prepared with commands that a model with effects showed; as before where the base is worse with them."""
    other = prepared(ready.part, ready.request, progress, commands)
    before, after = (one.error(ready.input_noise) for one in (ready, other))
    return other if after <= MAX_ERROR_GROWTH * before else attrs.evolve(ready, settled=True)


def _with_commands(part: Part, request: Request, progress: ProgressCallback, commands: Commands) -> Prepared:
    """The recordings prepared and the base fitted, with no other commands than these."""
    notes = [f"{part.name}: {text}" for text in commands.notes]
    without_noise = _held_inputs(part, request.records)
    exact = {*commands.exact, *without_noise}
    filtered = tuple(k for k in part.diagram.inputs if request.condition and k not in exact)
    notes += _unfiltered_notes(part, request, commands, without_noise)
    records, settings = _conditioned(request, filtered, progress, notes), request.settings
    raw, compared = request.records, within_windows(request.records, settings.window)
    floors = noise_floors(compared, part.diagram, part.outputs, request.noise_floors)
    settings = settings.restricted_to(part.diagram, part.outputs, floors.sigma)
    settings = attrs.evolve(settings, hold=_holds(part, records, settings, commands, notes))
    if (piece := _piece_length(part, records, settings, progress)) is not None:
        records, raw, settings = _in_pieces(part, piece, records, compared, settings)
        notes.append(
            f"{part.name}: errors of the model add up in this plant, so its simulation restarts about every "
            f"{to_digits(piece)} s, from estimated initial states."
        )
    base, floors, lowered = _base(part, records, settings, progress, floors, compared)
    settings = attrs.evolve(settings, sigma=floors.sigma)
    notes += [*floors.notes, *lowered]
    noisy = noise_by_input(request.records, set(part.diagram.inputs) - exact, filtered=request.condition)
    noise = input_noise(base, noisy, settings.seed)
    without = InputNoise(noise.propagated, noise.propagated)
    plain = Prepared(
        part, request, records, raw, settings, floors, base, filtered, commands, tuple(notes), without, noisy
    )
    if not noise.whitening:
        return plain
    noise = noise.scaled_to(noise.whitened_base(base))
    settings = attrs.evolve(settings, whitening=noise.whitening)
    base = _calibrated(part, records, settings, progress)
    return attrs.evolve(plain, settings=settings, base=base, input_noise=noise, plain=plain)


def _held_inputs(part: Part, records: Mapping[str, Record]) -> dict[str, list[str]]:
    """The inputs that are piecewise constant in some recordings, and those recordings."""
    inputs = part.diagram.inputs
    found = {k: [name for name, one in records.items() if k in one and is_held(one[k])] for k in inputs}
    return {k: names for k, names in found.items() if names}


def _unfiltered_notes(
    part: Part, request: Request, commands: Commands, without_noise: Mapping[str, list[str]]
) -> list[str]:
    """Notes on inputs that are not filtered, though they look noisy in some recordings."""
    advice = " If it is held between samples in the other recordings as well, give hold='zero', or --hold zero."
    return [
        f"{part.name}: {k} was not filtered: it is piecewise constant in {few(names)}, so it has no noise."
        + ("" if k in commands.held else advice)
        for k, names in without_noise.items()
        if request.condition and k not in commands.exact and len(names) < len(request.records)
    ]


def _conditioned(
    request: Request, inputs: tuple[str, ...], progress: ProgressCallback, notes: list[str]
) -> Mapping[str, Record]:
    """The recordings with the noise of measured inputs filtered out."""
    raw = request.records
    progress("conditioned", 0, 1)
    records = all_conditioned(raw, inputs) if request.condition else dict(raw)
    notes += [f"{name}: {text}" for name, r in records.items() for text in r.notes if text not in raw[name].notes]
    return records


def _holds(
    part: Part, records: Mapping[str, Record], settings: ModelSettings, commands: Commands, notes: list[str]
) -> Hold:
    """Interpolation of the inputs of a part between samples, from whole recordings: pieces of them show too little."""
    names, orders, found = list(part.diagram.inports), equations(part.diagram).orders, []
    given = {**hold_of_each(settings.hold, names), **dict.fromkeys(commands.held, "zero")}
    for name, record in records.items():
        holds = resolved_holds(record, names, given, orders)
        notes += [f"{name}: {text}" for text in hold_notes(record, holds, given)]
        found.append((record, holds))
    return in_one_word(common_holds(found))


def _piece_length(
    part: Part, records: Mapping[str, Record], settings: ModelSettings, progress: ProgressCallback
) -> float | None:
    """How long [s] the simulation runs until it restarts, None for whole recordings.

    Where the plant integrates, errors grow with time: the longest pieces are taken in which those of the base do not
    exceed ``MAX_GROWN_ERROR``, since each restart has initial states that absorb small and slow errors. Pieces below
    ``SHORTEST_PIECE`` are for bases that are rough in those. Small errors that are about as large in pieces have not
    grown.
    """
    if not has_lasting_memory(part.diagram, records, settings):
        return None
    whole, delay = within_windows(records, settings.window), total_delay(part.diagram)

    @functools.cache
    def error_in(length: float | None) -> float:
        some, windows = (records, settings.window) if length is None else split_into_pieces(whole, delay, length)
        tried = attrs.evolve(settings, window=windows)
        return calibrate(part.diagram, some, tried, lambda *_: progress("calibrated", 0, 1)).mean_square

    in_whole = error = error_in(None)
    if in_whole <= MAX_GROWN_ERROR:
        return None
    *lengths, found = piece_lengths(whole)
    for length in lengths:
        shortest = length <= SHORTEST_PIECE
        if not (shortest and error <= ROUGH_ERROR):
            error = error_in(length)
        if error <= (ROUGH_ERROR if shortest else MAX_GROWN_ERROR):
            found = length
            break
    grown = in_whole > MAX_WHOLE_ERROR or in_whole > MIN_GROWTH * error_in(found)
    return found if grown else None


def _in_pieces(
    part: Part, length: float, records: Mapping[str, Record], raw: Mapping[str, Record], settings: ModelSettings
) -> tuple[Mapping[str, Record], Mapping[str, Record], ModelSettings]:
    """Recordings in pieces [s], with and without the noise of their inputs; settings with their windows."""
    delay = total_delay(part.diagram)
    pieces, windows = split_into_pieces(within_windows(records, settings.window), delay, length)
    return pieces, split_into_pieces(raw, delay, length)[0], attrs.evolve(settings, window=windows)


def _base(
    part: Part,
    records: Mapping[str, Record],
    settings: ModelSettings,
    progress: ProgressCallback,
    floors: NoiseFloors,
    compared: Mapping[str, Record],
) -> tuple[Model, NoiseFloors, list[str]]:
    """The base, fitted again where its residual lowers a noise floor; the floors, and notes on them."""
    base = _calibrated(part, records, settings, progress)
    floors, lowered = lowered_noise_floors(
        floors, base.residual_rms, fast_noise_of_residuals(base), compared, part.diagram
    )
    floors, more = without_motion_at_rest(floors, base, compared, settings.sigma)
    if floors.sigma != settings.sigma:
        base = _calibrated(part, records, attrs.evolve(settings, sigma=floors.sigma), progress)
    return base, floors, [*lowered, *more]


def _calibrated(
    part: Part, records: Mapping[str, Record], settings: ModelSettings, progress: ProgressCallback
) -> Model:
    """The base: the part with its own parameters fitted, and the initial states of its memories."""
    progress("calibrated", 0, 1)
    model = calibrate(part.diagram, records, settings, lambda *_: progress("calibrated", 0, 1))
    model = with_accurate_step(model, settings)
    return nearest(reset_idle_memories(refine_memories(with_signs(model, part.diagram.parameters))))
