"""Libraries that take turns, each behind a connection; here they are threads, in the command processes."""

import json
import os
from dataclasses import replace
from multiprocessing import Pipe
from threading import Thread

import numpy as np
import pytest

from nvsdata import cli
from nvsdata.benchmarks import measure, runner, tasks, worker
from nvsdata.benchmarks.case import Case, Options, PreparedCase


class Threads:
    """A worker without a process."""

    def __init__(self, task, options, library):
        self.connection, other = Pipe()
        self.thread = Thread(target=worker.serve, args=(other, task, options, library))
        self.thread.start()

    ask = runner.Worker.ask

    @property
    def _connection(self):
        return self.connection

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()
        self.thread.join()


def made(run, **options):
    return lambda: PreparedCase(run, **options)


def fails():
    raise ValueError("broken\nmore")


def missing():
    raise ImportError("No module named 'peer'")


@pytest.fixture
def given(monkeypatch, tmp_path):
    """A function that measures cases."""
    monkeypatch.setattr(runner, "Worker", Threads)
    monkeypatch.setattr(os, "environ", dict(os.environ))

    def measured(cases, **options):
        for module in (tasks, runner):
            monkeypatch.setattr(module, "cases_of", lambda task, options: cases)
        return list(runner.measure_task("decode", Options(tmp_path, quick=True), **options))

    return measured


def test_a_line_says_what_its_case_and_its_result_say(given, monkeypatch):
    monkeypatch.setattr(runner, "ROUND_TIME", 10)
    case = Case(
        *("decode", "work", made(lambda: 7, error=lambda found: found / 2, counters=lambda found: {"rows": found})),
        settings={"k": 1}, size={"events": 3}, axis="k", default=True, error_kind="e",
    )  # fmt: skip
    (line,) = given([case])
    assert (line.task, line.benchmark, line.library, line.settings, line.size) == (
        "decode",
        "work",
        "nvsdata",
        {"k": 1},
        {"events": 3},
    )
    assert (line.error, line.error_kind, line.counters, line.axis, line.default) == (3.5, "e", {"rows": 7}, "k", True)
    assert 0 < line.seconds <= line.p95 <= line.p99
    assert line.runs == runner.QUICK_ROUNDS * runner.MOST_CALLS
    assert "cores" in line.machine


def test_times_of_a_line_are_percentiles_of_its_calls(tmp_path):
    case = Case("decode", "work", made(lambda: 7))
    found = {"spent": list(range(101)), "version": "1", "error": None, "peak": 5, "counters": {}}
    line = runner._measurement(case, found, Options(tmp_path))
    assert (line.seconds, line.p95, line.p99, line.runs) == (50, 95, 99, 101)
    assert (line.peak_memory, line.scope) == (5, "full, simulated")
    assert runner._measurement(case, found, Options(tmp_path, quick=True, data=tmp_path)).scope == "quick, given data"


def test_libraries_take_turns_and_each_call_is_prepared(given, monkeypatch):
    monkeypatch.setattr(runner, "ROUND_TIME", 0)
    log = []
    cases = [
        Case("decode", "work", made(lambda name=name: log.append(name), before=lambda: log.append("-")), library=name)
        for name in ("nvsdata", "peer")
    ]
    assert [line.runs for line in given(cases, peers=True)] == [runner.QUICK_ROUNDS] * 2
    # each three times at first: for its error, its memory, and how long it takes
    assert log == ["-", "nvsdata"] * 3 + ["-", "peer"] * 3 + ["-", "nvsdata", "-", "peer"] * runner.QUICK_ROUNDS


def test_peers_are_measured_only_when_asked_for(given):
    cases = [Case("decode", "work", made(int), library=name) for name in ("nvsdata", "peer")]
    assert [line.library for line in given(cases)] == ["nvsdata"]
    assert [line.library for line in given(cases, wanted=lambda case: case.benchmark == "other")] == []


def test_what_cannot_be_measured_is_left_out_with_its_reason(given):
    cases = [
        Case("decode", "work", missing, library="peer"),
        Case("decode", "work", made(fails)),
        Case("decode", "work", made(int), settings={"n": 1}),
    ]
    absent, broken, line = given(cases, peers=True)
    assert (absent.case.library, absent.reason, absent.failed) == ("peer", "No module named 'peer'", False)
    assert (broken.reason, broken.failed) == ("ValueError: broken more", True)
    assert line.settings == {"n": 1}


