"""Shapes that are chosen for each experiment alone, as the instant of a jump is where experiments share no clock.

A shape of an experiment changes its own outputs alone, so that the best one is found there; only the base's parameters,
which are projected out, tie the experiments together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.fitting.column_space import ColumnSpace

Shape = Mapping[str, float]
"""Values by name of the parameter, ``name@experiment`` where an experiment has a separate one."""
SINGLE_PRECISION = 1e-6
"""Share of the sum of squares of a change that is rounding, in single precision. Chosen: ten times its resolution."""


def for_each(shape: Shape, own: Collection[str], experiments: Sequence[str]) -> dict[str, float]:
    """A shape with the same value of the parameters ``own`` for each experiment."""
    shared = {name: value for name, value in shape.items() if name not in own}
    return shared | {f"{name}@{one}": shape[name] for name in own if name in shape for one in experiments}


def joined(shapes: Sequence[Shape], chosen: Sequence[int], experiments: Sequence[str]) -> dict[str, float]:
    """The shape that has of each experiment the values of the shape that was ``chosen`` for it."""
    position = dict(zip(experiments, chosen, strict=True))
    return {name: shapes[position.get(name.partition("@")[2], 0)][name] for name in shapes[0]}


def moved(shape: Shape, parameter: str, distance: float) -> dict[str, float]:
    """A shape with a parameter moved by a distance in every experiment."""
    return {k: value + (distance if k.partition("@")[0] == parameter else 0.0) for k, value in shape.items()}


@attrs.frozen(eq=False)
class Products:
    """Products of the changes of an experiment's outputs by shapes S, each with k strengths, at their trial sizes.

    ``inside`` (q, S, k) are their components in the base. With the base projected out, ``g`` (S, k) are their products
    with the residual, and ``noise`` (S, k, D) those with surrogates of it. ``whole`` (S, k, k) are their products with
    each other, before the base was projected out.
    """

    inside: np.ndarray
    g: np.ndarray
    noise: np.ndarray
    whole: np.ndarray

    @classmethod
    def of(cls, changes: np.ndarray, k: int, base: ColumnSpace, r: np.ndarray, noise: np.ndarray | None) -> Products:
        """Of the changes (N, S k), zero outside of the experiment, the residual (N,) and surrogates of it (N, D)."""
        count = changes.shape[1] // k
        inside = base.basis.transposed_times(changes)
        g = changes.T @ r - inside.T @ base.basis.transposed_times(r)
        by_noise = np.zeros((count * k, 0)) if noise is None else changes.astype(noise.dtype).T @ noise
        apart = changes.reshape(len(changes), count, k)
        whole = np.einsum("nsi,nsj->sij", apart, apart, optimize=True)
        return cls(inside.reshape(-1, count, k), g.reshape(count, k), by_noise.reshape(count, k, -1), whole)

    @property
    def best(self) -> int:
        """The shape with the largest fall of the sum of squares."""
        return int(np.argmax(self._gains(self.g[..., None])[:, 0]))

    @property
    def best_of_noise(self) -> np.ndarray:
        """The same in each surrogate, shape (D,)."""
        return np.argmax(self._gains(self.noise.astype(float)), axis=0)

    def _gains(self, g: np.ndarray) -> np.ndarray:
        """Falls of the sum of squares (S, D) for products ``g`` (S, k, D)."""
        m = self.whole - np.einsum("qsi,qsj->sij", self.inside, self.inside, optimize=True)
        return falls(regular(m, self.whole), g)


def noise_gains(every: Sequence[Products]) -> np.ndarray:
    """Gains (D,) in surrogates, in each with the best shape of each experiment."""
    chosen = [one.best_of_noise for one in every]
    gains = np.empty(len(chosen[0]))
    k = every[0].g.shape[1]
    for d in range(len(gains)):
        inside = np.concatenate([one.inside[:, own[d]] for one, own in zip(every, chosen, strict=True)], axis=1)
        g = np.concatenate([one.noise[own[d], :, d] for one, own in zip(every, chosen, strict=True)]).astype(float)
        whole = np.zeros((len(g), len(g)))
        for e, (one, own) in enumerate(zip(every, chosen, strict=True)):
            whole[e * k : (e + 1) * k, e * k : (e + 1) * k] = one.whole[own[d]]
        gains[d] = g @ np.linalg.solve(regular(whole - inside.T @ inside, whole), g)
    return gains


def falls(m: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Falls of the sum of squares (..., D), for products of changes with residuals, ``g`` (..., k, D), and with each
    other, ``m`` (..., k, k).
    """
    return np.asarray(np.einsum("...kd,...kd->...d", g, np.linalg.solve(m, g)))


def regular(m: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Products (..., k, k) that can be inverted: what the base absorbs has no gain."""
    diagonal = np.einsum("...ii->...i", whole)
    return m + SINGLE_PRECISION * np.maximum(diagonal, 1e-300)[..., None] * np.eye(m.shape[-1])
