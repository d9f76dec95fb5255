"""Linear algebra of other processors than the one that runs the tests (`studies.processors`)."""

from functools import cache

import pytest

from studies.processors import used


@cache
def lacking(kernel: str) -> bool:
    """Whether this processor, or this build of numpy and scipy, cannot run the code of another processor."""
    return used(kernel) != [kernel]


def needs_kernels(*names: str) -> pytest.MarkDecorator:
    """Skips a test where the linear algebra of a processor does not run, and says which."""
    absent = [name for name in names if lacking(name)]
    return pytest.mark.skipif(bool(absent), reason=f"no OpenBLAS code of {', '.join(absent)} runs here")
