"""Archives that lead elsewhere, hide links, are damaged, or are too much for the disk."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import random
import shutil
import tarfile
import zipfile

import pytest
import trees
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.common.errors import DownloadError
from nvsdata.datasets.archives import unpack as module
from nvsdata.datasets.archives.unpack import extract_file, unpack


def zipped(files, method=zipfile.ZIP_STORED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


def tarred(files):
    return gzip.decompress(trees.tarred(files))


def with_fields(raw, local, central, value):
    """A zip with a 16-bit field of all its entries changed, told by where it is in both kinds of headers."""
    raw = bytearray(raw)
    for signature, at in ((b"PK\3\4", local), (b"PK\1\2", central)):
        begin = raw.find(signature)
        while begin >= 0:
            raw[begin + at : begin + at + 2] = value.to_bytes(2, "little")
            begin = raw.find(signature, begin + 4)
    return bytes(raw)


def contents(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def refused(tmp_path_factory):
    """A function that unpacks what must be refused, and holds that nothing is left and nothing of the user's lost."""

    def run(raw, match, name="a.zip"):
        home = tmp_path_factory.mktemp("home")
        mine = {"thesis.zip": trees.zipped({"years": b"of work"}), "work/x": b"mine", name: raw}
        for other, data in mine.items():
            (home / other).parent.mkdir(exist_ok=True)
            (home / other).write_bytes(data)
        with pytest.raises(DownloadError, match=match) as caught:
            unpack(home / name, home / "work" / "out")
        assert str(caught.value).startswith(str(home / name))
        assert "\n" not in str(caught.value)
        assert contents(home) == mine
        assert not (home / "work" / "out").exists()

    return run


NAMES = [
    "../evil",
    "/evil",
    "a/../../evil",
    "..\\evil",
    "\\evil",
    "\\\\host\\share\\evil",
    "C:evil",
    "C:\\evil",
    "a/c:/evil",
    "a:stream",
    ".../evil",
    ".. /evil",
    "a/NUL",
    "con.txt",
    "Com1 .log",
]


@pytest.mark.parametrize("name", NAMES)
def test_entries_that_lead_elsewhere_are_refused(refused, name):
    refused(zipped({"fine": b"1", name: b"x"}), "refused to unpack .*leads out of the folder")
    refused(trees.zipped({"in.zip": zipped({name: b"x"})}), "'in.zip': refused to unpack .*leads out of the folder")
    refused(trees.tarred({"fine": b"1", name: b"x"}), "refused to unpack", name="a.tar.gz")


@pytest.mark.parametrize("name", ["...zip", "a/...zip", ".zip", "a/.ZIP", " .zip", "....zip"])
def test_zips_whose_folder_would_be_elsewhere_are_refused(refused, name):
    """`...zip` less its suffix is `..`: it left the folder, and the user's own zips there were unpacked and removed."""
    refused(zipped({name: zipped({"x/evil": b"1"})}), "refused to unpack .*leads out of the folder")


@pytest.mark.parametrize("kind", [0o120000, 0o010000, 0o020000, 0o060000, 0o140000])
def test_links_and_devices_in_zips_are_refused(refused, kind):
    entry, out = zipfile.ZipInfo("link"), io.BytesIO()
    entry.external_attr = (kind | 0o777) << 16
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    refused(out.getvalue(), "refused to unpack 'link': a link or a device")


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE])
@pytest.mark.parametrize("target", ["../../etc/passwd", "fine"])
def test_links_and_devices_in_tars_are_refused(refused, kind, target):
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as archive:
        for name, entry_kind in (("fine", tarfile.DIRTYPE), ("link", kind), ("link/evil", tarfile.DIRTYPE)):
            entry = tarfile.TarInfo(name)
            entry.type, entry.linkname = entry_kind, target if name == "link" else ""
            archive.addfile(entry)
    refused(out.getvalue(), "refused to unpack 'link': a link or a device", name="a.tar.gz")


def test_files_of_tars_are_not_run_by_others(tmp_path):
    entry, out = tarfile.TarInfo("tool"), io.BytesIO()
    entry.mode, entry.size = 0o6777, 1
    with tarfile.open(fileobj=out, mode="w") as archive:
        archive.addfile(entry, io.BytesIO(b"x"))
    (tmp_path / "a.tar").write_bytes(out.getvalue())
    unpack(tmp_path / "a.tar", tmp_path / "out")
    assert (tmp_path / "out/tool").stat().st_mode & 0o7111 == 0


