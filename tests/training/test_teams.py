"""Who of the processes that train together does what, without starting any."""

import os
from itertools import zip_longest

import pytest
import torch
from torch import distributed

from nvsdata.training import Team, loader, team
from nvsdata.training.evaluation import predict
from nvsdata.training.processes import ProcessFailed

CPU = torch.device("cpu")


@pytest.fixture
def called(monkeypatch):
    """What torch is told."""
    calls = []
    for place, name in ((distributed, "init_process_group"), (distributed, "destroy_process_group")):
        monkeypatch.setattr(place, name, lambda *given, name=name: calls.append((name, *given)))
    monkeypatch.setattr(distributed, "barrier", lambda: calls.append(("barrier",)))
    monkeypatch.setattr(distributed, "get_rank", lambda: 1)
    monkeypatch.setattr(torch.cuda, "set_device", lambda name: calls.append(("set_device", name)))
    monkeypatch.setattr(torch, "set_num_threads", lambda count: calls.append(("set_num_threads", count)))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for name in ("WORLD_SIZE", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    return calls


# half of the cores prepare samples, at least one and at most four of them; shared by the processes
@pytest.mark.parametrize(
    ("cores", "count", "workers", "threads"),
    [
        (None, 1, 1, 1),
        (1, 1, 1, 1),
        (2, 1, 1, 1),
        (3, 1, 1, 2),
        (4, 1, 2, 2),
        (6, 1, 3, 3),
        (8, 1, 4, 4),
        (64, 1, 4, 60),
        (8, 2, 2, None),
        (8, 3, 1, None),
        (8, 16, 1, None),
        (64, 2, 4, None),
    ],
)
def test_workers_and_threads_share_the_cores(monkeypatch, called, cores, count, workers, threads):
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    assert Team(CPU, 0, count).workers == workers
    if count == 1:
        with team() as alone:
            assert alone == Team(CPU, 0, 1)
        assert called == [("set_num_threads", threads)]


def test_processes_of_torchrun_join(monkeypatch, called):
    monkeypatch.setenv("WORLD_SIZE", "2")
    with team("cpu") as second:
        assert second == Team(CPU, 1, 2)
        assert called == [("init_process_group", "gloo")]
    assert called[1:] == [("destroy_process_group",)]
    called.clear()
    monkeypatch.setenv("LOCAL_RANK", "3")
    with team("cuda") as second:
        assert second.device == torch.device("cuda:3")
    assert called == [("set_device", "cuda:3"), ("init_process_group", "nccl"), ("destroy_process_group",)]


def test_a_gpu_is_used_if_there_is_one(monkeypatch, called):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    with team() as alone:
        assert alone.device == torch.device("cuda")
    with team("cpu") as alone:
        assert alone.device == CPU
    monkeypatch.setenv("WORLD_SIZE", "2")
    with team() as first:
        assert first.device == torch.device("cuda:0")


def test_the_first_process_writes_and_prints(called, tmp_path, capsys):
    first, second = (Team(CPU, rank, 2) for rank in (0, 1))
    second.print("no")
    first.print("yes")
    assert capsys.readouterr().out == "yes\n"
    with second.claiming(tmp_path / "a"):
        assert not (tmp_path / "a").exists()
    with first.claiming(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir()
    first.barrier()
    Team(CPU).barrier()
    assert called == [("barrier",)]


def test_what_all_processes_predict_is_in_the_order_of_the_samples(monkeypatch):
    """Of each batch the processes have shares, in order of rank; the last one is for the first alone."""
    shares = {0: [[0, 1], [4, 5], [8]], 1: [[2, 3], [6, 7]]}
    first = [(torch.tensor(part) * 10.0, torch.tensor(part)) for part in shares[0]] + [None]

    def gather(places, mine):
        assert len(places) == 2
        places[:] = (first.pop(0), None), mine

    monkeypatch.setattr(distributed, "all_gather_object", gather)
    batches = [(torch.tensor(part), torch.tensor(part)) for part in shares[1]]
    values, targets = predict(lambda given: given * 10.0, batches, Team(CPU, 1, 2))
    assert targets.tolist() == list(range(9))
    assert values.tolist() == [10 * n for n in range(9)]
    assert not first


def test_all_processes_fail_if_one_does(monkeypatch):
    second, sent = Team(CPU, 1, 2), []

    def gather(places, mine):
        sent.append(mine)
        places[:] = (None, "a.bin: torn"), mine

    monkeypatch.setattr(distributed, "all_gather_object", gather)
    with pytest.raises(ProcessFailed, match=r"^process 0: a\.bin: torn$"):
        second.attempt(lambda: 5)
    # its own error is raised, after the others have been informed
    with pytest.raises(KeyError):
        second.attempt(lambda: {}["b"])
    assert sent == [(5, None), (None, "'b'")]
    assert second.gather("c") == [(None, "a.bin: torn"), "c"]
    assert Team(CPU).attempt(lambda: 5) == Team(CPU).gather(5) == [5]


def test_parts_of_batches_are_refused():
    with pytest.raises(ValueError, match="the processes divide each batch: pass whole_batches=True"):
        predict(torch.nn.Identity(), loader(range(5), 4, Team(CPU, 1, 2)), Team(CPU, 1, 2))


@pytest.mark.parametrize("count", range(1, 6))
@pytest.mark.parametrize("size", [1, 2, 5, 12, 13])
def test_processes_divide_whole_batches_of_a_single_one(size, count):
    def of(rank, count):
        batches = loader(range(size), 3, Team(CPU, rank, count), last=2, seed=4, shuffle=True, whole_batches=True)
        assert len(batches) == len(list(batches.batch_sampler))
        return list(batches.batch_sampler)

    parts = [of(rank, count) for rank in range(count)]
    assert [batch for turn in zip_longest(*parts) for batch in turn if batch is not None] == of(0, 1)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
