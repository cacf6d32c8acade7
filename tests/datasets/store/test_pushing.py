"""Copies of stores on remote file systems and back: resumable, and checked."""

import os
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import fsspec
import pytest
import torch
import trees
from remote_server import serving, some_faults

import nvsdata
from nvsdata import NMNIST, EventFolder, FormatError, Precomputed
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.common.locks import OutputInUse, locked
from nvsdata.datasets.store import fetching, pushing
from nvsdata.datasets.store.card import dataset_card
from nvsdata.datasets.store.fetching import fetch
from nvsdata.datasets.store.precompute import precompute
from nvsdata.datasets.store.pushing import Pushed, push
from nvsdata.datasets.store.writer import pack
from nvsdata.remote import transport
from nvsdata.remote.url import Url

SHARDS = ["b c-1-of-2.nvs", "b c-2-of-2.nvs", "b c.nvs"]


@pytest.fixture(autouse=True)
def _small(empty_cache, monkeypatch):
    monkeypatch.setattr(fetching, "CHUNK", 5000)


@pytest.fixture
def home(tmp_path):
    """A folder with a.nvs, a single store, and "b c.nvs", the index of two shards."""
    dataset = NMNIST(trees.put(tmp_path / "data", trees.nmnist()), "all")
    folder = tmp_path / "files"
    folder.mkdir()
    pack(dataset, folder / "a.nvs")
    for number in (1, 2):
        pack(dataset, folder / "b c.nvs", shard=(number, 2))
    nvsdata.join([folder / name for name in SHARDS[:2]], folder / "b c.nvs")
    return folder


def test_a_folder_that_is_not_there_is_made(home, tmp_path):
    assert push([home / "a.nvs"], f"file://{tmp_path}/new/folder").sent == ["a.nvs", "README.md"]
    assert (tmp_path / "new/folder/a.nvs").read_bytes() == (home / "a.nvs").read_bytes()


@pytest.fixture
def server(home):
    with serving(home) as server:
        yield server


@pytest.fixture
def hub(tmp_path):
    """Address and path of a folder that gets files."""
    (tmp_path / "hub").mkdir()
    return SimpleNamespace(url=f"file://{tmp_path}/hub", path=tmp_path / "hub")


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.nvs")}


def test_a_store_is_pushed_with_its_shards_and_can_be_read_there(home, hub):
    assert push([home / "b c.nvs", home / "a.nvs"], hub.url) == Pushed([*SHARDS, "a.nvs", "README.md"], [])
    assert contents(hub.path) == contents(home)
    assert NMNIST(f"{hub.url}/b c.nvs").split_hash == NMNIST(home / "b c.nvs").split_hash


def test_what_is_there_is_not_sent_again(home, hub, monkeypatch):
    push([home / "b c.nvs"], hub.url)
    assert push([home / "b c.nvs"], hub.url) == Pushed([], [*SHARDS, "README.md"])
    # a copy that was cut off, as by a kill
    os.truncate(hub.path / SHARDS[1], 3000)
    (hub.path / SHARDS[2]).unlink()
    assert push([home / "b c.nvs"], hub.url) == Pushed(SHARDS[1:], [SHARDS[0], "README.md"])
    assert contents(hub.path) == {name: one for name, one in contents(home).items() if name != "a.nvs"}


def test_other_files_are_replaced_only_if_told_so(home, hub, capsys):
    (hub.path / "a.nvs").write_bytes((home / "b c.nvs").read_bytes())
    (hub.path / "README.md").write_text("mine")
    with pytest.raises(FileExistsError, match=r"hub/a.nvs already exists: --overwrite"):
        push([home / "a.nvs"], hub.url)
    assert push([home / "b c.nvs"], hub.url).kept == ["README.md"]
    assert "README.md is kept" in capsys.readouterr().err
    assert (hub.path / "README.md").read_text() == "mine"
    push([home / "a.nvs"], hub.url, overwrite=True)
    assert (hub.path / "a.nvs").read_bytes() == (home / "a.nvs").read_bytes()
    assert (hub.path / "README.md").read_text().startswith("---\n")


def test_a_damaged_store_is_not_sent(home, hub):
    raw = bytearray((home / SHARDS[1]).read_bytes())
    raw[2000] ^= 1
    (home / SHARDS[1]).write_bytes(raw)
    with pytest.raises(FormatError, match=r"b c-2-of-2.nvs:.*checksum"):
        push([home / "b c.nvs"], hub.url)
    assert [path.name for path in hub.path.iterdir()] == SHARDS[:1]
    (home / SHARDS[1]).unlink()
    with pytest.raises(FormatError, match=r"b c-2-of-2.nvs: this shard of the store is missing"):
        push([home / "b c.nvs"], hub.url)


