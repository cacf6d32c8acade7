"""Names and fields that aim at the terminal or the page that shows them, through every command and every page."""

import io
import json
import logging
import os
import re
import sys
import warnings
from html.parser import HTMLParser

import pytest
import trees
from clips import write_video

import nvsdata
from nvsdata import EventFolder, FormatError
from nvsdata.batch import run
from nvsdata.benchmarks.measurement import Measurement
from nvsdata.benchmarks.page import benchmark_page as bench_page
from nvsdata.cli import COMMANDS, main
from nvsdata.common import locks, progress
from nvsdata.common.errors import DownloadError, message_of, shown
from nvsdata.common.terminal import escaped_output
from nvsdata.common.text import aligned, as_html, as_script
from nvsdata.datasets.cache.cached import TAG as CACHE_CONTENT
from nvsdata.datasets.source import CACHE_TAG
from nvsdata.plots.gallery import ClassSummary, gallery
from nvsdata.plots.page import player_page as view_page
from nvsdata.rig.report import report_page
from nvsdata.training import runs as recipes

# a title, a line of its own, a line that overwrites, C1, right to left, a byte that isn't UTF-8, a tag, an attribute
BAD = "\x1b]0;owned\x07\nowned: 3\rowned\x9b31m\u202e\u2028\udcff<owned>\"'&onowned=1 äß日本\u3099"
TAG = f"</script><owned>{BAD}" + "x" * 5_000
FOLDER = ("--dataset", "folder")
STEM = BAD + "x" * 100
PLAYED = BAD.replace("\udcff", "")  # OpenCV opens no others


def clean(text):
    """Nothing but printable text and lines; none of the lines is a name's."""
    assert not [c for c in text if not c.isprintable() and c not in "\n\t"]
    assert not [line for line in text.splitlines() if line.lstrip().startswith("owned")]
    return text


class Tags(HTMLParser):
    """Collects what a browser would take for tags and attributes."""

    def __init__(self):
        super().__init__()
        self.found = set()

    def handle_starttag(self, tag, attrs):
        self.found |= {tag, *(name for name, _ in attrs)}


