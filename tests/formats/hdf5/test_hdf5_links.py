"""What an HDF5 file may claim, and which files it may speak of: its own."""

import os
import sys

import h5py
import numpy as np
import pytest
from lookalikes import MATLAB_73, hdf5_bytes, lead_elsewhere

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.hdf5.file import FOLLOW

ELSEWHERE = ("external link", "virtual", "stored externally")
LAYOUTS = {
    "own": "events/t events/x events/y events/p",
    "dsec": "events/t events/x events/y events/p",
    "plain": "t x y p",
    "metavision": "CD/events",
    "matlab": "ts x y pol",
}


def like(path, layout, ev):
    """A file of one of the layouts; the names of its datasets."""
    names = LAYOUTS[layout].split()
    if layout == "own":
        nvsdata.write(ev, path.with_suffix(".h5"))
        os.rename(path.with_suffix(".h5"), path)
        return names
    columns = dict(zip(names, ev.columns, strict=False))
    if layout == "metavision":
        columns = {names[0]: ev.to_structured()}
    if layout == "dsec":
        columns |= {"t_offset": np.int64(0), "ms_to_idx": np.arange(3)}
    path.write_bytes(hdf5_bytes({n: {"data": c} for n, c in columns.items()}, MATLAB_73 if layout == "matlab" else b""))
    return names


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("how", ELSEWHERE)
@pytest.mark.parametrize("there", ["file", "nothing", "pipe"])
def test_what_lies_in_other_files_is_refused(tmp_path, ev, layout, how, there):
    other = tmp_path / "other"
    if there == "file":
        like(other, layout, ev)
    elif there == "pipe":
        os.mkfifo(other)
    path = tmp_path / ("a.mat" if layout == "matlab" else "a.h5")
    name = like(path, layout, ev)[-1]
    with h5py.File(path, "r+") as file:
        shape, kind = file[name].shape, file[name].dtype
        del file[name]
        lead_elsewhere(file, name, how, other, shape, kind)
    reason = f"/?{name} is .*{how}.*: other files are read only with {FOLLOW}=1 in the environment"
    for strict in (True, False):
        with pytest.raises(FormatError, match=reason):
            nvsdata.read(path, strict=strict)


@pytest.mark.parametrize("name", ["t_offset", "ms_to_idx", "events"])
def test_other_files_are_not_asked_for_side_data_either(tmp_path, ev, name):
    like(tmp_path / "other", "dsec", ev)
    like(tmp_path / "a.h5", "dsec", ev)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        del file[name]
        file[name] = h5py.ExternalLink(tmp_path / "other", name)
    with pytest.raises(FormatError, match=f"{name} is an external link to '.*other:{name}': other files"):
        nvsdata.open(tmp_path / "a.h5")


@pytest.mark.parametrize("how", ELSEWHERE)
def test_who_asks_for_other_files_gets_them(tmp_path, ev, how, monkeypatch):
    monkeypatch.setenv(FOLLOW, "1")
    like(tmp_path / "other", "plain", ev)
    like(tmp_path / "a.h5", "plain", ev)
    with h5py.File(tmp_path / "a.h5", "r+") as file, h5py.File(tmp_path / "other") as other:
        where = other["x"].id.get_offset()
        del file["x"]
        if how == "stored externally":
            file.create_dataset("x", (1_000,), "i2", external=[(str(tmp_path / "other"), where, 2_000)])
        else:
            lead_elsewhere(file, "x", how, tmp_path / "other", (1_000,), "i2")
    assert nvsdata.read(tmp_path / "a.h5", sensor_size=(30, 20)) == ev
    assert nvsdata.read(tmp_path / "a.h5", 100, 300, sensor_size=(30, 20)) == ev.window(100, 300)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_soft_links_within_the_file_are_followed(tmp_path, ev, layout):
    path = tmp_path / ("a.mat" if layout == "matlab" else "a.h5")
    name = like(path, layout, ev)[-1]
    with h5py.File(path, "r+") as file:
        file.move(name, "some/where")
        file["one"] = h5py.SoftLink("/some/./where")
        file[name] = h5py.SoftLink("/one")
    assert nvsdata.read(path, sensor_size=(30, 20)) == ev
    assert nvsdata.read(path, 100, 300, sensor_size=(30, 20)) == ev.window(100, 300)


