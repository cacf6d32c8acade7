"""Links of the documentation to elsewhere, asked of a server on this machine."""

import links
import pytest
from hosts import hosting


@pytest.fixture
def host():
    with hosting() as host:
        yield host


def test_dead_links_are_named_with_their_file(tmp_path, host, monkeypatch, capsys):
    monkeypatch.setattr(links, "OWN", links.re.compile("none"))
    there = host.serve("/there", b"<!doctype html><html></html>")
    (tmp_path / "docs/datasets").mkdir(parents=True)
    (tmp_path / "README.md").write_text(f"see [it]({there}), or <{there}>; `{there}`.")
    assert links.main(tmp_path) == 0
    assert capsys.readouterr().out == ""
    (tmp_path / "docs/datasets/a.md").write_text(f"gone: {host.address}/gone. And {there}")
    assert links.main(tmp_path) == 1
    assert capsys.readouterr().out == f"docs/datasets/a.md: {host.address}/gone: HTTP 404 Not Found\n"


def test_every_address_of_the_documentation_is_one():
    found = links.links(links.ROOT)
    assert len(found) >= 3
    assert not [address for address in found if address.count("(") or " " in address]
