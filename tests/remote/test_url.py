from pathlib import Path

import pytest

from nvsdata.remote.url import Url, place_of


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("https://me:secret@host:8/a/b.nvs?X-Amz-Signature=secret", "https://host:8/a/b.nvs?..."),
        ("https://secret@host/b.nvs", "https://host/b.nvs"),
        ("HTTP://host/b.nvs#part", "http://host/b.nvs"),
        ("s3://bucket/a?b.nvs", "s3://bucket/a?b.nvs"),
        ("sftp://me:secret@host/b.nvs", "sftp://me@host/b.nvs"),
        ("abfs://container@account/b.nvs", "abfs://container@account/b.nvs"),
        ("hf://datasets/me/name@main/b.nvs", "hf://datasets/me/name@main/b.nvs"),
    ],
)
def test_a_url_is_shown_without_passwords(address, shown):
    url = Url(address)
    assert str(url) == shown
    assert "secret" not in repr(url)
    assert url.has_secrets == ("secret" in address or "#" in address)


def test_neighbors_keep_the_query_and_are_quoted_on_the_web():
    url = Url("https://host/a/b%20c.nvs?key=1")
    assert url.name == "b c.nvs"
    assert url.sibling("d e#.nvs").address == "https://host/a/d%20e%23.nvs?key=1"
    assert Url("https://host/a/?key=1").child("d.nvs").address == "https://host/a/d.nvs?key=1"
    url = Url("s3://bucket/a/b%20c.nvs")
    assert url.name == "b%20c.nvs"
    assert url.sibling("d e.nvs").address == "s3://bucket/a/d e.nvs"
    assert Url("s3://bucket").child("d.nvs").address == "s3://bucket/d.nvs"


def test_a_root_is_a_path_or_a_url():
    assert place_of("s3://a/b.nvs") == Url("s3://a/b.nvs")
    assert place_of(Url("s3://a/b.nvs")) == Url("s3://a/b.nvs")
    assert place_of("~/a") == Path.home() / "a"
    assert place_of(Path("a:/b")) == Path("a:/b")
    with pytest.raises(ValueError, match="give the URL as a string"):
        place_of(Path("s3://a/b.nvs"))
    with pytest.raises(ValueError, match="isn't a URL"):
        Url("a/b.nvs")