def test_what_arrives_differently_is_noticed(home, hub, monkeypatch):
    def put_file(self, local, remote, **_):
        raw = bytearray(Path(local).read_bytes())
        raw[-5] ^= 1
        Path(self._strip_protocol(remote)).write_bytes(raw)

    monkeypatch.setattr(type(fsspec.filesystem("file")), "put_file", put_file)
    with pytest.raises(OSError, match=r"hub/a.nvs: isn't what was sent"):
        push([home / "a.nvs"], hub.url)


def test_files_go_to_object_stores_only(home, hub):
    with pytest.raises(ValueError, match="a web server takes no files"):
        push([home / "a.nvs"], "https://host/folder")
    with pytest.raises(ValueError, match="isn't a URL"):
        push([home / "a.nvs"], "folder")
    (home / "x").mkdir()
    shutil.copy(home / "a.nvs", home / "x/a.nvs")
    with pytest.raises(ValueError, match="two files have the same name"):
        push([home / "a.nvs", home / "x/a.nvs"], hub.url)
    assert not list(hub.path.iterdir())


def test_the_card_states_what_is_known(home):
    card = dataset_card([home / "a.nvs", home / "b c.nvs"], Url("hf://datasets/me/n"))
    head, _, text = card.removeprefix("---\n").partition("\n---\n")
    assert head.splitlines() == [
        'pretty_name: "n-mnist"',
        "license: cc-by-sa-4.0",
        'size_categories: ["n<1K"]',
        "task_categories: [video-classification]",
        "tags: [event-camera, neuromorphic, nvsdata]",
    ]
    train = NMNIST(home / "a.nvs", "train")
    assert text.count(f"| train | 30 | {train.split_hash} |") == 2
    assert text.count("50 recordings, ") == 2
    assert "34 x 34 pixels" in text
    assert NMNIST.info.page in text
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    assert 'nvsdata.NMNIST("hf://datasets/me/n/a.nvs", "all")' in code
    compile(code, "card", "exec")


def test_the_card_of_precomputed_samples_has_their_transform(tmp_path, hub):
    (tmp_path / "data/a").mkdir(parents=True)
    nvsdata.write(trees.some(0), tmp_path / "data/a/0.h5")
    precompute(EventFolder(tmp_path / "data", transform=T.VoxelGrid(2)), tmp_path / "v.nvs")
    push([tmp_path / "v.nvs"], hub.url)
    card = (hub.path / "README.md").read_text()
    assert "1 precomputed samples" in card
    assert re.search(r"\n    .*VoxelGrid\(", card)
    assert f'nvsdata.Precomputed("{hub.url}/v.nvs")' in card
    remote, local = Precomputed(f"{hub.url}/v.nvs"), Precomputed(tmp_path / "v.nvs")
    assert torch.equal(remote[0][0], local[0][0])
    fetch(f"{hub.url}/v.nvs", tmp_path / "out")
    assert contents(tmp_path / "out")["v.nvs"] == (tmp_path / "v.nvs").read_bytes()


