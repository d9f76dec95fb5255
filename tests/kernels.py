"""Linear algebra of other processors than the one that runs the tests (`studies.processors`)."""

from functools import cache

import pytest

from studies.processors import used


@cache
def runs(kernel: str) -> bool:
    """Whether this processor, with this build of numpy and scipy, can run the code of another processor."""
    return used(kernel) == [kernel]


def skip_without(*kernels: str) -> None:
    """Skips a test where the linear algebra of a processor does not run, and says which."""
    for kernel in kernels:
        if not runs(kernel):
            pytest.skip(f"the linear algebra of {kernel} does not run on this processor")