def test_work_that_fails_later_is_left_out_too(given):
    calls = iter([1, 2, 3])
    (found,) = given([Case("decode", "work", made(lambda: next(calls)))])
    assert found.failed
    assert found.reason.startswith("StopIteration")


def test_a_process_that_dies_is_named_and_replaced(monkeypatch):
    class Dead:
        exitcode = -9

        def join(self, timeout):
            pass

    started = []
    monkeypatch.setattr(runner.Worker, "_start", lambda self: started.append(self._arguments))
    one = runner.Worker("decode", "options", "peer")
    one._connection, other = Pipe()
    one._process = Dead()
    other.close()
    assert one.ask("drop") == {"failed": "its process ended with exit code -9"}
    assert started == [("decode", "options", "peer")] * 2


def test_long_work_takes_fewer_turns(given, monkeypatch):
    monkeypatch.setattr(runner, "LONG", 0)
    monkeypatch.setattr(runner, "ROUND_TIME", 10)
    assert given([Case("decode", "work", made(int))])[0].runs == 1


def test_the_peak_is_what_a_call_needs_for_a_while():
    peak = measure.peak_memory(lambda: np.ones(40_000_000, np.uint8).sum())
    assert peak is None or 39_000_000 < peak < 60_000_000
    assert (measure.peak_memory(int) or 0) < 1_000_000


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("task", tasks.TASKS)
def test_cases_are_told_apart_and_every_curve_has_ours(tmp_path, task, quick):
    cases = tasks.cases_of(task, Options(tmp_path, quick))
    assert len({case.key for case in cases}) == len(cases)
    ours = {case.benchmark for case in cases if case.library == "nvsdata"}
    assert ours == {case.benchmark for case in cases}
    for case in cases:
        assert case.task == task
        assert case.axis == "" or case.axis in {**case.settings, **case.size}
    # those of a work stand together, so that they take turns
    works = [case.benchmark for case in cases]
    assert len([i for i, work in enumerate(works) if i == 0 or works[i - 1] != work]) == len(set(works))


def test_the_command_measures_in_processes_and_writes_what_it_found(tmp_path, capsys):
    out = [tmp_path / "a.json", tmp_path / "a.html"]
    words = ["bench", "represent", "--quick", "--only", "downsample", "--json", str(out[0]), "--html", str(out[1])]
    assert cli.main(words) == 0
    (line,) = json.loads(out[0].read_text())["measurements"]
    assert (line["task"], line["benchmark"], line["library"]) == ("represent", "downsample", "nvsdata")
    assert "downsample" in out[1].read_text()
    assert "represent: downsample" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["nothing"], 2, "unknown task 'nothing': choose from start, decode, load,"),
        (["--data", "nowhere"], 1, "nowhere: no such folder; --data needs a folder with recordings"),
        (["--compare", "nowhere.json"], 1, "nowhere.json"),
        (["decode", "--only", "no such work"], 1, "no benchmark's name contains 'no such work'"),
    ],
)
def test_wrong_words_end_before_anything_is_measured(capsys, words, code, said):
    if code == 2:
        with pytest.raises(SystemExit, match="2"):
            cli.main(["bench", *words])
    else:
        assert cli.main(["bench", *words]) == code
    assert said in capsys.readouterr().err


def test_a_process_of_its_own_ends_with_its_connection(tmp_path):
    with runner.Worker("metrics", replace(Options(tmp_path), quick=True), "nobody") as one:
        assert one.ask("drop") == {}
        one._connection.close()
        # on a busy machine, the context would kill it before it ends
        one._process.join(60)
        assert one._process.exitcode == 0


def test_a_worker_ends_quietly_if_nobody_waits_for_its_answer(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(worker, "end_with_parent", lambda: None)
    ours, other = Pipe()
    ours.send(("drop",))
    ours.close()
    worker.serve(other, "metrics", Options(tmp_path, quick=True), "nvsdata")
