"""The parts of a fit of flashes, each against figures by hand or against loops."""

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.rig.clock_fit import (
    ClockFit,
    NoSync,
    _above,
    _agreeing,
    _line,
    _pattern,
    _Rates,
    _Triggers,
    fit_clock,
    flashes,
)


def test_the_pattern_and_its_beginnings():
    """Its bits are those of recordings that are there already."""
    bits = "1000010010110011111000110111010"
    assert "".join(map(str, flashes().tolist())) == bits
    assert bits.count("1") == 16
    assert flashes(17).tolist() == [int(bit) for bit in bits[:17]]
    assert flashes(40).tolist() == [int(bit) for bit in bits + bits[:9]]


def test_camera_time_is_the_offset_and_the_host_time_by_a_rate():
    line = ClockFit(10.0, 0.5, 0.0, 1, 1)
    assert line.camera(1_000) == 1_510
    assert line.host(1_510) == 1_000


@pytest.mark.parametrize(
    ("peak", "level", "run"),
    [
        (1, 1, (1, 5)),
        (2, 1, (1, 5)),
        (5, 1, (1, 5)),
        (9, 1, (9, 10)),
        (14, 1, (14, 14)),
        (1, 4, (1, 2)),
        (9, 5, (9, 9)),
    ],
)
def test_a_run_may_have_gaps_of_two_bins(peak, level, run):
    counts = np.array([0, 5, 5, 1, 0, 4, 0, 0, 0, 6, 5, 0, 0, 0, 3])
    assert _above(counts, peak, level) == run


@pytest.mark.parametrize(
    ("expected", "near", "found"),
    [
        (240, 40, 200),
        (240, 39, None),
        (260, 40, 300),
        (260, 39, None),
        (-50, 150, 100),
        (-50, 149, None),
        (300, 0, 300),
    ],
)
def test_the_nearest_trigger(expected, near, found):
    time = _Triggers(np.array([100.0, 200.0, 300.0])).near(expected, True, near)
    assert np.isnan(time) if found is None else time == found


