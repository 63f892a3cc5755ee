from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from maglev_design.simulation import noise
from maglev_design.simulation.noise import pcg4d, standard_normals

STEPS = 100_000
SEEDS = (0, 1, 2, 12345, 2**31, noise.LARGEST_SEED)

DEVIATIONS = 4.5
"""Of a statistic's own standard error: one honest stream in a hundred thousand is farther off."""
KOLMOGOROV = 1.95
"""sqrt(n) times the Kolmogorov-Smirnov distance: exceeded with probability 0.001."""


# --- hash ----------------------------------------------------------------------------------


def pcg4d_by_hand(words: tuple[int, int, int, int]) -> tuple[int, ...]:
    """The published function on Python's own integers."""
    v = [(x * reference.PCG4D_MULTIPLIER + reference.PCG4D_INCREMENT) % 2**32 for x in words]

    def mix() -> None:
        v[0] = (v[0] + v[1] * v[3]) % 2**32
        v[1] = (v[1] + v[2] * v[0]) % 2**32
        v[2] = (v[2] + v[0] * v[1]) % 2**32
        v[3] = (v[3] + v[1] * v[2]) % 2**32

    mix()
    v = [x ^ (x >> 16) for x in v]
    mix()
    return tuple(v)


words = st.integers(0, 2**32 - 1)


@given(words, words, words, words)
def test_the_hash_is_the_published_one(a: int, b: int, c: int, d: int) -> None:
    columns = [np.array([x], dtype=np.uint32) for x in (a, b, c, d)]
    assert tuple(int(w[0]) for w in pcg4d(*columns)) == pcg4d_by_hand((a, b, c, d))


@given(words, words, st.integers(0, 1), st.integers(0, 50))
def test_the_stream_is_the_documented_one(seed: int, scenario: int, channel: int, n: int) -> None:
    halves = [h for w in pcg4d_by_hand((seed, scenario, channel, n)) for h in (w & 0xFFFF, w >> 16)]
    r = (float(sum(halves)) - 4 * 65535.0) * noise._SCALE
    r2 = r * r
    expected = r * (noise._A1 + r2 * (noise._A3 + r2 * (noise._A5 + r2 * noise._A7)))
    assert standard_normals(seed, scenario, channel, n + 1)[n] == expected


def test_the_scale_makes_the_variance_of_eight_uniforms_one() -> None:
    assert 1 / (65536 * math.sqrt(8 / 12)) == noise._SCALE


# --- normal transform ----------------------------------------------------------------------


def irwin_hall(x: float) -> float:
    """Return P(sum of eight uniforms on [0, 1] < x), for x in the lower half."""
    terms = ((-1) ** k * math.comb(8, k) * (x - k) ** 8 for k in range(int(x) + 1))
    return float(sum(terms)) / math.factorial(8)


@pytest.mark.parametrize(("up_to", "error"), [(2.0, 6e-5), (3.0, 3e-4), (4.0, 6e-3)])
def test_the_transform_is_as_near_to_the_normal_quantile_as_documented(
    up_to: float, error: float
) -> None:
    worst = 0.0
    for r in np.linspace(-4.2, 0.0, 2001):
        value = float(
            r * (noise._A1 + r * r * (noise._A3 + r * r * (noise._A5 + r * r * noise._A7)))
        )
        exact = float(stats.norm.ppf(irwin_hall(4 + r * math.sqrt(8 / 12))))
        if abs(exact) <= up_to:
            worst = max(worst, abs(value - exact))
    assert worst <= error
    assert worst > error / 4, "the documented error is not idle"


def test_no_value_is_larger_than_documented() -> None:
    r = 4 * 65535.0 * noise._SCALE
    largest = r * (noise._A1 + r * r * (noise._A3 + r * r * (noise._A5 + r * r * noise._A7)))
    assert 6.0 < largest <= 6.5


# --- statistics ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("channel", [noise.INPUT_CHANNEL, noise.POSITION_CHANNEL])
def test_the_moments_are_those_of_the_normal_distribution(seed: int, channel: int) -> None:
    x = standard_normals(seed, 3, channel, STEPS)
    root = math.sqrt(STEPS)
    assert abs(x.mean()) < DEVIATIONS / root
    assert abs(x.var() - 1) < DEVIATIONS * math.sqrt(2) / root
    assert abs((x**3).mean()) < DEVIATIONS * math.sqrt(15) / root
    assert abs((x**4).mean() - 3) < DEVIATIONS * math.sqrt(96) / root


@pytest.mark.parametrize("seed", SEEDS)
def test_the_distribution_is_normal(seed: int) -> None:
    distance = stats.kstest(standard_normals(seed, 0, 0, STEPS), "norm").statistic
    assert distance * math.sqrt(STEPS) < KOLMOGOROV


def test_streams_and_neighbours_are_uncorrelated() -> None:
    streams = [
        standard_normals(seed, scenario, channel, STEPS)
        for seed, scenario, channel in itertools.product((0, 1, 2), (0, 1, 7), (0, 1))
    ]
    bound = DEVIATIONS / math.sqrt(STEPS)
    matrix = np.corrcoef(streams) - np.eye(len(streams))
    assert np.abs(matrix).max() < bound
    for stream in streams:
        for lag in (1, 2, 16, 256):
            assert abs(np.corrcoef(stream[:-lag], stream[lag:])[0, 1]) < bound * 1.01
        squares = stream**2
        assert abs(np.corrcoef(squares[:-1], squares[1:])[0, 1]) < bound * 1.01


def test_a_value_depends_on_its_step_and_not_on_the_length() -> None:
    long = standard_normals(7, 1, 0, 1000)
    for length in (0, 1, 10, 999):
        assert (standard_normals(7, 1, 0, length) == long[:length]).all()


def test_every_argument_matters() -> None:
    base = standard_normals(1, 2, 0, 100)
    for other in ((2, 2, 0), (1, 3, 0), (1, 2, 1)):
        assert (standard_normals(*other, 100) != base).mean() > 0.99
