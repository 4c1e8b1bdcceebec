"""A CAN speed is sampled, jittered, delayed and quantised as declared, and its frames keep their order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from driveline.quantities import InputError
from driveline.sensors import can_signal as can
from driveline.sensors.can_signal import CanSignal

TICK = 1e-3
SETS = [(source, number) for source in ("engine", "wheel") for number in (2, 3, 4)]


def receive(kernels, signal: CanSignal, values: np.ndarray, *, source: str = "wheel", stream: int = 1,
            tick: float = TICK, first: int = 0, way: str = "native") -> np.ndarray:
    """What the receiver holds at the ticks after ``first``, where ``values`` are the true ones."""
    parameters = can.can_signal_parameters(signal, tick, stream)
    table = can.jitter_table(source, signal.jitter_set, tick)
    state = can.can_signal_state(parameters, table, first, values[0])
    memory = np.concatenate([[np.nan] * 2, state, [np.nan]])
    constants = np.concatenate([[np.nan], table, [np.nan] * 2, parameters])
    held = np.empty(values.size - 1)
    run = kernels("channel_signal", way).bind(memory, constants, values[1:].copy(), held)
    run(2, 3 + table.size, 1, first + 1, held.size)
    assert np.isnan(memory[[0, 1, -1]]).all()
    return held


def taken(kernels, signal: CanSignal, ticks: int, **where) -> np.ndarray:
    """The ticks at which frames were taken: the true value is the tick itself."""
    held = receive(kernels, signal, np.arange(ticks + 1.0), **where)
    return np.unique(held[held > 0.0]).astype(int)


# -- random numbers ---------------------------------------------------------------------------------

@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_a_product_of_32_bits_is_exact_and_fits_a_compiled_integer(x: int, y: int):
    assert can.product32(x, y) == x * y % 2**32
    assert (x & 0xFFFF) * y + ((((x >> 16) * y) & 0xFFFF) << 16) < 2**63
    assert 0 <= can.mix32(x) < 2**32


def random_numbers(kernels, seed: int, count: int, normal: bool = False, way: str = "native") -> np.ndarray:
    result = np.empty(count)
    kernels("random_numbers", way).bind(result)(seed, int(normal), count)
    return result


@pytest.mark.parametrize("seed", [0, 1, 2**31 - 1])
def test_random_numbers_are_uniform_and_normal(kernels, seed: int):
    uniform, normal = (random_numbers(kernels, seed, 50_000, kind) for kind in (False, True))
    assert 0.0 < uniform.min() and uniform.max() < 1.0
    assert stats.kstest(uniform, "uniform").pvalue > 1e-3
    assert stats.kstest(normal, "norm").pvalue > 1e-3
    assert np.unique(uniform).size == uniform.size


@pytest.mark.parametrize("lag", [1, 2, 3, 10])
def test_neither_neighbours_nor_neighbouring_seeds_are_alike(kernels, lag: int):
    numbers = [random_numbers(kernels, seed, 50_000) for seed in (7, 8)]
    limit = 4.0 / np.sqrt(50_000)
    assert abs(np.corrcoef(numbers[0][:-lag], numbers[0][lag:])[0, 1]) < limit
    assert abs(np.corrcoef(numbers[0][:-lag], numbers[1][lag:])[0, 1]) < limit
    assert abs(np.corrcoef(numbers[0], numbers[1])[0, 1]) < limit


def test_random_numbers_have_the_same_bits_compiled_and_plain(kernels):
    for normal in (False, True):
        compiled, plain = (random_numbers(kernels, 12345, 3000, normal, way) for way in ("native", "python"))
        assert compiled.tobytes() == plain.tobytes()


# -- the densities ----------------------------------------------------------------------------------

GRID = np.linspace(-can.LARGEST_JITTER, can.LARGEST_JITTER, 4001)


@pytest.mark.parametrize(("source", "number"), SETS)
def test_density_is_the_slope_of_the_cumulative_one_and_ends_at_5_ms(source: str, number: int):
    share, density = can.jitter_cumulative(source, number, GRID), can.jitter_density(source, number, GRID)
    assert (share[0], share[-1]) == pytest.approx((0.0, 1.0), abs=1e-15)
    np.testing.assert_allclose(np.diff(share), 0.5 * (density[1:] + density[:-1]) * np.diff(GRID), atol=1e-8)
    assert (can.jitter_density(source, number, np.array([-5.001e-3, 5.001e-3])) == 0.0).all()
    samples, _, bandwidth = can._kernel_density(source, number)
    raw = np.repeat(samples, can.JITTER_COUNTS[source][number])
    silverman = 0.9 * min(raw.std(ddof=1), stats.iqr(raw) / 1.34) * raw.size ** -0.2
    kept = stats.gaussian_kde(raw, silverman / raw.std(ddof=1))
    expected = kept(GRID) / kept.integrate_box_1d(GRID[0], GRID[-1])
    assert bandwidth == pytest.approx(silverman)
    np.testing.assert_allclose(density, expected, rtol=1e-9)


@pytest.mark.parametrize(("source", "number"), SETS)
def test_the_table_holds_the_quantiles(source: str, number: int):
    table = can.jitter_table(source, number, 1.0)
    shares = np.linspace(0.0, 1.0, can.TABLE_SIZE)
    assert (np.diff(table) > 0.0).all()
    np.testing.assert_allclose(can.jitter_cumulative(source, number, table), shares, atol=1e-6)
    between = np.interp(GRID, table, shares)  # what drawing from the table means between its entries
    assert abs(between - can.jitter_cumulative(source, number, GRID)).max() < 3e-3


def test_the_sets_are_as_the_thesis_tells_of_figures_3_15_and_3_16():
    density = {key: can.jitter_density(*key, GRID) for key in SETS}
    for (source, number), values in density.items():
        mean = np.trapezoid(GRID * values, GRID)
        deviation = np.sqrt(np.trapezoid((GRID - mean) ** 2 * values, GRID))
        normal = stats.norm(mean, deviation).cdf(GRID)
        assert abs(can.jitter_cumulative(source, number, GRID) - normal).max() > 0.02, "a normal distribution"
    for source in ("engine", "wheel"):
        for number, other in ((2, 3), (3, 4), (2, 4)):
            distance = abs(can.jitter_cumulative(source, number, GRID)
                           - can.jitter_cumulative(source, other, GRID)).max()
            assert distance > 0.05, "two equal sets"

    values = density["engine", 3]
    peaks = GRID[1:-1][(values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])]
    assert len(peaks) == 2
    assert 4e-3 < peaks[1] <= 5e-3

    def mass(number: int, low: float, high: float) -> float:
        return np.diff(can.jitter_cumulative("wheel", number, np.array([low, high])))[0]

    assert mass(4, 4e-3, 5e-3) > 1.5 * mass(3, 4e-3, 5e-3)
    assert mass(4, 0.0, 5e-3) > mass(3, 0.0, 5e-3)
    assert abs(density["wheel", 3].argmax() - density["wheel", 4].argmax()) < 200  # within 0.5 ms


def test_set_1_has_no_jitter():
    assert not can.jitter_table("engine", 1, TICK).any()


# -- the channel ------------------------------------------------------------------------------------

@pytest.mark.parametrize(("source", "number"), SETS)
def test_frames_are_taken_with_the_jitter_of_the_density(kernels, source: str, number: int):
    frames = 20_000
    signal = CanSignal(period=0.02, jitter_set=number)  # too long for two frames at one tick
    jitter = taken(kernels, signal, 20 * frames + 5, source=source) - 20 * np.arange(1, frames + 1)
    assert abs(jitter).max() <= 5
    edges = np.clip(np.arange(-5.5, 6.0), -5.0, 5.0) * TICK
    expected = frames * np.diff(can.jitter_cumulative(source, number, edges))
    counts = np.array([(jitter == k).sum() for k in range(-5, 6)])
    few = expected < 20.0
    assert (counts[few] < 60).all()
    chi_square = ((counts - expected)[~few] ** 2 / expected[~few]).sum()
    assert stats.chi2.sf(chi_square, (~few).sum() - 1) > 1e-4


def test_without_jitter_every_period_brings_the_value_of_that_tick(kernels):
    held = receive(kernels, CanSignal(period=0.01), np.arange(101.0))
    np.testing.assert_array_equal(held, np.arange(1, 101) // 10 * 10)


@pytest.mark.parametrize("period", [1e-3, 2e-3, 3.3e-3, 0.01, 0.05])
@pytest.mark.parametrize("number", [1, 3, 4])
@pytest.mark.parametrize("delay", [1, 30, 200])
def test_a_delay_shifts_what_is_held_by_exactly_that_many_ticks(
        kernels, period: float, number: int, delay: int):
    values = np.random.default_rng(5).normal(size=1500)
    at_once = receive(kernels, CanSignal(period=period, jitter_set=number), values)
    later = receive(kernels, CanSignal(period=period, jitter_set=number, delay=delay * TICK), values)
    np.testing.assert_array_equal(later[delay:], at_once[:-delay])
    assert (later[:delay] == values[0]).all()


@pytest.mark.parametrize(("source", "number"), SETS)
@pytest.mark.parametrize("period", [1e-3, 2e-3, 5e-3, 0.01])
def test_no_frame_is_lost_or_overtaken(kernels, source: str, number: int, period: float):
    signal = CanSignal(period=period, jitter_set=number)
    parameters = can.can_signal_parameters(signal, TICK, 1)
    table = can.jitter_table(source, number, TICK)
    frames = np.arange(1, int(1.0 / period))
    alone = [can.frame_tick(int(k), parameters, 0, table, 0) for k in frames]
    in_order = np.maximum.accumulate(np.maximum(alone, 1))
    ticks = taken(kernels, signal, 1100, source=source)
    np.testing.assert_array_equal(ticks[ticks <= in_order[-1]], np.unique(in_order))
    if period == 0.01:  # jitter of 5 ms cannot bring frames together
        assert (in_order == alone).all()
    held = receive(kernels, signal, np.arange(1101.0), source=source)
    assert (np.diff(held) >= 0.0).all()


@pytest.mark.parametrize("resolution", [0.01, 0.25])
def test_quantisation_is_to_the_nearest_step_and_has_no_bias(kernels, resolution: float):
    values = np.random.default_rng(6).uniform(-200.0, 200.0, 40_001)
    held = receive(kernels, CanSignal(period=TICK, resolution=resolution), values)
    error = held - values[1:]
    assert abs(error).max() <= resolution / 2 * (1.0 + 1e-9)
    assert abs(error.mean()) < 4.0 * resolution / np.sqrt(12.0 * error.size)
    assert error.std() == pytest.approx(resolution / np.sqrt(12.0), rel=0.02)
    np.testing.assert_allclose(held / resolution, np.round(held / resolution), atol=1e-6)


def test_where_a_run_starts_does_not_change_its_frames(kernels):
    signal = CanSignal(jitter_set=4, delay=0.03)
    values = np.random.default_rng(7).normal(size=2001)
    whole = receive(kernels, signal, values)
    part = receive(kernels, signal, values[137:], first=137)
    np.testing.assert_array_equal(part[60:], whole[137 + 60:])


def test_the_state_is_complete(kernels):
    signal = CanSignal(jitter_set=3, delay=0.1, resolution=0.5)
    parameters, table = can.can_signal_parameters(signal, TICK, 2), can.jitter_table("engine", 3, TICK)
    constants = np.concatenate([table, parameters])
    values = np.random.default_rng(8).normal(0.0, 50.0, 600)
    state = can.can_signal_state(parameters, table, 0, values[0])

    def run(state: np.ndarray, first: int) -> np.ndarray:
        held = np.empty(300)
        channel = kernels("channel_signal").bind(state, constants, values[first:first + 300].copy(), held)
        channel(0, table.size, 0, first, held.size)
        return held

    run(state, 0)
    saved = np.frombuffer(state.tobytes()).copy()
    onward = run(state, 300)
    assert run(saved, 300).tobytes() == onward.tobytes()
    assert saved.tobytes() == state.tobytes()


def test_a_finer_clock_moves_frames_by_less_than_the_coarse_tick(kernels):
    signal = CanSignal(jitter_set=4)
    coarse = taken(kernels, signal, 2000, tick=1e-3)[:190] * 1e-3
    fine = taken(kernels, signal, 20_000, tick=1e-4)[:190] * 1e-4
    assert abs(coarse - fine).max() <= 0.55e-3 + 1e-9
    assert abs(coarse - fine).max() > 0.4e-3


def test_channels_of_one_seed_and_seeds_of_one_channel_jitter_independently(kernels):
    def jitter(seed: int, stream: int) -> np.ndarray:
        signal = CanSignal(period=0.02, jitter_set=4, seed=seed)
        return taken(kernels, signal, 100_005, stream=stream) - 20 * np.arange(1, 5001)

    first, stream, seed = jitter(1, 1), jitter(1, 2), jitter(2, 1)
    limit = 4.0 / np.sqrt(first.size)
    for other in (stream, seed):
        assert abs(np.corrcoef(first, other)[0, 1]) < limit
    np.testing.assert_array_equal(first, jitter(1, 1))


@pytest.mark.parametrize("number", [1, 3])
def test_channel_gives_the_same_bits_compiled_and_plain(kernels, number: int):
    signal = CanSignal(period=3e-3, jitter_set=number, delay=0.02, resolution=0.03)
    values = np.random.default_rng(9).normal(0.0, 100.0, 2000)
    compiled, plain = (receive(kernels, signal, values, source="engine", way=way)
                       for way in ("native", "python"))
    assert compiled.tobytes() == plain.tobytes()


def test_a_period_below_the_tick_is_refused():
    with pytest.raises(InputError, match="wheel_speed_sensor.period is 0.0005 s: at least the tick"):
        can.can_signal_parameters(CanSignal(period=5e-4), TICK, 1, "wheel_speed_sensor")