def test_the_card_of_unknown_recordings_claims_no_license(tmp_path):
    (tmp_path / "data/a").mkdir(parents=True)
    nvsdata.write(trees.some(0), tmp_path / "data/a/0.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "c.nvs")
    card = dataset_card([tmp_path / "c.nvs"], Url("s3://bucket/folder"))
    assert 'license: other\nlicense_name: "your own"' in card
    assert "1 recordings" in card


@pytest.mark.parametrize("name", ["a.nvs", "b c.nvs"])
def test_a_store_is_fetched_whatever_the_server_does(server, home, tmp_path, name, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.1)
    server.late = 0.3
    for seed in range(4):
        server.faults = some_faults(0.2, seed=seed)
        out = tmp_path / f"out {seed}"
        url = f"{server.url}/{name.replace(' ', '%20')}"
        names = ["a.nvs"] if name == "a.nvs" else SHARDS
        assert fetch(url, out) == [out / one for one in names]
        assert contents(out) == {one: (home / one).read_bytes() for one in names}


@pytest.mark.parametrize("transform", [None, T.Compose([T.MergePixels(), T.KNNGraph()])], ids=["events", "graphs"])
def test_damage_of_any_byte_is_found(tmp_path, transform):
    (tmp_path / "data/a").mkdir(parents=True)
    for number in range(2):
        nvsdata.write(trees.some(number)[:21], tmp_path / f"data/a/{number}.h5")
    dataset = EventFolder(tmp_path / "data", transform=transform)
    (precompute if transform else pack)(dataset, tmp_path / "a.nvs")
    raw = (tmp_path / "a.nvs").read_bytes()
    found = []
    # the head, whose checksum is known to be right when bytes are compared, has 64
    for place in range(64, len(raw)):
        altered = bytearray(raw)
        altered[place] ^= 1 << place % 8
        (tmp_path / "b.nvs").write_bytes(altered)
        found.append(bool(list(fetching._damaged(tmp_path / "b.nvs"))))
    assert all(found)


def test_an_interrupted_copy_is_resumed(server, home, tmp_path, capsys):
    url, size = f"{server.url}/a.nvs", (home / "a.nvs").stat().st_size
    server.faults = lambda number: "403" if number > 8 else None
    with pytest.raises(PermissionError):
        fetch(url, tmp_path)
    part = tmp_path / ".a.nvs.part"
    have = part.stat().st_size
    assert 0 < have < size
    assert f"{have:,} of {size:,} bytes are in {part}: the same command resumes" in capsys.readouterr().err
    # a power failure may leave other bytes
    raw = bytearray(part.read_bytes())
    raw[1000:1100] = bytes(100)
    part.write_bytes(raw)
    server.faults = lambda number: None
    before = server.done["bytes"]
    fetch(url, tmp_path)
    assert contents(tmp_path)["a.nvs"] == (home / "a.nvs").read_bytes()
    assert not part.exists()
    # the index, the head and one recording were read again
    assert server.done["bytes"] - before < size + 4 * 64 + 2000


def test_the_part_of_another_store_is_not_used(server, home, tmp_path):
    (tmp_path / ".a.nvs.part").write_bytes((home / SHARDS[0]).read_bytes())
    fetch(f"{server.url}/a.nvs", tmp_path)
    assert contents(tmp_path)["a.nvs"] == (home / "a.nvs").read_bytes()
    # one that is longer is cut
    os.rename(tmp_path / "a.nvs", tmp_path / ".a.nvs.part")
    with (tmp_path / ".a.nvs.part").open("ab") as part:
        part.write(b"more")
    fetch(f"{server.url}/a.nvs", tmp_path)
    assert contents(tmp_path)["a.nvs"] == (home / "a.nvs").read_bytes()


def test_existing_files_are_kept_or_replaced_if_told_so(server, home, tmp_path, capsys):
    url = f"{server.url}/a.nvs"
    (tmp_path / "a.nvs").write_bytes(b"mine")
    with pytest.raises(FileExistsError, match=r"a.nvs already exists"):
        fetch(url, tmp_path)
    assert (tmp_path / "a.nvs").read_bytes() == b"mine"
    fetch(url, tmp_path, overwrite=True)
    before = server.done["bytes"]
    fetch(url, tmp_path)
    assert "a.nvs is there" in capsys.readouterr().err
    assert server.done["bytes"] - before < 1000
    shutil.copy(home / "a.nvs", home / "b.nvs")
    with locked(tmp_path / "b.nvs"), pytest.raises(OutputInUse):
        fetch(f"{server.url}/b.nvs", tmp_path)


@pytest.mark.parametrize("at", [2000, -10])
def test_a_store_that_is_damaged_there_does_not_appear_here(server, home, tmp_path, at, monkeypatch):
    raw = bytearray((home / SHARDS[0]).read_bytes())
    raw[at] ^= 1
    (home / SHARDS[0]).write_bytes(raw)
    with pytest.raises(FormatError, match=r"b%20c-1-of-2.nvs: byte \d+: .*checksum"):
        fetch(f"{server.url}/b%20c.nvs", tmp_path / "out")
    assert not [path for path in (tmp_path / "out").iterdir() if path.suffix == ".nvs"]


def test_another_shard_is_refused(server, home, tmp_path):
    shutil.copy(home / SHARDS[0], home / SHARDS[1])
    with pytest.raises(FormatError, match=r"b%20c-2-of-2.nvs: isn't the shard that was joined"):
        fetch(f"{server.url}/b%20c.nvs", tmp_path / "out")
    assert not (tmp_path / "out/b c.nvs").exists()


def test_the_commands(home, hub, tmp_path, capsys):
    assert main(["push", str(home / "b c.nvs"), hub.url]) == 0
    assert capsys.readouterr().out == f"4 files sent to {hub.url}, 0 were there\n"
    assert main(["fetch", f"{hub.url}/b c.nvs", "--out", str(tmp_path / "out"), "--json"]) == 0
    assert '"bytes"' in capsys.readouterr().out
    assert main(["fetch", f"{hub.url}/none.nvs", "--out", str(tmp_path / "out")]) == 1
    assert "none.nvs: no such file" in capsys.readouterr().err
    assert main(["push", str(home / "none.nvs"), hub.url]) == 1
    assert pushing.CARD == "README.md"
