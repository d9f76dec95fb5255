"""A log of a case as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Trial:
    """One log of a case as arrays.

    Attributes:
        name: file of the log.
        role: use of the log in the case.
        reference: (n, references) references [SI].
        measured: (n, columns) measured signals [SI], NaN where missing.
        latent: inputs that were not logged but decoded from the log, name -> (n, channels).
        follow: (n, channels) logged inputs and outputs that correct a run (`Machine.observer`), if they do.
        whole: whether no part of it may be left out, as of a motion that was designed to tell explanations apart.
    """

    name: str
    role: str
    reference: np.ndarray
    measured: np.ndarray
    latent: Mapping[str, np.ndarray] = field(default_factory=dict)
    follow: np.ndarray | None = None
    whole: bool = False

    def shortened(self, share: float) -> Trial:
        """The first part of the log, two frames at least; all of one that is used whole."""
        return self if self.whole else self.first(max(2, int(share * len(self.reference))))

    def first(self, n: int) -> Trial:
        """The first n frames."""
        follow = None if self.follow is None else self.follow[:n]
        return replace(self, reference=self.reference[:n], measured=self.measured[:n], follow=follow)
