"""The result of a batch: results by set of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.tables import few
from tsmblocks.common.views import view


@attrs.frozen(eq=False)
class Batch:
    """Results of many runs of one diagram.

    Parameters
    ----------
    parameters : dict of str to ndarray
        Values of the varied parameters, shape (sets,).
    results : dict of str to ndarray
        Signals of shape (sets, N), or reduced results of shape (sets,).
    t : ndarray
        Instants in s, shape (N,).
    units : dict of str to str, optional
        Units of signals that were not reduced.
    """

    parameters: Mapping[str, np.ndarray]
    results: Mapping[str, np.ndarray]
    t: np.ndarray
    units: Mapping[str, str] = attrs.field(factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        """A result by name; raises RunError with the near miss."""
        if name not in self.results:
            raise RunError(f"the batch has no result '{name}'.{near(name, self.results)}")
        return self.results[name]

    @property
    def failed(self) -> np.ndarray:
        """Sets with a result that is not finite (an unstable choice of gains, for example), shape (sets,)."""
        return np.any([~np.isfinite(v.reshape(len(v), -1)).all(axis=1) for v in self.results.values()], axis=0)

    @property
    def _count(self) -> int:
        return len(next(iter(self.parameters.values())))

    def __repr__(self) -> str:
        return f"Batch({self._count} sets of {few(self.parameters)}, results {few(self.results)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def to_pandas(self) -> Any:
        """A table with a row for each set: parameters, then reduced results.

        Returns
        -------
        pandas.DataFrame
            The table; signals over time are left out. Needs pandas.
        """
        single = {k: v for k, v in self.results.items() if v.ndim == 1}
        return frame({**self.parameters, **single}, np.arange(self._count), "set")

    def to_xarray(self) -> Any:
        """All results over ``set`` and ``t`` [s], with the parameters as coordinates.

        Returns
        -------
        xarray.Dataset
            The results, with ``attrs["units"]``. Needs xarray.
        """
        results = {k: (("set", "t")[: v.ndim], v, self.units.get(k, "")) for k, v in self.results.items()}
        coords = {
            "set": (("set",), np.arange(self._count), ""),
            **{k: (("set",), v, "") for k, v in self.parameters.items()},
        }
        if any(v.ndim > 1 for v in self.results.values()):
            coords["t"] = (("t",), self.t, "s")
        return dataset(results, coords, {})
