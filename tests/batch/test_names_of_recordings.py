"""What recordings of a folder of videos are called."""

from nvsdata.batch.folder import videos_in


def named(tmp_path, *names):
    """Names of the recordings, by names of the videos."""
    for name in names:
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    out = tmp_path / "out"
    return {video.name: video.target.relative_to(out).as_posix() for video in videos_in(tmp_path / "in", out)}


def test_extensions_are_kept_where_names_would_be_the_same(tmp_path):
    found = named(tmp_path, "a.avi", "a.mp4", "a.avi.mp4", "b.avi", "c.d.avi", "x/a.avi", "e.avi.mp4")
    assert found == {
        "a.avi": "a.avi.h5",
        "a.mp4": "a.mp4.h5",
        "a.avi.mp4": "a.avi.mp4.h5",
        "b.avi": "b.h5",
        "c.d.avi": "c.d.h5",
        "x/a.avi": "x/a.h5",
        "e.avi.mp4": "e.avi.h5",
    }


def test_hidden_files_are_no_videos(tmp_path):
    assert list(named(tmp_path, "._a.avi", ".b.avi", ".trash/c.avi", "a.avi", "d/e.mp4")) == ["a.avi", "d/e.mp4"]