def harmless(page):
    tags = Tags()
    tags.feed(clean(page))
    assert not [name for name in tags.found if "owned" in name]
    assert "owned" in page
    page.encode()


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A folder of hostile name with a class of hostile name, a sound recording and a broken one."""
    if sys.platform == "win32":
        pytest.skip("Windows has no such names")
    monkeypatch.chdir(tmp_path)
    root = tmp_path / f"root{BAD}"
    for stem in ("b", "c"):
        path = root / f"class{BAD}" / f"{stem}{STEM}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        nvsdata.write(trees.some(1), path)
    (path.parent / f"a{STEM}.bin").write_bytes(b"abc")
    write_video(tmp_path / "square.avi")
    videos = tmp_path / f"videos{PLAYED}"
    (videos / f"class{PLAYED}").mkdir(parents=True)
    os.replace(tmp_path / "square.avi", videos / f"class{PLAYED}" / f"a{PLAYED}.avi")
    (videos / f"b{PLAYED}.avi").write_bytes(b"abc")
    kept = tmp_path / f"kept{BAD}"
    (kept / "n-mnist").mkdir(parents=True)
    (kept / CACHE_TAG).write_bytes(CACHE_CONTENT)
    status = {"state": "done", "began": BAD, "updated": BAD, "done": 1, "total": 2, "failed": 1, "flagged": 0}
    status |= {"seconds_left": None, "disk_free": 1, "video": BAD, "recent": [BAD]}
    (root / "status.json").write_text(json.dumps(status))
    return root


def calls(root):
    """Commands with what they are called with, and their exit code."""
    folder = root / f"class{BAD}"
    sound, other, broken = folder / f"b{STEM}.h5", folder / f"c{STEM}.h5", folder / f"a{STEM}.bin"
    videos, out = root.parent / f"videos{PLAYED}", root.parent / f"out{PLAYED}"
    return [
        ("info", 1, sound, broken, "nowhere" + BAD),
        ("view", 0, sound),
        ("view", 1, sound),
        ("view", 1, broken, out.with_name("a.png")),
        ("view", 2, sound, "a.png", BAD),
        ("gallery", 1, root, out.with_suffix(".html")),
        ("gallery", 1, root, out.with_suffix(".html")),
        ("datasets", 0, "--root", root.parent / f"kept{BAD}"),
        ("download", 0, "n-mnist", "--root", root, "--mirror", root, "--dry-run"),
        ("download", 1, "n-mnist", "--root", sound),
        ("pack", 0, root, *FOLDER, "--out", out.with_suffix(".h5"), "--dry-run"),
        ("pack", 1, root, *FOLDER, "--out", out.with_suffix(".h5")),
        ("pack", 1, root, *FOLDER, "--out", out.with_suffix(".h5")),
        ("pack", 2, root, *FOLDER, "--out", out.with_suffix(".h5"), "--split", BAD),
        ("precompute", 1, root, *FOLDER, "--transform", "RadiusGraph()", "--out", out.with_suffix(".nvs")),
        ("precompute", 2, root, *FOLDER, "--transform", BAD, "--out", out.with_suffix(".nvs")),
        ("join", 1, out.with_suffix(".h5"), "--out", out.with_suffix(".nvs")),
        ("push", 1, out.with_suffix(".h5"), f"s9://a/{BAD}"),
        ("fetch", 1, f"s9://a/{BAD}", "--out", out),
        ("verify", 1, root),
        ("verify", 1, root, "--json"),
        ("verify", 1, out.with_suffix(".h5")),
        ("verify", 1, out),
        ("convert", 0, sound, out.with_suffix(".raw")),
        ("convert", 1, broken, out.with_suffix(".npy")),
        ("convert", 2, sound, out),
        ("compare", 0, sound, other, "--image", out.with_suffix(".png")),
        ("convert-videos", 0, videos, "--out", out, "--dry-run"),
        ("convert-videos", 1, videos, "--out", out, "--verbose", "--preview"),
        ("convert-videos", 1, videos, "--out", out, "--fps", "10"),
        ("convert-videos", 1, out / BAD),
        ("tune", 1, "--real", broken, "--video", videos / f"b{PLAYED}.avi", "--out", out),
        ("record", 1, "--status", root),
        ("record", 1, "--status", out),
        ("record", 2, "--settings", root / "status.json", "--out", out.with_suffix(".h5")),
        ("record", 1, "--monitor", out / BAD, "--out", root),
        ("bench", 1, "--data", out / BAD),
        ("bench", 1, "--compare", root / "status.json"),
        ("bench", 2, BAD),
        ("demo", 1, "--out", sound),
        ("cache", 0, "info", root.parent, root),
        ("cache", 0, "clear", root.parent),
        (BAD, 2),
    ]


def test_no_command_prints_what_a_terminal_obeys(root, capsys):
    named = set()
    for command, code, *given in calls(root):
        try:
            found = main([command, *map(str, given)])
        except SystemExit as error:
            found = error.code
        out, err = capsys.readouterr()
        assert found == code, (command, given, err)
        clean(out)
        clean(err)
        named |= {command} if "owned" in out + err else set()
    assert named - {BAD} == set(COMMANDS)
    for page in root.parent.glob("*.html"):
        harmless(page.read_text("utf-8"))


def test_who_writes_is_named_without_obeying(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["nvsdata", BAD])
    nvsdata.write(trees.some(1), "a.h5")
    with locks.locked("b.npy"):
        (tmp_path / ".b.npy.lock").write_text(json.dumps({"owner": BAD, "host": BAD, "pid": BAD, "command": BAD}))
        with pytest.raises(locks.OutputInUse) as raised, locks.locked("b.npy"):
            pass
        assert main(["convert", "a.h5", "b.npy"]) == 1
    clean(str(raised.value))
    assert "owned" in clean(capsys.readouterr().err)


@pytest.mark.filterwarnings("ignore:Glyph:UserWarning")  # matplotlib's font has no Japanese
def test_every_page_shows_names_as_text(root):
    events = trees.some(1)
    harmless(view_page(events, TAG))
    shelf = ClassSummary(TAG, 1)
    shelf.add(events)
    shelf.show(TAG, events)
    harmless(gallery(TAG, [shelf, shelf], [TAG]))
    harmless(EventFolder(root)._repr_html_())
    line = Measurement(
        TAG, TAG, TAG, TAG, 1.0, 1.0, 1.0, 1, {TAG: TAG}, {TAG: 3}, TAG, error_kind=TAG, machine=TAG, date=TAG
    )
    harmless(bench_page([line]))
    grown = [Measurement(TAG, "work", "nvsdata", "", n, n, n, 1, size={TAG: n}, axis=TAG) for n in (1, 2, 4)]
    harmless(bench_page(grown))
    recorded = {"video": TAG, "status": TAG, "reason": TAG, "review": [TAG]}
    harmless(report_page([recorded], {}, TAG, TAG))


def test_a_repr_and_a_warning_are_safe_where_no_command_runs(root):
    clean(repr(EventFolder(root)))
    data = EventFolder(root, errors="skip")
    with pytest.warns(UserWarning, match="owned") as expected:
        for _ in data:
            pass
    for one in expected:
        clean(str(one.message))
    clean(str(FormatError(BAD, BAD)))
    clean(aligned([[BAD, "a"], ["a", BAD]]))
    report = run.FolderReport(failed={BAD: BAD}, damaged={BAD: 3}, without_preview={BAD: BAD})
    assert [clean(line) for line in report.messages()]


def test_whatever_prints_while_a_command_runs_is_escaped(capsys):
    with escaped_output():
        print("a\x1b[2J\tb\rc", BAD)
        sys.stderr.writelines(["a\x1b\n", "b\x9b"])
        print(warnings.formatwarning(BAD, UserWarning, BAD, 1, line="\x07"), file=sys.stderr)
        logging.StreamHandler().emit(logging.LogRecord("a", 30, "a", 1, "\x1b]0;%s", (BAD,), None))
    out, err = capsys.readouterr()
    assert not [c for c in out + err if not c.isprintable() and c not in "\n\t"]
    assert out.startswith("a\\x1b[2J\tb\\rc \\x1b]0;owned\\x07\nowned")
    assert "äß日本\u3099" in out
    print("\x1b")
    assert capsys.readouterr().out == "\x1b\n"


def test_a_recipe_ends_in_a_safe_line(capsys):
    def fails():
        print("\x1b")
        raise ValueError(BAD)

    with pytest.raises(SystemExit) as ended:
        recipes.run(fails)
    assert "owned" in clean(ended.value.code)
    assert capsys.readouterr().out == "\\x1b\n"


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self):
        return True


def test_a_bar_moves_the_cursor_and_its_words_do_not(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with escaped_output(), progress.bar(range(3), BAD, mininterval=0) as bar:
        for _ in bar:
            bar.set_postfix_str(BAD)
            progress.say_above_bar(BAD)
    text = screen.getvalue()
    # the bar is cleared before the line is written
    assert f" \r{shown(BAD)}\n" in text
    assert not [c for c in text if not c.isprintable() and c not in "\n\r"]
    assert not [line for line in re.split("[\n\r]", text) if line.startswith("owned")]


def test_one_function_for_pages_one_for_scripts_and_one_for_errors():
    assert as_html("<a href='x'>&\"\n\x1b\udcff", "\n") == "&lt;a href=&#x27;x&#x27;&gt;&amp;&quot;\n\\x1b\\udcff"
    result = as_script({"</script>": ["<!--", "\u2028", "\udcff", 1.5]})
    assert "<" not in result
    assert result.isascii()
    assert json.loads(result) == {"</script>": ["<!--", "\u2028", "\udcff", 1.5]}
    assert message_of(ValueError("a\nb")) == "a\\nb"
    sent = "Caught FormatError in worker 0.\nTraceback:\n  a: b\nFormatError: a: t\x1b\n"
    assert message_of(ValueError(sent)) == "a: t\\x1b"
    assert message_of(DownloadError("a\n  b\x1b")) == "a\n  b\\x1b"
