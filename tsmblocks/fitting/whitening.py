"""Whitening of residuals whose errors are correlated, as those are that the noise of an input causes."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.fitting.inner_products import product

NEGLIGIBLE_SIZE = 0.1
"""Deviation of a correlated error [rms noise] below which it is left out. Chosen: it adds a hundredth of the noise."""


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

    def restored(self, values: np.ndarray) -> np.ndarray:
        """What was whitened, as it was before."""
        return self._scaled(values, np.sqrt(1 + self.sizes**2))

    @property
    def variances(self) -> np.ndarray:
        """Variance (N,) that the correlated errors add to each of the white ones."""
        result: np.ndarray = self.directions**2 @ self.sizes**2
        return result

    def _scaled(self, values: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Values with their components along the directions times ``factors`` (k,)."""
        wide = values if values.ndim == 2 else values[:, None]
        parts = product(np.ascontiguousarray(self.directions.T), wide)
        changed = wide + product(self.directions, (factors - 1)[:, None] * parts)
        return changed.reshape(values.shape)
