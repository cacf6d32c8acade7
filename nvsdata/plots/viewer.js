"use strict";
const viewer = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = id => document.getElementById(id);
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  const t = new Uint32Array(bytes(data.t)), xp = new Uint16Array(bytes(data.xp)), y = new Uint16Array(bytes(data.y));
  const unit = data.unit, span = Math.max(data.span, 1), [width, height] = data.size, count = t.length;
  // colors of the drawings: events, paper behind them, cloud, text and shades of the chart
  const LIGHT = { on: [220, 60, 60], off: [40, 120, 220], both: [150, 60, 150], paper: "#fff", space: 0.98,
    note: "#6b6b6b", line: "#333", shade: "rgba(0, 0, 0, 0.12)", box: 0.7 };
  const DARK = { on: [255, 100, 90], off: [80, 155, 255], both: [205, 130, 215], paper: "#101010", space: 0.08,
    note: "#a0a0a0", line: "#ddd", shade: "rgba(255, 255, 255, 0.18)", box: 0.45 };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let look = dark.matches ? DARK : LIGHT;
  const state = { time: 0, window: 0, speed: 1, playing: false, turn: [0.6, 0.35], zoom: 1, drawn: 0 };

  // first event at or after a time in microseconds
  function first(time) {
    let low = 0, high = count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (t[middle] * unit < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  // the player: frames below, events above
  const sheet = at("events"), behind = at("behind");
  sheet.width = behind.width = width;
  sheet.height = behind.height = height;
  const picture = sheet.getContext("2d"), image = picture.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer), back = behind.getContext("2d");
  const packed = color => (255 << 24) | (color[2] << 16) | (color[1] << 8) | color[0];
  const seen = new Uint8Array(width * height);
  const photos = data.frames.map(frame => {
    const photo = new Image();
    photo.onload = () => { draw(); };
    photo.src = "data:image/jpeg;base64," + frame.image;
    return { ...frame, photo };
  });
  at("frames-choice").hidden = !photos.length;

  function drawPlayer() {
    // the window ends at the time shown
    const from = first(state.time - state.window), to = first(state.time + 1);
    seen.fill(0);
    const colors = [0, packed(look.off), packed(look.on), packed(look.both)].map(c => c >>> 0);
    for (let i = from; i < to; i++) seen[y[i] * width + (xp[i] & 0x7fff)] |= xp[i] & 0x8000 ? 2 : 1;
    for (let q = 0; q < pixels.length; q++) pixels[q] = colors[seen[q]];
    picture.putImageData(image, 0, 0);
    back.fillStyle = look.paper;
    back.fillRect(0, 0, width, height);
    const shown = photos.filter(frame => frame.at <= state.time).pop();
    if (shown && at("frames").checked && shown.photo.complete) back.drawImage(shown.photo, shown.x, shown.y);
    state.drawn = to - from;
  }

  // events per second, drawn once and copied below the line that marks the time
  const chart = at("rate");
  let curve = null;
  function drawRate() {
    const wide = chart.clientWidth || 600, high = chart.clientHeight || 90;
    if (!curve || curve.width !== wide) {
      chart.width = wide;
      chart.height = high;
      curve = document.createElement("canvas");
      curve.width = wide;
      curve.height = high;
      const sums = [new Uint32Array(wide), new Uint32Array(wide)];
      for (let i = 0; i < count; i++) sums[xp[i] >> 15][Math.min(Math.floor(t[i] * unit / span * wide), wide - 1)]++;
      let most = 1;
      for (let c = 0; c < wide; c++) most = Math.max(most, sums[0][c] + sums[1][c]);
      const pen = curve.getContext("2d");
      for (let c = 0; c < wide; c++) {
        const on = sums[1][c] / most * (high - 16), off = sums[0][c] / most * (high - 16);
        pen.fillStyle = `rgb(${look.on})`;
        pen.fillRect(c, high - on, 1, on);
        pen.fillStyle = `rgb(${look.off})`;
        pen.fillRect(c, high - on - off, 1, off);
      }
      pen.fillStyle = look.note;
      pen.font = "11px system-ui, sans-serif";
      pen.fillText(`${Math.round(most / (span / 1e6 / wide)).toLocaleString("en")} events/s at most`, 4, 11);
    }
    const pen = chart.getContext("2d");
    pen.clearRect(0, 0, chart.width, chart.height);
    pen.drawImage(curve, 0, 0);
    const x = state.time / span * chart.width, w = state.window / span * chart.width;
    pen.fillStyle = look.shade;
    pen.fillRect(x - w, 0, Math.max(w, 1), chart.height);
    pen.fillStyle = look.line;
    pen.fillRect(x, 0, 1, chart.height);
  }

  // the cloud: time from left to right
  const space = at("space");
  const gl = space.getContext("webgl", { alpha: false, antialias: true, preserveDrawingBuffer: true });
  let program = null, corners = 0;
  function compile(kind, text) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  }
  function buildCloud() {
    program = gl.createProgram();
    gl.attachShader(program, compile(gl.VERTEX_SHADER, `
      attribute vec4 place; uniform mat4 view; uniform vec2 shown; uniform float size; uniform vec3 on, off, box; varying vec4 color;
      void main() {
        gl_Position = view * vec4(place.xyz, 1.0);
        gl_PointSize = size;
        bool now = place.x >= shown.x && place.x <= shown.y;
        vec3 own = place.w > 1.5 ? box : place.w > 0.5 ? on : off;
        color = vec4(own, place.w > 1.5 || now ? 1.0 : 0.3);
      }`));
    gl.attachShader(program, compile(gl.FRAGMENT_SHADER,
      "precision mediump float; varying vec4 color; void main() { gl_FragColor = color; }"));
    gl.linkProgram(program);
    gl.useProgram(program);
    const wide = 1.6, side = Math.max(width, height);
    const points = new Float32Array(4 * (count + 24));
    // in an order whose first n points, for any n, are spread over the entire recording
    const divisor = (a, b) => b ? divisor(b, a % b) : a;
    let step = Math.round(count * 0.618) || 1;
    while (divisor(step, count || 1) !== 1) step++;
    for (let i = 0, q = 0; i < count; i++, q = (q + step) % count) {
      points[4 * i] = (t[q] * unit / span - 0.5) * wide;
      points[4 * i + 1] = (0.5 * height - y[q]) / side;
      points[4 * i + 2] = ((xp[q] & 0x7fff) - 0.5 * width) / side;
      points[4 * i + 3] = xp[q] >> 15;
    }
    // the edges of the box
    for (let axis = 0; axis < 3; axis++) for (let n = 0; n < 4; n++) for (let end = 0; end < 2; end++) {
      const sign = [n & 1, n >> 1];
      sign.splice(axis, 0, end);
      const box = [wide, height / side, width / side].map((length, a) => (sign[a] - 0.5) * length);
      points.set([...box, 2], 4 * (count + corners++));
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, points, gl.STATIC_DRAW);
    const place = gl.getAttribLocation(program, "place");
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 4, gl.FLOAT, false, 0, 0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  function view(aspect) {
    const [a, b] = state.turn, [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
    const z = 1.1 * state.zoom, fit = Math.min(1, aspect), k = 0.25;
    // rotated about the vertical axis by a and about the horizontal axis by b, in weak perspective
    const rows = [[ca, 0, sa], [sa * sb, cb, -ca * sb], [-sa * cb, sb, ca * cb]];
    const m = new Float32Array(16);
    for (let c = 0; c < 3; c++) {
      m[4 * c] = rows[0][c] * z * fit / aspect;
      m[4 * c + 1] = rows[1][c] * z * fit;
      m[4 * c + 2] = -rows[2][c] * 0.1;
      m[4 * c + 3] = -rows[2][c] * k;
    }
    m[15] = 1;
    return m;
  }
  function drawCloud() {
    if (!gl) return;
    if (!program) buildCloud();
    const ratio = window.devicePixelRatio || 1;
    const wide = Math.max(1, Math.round(space.clientWidth * ratio)), high = Math.max(1, Math.round(space.clientHeight * ratio));
    if (space.width !== wide || space.height !== high) { space.width = wide; space.height = high; }
    gl.viewport(0, 0, wide, high);
    gl.clearColor(look.space, look.space, look.space, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const set = name => gl.getUniformLocation(program, name);
    gl.uniformMatrix4fv(set("view"), false, view(wide / high));
    gl.uniform2f(set("shown"), ((state.time - state.window) / span - 0.5) * 1.6, (state.time / span - 0.5) * 1.6);
    gl.uniform1f(set("size"), (count > 200000 ? 1 : 2) * ratio);
    gl.uniform3fv(set("on"), look.on.map(c => c / 255));
    gl.uniform3fv(set("off"), look.off.map(c => c / 255));
    gl.uniform3f(set("box"), look.box, look.box, look.box);
    gl.drawArrays(gl.LINES, count, corners);
    gl.drawArrays(gl.POINTS, 0, moving() ? Math.min(count, budget) : count);
  }
  // during motion, at most as many points are drawn as the graphics card draws 20 times per second
  let budget = count, touched = -1e9, resting = 0, last = 0, moved = false;
  const moving = () => state.playing || performance.now() - touched < 250;
  function pace(now) {
    const gap = now - last;
    last = now;
    const going = moved;
    moved = moving();
    if (!going || !moved) return;
    budget = gap > 50 ? Math.max(20000, budget * 40 / gap) : gap < 25 ? Math.min(count, budget * 1.1) : budget;
  }
  function touch() {
    touched = performance.now();
    clearTimeout(resting);
    resting = setTimeout(draw, 300);
    draw();
  }
  if (!gl) at("cloud").querySelector("span").textContent = "this browser doesn't support WebGL";

  // at most one redraw per refresh of the screen
  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(now => { waiting = false; pace(now); drawNow(); });
  }
  function drawNow() {
    drawPlayer();
    drawRate();
    drawCloud();
    at("scrubber").value = state.time / span;
    at("time").textContent = ((data.offset + state.time) / 1e3).toFixed(1) + " ms";
    at("length").textContent = state.window < 1e3 ? Math.round(state.window) + " \u00b5s" : (state.window / 1e3).toFixed(1) + " ms";
    at("play").textContent = state.playing ? "Pause" : "Play";
  }

  function seek(time) { state.time = Math.min(Math.max(time, 0), span); draw(); }
  let before = 0;
  function tick(now) {
    if (!state.playing) return;
    if (before) {
      const next = state.time + (now - before) * 1e3 * state.speed;
      if (next >= span) state.playing = false;
      seek(next);
    }
    before = now;
    if (state.playing) requestAnimationFrame(tick); else draw();
  }
  function play(on) {
    state.playing = on;
    before = 0;
    if (on && state.time >= span) state.time = 0;
    if (on) requestAnimationFrame(tick);
    draw();
  }

  // window lengths from 100 microseconds to the entire recording, on a logarithmic slider
  const least = Math.min(100, span), range = Math.log(span / least) || 1;
  function setWindow(length) {
    state.window = Math.min(Math.max(length, least), span);
    at("window").value = Math.log(state.window / least) / range;
    draw();
  }
  const SPEEDS = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3];
  for (const speed of SPEEDS) at("speed").add(new Option(speed + "x", speed));
  // recordings shorter than 4 s are slowed down, and play for at most 13 s
  state.speed = span >= 4e6 ? 1 : span >= 1e6 ? 0.3 : span >= 3e5 ? 0.1 : span >= 1e5 ? 0.03 : 0.01;
  function setSpeed(speed) { state.speed = at("speed").value = speed; }
  setSpeed(state.speed);
  at("speed").onchange = event => setSpeed(Number(event.target.value));
  at("scrubber").oninput = event => seek(Number(event.target.value) * span);
  at("window").oninput = event => setWindow(least * Math.exp(Number(event.target.value) * range));
  at("play").onclick = () => play(!state.playing);
  at("frames").onchange = draw;
  const hold = event => { try { event.target.setPointerCapture(event.pointerId); } catch (error) { /* not a real pointer */ } };
  chart.onpointerdown = event => { hold(event); seek(event.offsetX / chart.clientWidth * span); };
  chart.onpointermove = event => { if (event.buttons) seek(event.offsetX / chart.clientWidth * span); };

  // one pointer rotates the cloud, two zoom it
  const pointers = new Map();
  function rotate(right, down) {
    state.turn[0] += right * 0.008;
    state.turn[1] = Math.min(Math.max(state.turn[1] + down * 0.008, -1.57), 1.57);
    touch();
  }
  function zoom(factor) { state.zoom = Math.min(Math.max(state.zoom * factor, 0.2), 20); touch(); }
  function reset() { state.turn = [0.6, 0.35]; state.zoom = 1; draw(); }
  function spread() {
    const [a, b] = [...pointers.values()];
    return Math.max(Math.hypot(a[0] - b[0], a[1] - b[1]), 1);
  }
  space.onpointerdown = event => { hold(event); pointers.set(event.pointerId, [event.clientX, event.clientY]); };
  space.onpointerup = space.onpointercancel = event => { pointers.delete(event.pointerId); };
  space.onpointermove = event => {
    const from = pointers.get(event.pointerId), wide = pointers.size === 2 && spread();
    if (!from) return;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (wide) zoom(spread() / wide);
    else if (pointers.size === 1) rotate(event.clientX - from[0], event.clientY - from[1]);
  };
  space.ondblclick = reset;
  space.addEventListener("wheel", event => { event.preventDefault(); zoom(Math.exp(-event.deltaY * 0.001)); }, { passive: false });

  const later = by => { setSpeed(SPEEDS[Math.min(Math.max(SPEEDS.indexOf(state.speed) + by, 0), SPEEDS.length - 1)]); };
  const KEYS = {
    " ": event => { if (!event.repeat) play(!state.playing); },
    ArrowRight: () => seek(state.time + state.window), ArrowLeft: () => seek(state.time - state.window),
    Home: () => seek(0), End: () => seek(span),
    "[": () => setWindow(state.window / 2), "]": () => setWindow(state.window * 2),
    ",": () => later(-1), ".": () => later(1),
  };
  const CLOUD_KEYS = {
    ArrowRight: () => rotate(12, 0), ArrowLeft: () => rotate(-12, 0),
    ArrowDown: () => rotate(0, 12), ArrowUp: () => rotate(0, -12),
    "+": () => zoom(1.25), "-": () => zoom(0.8), "0": reset,
  };
  document.addEventListener("keydown", event => {
    const { tagName, type } = event.target;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    // elements with the focus have a use of their own for some keys
    const pressed = ["BUTTON", "SUMMARY"].includes(tagName) || type === "checkbox";
    if (tagName === "SELECT" || (type === "range" && event.key.length > 1) || (pressed && event.key === " ")) return;
    const act = (event.target === space && CLOUD_KEYS[event.key]) || KEYS[event.key];
    if (act) { event.preventDefault(); act(event); }
  });
  dark.addEventListener("change", () => { look = dark.matches ? DARK : LIGHT; curve = null; draw(); });
  new ResizeObserver(() => { curve = null; draw(); }).observe(document.body);
  state.time = Math.min(data.window, span);
  setWindow(data.window);
  return { state, seek, play, setWindow, drawNow, count };
})();