def test_soft_links_that_lead_nowhere_are_named(path):
    with h5py.File(path, "r+") as file:
        del file["events/x"]
        file["events/x"] = h5py.SoftLink("y")
    assert nvsdata.read(path).x.max() == 19  # a relative one
    with h5py.File(path, "r+") as file:
        del file["events/y"]
        file["events/y"] = h5py.SoftLink("/events/x")
    with pytest.raises(FormatError, match="x has a cycle of soft links"):
        nvsdata.open(path)
    with h5py.File(path, "r+") as file:
        del file["events/y"]
    with pytest.raises(FormatError, match="without /events"):
        nvsdata.open(path)


@pytest.mark.parametrize("filters", [1, 2])
def test_a_small_file_that_inflates_to_gigabytes_is_refused(tmp_path, filters):
    """By its claims: nothing of that size is made."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((1 << 28,))
    for _ in range(filters):
        plist.set_deflate(9)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space, group = h5py.h5s.create_simple((1 << 30,)), file.create_group("events")
        for name in "txyp":
            made = h5py.h5d.create(group.id, name.encode(), h5py.h5t.NATIVE_UINT32, space, plist)
            for i in range(4):
                made.write_direct_chunk((i << 28,), b"x" * 1_000)
    assert (tmp_path / "a.h5").stat().st_size < 30_000
    with pytest.raises(FormatError, match=r"/events/t claims 4294967296 bytes; a file of .* may expand to 67108864"):
        nvsdata.open(tmp_path / "a.h5")


def test_a_filter_that_is_not_installed_names_what_to_install(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space = h5py.h5s.create_simple((10,))
        for name in "txyp":
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_chunk((10,))
            plist.set_filter(32_099, h5py.h5z.FLAG_OPTIONAL, ())
            made = h5py.h5d.create(file.id, name.encode(), h5py.h5t.NATIVE_UINT8, space, plist)
            made.write_direct_chunk((0,), b"0123456789")
    reason = "/t is compressed by filter 32099, which isn't installed"
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "hdf5plugin", None)
        with pytest.raises(ImportError, match=rf"{reason}: pip install 'nvsdata\[hdf5\]' installs the usual"):
            nvsdata.open(tmp_path / "a.h5")
    # no package helps, so the file is one that can't be read, which commands and datasets leave out
    pytest.importorskip("hdf5plugin")
    with pytest.raises(FormatError, match=f"{reason}, and isn't one of hdf5plugin's"):
        nvsdata.open(tmp_path / "a.h5")


@pytest.mark.parametrize("size", [(0, 20), (30, -1), (40_000, 20), (2**40, 20), (30.5, 20), (float("inf"), 20)])
def test_sizes_in_headers_are_checked(path, size):
    with h5py.File(path, "r+") as file:
        file.attrs.update(width=size[0], height=size[1])
    with pytest.raises(FormatError, match=r"a\.h5: (byte 0: the header states an invalid sensor|attribute width is)"):
        nvsdata.open(path)


@pytest.mark.parametrize("name", ["frames", "inertial", "frames/pixels", "inertial/t"])
def test_frames_and_samples_of_other_files_are_refused(path, tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(path, "r+") as file:
        file[name] = h5py.ExternalLink(tmp_path / "pipe", name)
        for other in ("t", "acceleration", "rotation", "temperature"):
            if name == "inertial/t" and other != "t":
                file[f"inertial/{other}"] = np.zeros(3)
        for other in ("start", "exposure_start", "exposure_end", "end", "x", "y", "width", "height"):
            if name == "frames/pixels":
                file[f"frames/{other}"] = np.ones(1, int)
    recording = nvsdata.open(path)
    with pytest.raises(FormatError, match=f"/{name} is an external link to"):
        list(recording.frames()) if "frames" in name else recording.inertial()
