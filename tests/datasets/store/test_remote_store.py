"""Stores by URL: the same samples as from the local file, whatever the server does."""

import os
import pickle
import re
from contextlib import closing

import pytest
import trees
from remote_server import serving, some_faults
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST, EventFolder, Events, FormatError
from nvsdata.cli import main
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.writer import pack
from nvsdata.remote import blocks, file, transport
from nvsdata.remote.url import Url


@pytest.fixture(autouse=True)
def _small(empty_cache, monkeypatch):
    monkeypatch.setattr(file, "BLOCK", 4096)
    monkeypatch.setattr(blocks, "PIECE", 1024)


@pytest.fixture
def home(tmp_path):
    """A folder with a.nvs, a single store, and b.nvs, the index of three shards."""
    dataset = NMNIST(trees.put(tmp_path / "data", trees.nmnist()), "all")
    folder = tmp_path / "files"
    folder.mkdir()
    pack(dataset, folder / "a.nvs")
    for number in (1, 2, 3):
        pack(dataset, folder / "b.nvs", shard=(number, 3))
    nvsdata.join([folder / f"b-{number}-of-3.nvs" for number in (1, 2, 3)], folder / "b.nvs")
    return folder


@pytest.fixture
def server(home):
    with serving(home) as server:
        yield server


def same(one, other):
    assert one.targets == other.targets
    assert one.split_hash == other.split_hash
    return all(one[i][0] == other[i][0] for i in range(len(other)))


@pytest.mark.parametrize("name", ["a", "b"])
@pytest.mark.parametrize("split", ["train", "test", "all"])
def test_a_store_by_url_has_the_samples_of_the_file(server, home, name, split):
    remote = NMNIST(f"{server.url}/{name}.nvs", split)
    assert same(remote, NMNIST(home / f"{name}.nvs", split))
    assert f"root: {server.url}/{name}.nvs" in repr(remote)
    recording, local = remote.recording(0), NMNIST(home / f"{name}.nvs", split).recording(0)
    first, last = recording.span
    middle = (first + last) // 2
    assert recording.read(first, middle) == local.read(first, middle)


@pytest.mark.parametrize("name", ["a", "b"])
def test_no_fault_of_the_server_causes_wrong_events(server, home, name, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.1)
    monkeypatch.setattr(file, "AHEAD", 0)
    server.late = 0.3
    local = NMNIST(home / f"{name}.nvs", "all")
    found = set()
    for seed in range(6):
        server.faults = some_faults(0.3, seed=seed)
        for path in (home.parent / "blocks").glob("*/*.block"):
            path.unlink()
        file._process = None
        assert same(NMNIST(f"{server.url}/{name}.nvs", "all"), local)
        found |= set(server.done)
    assert found >= {"drop", "delay", "cut", "altered", "busy", "page"}


