"""What many runs at once return: results by set of parameters."""

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
    """Results of many runs. ``results[name]`` has shape (sets,) after a reduction, else (sets, N).

    ``t`` (N,) [s] are the instants, ``units`` the labels of signals that were not reduced.
    ``failed`` marks the sets whose results are not finite (an unstable choice of gains, say).
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
        """Which sets have a result that is not finite, shape (sets,)."""
        return np.any([~np.isfinite(v.reshape(len(v), -1)).all(axis=1) for v in self.results.values()], axis=0)

    def __repr__(self) -> str:
        count = len(next(iter(self.parameters.values())))
        return f"Batch({count} sets of {few(self.parameters)}, results {few(self.results)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def to_pandas(self) -> Any:
        """A frame with a row per set: parameters, then reduced results. Needs pandas."""
        single = {k: v for k, v in self.results.items() if v.ndim == 1}
        return frame({**self.parameters, **single}, np.arange(len(next(iter(self.parameters.values())))), "set")

    def to_xarray(self) -> Any:
        """A data set over ``set`` (with the parameters as coordinates) and ``t`` [s]. Needs xarray."""
        results = {k: (("set", "t")[: v.ndim], v, self.units.get(k, "")) for k, v in self.results.items()}
        sets = np.arange(len(next(iter(self.parameters.values()))))
        coords = {"set": (("set",), sets, ""), **{k: (("set",), v, "") for k, v in self.parameters.items()}}
        if any(v.ndim > 1 for v in self.results.values()):
            coords["t"] = (("t",), self.t, "s")
        return dataset(results, coords, {})
