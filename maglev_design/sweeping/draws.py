"""From (seed, scenario number) to physical values: what is drawn, and how.

Every method can be entered at any scenario, so that chunks are drawn in any order, anywhere, and
each scenario alone. Uniforms are from 2^-53 to 1 - 2^-53.
"""

from __future__ import annotations

import inspect
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import (
    Design,
)
from maglev_design.controller.family import family_of
from maglev_design.controller.plant import (
    on_plant,
    plant_numbers,
)
from maglev_design.options import Equilibrium
from maglev_design.programs import believed_program, beta_program
from maglev_design.rig import Rig, Spread

Array = NDArray[np.float64]
Sampling = Literal["lhs", "sobol", "random"]

SAMPLINGS: tuple[Sampling, ...] = get_args(Sampling)
RATIO = "ratio"
"""What is drawn for beta when none of mass, current_gain and force_constant is."""
BETA_PARTS = ("mass", "current_gain", "force_constant")
_SMALLEST = 2.0**-53
_PLACES, _JITTER, _SCRAMBLE = 1, 2, 3
"""Which stream of a seed: the permutations, what is independent, the scrambling."""


def drawn_spreads(
    rig: Rig, equilibrium: Equilibrium = "model", beta_error: float | None = None
) -> dict[str, Spread]:
    """Return what is drawn for each scenario of a rig, in order.

    The ratio is uniform over the family of the reading and of `beta_error`, see
    :func:`maglev_design.controller.family.family_of`. Under ``measured`` the plant's beta follows
    from the voltage that holds the ball, and what its parts may be plays no part.

    Examples
    --------
    >>> from maglev_design.rig import load_rig
    >>> list(drawn_spreads(load_rig("belmonte2021")))
    ['ratio']
    """
    spreads = rig.uncertainty.spreads
    if beta_is_computed(rig, equilibrium):
        return spreads
    low, high = family_of(rig, equilibrium, beta_error).ratios
    ratio = {RATIO: Spread(distribution="uniform", lower=low, upper=high)} if low < high else {}
    unused = BETA_PARTS if equilibrium == "measured" else ()
    return ratio | {name: spread for name, spread in spreads.items() if name not in unused}


def beta_is_computed(rig: Rig, equilibrium: Equilibrium = "model") -> bool:
    """Whether the plant's beta follows from drawn values of its parts, so that u is not used."""
    return equilibrium != "measured" and any(x in rig.uncertainty.spreads for x in BETA_PARTS)


def uniforms(
    sampling: Sampling, seed: int, total: int, width: int, first: int, count: int
) -> Array:
    """Return the uniforms of scenarios first, ..., first + count - 1, shape (count, width).

    ``random``: independent, by the counter-based Philox. ``sobol``: a scrambled Sobol sequence
    (SciPy), entered at `first`. ``lhs``: a Latin hypercube of `total` rows: a seeded permutation
    for each column (4 bytes a scenario and column, kept), and an independent place in the cell.

    Examples
    --------
    >>> whole = uniforms("lhs", 1, 8, 2, 0, 8)
    >>> bool((uniforms("lhs", 1, 8, 2, 5, 2) == whole[5:7]).all())
    True
    >>> sorted((8 * whole[:, 0]).astype(int).tolist())
    [0, 1, 2, 3, 4, 5, 6, 7]
    """
    if not width:
        return np.empty((count, 0))
    if sampling == "sobol":
        return _inside(_sobol(seed, width, first, count))
    values = _independent(seed, width, first, count)
    if sampling == "lhs":
        rows = slice(first, first + count)
        places = np.stack([_permutation(seed, n, total)[rows] for n in range(width)], axis=1)
        values = (places + values) / total
    return _inside(values)


def _inside(values: Array) -> Array:
    return np.clip(values, _SMALLEST, 1 - _SMALLEST)


