"""`pack` and `verify` by several processes, on a cluster that loses a worker, and in shards."""

import os
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
import trees

from nvsdata import EventFolder
from nvsdata.cli import main
from nvsdata.datasets import verification
from nvsdata.datasets.store import writing
from nvsdata.datasets.store.writer import pack
from nvsdata.datasets.verification import problems


@pytest.fixture
def animals(tmp_path):
    """40 recordings of two classes; two are damaged and one is empty."""
    files = {f"{name}/{i}.bin": trees.atis(trees.some(i)) for name in ("ant", "cat") for i in range(20)}
    files |= {"ant/3.bin": b"abc", "cat/4.bin": b"", "cat/19.bin": files["cat/19.bin"] + b"x"}
    return trees.put(tmp_path / "data", files)


def killing_one(real, pid):
    """`in_order` that kills a worker after the first result."""

    def run(*arguments):
        results = real(*arguments)
        yield next(results)
        os.kill(pid(), signal.SIGKILL)
        yield from results

    return run


def newest_child():
    """Process of this one's newest worker."""
    # workers are forked from a server, which is the child
    return max(int(pid) for child in children_of(os.getpid()) for pid in children_of(child))


def children_of(pid):
    return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()


pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds processes in /proc")


@pytest.mark.parametrize("where", ["processes", "cluster"])
def test_a_store_has_the_same_bytes_whoever_decodes(animals, tmp_path, cluster, monkeypatch, where):
    dataset = EventFolder(animals)
    report = pack(dataset, tmp_path / "one.nvs")
    assert (report.packed, len(report.skipped)) == (37, 3)
    at = {"jobs": 2} if where == "processes" else {"scheduler": cluster.scheduler_address}
    victim = newest_child if where == "processes" else lambda: next(iter(cluster.workers.values())).pid
    monkeypatch.setattr(writing, "in_order", killing_one(writing.in_order, victim))
    again = pack(dataset, tmp_path / "two.nvs", **at)
    assert again == report
    assert (tmp_path / "two.nvs").read_bytes() == (tmp_path / "one.nvs").read_bytes()


@pytest.mark.parametrize("where", ["processes", "cluster"])
def test_the_faults_are_the_same_whoever_reads(animals, cluster, monkeypatch, where):
    counts = Counter()
    faults = list(problems(animals, EventFolder, counts))
    assert {name for name, _ in faults} == {"ant/3.bin", "cat/19.bin", "cat/4.bin"}
    assert counts["opened"] == 40
    at = {"jobs": 2} if where == "processes" else {"scheduler": cluster.scheduler_address}
    victim = newest_child if where == "processes" else lambda: next(iter(cluster.workers.values())).pid
    monkeypatch.setattr(verification, "in_order", killing_one(verification.in_order, victim))
    counts = Counter()
    assert list(problems(animals, EventFolder, counts, **at)) == faults
    assert counts["opened"] == 40


def test_shards_find_each_fault_once(animals, capsys):
    faults = list(problems(animals))
    counts = Counter()
    found = [fault for i in (1, 2, 3) for fault in problems(animals, None, counts, shard=(i, 3))]
    assert sorted(found) == sorted(faults)
    assert counts["opened"] == 40
    assert main(["verify", str(animals), "--shard", "3/3"]) == 0
    assert "13 recordings opened: no faults" in capsys.readouterr().out


def test_a_shard_reports_what_it_left_out(animals, tmp_path):
    for i in (1, 2):
        pack(EventFolder(animals), tmp_path / "a.nvs", shard=(i, 2))
    found = [name for i in (1, 2) for name, _ in problems(tmp_path / f"a-{i}-of-2.nvs")]
    assert sorted(found) == ["ant/3.bin", "cat/19.bin", "cat/4.bin"]


def test_what_is_missing_is_reported_by_one_shard(tmp_path):
    root = trees.put(tmp_path / "yupenn", {f"ocean/{i}.bin": trees.atis(trees.some(i)) for i in range(9)})
    kind = verification.DATASETS["yupenn-dvs"]
    faults = list(problems(root, kind))
    assert ("ocean", "21 of 30 recordings are missing") in faults
    assert list(problems(root, kind, shard=(1, 2))) == faults
    assert list(problems(root, kind, shard=(2, 2))) == []