def burst(*parts, p=1):
    t = np.sort(np.concatenate(parts)).astype(np.int64)
    return _Rates(Events(t, t * 0, t * 0, t * 0 + p, (2, 2)))


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize(
    ("t", "begins"),
    [
        (100_000 + 10 * np.arange(20), 100_000),
        (100_000 + 10 * np.arange(19), None),
        # it begins with a twentieth of its events
        (100_000 + 9 * np.arange(100), 100_036),
        (100_000 + 9 * np.arange(120), 100_045),
        # from 12 ms before to 37 ms after the time
        (np.append(100_000 + 10 * np.arange(19), 136_999), 100_000),
        (np.append(100_000 + 10 * np.arange(19), 137_000), None),
        (np.append(88_000, 100_000 + 10 * np.arange(19)), 100_000),
        (np.append(87_999, 100_000 + 10 * np.arange(19)), None),
        # one event a millisecond is nothing
        (np.arange(88_500, 137_000, 1_000), None),
        # a burst that goes on for 20 ms
        (100_000 + 100 * np.arange(200), 100_900),
        # ten events above the noise at least
        (np.concatenate((100_000 + 10 * np.arange(9), 110_000 + 500 * np.arange(11) // 100 * 1_000)), None),
    ],
)
def test_where_a_flash_begins_without_noise(t, begins, up):
    seen = burst(t, p=int(up))
    found = seen.near(100_000, up, 12_000)
    assert np.isnan(found) if begins is None else found == begins
    # of the other direction there is none
    assert np.isnan(seen.near(100_000, not up, 12_000))


@pytest.mark.parametrize(("surplus", "begins"), [(12, None), (17, None), (21, 99_950), (300, 100_050)])
def test_a_flash_must_rise_above_the_noise(surplus, begins):
    """Ten events a millisecond come anyway; those of the flash in a millisecond, evenly."""
    noise = np.arange(80_050, 140_000, 100)
    flash = 100_000 + np.arange(surplus) * 1_000 / surplus
    found = burst(noise, flash).near(100_000, True, 12_000)
    assert np.isnan(found) if begins is None else found == pytest.approx(begins, abs=100)


@pytest.mark.parametrize("seed", range(4))
def test_places_are_those_where_the_rate_is_most_like_the_flashes(seed):
    """Of all places, in loops; no two of them within 20 ms."""
    rng = np.random.default_rng(seed)
    host = np.array([5_000.0, 8_400.0, 9_600.0, 16_100.0])
    steps, rising = [0, 3, 5, 11], rng.random(4) < 0.5
    rate = rng.normal(size=120)
    score = {}
    for place in range(-16, 121):
        inside = [(step, up) for step, up in zip(steps, rising, strict=True) if 0 <= place + step < 120]
        score[place] = sum(rate[place + step] * (1 if up else -1) for step, up in inside)
    expected = []
    for _ in range(4):
        best = max(score, key=score.get)
        expected.append(best * 1_000 - 5_000)
        score = {place: value for place, value in score.items() if not best - 20 <= place < best + 20}
    assert _pattern(rate, host, rising) == expected


def flashed(seed=0, n=30):
    rng = np.random.default_rng(seed)
    host = np.sort(rng.uniform(0, 10e6, n))
    return host, np.arange(n) % 3 > 0


@pytest.mark.parametrize("alike", [False, True])
def test_a_line_through_flashes_of_two_delays_with_three_that_are_late(alike):
    host, rising = flashed()
    rising |= alike
    camera = 5e5 + (1 + 200e-6) * host + np.where(rising, 700, 1_500)
    camera[[3, 8, 20]] += 16_667
    offset, slope, residual, used = _line(host, camera, rising)
    assert slope == pytest.approx(1 + 200e-6, abs=1e-9)
    # the mean of both delays is the camera's
    assert offset == pytest.approx(5e5 + (700 if alike else 1_100), abs=0.01)
    assert residual == pytest.approx(0, abs=1e-3)
    assert used == 27


@pytest.mark.parametrize(("off", "used"), [(390, 30), (-390, 30), (440, 29), (-440, 29)])
def test_a_flash_may_be_off_a_line_by_400_us(off, used):
    host, rising = flashed()
    camera = host.copy()
    camera[10] += off
    assert _line(host, camera, rising)[3] == used


def test_flashes_that_scatter_more_may_be_off_more():
    host, rising = flashed(n=40)
    camera = host + np.where(np.arange(40) // 3 % 2, 300, -300)
    camera[13] += 700
    _, slope, residual, used = _line(host, camera, rising)
    assert used == 40
    assert slope == pytest.approx(1, abs=1e-4)
    assert residual == pytest.approx(300, abs=60)


@pytest.mark.parametrize(("slope", "more"), [(1.0009, True), (0.9991, True), (1.0011, False), (0.9989, False)])
def test_lines_of_other_clocks_are_not_looked_at(slope, more):
    host = np.arange(24) * 5e5
    camera = np.where(np.arange(24) % 12 < 5, host + 3e5, slope * host)
    expected = (np.arange(24) % 12 >= 5) == more
    assert (_agreeing(host, camera, np.ones(24, bool)) == expected).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_line_with_most_flashes(seed):
    """By loops over all lines through two flashes of one direction that are apart enough."""
    rng = np.random.default_rng(seed)
    host = np.sort(rng.uniform(0, 2e6, 14))
    rising = rng.random(14) < 0.6
    camera = host + np.where(rising, 0, 3_000) + rng.choice([0, 300, 900, 16_000], 14)
    best, most = None, 0
    for i in range(14):
        for j in range(i + 1, 14):
            if rising[i] == rising[j] and host[j] - host[i] >= 0.4 * (host[-1] - host[0]):
                slope = (camera[j] - camera[i]) / (host[j] - host[i])
                away = camera - (camera[i] + slope * (host - host[i]))
                delay = np.median(away[rising != rising[i]])
                kept = [abs(a - (0 if up == rising[i] else delay)) <= 400 for a, up in zip(away, rising, strict=True)]
                if abs(slope - 1) <= 1e-3 and sum(kept) > most:
                    best, most = kept, sum(kept)
    assert _agreeing(host, camera, rising).tolist() == best


def shown(count, gap=None):
    """Times of so many flashes, unevenly one after another, in two groups if there is a gap (µs)."""
    host = 1e6 + np.cumsum([0, 50, 100, 50, 150, 200, 50, 50, 100, 250, 50, 150] * 3)[:count] * 1_000.0
    if gap is not None:
        host[count // 2 :] += gap
    return host, np.ones(count, bool)


@pytest.mark.parametrize(
    ("count", "seen", "message"),
    [
        (6, 6, None),
        (5, 5, "5 flashes and 5 triggers can't be matched"),
        (20, 12, None),
        (20, 11, "the camera saw only 11 of 20 flashes: point it at the entire screen"),
        (8, 6, None),
        (8, 5, "the camera saw only 5 of 8 flashes"),
    ],
)
def test_how_many_flashes_must_be_seen(count, seen, message):
    host, bright = shown(count)
    times = (host + 5e5)[np.sort(np.r_[0 : seen // 2, count - (seen - seen // 2) : count])]
    if message is not None:
        with pytest.raises(NoSync, match=message):
            fit_clock(times.tolist(), host, bright)
        return
    found = fit_clock(times.tolist(), host, bright)
    assert (found.used, found.flashes) == (seen, count)
    assert found.camera(2e6) == pytest.approx(2.5e6, abs=1)


@pytest.mark.parametrize(("ppm", "message"), [(490, None), (-490, None), (510, "510 ppm off"), (-510, "510 ppm off")])
def test_how_far_off_a_clock_may_be(ppm, message):
    """After a video of 20 s its flashes are 10 ms from where they would be expected."""
    host, bright = shown(24, gap=20e6)
    times = 3e6 + (1 + ppm * 1e-6) * host
    if message is not None:
        with pytest.raises(NoSync, match=message):
            fit_clock(times.tolist(), host, bright)
        return
    found = fit_clock(times.tolist(), host, bright)
    assert found.drift == pytest.approx(ppm * 1e-6, abs=1e-9)
    assert (found.used, found.offset) == (24, pytest.approx(3e6, abs=1))


def test_flashes_that_do_not_agree_in_time():
    host, bright = shown(24)
    times = host + 4e6 + np.arange(24) * 7 % 24 * 500.0
    with pytest.raises(NoSync, match=r"only \d+ of 24 flashes agree in time"):
        fit_clock(np.sort(times).tolist(), host, bright)