def _independent(seed: int, width: int, first: int, count: int) -> Array:
    """Return independent uniforms; a block of the generator is four words."""
    blocks = -(-width // 4)
    stream = np.random.Philox(key=np.array([seed, _JITTER], dtype=np.uint64))
    stream.advance(first * blocks)
    words = np.asarray(stream.random_raw(count * blocks * 4), dtype=np.uint64)
    values = (words.reshape(count, -1)[:, :width] >> np.uint64(11)).astype(float)
    return np.asarray(values * _SMALLEST, dtype=float)


@lru_cache(maxsize=32)
def _permutation(seed: int, column: int, total: int) -> NDArray[np.uint32]:
    generator = np.random.default_rng([_PLACES, seed, column])
    return generator.permutation(np.arange(total, dtype=np.uint32))


def _sobol(seed: int, width: int, first: int, count: int) -> Array:
    from scipy.stats import qmc  # noqa: PLC0415 - slow to import

    known = inspect.signature(qmc.Sobol.__init__).parameters
    generator = np.random.default_rng([_SCRAMBLE, seed])
    chosen: dict[str, Any] = {"rng" if "rng" in known else "seed": generator}
    engine = qmc.Sobol(width, scramble=True, **chosen)
    if first:
        engine.fast_forward(first)
        return np.asarray(engine.random(count), dtype=float)
    # SciPy warns when the first call asks for a count that is no power of two.
    head = engine.random(1)
    return np.concatenate([head, engine.random(count - 1)]) if count > 1 else np.asarray(head)


def quantile(spread: Spread, u: Array) -> Array:
    """Return the values of a spread at the probabilities `u`: its inverse distribution.

    Examples
    --------
    >>> quantile(Spread(distribution="uniform", lower=1, upper=3), np.array([0.25])).tolist()
    [1.5]
    """
    low, high = spread.reach
    if spread.mode is not None:
        values = _triangular(low, spread.mode, high, u)
    elif spread.mean is not None and spread.deviation is not None:
        from scipy.special import ndtr, ndtri  # noqa: PLC0415 - slow to import

        start, end = (
            p if given is None else ndtr((given - spread.mean) / spread.deviation)
            for given, p in ((spread.lower, 0.0), (spread.upper, 1.0))
        )
        values = spread.mean + spread.deviation * ndtri(start + u * (end - start))
    else:
        values = (1 - u) * low + u * high
    return np.clip(values, low, high)


def _triangular(low: float, mode: float, high: float, u: Array) -> Array:
    width = high - low
    rising = low + np.sqrt(u * width * (mode - low))
    falling = high - np.sqrt((1 - u) * width * (high - mode))
    return np.where(u * width < mode - low, rising, falling)


def draw(
    rig: Rig,
    sampling: Sampling,
    seed: int,
    total: int,
    first: int,
    count: int,
    equilibrium: Equilibrium = "model",
    beta_error: float | None = None,
) -> dict[str, Array]:
    """Return the drawn values of some scenarios by name, SI units; ``ratio`` is beta_c/beta."""
    spreads = drawn_spreads(rig, equilibrium, beta_error)
    columns = uniforms(sampling, seed, total, len(spreads), first, count).T
    return {
        name: quantile(spread, column)
        for (name, spread), column in zip(spreads.items(), columns, strict=True)
    }


def plant_betas(rig: Rig, design: Design, drawn: dict[str, Array]) -> Array | float:
    """Return the plant's beta of each scenario: K C^2/m of what was drawn, or beta_c/ratio.

    Under ``measured`` every plant holds the ball at Y with its own voltage U sqrt(ratio): beta
    follows from it and from what was drawn for y0 and g.
    """
    if beta_is_computed(rig, design.equilibrium):
        parts = [drawn.get(name, rig.stated(name)) for name in BETA_PARTS]
        if "resistance" in drawn:
            parts[1] = 1 / drawn["resistance"]
        (made,) = beta_program(rig.kind).numpy()(*parts)
        return np.asarray(made, dtype=float)
    ratio, power = drawn.get(RATIO, 1.0), rig.kind.exponent
    if design.equilibrium != "measured":
        beta: Array | float = design.believed.beta / ratio
        if "resistance" in drawn:  # the force constant stays, C = 1/R moves
            stays = (rig.stated("resistance") / drawn["resistance"]) ** power
            beta = np.asarray(beta * stays, dtype=float)
        return beta
    columns = plant_columns(rig, drawn)
    gravity, offset = (drawn.get(x, rig.stated(x)) for x in ("gravity", "gap_offset"))
    own = columns["u0"]
    voltage = own + (design.believed.U - rig.drive.input_offset) * (
        np.sqrt(ratio) if power == 2 else ratio
    )
    program = believed_program("measured", rig.kind)
    fixed = (gravity, design.believed.beta, design.Y, offset, voltage)
    values = program.numpy()(*on_plant(program, rig, *fixed, moved=columns))
    return np.asarray(values[program.outputs.index("beta_hat")], dtype=float)


DRIVE_NUMBERS = ("delta", "L", "R", "m", "u0")
"""Numbers of the plant that are drawn besides g, beta and y0, by symbol."""


def plant_columns(rig: Rig, drawn: dict[str, Array]) -> dict[str, Any]:
    """Return the numbers :data:`DRIVE_NUMBERS` of each scenario, arrays where they are drawn."""
    own: dict[str, Any] = dict(plant_numbers(rig))
    mass = drawn.get("mass", rig.plant.mass)
    own |= {"m": mass, "delta": drawn.get("damping", rig.plant.damping) / mass}
    symbols = {"lag": "L", "resistance": "R", "inductance": "L", "input_offset": "u0"}
    return own | {symbol: drawn[name] for name, symbol in symbols.items() if name in drawn}
