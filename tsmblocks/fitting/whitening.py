"""Whitening of residuals whose errors are correlated, as those are that the noise of an input causes.

Least squares of whitened residuals is generalised least squares. Source: Aitken, On least squares and linear
combination of observations, Proceedings of the Royal Society of Edinburgh 55 (1936), 42-48.
"""

from __future__ import annotations

import attrs
import numpy as np

NEGLIGIBLE_SIZE = 0.03
"""Deviation of a correlated error [rms noise] below which it is left out. Chosen: it adds a thousandth of the noise."""


@attrs.frozen(eq=False)
class Whitening:
    """A symmetric linear map that makes errors with the covariance I + U diag(s^2) U' white, and its inverse.

    ``directions`` U has shape (N, k) and orthonormal columns, ``sizes`` s shape (k,): errors are white with variance 1,
    and along each direction another one with deviation ``sizes`` adds to them.
    """

    directions: np.ndarray = attrs.field(repr=False)
    sizes: np.ndarray = attrs.field(repr=False)

    @classmethod
    def of(cls, causes: np.ndarray) -> Whitening | None:
        """The whitening of errors C w + e with white w (k,) and e (N,) of variance 1; ``causes`` C has shape (N, k).

        None where w causes next to nothing.
        """
        directions, sizes, _ = np.linalg.svd(causes, full_matrices=False)
        kept = sizes > NEGLIGIBLE_SIZE
        return cls(np.ascontiguousarray(directions[:, kept]), sizes[kept]) if kept.any() else None

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """Residuals (N,), or columns (N, m), whitened."""
        return self._scaled(values, 1 / np.sqrt(1 + self.sizes**2))

    def squares(self, columns: np.ndarray) -> np.ndarray:
        """Sums of squares (m,) of whitened columns (N, m)."""
        less = self.sizes**2 / (1 + self.sizes**2)
        return np.asarray(np.einsum("ij,ij->j", columns, columns) - self._parts(columns) ** 2 @ less)

    def restored(self, values: np.ndarray) -> np.ndarray:
        """What was whitened, as it was before."""
        return self._scaled(values, np.sqrt(1 + self.sizes**2))

    def scaled(self, factor: float) -> Whitening:
        """The whitening of correlated errors that are ``factor`` times as large."""
        return attrs.evolve(self, sizes=factor * self.sizes)

    def deviance(self, differences: np.ndarray) -> float:
        """Minus twice the logarithm of the likelihood of errors (N,) that are not whitened, but for a constant."""
        return float(self.squares(differences[:, None])[0] + np.sum(np.log(1 + self.sizes**2)))

    @property
    def variances(self) -> np.ndarray:
        """Variance (N,) that the correlated errors add to each of the white ones."""
        result: np.ndarray = self.directions**2 @ self.sizes**2
        return result

    def _scaled(self, values: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Values with their components along the directions times ``factors`` (k,)."""
        wide = values if values.ndim == 2 else values[:, None]
        changed = wide + self.directions @ ((factors - 1)[:, None] * self._parts(wide).T)
        return changed.reshape(values.shape)

    def _parts(self, columns: np.ndarray) -> np.ndarray:
        """Components (m, k) of columns (N, m) along the directions, which are many more and are not copied."""
        return np.ascontiguousarray(columns.T) @ self.directions
