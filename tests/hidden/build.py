"""Cases from specifications: batches of one kind side by side, effects scaled to the excess asked for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from .choose import allowed_effects, resolved
from .kinds import GROUPS, PROTOCOLS, Case, Spec
from .sheath_cases import sheath_cases

BATCH = 16


def case(
    group: str,
    *,
    effect: str = "",
    size: float = 1.0,
    seed: int = 0,
    protocol: str = "rich",
    measure: str = "regression",
    amplitude: float | None = None,
    step: float = 1e-3,
) -> Case:
    """One case. Much dearer than its share of a batch: see `cases`."""
    return cases([Spec(group, effect, size, seed, protocol, measure, amplitude)], step=step)[0]


def cases(specs: Iterable[Spec | tuple | dict], *, step: float = 1e-3) -> list[Case]:
    """Cases in the order asked for; those of one group, effect and protocol are simulated side by side.

    `step` is that of the sheath [s]; the motor's is a fifth of it.
    """
    asked = [_checked(_spec(s)) for s in specs]
    batches: dict[tuple, list[int]] = {}
    for i, spec in enumerate(asked):
        batches.setdefault((spec.group, spec.effect, spec.protocol), []).append(i)
    made: dict[int, Case] = {}
    for (group, _, _), members in batches.items():
        maker = _maker(group)
        for at in range(0, len(members), BATCH):
            part = members[at : at + BATCH]
            made |= dict(zip(part, maker([asked[i] for i in part], step), strict=True))
    return [made[i] for i in range(len(asked))]


def _maker(group):
    if group in ("motor_open", "motor_closed"):
        from .motor_cases import motor_cases

        return motor_cases
    if group in ("chain", "sensor"):
        from .chain_cases import chain_cases

        return chain_cases
    return sheath_cases


def _spec(given) -> Spec:
    if isinstance(given, Spec):
        return given
    return Spec(**given) if isinstance(given, dict) else Spec(*given)


def _checked(spec: Spec) -> Spec:
    if spec.group not in GROUPS or spec.protocol not in PROTOCOLS:
        raise ValueError(f"{spec}: groups are {', '.join(GROUPS)}; protocols {', '.join(PROTOCOLS)}")
    made = replace(resolved(spec), size=float(spec.size))
    allowed = allowed_effects(made.group)
    strange = [name for name in made.effect.split("+") if name and name not in allowed]
    if strange:
        raise ValueError(f"{spec}: no effect {', '.join(strange)} in group {made.group}, only {', '.join(allowed)}")
    return made