def test_an_altered_recording_is_requested_again_and_then_reported(server, home):
    with closing(Store(home / "a.nvs")) as store:
        place, end = store.extent(7)
        name = store.names[7]
    raw = bytearray((home / "a.nvs").read_bytes())
    raw[end - 20] ^= 1
    (home / "a.nvs").write_bytes(raw)
    dataset = NMNIST(f"{server.url}/a.nvs", "all")
    index = [sample.name for sample in dataset.samples].index(name)
    before = server.done["requests"]
    with pytest.raises(FormatError, match=f"a.nvs:{name}: byte {place + 96}: its events fail their checksum"):
        dataset[index]
    assert server.done["requests"] <= before + 4 * (1 + (end - place) // 4096 + 1)
    # nobody reads the damaged blocks later
    raw[end - 20] ^= 1
    (home / "a.nvs").write_bytes(raw)
    assert dataset[index][0] == NMNIST(home / "a.nvs", "all")[index][0]


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_workers_open_the_store_themselves(server, home, context):
    if context == "fork" and not hasattr(os, "fork"):
        pytest.skip("no fork")
    remote, local = NMNIST(f"{server.url}/b.nvs", "all"), NMNIST(home / "b.nvs", "all")
    # the first shard is open before the workers start
    assert remote[0][0] == local[0][0]
    loader = DataLoader(remote, batch_size=None, num_workers=2, multiprocessing_context=context)
    assert [sample for sample, _ in loader] == [sample for sample, _ in local]


def test_only_the_url_is_sent_to_workers(server):
    sent = pickle.dumps(NMNIST(f"{server.url}/a.nvs", "all").source)
    assert server.url.encode() in sent
    assert len(sent) < 300


def test_recordings_of_a_missing_shard_are_skipped_and_those_of_a_silent_server_not(server, home, monkeypatch):
    local = NMNIST(home / "b.nvs", "all")
    (home / "b-2-of-3.nvs").rename(home / "lost.nvs")
    dataset = NMNIST(f"{server.url}/b.nvs", "all", errors="skip")
    with pytest.warns(UserWarning, match="b-2-of-3.nvs: this shard of the store is missing"):
        found = [sample for sample, _ in dataset]
    assert len(found) == len(local)
    assert set(map(len, found)) == {60}
    assert dataset.num_damaged == 17
    (home / "lost.nvs").rename(home / "b-2-of-3.nvs")
    file._process = None
    for path in (home.parent / "blocks").glob("*/*.block"):
        path.unlink()
    dataset = NMNIST(f"{server.url}/b.nvs", "all", errors="skip")
    monkeypatch.setattr(transport, "DEADLINE", 1.0)
    server.faults = lambda number: "busy"
    with pytest.raises(TimeoutError, match="HTTP 503"):
        dataset[0]
    assert dataset.num_damaged == 0


def test_another_shard_in_its_place_is_noticed(server, home):
    (home / "b-2-of-3.nvs").write_bytes((home / "b-1-of-3.nvs").read_bytes())
    dataset = NMNIST(f"{server.url}/b.nvs", "all")
    with pytest.raises(FormatError, match=r"b-2-of-3.nvs: isn't the shard that was joined"):
        list(dataset)


def test_a_changed_store_is_not_mixed_with_the_earlier_one(server, home, tmp_path):
    before = NMNIST(f"{server.url}/a.nvs", "all")
    first = before[0][0]
    other = trees.put(
        tmp_path / "other", {name: trees.atis(trees.some(1_000 + n)) for n, name in enumerate(trees.nmnist())}
    )
    pack(NMNIST(other, "all"), home / "a.nvs", overwrite=True)
    after = NMNIST(f"{server.url}/a.nvs", "all")
    assert same(after, NMNIST(home / "a.nvs", "all"))
    assert before[0][0] == first != after[0][0]
    file._process = None
    for path in (home.parent / "blocks").glob("*/*.block"):
        path.unlink()
    with pytest.raises(FormatError):
        before[10]


@pytest.mark.parametrize(
    ("name", "content", "kind", "reason"),
    [
        (
            "data",
            None,
            FileNotFoundError,
            "no such file; of a folder of recordings, pack a store",
        ),
        ("a.html", b"<html>" + bytes(100), FormatError, "the server sent a page, not a store"),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(100), FormatError, "stores of the second layout can't be read by URL"),
        ("a.bin", bytes(100), FormatError, "isn't a packed store"),
        ("a.bin", bytes(10), FormatError, "a.bin is shorter than it states|a.bin: is shorter than it states"),
    ],
)
def test_what_is_no_store_is_refused(server, home, name, content, kind, reason):
    if content:
        (home / name).write_bytes(content)
    with pytest.raises(kind, match=reason):
        EventFolder(f"{server.url}/{name}")


def test_a_store_that_is_cut_short_or_of_another_dataset_is_refused(server, home):
    (home / "c.nvs").write_bytes((home / "a.nvs").read_bytes()[:5000])
    with pytest.raises(FormatError, match=r"c.nvs: is shorter than it states"):
        NMNIST(f"{server.url}/c.nvs")
    with pytest.raises(ValueError, match=r"a.nvs contains n-mnist, not folder"):
        EventFolder(f"{server.url}/a.nvs")
    with pytest.raises(ValueError, match="is shard 1/3 of a store"):
        NMNIST(f"{server.url}/b-1-of-3.nvs")


