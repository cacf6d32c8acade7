"""Which addresses still lead to files, asked of a server on this machine."""

import json

import pytest
import trees
from hosts import hosting

from nvsdata.cli import main
from nvsdata.datasets import DATASETS, NCARS, NMNIST
from nvsdata.datasets.archives.address_check import PAGE, AddressCheck, check_addresses
from nvsdata.datasets.facts import Archive, Info

CONTENT = trees.zipped({"a/b.bin": b"1" * 300_000})
WEB = b"<!doctype html><html><title>Sign in</title></html>"


@pytest.fixture
def host():
    with hosting() as host:
        yield host


def info(host, *urls, name="made-up"):
    return Info(name, None, ("a",), f"{host.address}/page", "none", (Archive("a.zip", "", urls, "a"),))


def test_each_address_is_asked_for_its_first_bytes(host):
    urls = [host.serve("/there", CONTENT), f"{host.address}/gone", host.serve("/web", WEB), "http://127.0.0.1:1/x"]
    host.serve("/page", WEB)
    page, there, gone, web, none = check_addresses([info(host, *urls)])
    assert page == AddressCheck("made-up", PAGE, f"{host.address}/page", "", None)
    assert there == AddressCheck("made-up", "a.zip", urls[0], "", len(CONTENT))
    assert (gone.fault, gone.bytes) == ("HTTP 404 Not Found", None)
    assert web.fault == "the server sent a web page, 'Sign in': the file needs a browser"
    assert "Connection refused" in none.fault


def test_archives_that_contain_others_are_asked_once(host):
    outer = Archive("all.zip", "", (host.serve("/all", CONTENT),), "all")
    inner = tuple(Archive(f"{name}.zip", "", (), name, within=outer) for name in "ab")
    assert check_addresses([Info("made-up", None, ("a",), "", "none", inner)]) == [
        AddressCheck("made-up", "all.zip", outer.urls[0], "", len(CONTENT))
    ]


def test_pages_that_are_gone_and_archives_without_an_address(host):
    (page,) = check_addresses([info(host)])
    assert page.fault == "HTTP 404 Not Found"
    assert check_addresses([Info("made-up", None, ("a",), "", "none")]) == []


def test_the_command_says_what_answers_by_its_exit_code_too(host, monkeypatch, capsys):
    host.serve("/page", WEB)
    url = host.serve("/there", CONTENT)
    for name, kind in DATASETS.items():
        if name != "folder":
            monkeypatch.setattr(kind, "info", Info(name, None, ("a",), "", "none"))
    monkeypatch.setattr(NMNIST, "info", info(host, url, name="n-mnist"))
    assert main(["datasets", "--check"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        ["n-mnist", "its", "page", f"{host.address}/page", "available"],
        ["n-mnist", "a.zip", "0.00", "GB", url, "available"],
    ]
    monkeypatch.setattr(NCARS, "info", info(host, f"{host.address}/gone", name="n-cars"))
    assert main(["datasets", "--check", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["sources"]
    assert [one["fault"] for one in found] == ["", "", "", "HTTP 404 Not Found"]
    assert found[1]["bytes"] == len(CONTENT)
