"""The page that plays events, in a real browser where there is one."""

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from queue import Queue
from threading import Thread

import cv2
import numpy as np
import pytest

from nvsdata import Events
from nvsdata.data.samples import Frame
from nvsdata.plots.drawing import event_image
from nvsdata.plots.page import player_page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
LATE = 10**15
# for a second, a pixel moves right along row 10 of 40x30; ON first, then OFF
PLACES = np.arange(4_000) // 100
MOVING = Events(LATE + np.arange(4_000) * 250, PLACES, np.full(4_000, 10), PLACES < 20, (40, 30))
GRAY = np.tile(np.arange(40, dtype=np.uint16), (30, 1)) * 20
FRAME = Frame(LATE + 400_000, LATE + 500_000, LATE + 510_000, LATE + 520_000, 0, 0, GRAY)


def embedded(text):
    data = json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', text)[1])
    kinds = {"t": "<u4", "xp": "<u2", "y": "<u2"}
    t, xp, y = (np.frombuffer(base64.b64decode(data[name]), kind) for name, kind in kinds.items())
    return data, t.astype(np.int64) * data["unit"], xp & 0x7FFF, y, xp >> 15


def test_a_page_holds_all_events():
    data, t, x, y, p = embedded(player_page(MOVING, "a <title> & more", [FRAME]))
    assert np.array_equal(t + LATE, MOVING.t)
    for found, wanted in ((x, MOVING.x), (y, MOVING.y), (p, MOVING.p)):
        assert np.array_equal(found, wanted)
    assert (data["size"], data["span"], data["window"]) == ([40, 30], 999_750, 33_333)
    (frame,) = data["frames"]
    assert frame["at"] == 500_000
    gray = cv2.imdecode(np.frombuffer(base64.b64decode(frame["image"]), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert gray.shape == (30, 40)
    assert gray[:, 0].max() < 10
    assert gray[:, -1].min() > 245


def test_a_page_needs_nothing_else():
    text = player_page(MOVING, "a <title> & more")
    assert "<title>a &lt;title&gt; &amp; more</title>" in text
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert "__" not in re.sub(r"<script id=\"data\".*?</script>", "", text)


def test_a_page_follows_dark_mode_and_lists_its_keys():
    text = player_page(MOVING, "")
    assert "@media (prefers-color-scheme: dark)" in text
    assert 'matchMedia("(prefers-color-scheme: dark)")' in text
    keys = re.search(r"const KEYS = {(.*?)};.*?const CLOUD_KEYS = {(.*?)};", text, re.DOTALL)
    bound = {key.strip('"') for part in keys.groups() for key in re.findall(r'(".+?"|\w+): (?:event|\(\)|reset)', part)}
    names = {"space": " ", "&larr;": "ArrowLeft", "&rarr;": "ArrowRight"}
    listed = {names.get(key, key) for key in re.findall("<kbd>(.*?)</kbd>", text)}
    # up and down are among "arrow keys"
    assert bound - {"ArrowUp", "ArrowDown"} == listed


def test_times_may_count_from_an_earlier_moment():
    assert embedded(player_page(MOVING, ""))[0]["offset"] == 0
    assert embedded(player_page(MOVING, "", origin=LATE - 7))[0]["offset"] == 7


def test_more_events_than_a_browser_takes(monkeypatch):
    monkeypatch.setattr("nvsdata.plots.page.MOST_EVENTS", 3_999)
    with pytest.raises(ValueError, match=r"a page of 4,000 events .* select a part \(up to 3,999 events\)"):
        player_page(MOVING, "")


def test_long_recordings_and_empty_ones():
    days = Events([0, 3 * 10**11], [0, 1], [0, 0], [0, 1], (2, 1))
    _, t, *_ = embedded(player_page(days, ""))
    assert t[0] == 0
    assert abs(int(t[1]) - 3 * 10**11) < 100
    assert embedded(player_page(Events.empty((5, 3)), ""))[0]["window"] == 1
    assert embedded(player_page(MOVING, "", window=500))[0]["window"] == 500


def test_a_title_may_hold_any_words():
    text = player_page(MOVING, "__DATA__ <b> __ABOUT__")
    assert text.count("__DATA__ &lt;b&gt; __ABOUT__") == player_page(MOVING, "plain words").count("plain words")
    assert embedded(text)[0]["size"] == [40, 30]


@pytest.mark.parametrize(
    ("span", "unit", "window"),
    [
        (2**32 - 1, 1, 33_333),
        (2**32, 2, 33_333),
        (2**33 - 2, 2, 33_333),
        (2**33 - 1, 3, 33_333),
        (333_330, 1, 33_333),
        (333_329, 1, 33_332),
        (100, 1, 10),
        (5, 1, 1),
    ],
)
def test_times_of_a_page_fit_32_bits(span, unit, window):
    events = Events([7, 7 + span], [0, 1], [0, 0], [0, 1], (2, 1))
    data, t, *_ = embedded(player_page(events, ""))
    assert (data["unit"], data["span"], data["window"]) == (unit, span, window)
    assert t.tolist() == [0, span // unit * unit]
    # no longer than what there is
    assert embedded(player_page(events, "", window=50))[0]["window"] == min(50, span)


def test_a_page_says_what_it_is_of():
    assert "<p>4,000 events, 999.8 ms, 40x30 pixels, 50% ON</p>" in player_page(MOVING, "")
    assert "<p>0 events, 0.0 ms, 5x3 pixels</p>" in player_page(Events.empty((5, 3)), "")
    assert "<p>1 events, 0.0 ms, 40x30 pixels, 100% ON</p>" in player_page(MOVING[:1], "")


@pytest.mark.parametrize(("given", "kept"), [(0, []), (3, [0, 1, 2]), (4, [0, 2]), (6, [0, 2, 4]), (7, [0, 3, 6])])
def test_of_very_many_frames_some_are_shown(monkeypatch, given, kept):
    monkeypatch.setattr("nvsdata.plots.page.MOST_FRAMES", 3)
    frames = [replace(FRAME, exposure_start=LATE + n, x=n, y=2 * n) for n in range(given)]
    shown = embedded(player_page(MOVING, "", frames))[0]["frames"]
    assert [(frame["at"], frame["x"], frame["y"]) for frame in shown] == [(n, n, 2 * n) for n in kept]


def test_frames_are_brightened_to_their_own_range():
    def gray(values):
        (found,) = embedded(player_page(MOVING, "", [replace(FRAME, pixels=np.array(values, np.uint16))]))[0]["frames"]
        encoded = np.frombuffer(base64.b64decode(found["image"]), np.uint8)
        return cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE).astype(int)

    # of ten thousand pixels, half a percent may be beyond either end
    values = np.repeat([0, 1_000, 1_500, 2_000, 60_000], (40, 2_000, 5_920, 2_000, 40)).reshape(100, 100)
    found = np.median(gray(values), 1)
    assert found[[5, 50, 95]] == pytest.approx([0, 127, 255], abs=3)
    assert np.abs(gray(np.full((16, 16), 700))).max() < 3
    # 1 is the least range
    assert gray([[700] * 16] * 8 + [[701] * 16] * 8)[-1, 0] == pytest.approx(255, abs=3)


def test_a_page_may_have_as_many_events_as_browsers_take(monkeypatch):
    monkeypatch.setattr("nvsdata.plots.page.MOST_EVENTS", 4_000)
    assert len(embedded(player_page(MOVING, ""))[1]) == 4_000


DRIVER = """
<script>
const report = [], drawn = () => new Promise(requestAnimationFrame);
const wait = async ms => { await new Promise(done => setTimeout(done, ms)); await drawn(); await drawn(); };
const $ = id => document.getElementById(id);
const send = (id, value) => { $(id).value = value; $(id).dispatchEvent(new Event("input")); };
function colors(id) {
  const c = $(id), all = c.getContext("2d").getImageData(0, 0, c.width, c.height).data, found = {};
  for (let i = 0; i < all.length; i += 4) if (all[i + 3]) {
    const key = [all[i], all[i + 1], all[i + 2]].join(); (found[key] = found[key] || []).push(i / 4 % c.width);
  }
  return found;
}
function cloud() {
  const c = document.createElement("canvas"), s = $("space"); c.width = 64; c.height = 48;
  c.getContext("2d").drawImage(s, 0, 0, 64, 48);
  return Array.from(c.getContext("2d").getImageData(0, 0, 64, 48).data);
}
const press = (key, target = document.body) => {
  const event = new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true });
  target.dispatchEvent(event);
  return event.defaultPrevented;
};
window.onerror = message => report.push({ error: String(message) });
if (window.top === window) (async () => {
  await wait(200);
  viewer.setWindow(25000); send("scrubber", 0.25); await wait(200);
  report.push({ step: "scrub on", time: $("time").textContent, drawn: viewer.state.drawn, colors: colors("events") });
  send("scrubber", 0.75); await wait(200);
  report.push({ step: "scrub off", colors: colors("events"), behind: Object.keys(colors("behind")).length });
  $("frames").click(); await wait(200);
  report.push({ step: "no frames", behind: Object.keys(colors("behind")).length });
  send("window", 1); await wait(200);
  const shown = $("events"), all = shown.getContext("2d").getImageData(0, 0, shown.width, shown.height).data;
  report.push({ step: "window", length: $("length").textContent, drawn: viewer.state.drawn,
    size: [shown.height, shown.width], picture: Array.from(all) });
  viewer.setWindow(25000);
  $("speed").value = "0.1"; $("speed").dispatchEvent(new Event("change")); viewer.seek(0); $("play").click();
  await wait(1000);
  const moved = viewer.state.time; $("play").click(); await wait(200);
  report.push({ step: "play", moved, after: viewer.state.time - moved, label: $("play").textContent });
  const before = cloud();
  const point = (kind, id, x, y) => $("space").dispatchEvent(
    new PointerEvent(kind, { pointerId: id, buttons: 1, clientX: x, clientY: y, bubbles: true }));
  point("pointerdown", 1, 100, 100); point("pointermove", 1, 250, 140); point("pointerup", 1, 250, 140);
  point("pointermove", 1, 900, 900);
  await wait(200);
  const turned = cloud();
  $("space").dispatchEvent(new WheelEvent("wheel", { deltaY: -800, cancelable: true })); await wait(200);
  const zoomed = cloud();
  $("space").dispatchEvent(new MouseEvent("dblclick")); await wait(200);
  const differ = (a, b) => a.filter((v, i) => Math.abs(v - b[i]) > 20).length;
  const [a, b, c] = [differ(before, turned), differ(turned, zoomed), differ(before, cloud())];
  report.push({ step: "cloud", turned: a, zoomed: b, back: c });
  point("pointerdown", 1, 100, 100); point("pointerdown", 2, 200, 100); point("pointermove", 2, 300, 100);
  const pinched = [viewer.state.zoom, ...viewer.state.turn];
  point("pointerup", 1, 100, 100); point("pointerup", 2, 300, 100);
  press("0", $("space")); press("ArrowRight", $("space")); press("+", $("space"));
  report.push({ step: "touch", pinched, keys: [viewer.state.zoom, ...viewer.state.turn] });
  const seen = { step: "keys", times: [], windows: [], speeds: [] };
  viewer.setWindow(20000); press("End"); press("ArrowLeft"); seen.times.push(viewer.state.time);
  press("Home"); press("ArrowRight", $("play")); seen.times.push(viewer.state.time);
  for (const key of "]][") { press(key); seen.windows.push(viewer.state.window); }
  for (const key of ".,,") { press(key); seen.speeds.push([viewer.state.speed, $("speed").value]); }
  press(" "); seen.playing = [viewer.state.playing]; press(" "); seen.playing.push(viewer.state.playing);
  seen.left = [press(" ", $("play")), press("ArrowRight", $("scrubber")), press("Home", $("speed")), press("x")];
  report.push(seen);
  const phone = document.createElement("iframe");
  phone.style = "width: 390px; height: 664px; border: 0"; phone.src = "/"; document.body.append(phone);
  await new Promise(done => { phone.onload = done; }); await wait(300);
  const inside = phone.contentDocument;
  report.push({ step: "phone", wide: inside.documentElement.scrollWidth,
    controls: ["scrubber", "play", "speed", "window", "frames-choice"].map(id => {
      const box = inside.getElementById(id).getBoundingClientRect(); return [id, box.height, box.bottom]; }) });
  phone.remove();
  document.body.style.width = "420px"; await wait(300);
  report.push({ step: "resize", rate: $("rate").width, space: $("space").width, wide: document.body.scrollWidth });
  await fetch("/report", { method: "POST", body: JSON.stringify(report) });
})();
</script>
"""


def browser(profile, *rest):
    flags = ["--headless", "--no-sandbox", "--enable-unsafe-swiftshader", f"--user-data-dir={profile}"]
    flags += ["--enable-logging=stderr", "--window-size=1200,900", "--force-device-scale-factor=1"]
    return [CHROMIUM, *flags, *rest]


class Serve(BaseHTTPRequestHandler):
    """Gives the page, and takes what its driver found."""

    def do_GET(self):
        self.send_response(200 if self.path == "/" else 204)
        self.end_headers()
        self.wfile.write(self.server.page if self.path == "/" else b"")

    def do_POST(self):
        self.server.report.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def browsed(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    folder = tmp_path_factory.mktemp("page")
    with ThreadingHTTPServer(("127.0.0.1", 0), Serve) as server, (folder / "log").open("w") as log:
        server.page = player_page(MOVING, "moving", [FRAME]).replace("</body>", DRIVER + "</body>").encode()
        server.report = Queue()
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        process = subprocess.Popen(browser(folder / "profile", "--remote-debugging-port=0", address), stderr=log)
        try:
            steps = server.report.get(timeout=100)
        finally:
            process.terminate()
            process.wait(20)
            server.shutdown()
    # reading pictures back, as this test does, is slow, and the browser says so
    hints = "GL Driver Message", "willReadFrequently"
    said = [line for line in (folder / "log").read_text(errors="replace").splitlines() if "CONSOLE" in line]
    assert not [line for line in said if not any(hint in line for hint in hints)]
    assert not [step for step in steps if "error" in step]
    return {step["step"]: step for step in steps}


ON, OFF = "220,60,60", "40,120,220"


def test_the_scrubber_shows_the_window_that_ends_there(browsed):
    on, off = browsed["scrub on"], browsed["scrub off"]
    assert on["time"] == "249.9 ms"
    assert on["drawn"] == 100
    assert set(on["colors"]) == {ON}
    assert set(off["colors"]) == {OFF}
    assert set(on["colors"][ON]) <= {8, 9, 10}
    assert set(off["colors"][OFF]) <= {28, 29, 30}


def test_frames_are_shown_behind_the_events(browsed):
    assert browsed["scrub off"]["behind"] > 10
    assert browsed["no frames"]["behind"] == 1


def test_the_window_s_length_and_speed(browsed):
    assert browsed["window"]["length"] == "999.8 ms"
    assert browsed["window"]["drawn"] == 3_000
    # a tenth of a second of real time shows in a second
    assert 60_000 < browsed["play"]["moved"] < 140_000
    assert browsed["play"]["after"] < 40_000
    assert browsed["play"]["label"] == "Play"


def test_the_player_draws_what_event_image_draws(browsed):
    found = np.array(browsed["window"]["picture"], np.uint8).reshape(*browsed["window"]["size"], 4)
    # the scrubber stands at three quarters
    expected = event_image(MOVING[:3_000])[..., ::-1]
    # where there are no events, what lies behind is seen
    there = (expected != 255).any(2)
    assert np.array_equal(found[..., 3] > 0, there)
    assert np.array_equal(found[there][:, :3], expected[there])


def test_the_cloud_turns(browsed):
    assert browsed["cloud"]["turned"] > 100
    assert browsed["cloud"]["zoomed"] > 100
    assert browsed["cloud"]["back"] == 0


def test_fingers_and_keys_turn_and_zoom_the_cloud(browsed):
    # two fingers at twice their distance
    assert browsed["touch"]["pinched"] == pytest.approx([2, 0.6, 0.35])
    assert browsed["touch"]["keys"] == pytest.approx([1.25, 0.6 + 12 * 0.008, 0.35])


def test_keys_control_the_player(browsed):
    keys = browsed["keys"]
    assert keys["times"] == [999_750 - 20_000, 20_000]
    assert keys["windows"] == [40_000, 80_000, 40_000]
    assert keys["speeds"] == [[0.3, "0.3"], [0.1, "0.1"], [0.03, "0.03"]]
    assert keys["playing"] == [True, False]
    # elements with the focus keep their own keys
    assert keys["left"] == [False] * 4


def test_controls_are_large_and_at_the_top_of_a_phone(browsed):
    assert browsed["phone"]["wide"] <= 390
    for name, height, bottom in browsed["phone"]["controls"]:
        assert height >= 40, name
        assert bottom <= 664, name


def test_a_narrow_page_fits(browsed):
    assert browsed["resize"]["rate"] <= 420
    assert browsed["resize"]["space"] <= 420
    assert browsed["resize"]["wide"] <= 444


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_screenshot_shows_the_events_in_their_places(tmp_path):
    path = tmp_path / "a.html"
    path.write_text(player_page(MOVING, "moving", window=1_000_000), encoding="utf-8")
    shot = f"--screenshot={tmp_path / 'shot.png'}"
    command = browser(tmp_path / "profile", "--virtual-time-budget=5000", shot, path.as_uri())
    subprocess.run(command, capture_output=True, timeout=100, check=True)
    shot = cv2.imread(str(tmp_path / "shot.png")).astype(int)
    # the player is on the left: a red stroke, then a blue one, a third down
    left = shot[:, :600]
    red, blue = (abs(left - np.array(color[::-1])).max(2) < 30 for color in ((220, 60, 60), (40, 120, 220)))
    # above the controls
    red, blue = red[:560], blue[:560]
    assert red.sum() > 500
    assert blue.sum() > 500
    assert np.argwhere(red)[:, 1].max() < np.argwhere(blue)[:, 1].min() + 30
    assert abs(np.argwhere(red)[:, 0].mean() - np.argwhere(blue)[:, 0].mean()) < 3
