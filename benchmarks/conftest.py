"""The table at the end: who took how long, how that compares, and what was promised.

Every benchmark does one thing many times over and says so in `extra_info`: `what` is compared, by
`whom`, how many `calls` a round makes. Times are the shortest round's, divided by its calls: on a
busy machine that is what repeats. What takes long takes turns (`in_turns`), with as many rounds for each,
so that all of them meet the machine in the same moods.
"""

from __future__ import annotations

import platform
import time

import pytest

TURNS = pytest.StashKey[dict]()
UNREAD = "unread"  # the second protocol is for comparison; promises are for the first

# At least so many times as fast as the one that stands behind it.
PROMISES = {
    ("update", "wpimath"): 1.0,
    ("update with covariance", "wpimath"): 1.0 / 8.0,
    ("inverse", "wpimath"): 2.0,
    ("100,000 samples, Numba", "wpimath"): 800.0,
    ("100,000 samples, NumPy", "wpimath"): 60.0,
    ("10,000,000 samples, Numba", "compiled copy"): 1.0 / 2.0,
    ("4096 robots x 1000 steps, Numba", "compiled copy"): 1.0 / 3.0,
    ("JointState, MCAP", "rosbags"): 60.0,
    ("JointState, MCAP zstd", "rosbags"): 35.0,
    ("log to trajectory file", "rosbags, wpimath, savetxt"): 20.0,
}
AT_MOST_NS = {("integrate, with covariance", name): 400.0 for name in ("differential", "mecanum")}


@pytest.fixture
def compare(benchmark):
    """Time a function that makes so many calls: `compare(what, detail, whom, function, calls)`."""

    def run(what, detail, whom, function, calls, *, rounds=40, setup=None):
        benchmark.group = f"{what}: {detail}"
        benchmark.extra_info.update(what=what, detail=detail, whom=whom, calls=calls)
        benchmark.pedantic(function, setup=setup, rounds=rounds, warmup_rounds=1)

    return run


@pytest.fixture
def in_turns(request):
    """CPU time, all threads together, of functions that take turns: `in_turns(what, detail, ways, calls)`."""

    def run(what, detail, functions, calls, *, rounds):
        times = {whom: [] for whom in functions}
        for _ in range(1 + rounds):  # the first one warms up
            for whom, function in functions.items():
                start = time.process_time()
                function()
                times[whom].append(time.process_time() - start)
        shortest = {whom: min(rounds[1:]) / calls * 1e9 for whom, rounds in times.items()}
        request.config.stash.setdefault(TURNS, {})[(what, detail)] = shortest

    return run


def pytest_terminal_summary(terminalreporter, config):
    session = getattr(config, "_benchmarksession", None)
    groups = config.stash.get(TURNS, {})
    for bench in getattr(session, "benchmarks", []):
        info = bench.extra_info
        if "what" in info:
            times = groups.setdefault((info["what"], info["detail"]), {})
            times[info["whom"]] = bench.stats.min / info["calls"] * 1e9
    if not groups:
        return
    terminalreporter.section("side by side")
    write = terminalreporter.write_line
    write(
        f"{platform.machine()}, Python {platform.python_version()}; ns per call or sample, best of all rounds"
    )
    write(f"{'':<64}{'trundle':>10}{'other':>10}{'times as fast':>15}")
    for (what, detail), times in groups.items():
        for row in rows(what, detail, times):
            write(row)


def rows(what, detail, times):
    """Each of our ways beside each of the others."""
    others = {whom: time for whom, time in times.items() if not whom.startswith("trundle")}
    for whom, ours in times.items():
        if whom in others:
            continue
        name = what + whom.removeprefix("trundle")
        for other, theirs in others.items():
            asked = None if UNREAD in detail else PROMISES.get((name, other))
            ratio = theirs / ours
            told = verdict("at least", asked, ratio)
            yield f"{f'{name}: {detail}; {other}':<68}{ours:>10.1f}{theirs:>10.1f}{ratio:>14.2f}x{told}"
        if not others:
            told = verdict("at most", AT_MOST_NS.get((what, detail)), ours)
            yield f"{f'{name}: {detail}':<68}{ours:>10.1f}{'':>25}{told}"


def verdict(word, asked, got):
    if asked is None:
        return ""
    missed = got < asked if word == "at least" else got > asked
    return f"   asked: {word} {asked:.3g}{', missed' if missed else ''}"
