"""The linear cross fixes are the paper's equations 4 and 8, which are not the same: matrices, symbols, numbers.

Angles φ in the paper run from the east axis. Numerical tolerances are rounding times the condition of three lines that
meet at a thousandth of a radian.
"""

import math

import numpy as np
import pytest
import sympy

from passloc_env.angles import bearing_of
from passloc_env.tracking.cross_fix import least_squares, tangent_least_squares


def problem(count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Stations in the unit square, and bearings to one target there, each up to 45° wrong."""
    rng = np.random.default_rng(count)
    stations, target = rng.uniform(size=(2, count, size)), rng.uniform(size=(2, size))
    return stations, bearing_of(target[:, None] - stations) + rng.uniform(-math.pi / 4, math.pi / 4, (count, size))


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """Points within a share of their distance from the origin, or of one."""
    error = np.hypot(*(found - expected)) / (1.0 + np.hypot(*expected))
    assert error.max() < tolerance


@pytest.mark.parametrize("count", [2, 3, 6])
def test_lines_solve_the_matrices_of_the_paper(count: int) -> None:
    """Eqs. 4, 7 and 8 as printed, angles from the east axis, one column at a time."""
    stations, bearings = problem(count, 200)
    tangent, cartesian = tangent_least_squares(stations, bearings), least_squares(stations, bearings)
    for i in range(200):
        (x, y), angle = stations[..., i], math.pi / 2 - bearings[:, i]
        slopes = np.column_stack([np.tan(angle), -np.ones(count)])
        expected = np.linalg.lstsq(slopes, x * np.tan(angle) - y)[0]
        assert_close(tangent[:, i], expected)
        one, zero = np.ones((count, 1)), np.zeros((count, 1))
        q = np.block([[one, zero, np.diag(-np.cos(angle))], [zero, one, np.diag(-np.sin(angle))]])
        assert_close(cartesian[:, i], np.linalg.lstsq(q, np.concatenate([x, y]))[0][:2])


class Symbols:
    """Lines of M stations with angles φ from the east axis, in symbols."""

    def __init__(self, count: int) -> None:
        self.x, self.y = sympy.symbols("x y", real=True)
        self.px, self.py = (sympy.symbols(f"{name}1:{count + 1}", real=True) for name in ("p", "q"))
        self.phi = sympy.symbols(f"phi1:{count + 1}", real=True)
        lines = zip(self.px, self.py, self.phi, strict=True)
        self.e = [(self.x - p) * sympy.sin(f) - (self.y - q) * sympy.cos(f) for p, q, f in lines]
        self.a = sympy.Matrix([[sympy.tan(f), -1] for f in self.phi])
        self.b = sympy.Matrix([p * sympy.tan(f) - q for p, q, f in zip(self.px, self.py, self.phi, strict=True)])

    def slope_of(self, weights: list[sympy.Expr]) -> sympy.Matrix:
        """Half the gradient of ``Σ w e²`` in the point."""
        total = sum(w * e**2 for w, e in zip(weights, self.e, strict=True))
        return sympy.Matrix([sympy.diff(total, self.x), sympy.diff(total, self.y)]) / 2

    def normal_equations(self) -> sympy.Matrix:
        """``AᵀA s − Aᵀb`` of eq. 4."""
        return self.a.T * (self.a * sympy.Matrix([self.x, self.y]) - self.b)


def test_what_equation_4_minimises() -> None:
    """``Σ e² / cos² φ``: its gradient is the left side of the normal equations."""
    s = Symbols(3)
    difference = s.normal_equations() - s.slope_of([1 / sympy.cos(f) ** 2 for f in s.phi])
    assert sympy.simplify(difference) == sympy.zeros(2, 1)


def test_what_equation_8_minimises() -> None:
    """``Σ e²``: what is left of the gradient of ``|Qq − h|²`` once the ranges have made their part vanish."""
    s = Symbols(3)
    ranges = sympy.symbols("r1:4", real=True)
    east = [s.x - r * sympy.cos(f) - p for r, f, p in zip(ranges, s.phi, s.px, strict=True)]
    north = [s.y - r * sympy.sin(f) - q for r, f, q in zip(ranges, s.phi, s.py, strict=True)]
    total = sum(term**2 for term in east + north)
    slopes = {r: sympy.diff(total, r) for r in ranges}
    best = {r: -slope.subs(r, 0) / sympy.simplify(sympy.diff(slope, r)) for r, slope in slopes.items()}
    gradient = sympy.Matrix([sympy.diff(total, s.x), sympy.diff(total, s.y)]).subs(best) / 2
    assert sympy.simplify(gradient - s.slope_of([sympy.Integer(1)] * 3)) == sympy.zeros(2, 1)


def test_equations_4_and_8_agree_for_two_stations() -> None:
    """Two lines cross: both sums vanish there, whatever the weights."""
    s = Symbols(2)
    crossing = s.a.LUsolve(s.b)
    at_crossing = [e.subs({s.x: crossing[0], s.y: crossing[1]}, simultaneous=True) for e in s.e]
    assert [sympy.simplify(e) for e in at_crossing] == [0, 0]
    stations, bearings = problem(2, 1000)
    assert_close(tangent_least_squares(stations, bearings), least_squares(stations, bearings))


def test_equations_4_and_8_differ_for_three_stations() -> None:
    """One exact counterexample to the paper's proof, with slopes 0, 3/4 and 4/3, and ours equal to it."""
    s = Symbols(3)
    places = dict(zip(s.px + s.py, (0, 4, 1, 0, 0, 3), strict=True))
    angles = (sympy.Integer(0), sympy.atan(sympy.Rational(3, 4)), sympy.atan(sympy.Rational(4, 3)))
    values = {**places, **dict(zip(s.phi, angles, strict=True))}
    eq4 = sympy.solve(list(s.normal_equations().subs(values)), [s.x, s.y])
    eq8 = sympy.solve(list(s.slope_of([sympy.Integer(1)] * 3).subs(values)), [s.x, s.y])
    assert eq4 != eq8
    assert all(value.is_Rational for value in (*eq4.values(), *eq8.values()))
    stations = np.array([[0.0, 4.0, 1.0], [0.0, 0.0, 3.0]])[..., None]
    bearings = np.array([[math.pi / 2 - float(angle)] for angle in angles])
    for function, exact in ((tangent_least_squares, eq4), (least_squares, eq8)):
        expected = np.array([[float(exact[s.x])], [float(exact[s.y])]])
        assert_close(function(stations, bearings), expected, 1e-14)
