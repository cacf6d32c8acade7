"""Files that the gallery's pages write are kept, also when two builds of the site run at once."""

import gallery_cache
import pytest
import snippets


@pytest.fixture
def page(tmp_path, monkeypatch):
    monkeypatch.setattr(gallery_cache, "FOLDER", tmp_path / "kept")
    monkeypatch.setattr(gallery_cache, "_digest", lambda page: page.read_text())
    made = tmp_path / "page.md"
    made.write_text("first")
    return made


def running(monkeypatch, run):
    monkeypatch.setattr(snippets, "run_page", run)


def test_a_page_runs_once_until_it_changes(page, monkeypatch):
    ran = []

    def run(page, folder):
        ran.append(page.read_text())
        (folder / "a.png").write_bytes(ran[-1].encode())
        (folder / "a.txt").write_bytes(b"not kept")

    running(monkeypatch, run)
    for _ in range(2):
        assert list(gallery_cache.results(page)) == [("a.png", b"first")]
    page.write_text("second")
    assert list(gallery_cache.results(page)) == [("a.png", b"second")]
    assert ran == ["first", "second"]
    assert [one.name for one in gallery_cache.FOLDER.iterdir()] == ["page-second"]


def test_two_builds_at_once_have_the_same_files(page, monkeypatch):
    other = []

    def run(page, folder):
        (folder / "a.png").write_bytes(b"a")
        if not other:
            other.append(None)
            # all of another build, while this one runs
            other[0] = list(gallery_cache.results(page))

    running(monkeypatch, run)
    assert list(gallery_cache.results(page)) == other[0] == [("a.png", b"a")]
    assert len(list(gallery_cache.FOLDER.iterdir())) == 1


def test_nothing_is_kept_of_a_page_that_fails(page, monkeypatch):
    def run(page, folder):
        (folder / "a.png").write_bytes(b"a")
        raise snippets.SnippetError("page.md:1: fails")

    running(monkeypatch, run)
    with pytest.raises(snippets.SnippetError):
        list(gallery_cache.results(page))
    assert list(gallery_cache.FOLDER.iterdir()) == []