def test_tars_and_zips_in_zips_are_unpacked(tmp_path):
    (tmp_path / "a.tar.gz").write_bytes(trees.tarred({"d/one.aedat": b"1", "./d/sub/two.aedat": b"2"}))
    unpack(tmp_path / "a.tar.gz", tmp_path / "tar")
    assert contents(tmp_path / "tar") == {"d/one.aedat": b"1", "d/sub/two.aedat": b"2"}
    inner = zipped({"a/a_0001.mat": b"x"})
    deep = zipped({"deeper.ZIP": inner, "__MACOSX/._deeper.ZIP": b"what macOS adds"})
    (tmp_path / "b.zip").write_bytes(zipped({"Yin Bi - a.zip": inner, "deep.zip": deep, "d\\e": b"e"}))
    unpack(tmp_path / "b.zip", tmp_path / "zip")
    assert contents(tmp_path / "zip") == {
        "Yin Bi - a/a/a_0001.mat": b"x",
        "d/e": b"e",
        "deep/__MACOSX/._deeper.ZIP": b"what macOS adds",
        "deep/deeper/a/a_0001.mat": b"x",
    }


def test_a_zip_at_the_end_of_a_tar_is_not_taken_for_all(tmp_path):
    (tmp_path / "a.tar").write_bytes(tarred({"one": b"1", "z.zip": zipped({"two": b"2"})}))
    unpack(tmp_path / "a.tar", tmp_path / "out")
    assert contents(tmp_path / "out") == {"one": b"1", "z/two": b"2"}


def test_a_folder_that_is_there_is_left_alone(tmp_path):
    (tmp_path / "a.zip").write_bytes(zipped({"x": b"theirs"}))
    (tmp_path / "out").mkdir()
    (tmp_path / "out/x").write_bytes(b"mine")
    with pytest.raises(DownloadError, match="out already exists"):
        unpack(tmp_path / "a.zip", tmp_path / "out")
    assert (tmp_path / "out/x").read_bytes() == b"mine"


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_no_entry_is_written_over_by_another(refused):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("a", b"1")
        archive.writestr("./a", b"2")
    refused(out.getvalue(), r"can't unpack './a': File exists")
    # a zip's folder and the one that lies beside it may share files' names
    refused(zipped({"a/x": b"1", "a.zip": zipped({"x": b"2"})}), "'a.zip': can't unpack 'x': File exists")
    refused(zipped({"a": b"1", "a/b": b"2"}), "can't unpack 'a/b': File exists")


def test_names_that_differ_in_case_only_are_both_kept_or_refused(tmp_path):
    (tmp_path / "a.zip").write_bytes(zipped({"v_Handstand": b"1", "v_HandStand": b"2"}))
    (tmp_path / "Case").touch()
    if (tmp_path / "case").exists():
        with pytest.raises(DownloadError, match="File exists"):
            unpack(tmp_path / "a.zip", tmp_path / "out")
    else:
        unpack(tmp_path / "a.zip", tmp_path / "out")
        assert contents(tmp_path / "out") == {"v_Handstand": b"1", "v_HandStand": b"2"}


def test_what_python_cannot_read_is_named(refused):
    refused(with_fields(zipped({"in/enc": b"1"}), 6, 8, 1), "'in/enc' is encrypted; unpack the archive manually")
    for method, name in ((9, "Deflate64"), (93, "method 93")):
        refused(with_fields(zipped({"in/x": b"1"}), 8, 10, method), f"'in/x' is compressed by {name}, which Python")
    refused(zipped({"enc.zip": with_fields(zipped({"x": b"1"}), 6, 8, 1)}), "'enc.zip': 'x' is encrypted")


@pytest.mark.parametrize(
    "method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA], ids=str
)
def test_damaged_zips_are_named_by_the_entry(refused, method):
    raw = bytearray(zipped({"fine": b"1", "in/x": random.Random(1).randbytes(2_000)}, method))
    middle = raw.find(b"in/x") + 500
    raw[middle : middle + 8] = bytes(8)
    refused(bytes(raw), "can't unpack 'in/x': ")


def test_a_zip_that_lists_less_than_it_has_is_damaged(refused):
    raw = bytearray(zipped({f"f{i}": b"1" for i in range(5)}))
    entry = raw.find(b"PK\1\2", raw.find(b"PK\1\2") + 1)
    raw[entry + 32] = 46 + 2  # as if the next entry were this one's notes
    refused(bytes(raw), "damaged archive: 4 entries can be found, of 5")
    refused(zipped({}), "there is nothing in it")


THREE = tarred({f"f{i}": bytes([i]) * 600 for i in range(3)})[: 3 * 1_536 + 1_024]


