"""Functions that NumPy lacks, beside SciPy's."""

import numpy as np
from scipy import special

from passloc_env.special import FURTHER, erf


def test_the_error_function_is_scipys() -> None:
    """Within some units in the last place: two libraries."""
    x = np.linspace(-7.0, 7.0, 2800).reshape(7, -1)
    np.testing.assert_allclose(erf(x), special.erf(x), rtol=1e-15, atol=1e-300)
    assert erf(0.5) == erf(np.array([0.5]))[0]
    assert FURTHER["erf"] is erf


def test_it_writes_where_it_is_told() -> None:
    out = np.full((2, 3), 7.0)
    assert erf(np.ones((2, 3)), out=out) is out
    np.testing.assert_allclose(out, special.erf(1.0), rtol=1e-15)