def test_a_server_without_ranges_is_refused(server, home):
    with (home / "a.nvs").open("ab") as file:
        file.truncate(1 << 25)
    server.faults = lambda number: "whole"
    with pytest.raises(OSError, match="has no range requests"):
        NMNIST(f"{server.url}/a.nvs")


@pytest.mark.parametrize("status", ["401", "403"])
def test_refused_credentials_are_reported_without_printing_them(server, status, capsys):
    server.faults = lambda number: status
    url = f"{server.url}/a.nvs?token=secret".replace("http://", "http://me:secret@")
    with pytest.raises(PermissionError, match="check the credentials") as raised:
        NMNIST(url)
    assert "secret" not in str(raised.value)
    assert main(["verify", url]) == 1
    printed = "".join(capsys.readouterr())
    assert "check the credentials" in printed
    assert "secret" not in printed


def test_verify_reads_a_store_by_url(server, home, capsys):
    assert main(["verify", f"{server.url}/b.nvs"]) == 1
    out = capsys.readouterr().out
    assert "50 recordings opened" in out
    assert re.search(r"split train: [0-9a-f]{16}", out)
    # look-alikes are fewer than the dataset has; nothing else is wrong
    assert not [line for line in out.splitlines() if "nvs" in line]
    (home / "b-2-of-3.nvs").unlink()
    main(["verify", f"{server.url}/b.nvs"])
    main(["verify", f"{server.url}/b-3-of-3.nvs"])
    out = capsys.readouterr().out
    assert "b-2-of-3.nvs: this shard of the store is missing" not in out  # its blocks are in the cache
    assert "16 recordings opened: no faults" in out


def test_a_path_that_was_a_url_is_refused(tmp_path):
    from pathlib import Path

    with pytest.raises(ValueError, match="give the URL as a string"):
        NMNIST(Path("s3://bucket/a.nvs"))


def test_windows_of_a_remote_store_leave_no_files(server, home, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path / "data")
    before = sorted(tmp_path.rglob(".nvsdata-windows*"))
    remote = nvsdata.windows(NMNIST(f"{server.url}/a.nvs", "all"), 30_000)
    local = nvsdata.windows(NMNIST(home / "a.nvs", "all"), 30_000)
    assert [sample.window for sample in remote.samples] == [sample.window for sample in local.samples]
    assert sorted(tmp_path.rglob(".nvsdata-windows*")) == before


def test_other_file_systems_of_fsspec_are_read(home, tmp_path):
    assert same(NMNIST(f"file://{home}/b.nvs", "all"), NMNIST(home / "b.nvs", "all"))
    import fsspec

    system = fsspec.filesystem("memory")
    for path in home.iterdir():
        system.pipe_file(f"/bucket/{path.name}", path.read_bytes())
    assert same(NMNIST("memory://bucket/b.nvs", "all"), NMNIST(home / "b.nvs", "all"))
    assert str(Store(Url("memory://bucket/a.nvs")).root) == "memory://bucket/a.nvs"


def test_long_recordings_are_read_in_parts(tmp_path, monkeypatch):
    ev = trees.some(0, 200_000, gap=20)
    (tmp_path / "data/a").mkdir(parents=True)
    nvsdata.write(ev, tmp_path / "data/a/0.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "c.nvs")
    monkeypatch.setattr(file, "AHEAD", 0)
    with serving(tmp_path) as server:
        recording = EventFolder(f"{server.url}/c.nvs").recording(0)
        before = server.done["bytes"]
        begin, end = ev.t[150_000], ev.t[150_100]
        assert recording.read(int(begin), int(end)) == ev.window(int(begin), int(end))
        # one of four blocks of the store, and not the others
        assert server.done["bytes"] - before < 65_536 * 7 + 3 * 4096
        whole: Events = recording.read()
        assert whole == ev