@pytest.mark.parametrize(
    ("name", "pack"),
    [("a.tar", bytes), ("a.tar.gz", gzip.compress), ("a.tar.bz2", bz2.compress), ("a.tar.xz", lzma.compress)],
)
@pytest.mark.parametrize("end", [700, 1_536, 3_072, 4_000])
def test_tars_that_break_off_are_damaged(refused, name, pack, end):
    """Python takes a tar that breaks off between entries for whole."""
    refused(pack(THREE[:end]), "damaged archive|neither a zip nor a tar", name=name)
    packed = pack(THREE)
    refused(packed[: len(packed) * end // 5_000], "damaged|neither a zip nor a tar", name=name)


@pytest.mark.parametrize(("at", "what"), [(-6, "CRC check failed"), (-2, "Incorrect length"), (-9, "")])
def test_a_tar_gz_that_fails_its_checksum_is_damaged(refused, at, what):
    raw = bytearray(gzip.compress(THREE, mtime=0))
    raw[at] ^= 0xFF
    refused(bytes(raw), f"damaged archive: {what}", name="a.tar.gz")
    refused(gzip.compress(THREE)[:-8], "damaged archive: Compressed file ended", name="a.tar.gz")


def test_a_damaged_header_is_not_taken_for_the_end_of_a_tar(refused):
    raw = bytearray(THREE)
    raw[1_536 + 10] ^= 0xFF
    refused(bytes(raw), "damaged archive: no entry and no end at byte 1,536 of the tar", name="a.tar")
    refused(gzip.compress(bytes(raw)), "no entry and no end at byte 1,536", name="a.tar.gz")


@given(
    st.sampled_from(["deflated", "lzma", "inner", "tar.gz", "tar.xz"]),
    st.lists(st.tuples(st.integers(0), st.integers(1, 255)), max_size=3),
    st.integers(0, 3_000),
)
def test_damage_anywhere_is_an_error_or_changes_nothing(tmp_path_factory, kind, flips, cut):
    files = {f"d/f{i}": random.Random(i).randbytes(200) for i in range(4)}
    raw = bytearray(
        {
            "deflated": lambda: zipped(files, zipfile.ZIP_DEFLATED),
            "lzma": lambda: zipped(files, zipfile.ZIP_LZMA),
            "inner": lambda: zipped({"in.zip": zipped(files)}),
            "tar.gz": lambda: gzip.compress(tarred(files), mtime=0),
            "tar.xz": lambda: lzma.compress(tarred(files)),
        }[kind]()
    )
    for place, bits in flips:
        raw[place % len(raw)] ^= bits
    home = tmp_path_factory.mktemp("damaged")
    (home / "a").write_bytes(raw[: len(raw) - cut] if cut < len(raw) // 2 else raw)
    error = None
    try:
        unpack(home / "a", home / "out")
    except DownloadError as caught:
        error = str(caught)
    if error is not None:
        assert error.startswith(str(home / "a"))
        assert not (home / "out").exists()
    else:
        found = {name.removeprefix("in/"): data for name, data in contents(home / "out").items()}
        # a zip has no checksum over names, but both places of a name must agree
        assert sorted(found.values()) == sorted(files.values())
    assert {p.name for p in home.iterdir()} <= {"a", "out"}


def test_bombs_are_refused_before_anything_is_written(refused, monkeypatch):
    bomb = trees.zipped({"zeros": bytes(2_000_000)})
    with monkeypatch.context() as patched:
        patched.setattr(module, "MOST_BYTES", 1_000_000)
        refused(bomb, "refused, it unpacks to more than 1,000,000 bytes")
        refused(trees.tarred({"zeros": bytes(2_000_000)}), "unpacks to more than 1,000,000 bytes", name="a.tar.gz")
        # those in archives within count, too
        refused(zipped({f"{i}.zip": trees.zipped({"zeros": bytes(400_000)}) for i in range(3)}), "unpacks to more")
    with monkeypatch.context() as patched:
        patched.setattr(module, "MOST_FILES", 5)
        refused(zipped({str(i): b"" for i in range(6)}), "more than .* 5 files")
    monkeypatch.setattr(module, "SMALL", 100_000)
    refused(bomb, "or 100 times its size")


def test_what_the_disk_has_no_room_for_is_refused(refused, monkeypatch):
    raw = zipped({str(i): b"1" for i in range(30)})
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 100_000))
    # 30 bytes, but no file takes less than a block
    refused(raw, "unpacks to 122,880 bytes, but the disk has 100,000 left")


def test_a_disk_that_fills_up_leaves_nothing(refused):
    resource = pytest.importorskip("resource")
    raw = trees.zipped({"fine": b"1", "large": os.urandom(300_000)})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    inner = zipped({"in.zip": raw})

    def limited(packed, match):
        # the archive itself must still be written
        real = module._write

        def write(*given):
            resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
            try:
                real(*given)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(module, "_write", write)
            refused(packed, match)

    limited(raw, "can't unpack 'large': File too large")
    limited(inner, "can't unpack 'in.zip': File too large")


def test_taking_a_file_out(tmp_path):
    (tmp_path / "a.zip").write_bytes(zipped({"d/x.zip": b"1", "d/y.zip": b"2"}))
    extract_file(tmp_path / "a.zip", "y.zip", tmp_path / "y.part")
    assert (tmp_path / "y.part").read_bytes() == b"2"
    with pytest.raises(DownloadError, match=r"'z.zip' is not in it"):
        extract_file(tmp_path / "a.zip", "z.zip", tmp_path / "z.part")
