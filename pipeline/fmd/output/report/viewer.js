"use strict";
// A mechanism that turns and moves: drag to rotate, wheel or pinch to zoom, with shift to move, arrow keys, double click
// to go back; a slider for the time, which a button plays, and one for each coordinate. What the pointer is over is named.

const VERTEX = `#version 300 es
in vec3 position, normal; in float level;
uniform mat3 turn; uniform vec2 move, shape; uniform vec3 middle; uniform float zoom, depth, lift; uniform vec2 span;
out float shown; out vec3 facing;
void main() {
  vec3 p = turn * (position - middle);
  shown = (level - span.x) / (span.y - span.x); facing = turn * normal;
  gl_Position = vec4((p.xy * zoom + move) * shape, -p.z * depth - lift, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in float shown; in vec3 facing; out vec4 colour;
uniform sampler2D colours; uniform vec4 line; uniform vec4 flat_;
void main() {
  vec3 n = normalize(facing), light = normalize(vec3(-0.3, 0.4, 1.0));
  float shade = 0.7 + 0.3 * max(0.0, dot(gl_FrontFacing ? n : -n, light));
  vec3 hue = flat_.a > 0.0 ? flat_.rgb : texture(colours, vec2(shown, 0.5)).rgb;
  colour = line.a > 0.0 ? line : vec4(hue * shade, 1.0);
}`;

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const product = (a, b) => a.map((_, k) => [0, 1, 2].reduce((sum, j) => sum + a[3 * Math.floor(k / 3) + j] * b[3 * j + (k % 3)], 0));

function rotation(aboutUp, aboutRight) {
  const [c, s, d, t] = [Math.cos(aboutUp), Math.sin(aboutUp), Math.cos(aboutRight), Math.sin(aboutRight)];
  return product([1, 0, 0, 0, d, -t, 0, t, d], [c, 0, s, 0, 1, 0, -s, 0, c]);
}

// Positions of a body's points in space, deformed.
function place(body, frame, scale, target) {
  const { x, u, step, origin: o, rotation: r } = body, n = x.length, first = frame * n, a = 3 * frame, b = 9 * frame;
  for (let k = 0; k < n; k += 3) {
    let [p, q, s] = [x[k], x[k + 1], x[k + 2]];
    if (u) { p += scale * step * u[first + k]; q += scale * step * u[first + k + 1]; s += scale * step * u[first + k + 2]; }
    target[k] = o[a] + r[b] * p + r[b + 1] * q + r[b + 2] * s;
    target[k + 1] = o[a + 1] + r[b + 3] * p + r[b + 4] * q + r[b + 5] * s;
    target[k + 2] = o[a + 2] + r[b + 6] * p + r[b + 7] * q + r[b + 8] * s;
  }
}

function normals(p, triangles) {
  const sum = new Float32Array(p.length);
  for (let k = 0; k < triangles.length; k += 3) {
    const [a, b, c] = [3 * triangles[k], 3 * triangles[k + 1], 3 * triangles[k + 2]];
    const [ux, uy, uz] = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
    const [vx, vy, vz] = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
    for (const i of [a, b, c]) {
      sum[i] += uy * vz - uz * vy; sum[i + 1] += uz * vx - ux * vz; sum[i + 2] += ux * vy - uy * vx;
    }
  }
  return sum;
}

function show(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  const canvas = figure.querySelector("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return; // the still picture stays
  figure.classList.add("live");

  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(program, shader);
  }
  gl.linkProgram(program); gl.useProgram(program);
  const at = (name) => gl.getUniformLocation(program, name);
  const names = ["turn", "move", "shape", "middle", "zoom", "depth", "lift", "span", "line", "flat_"];
  const uniform = Object.fromEntries(names.map((name) => [name, at(name)]));
  const buffer = (target, values) => { const made = gl.createBuffer(); gl.bindBuffer(target, made); gl.bufferData(target, values, gl.STATIC_DRAW); return made; };
  const attribute = (name, size, kind, normalised) => {
    const place = gl.getAttribLocation(program, name), made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    if (place >= 0) { gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, kind, normalised, 0, 0); }
    return made;
  };
  const fill = (made, values) => { gl.bindBuffer(gl.ARRAY_BUFFER, made); gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW); };

  const bodies = data.bodies.map((given) => {
    const x = new Float32Array(bytes(given.positions)), corners = new Uint32Array(bytes(given.triangles));
    const edges = new Uint32Array(bytes(given.edges)), array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const position = attribute("position", 3, gl.FLOAT, false), normal = attribute("normal", 3, gl.FLOAT, false);
    const level = attribute("level", 1, gl.UNSIGNED_SHORT, true);
    const faces = buffer(gl.ELEMENT_ARRAY_BUFFER, corners), lines = buffer(gl.ELEMENT_ARRAY_BUFFER, edges);
    return {
      name: given.name, faces_at: given.faces ? new Uint16Array(bytes(given.faces.of)) : null, face_names: given.faces ? given.faces.names : [],
      x, corners, edges, array, position, normal, level, faces, lines, rgb: given.rgb, step: given.step, now: new Float32Array(x.length),
      u: given.displacements ? new Int16Array(bytes(given.displacements)) : null,
      levels: given.levels ? new Uint16Array(bytes(given.levels)) : new Uint16Array(0),
      origin: new Float32Array(bytes(given.origin)), rotation: new Float32Array(bytes(given.rotation)),
    };
  });
  const lines = data.lines.map((given) => {
    const array = gl.createVertexArray(); gl.bindVertexArray(array);
    const position = attribute("position", 3, gl.FLOAT, false), points = new Float32Array(bytes(given.points));
    return { array, position, points, count: points.length / 3 / data.clocks.length, rgb: given.rgb };
  });
  gl.bindVertexArray(null);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(bytes(data.colours)));
  for (const [key, how] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]])
    gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + key], gl[how]);
  gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

  const control = (name) => figure.querySelector(`[name=${name}]`);
  const [time, stretch, meshed, play, spanned, named] = ["time", "scale", "edges", "play", "span", "names"].map(control);
  const clips = [...figure.querySelectorAll("[name=clip]")];
  let turn, zoom, move, waiting = false, drawn = 0, playing = null, frame = data.frame;
  // Lengths in the picture are half of its shorter side.
  const shape = () => { const wide = canvas.clientWidth / canvas.clientHeight; return [Math.min(1, 1 / wide), Math.min(1, wide)]; };
  const home = () => {
    const [across, up] = shape();
    turn = data.axes; zoom = 0.95 / Math.max(across * data.reach[0], up * data.reach[1]); move = [0, 0]; draw();
  };
  const number = (value) => String(Number(value.toPrecision(3))).replace("-", "−");
  // What the colours span in a frame, as a share of all stress, and its numbers under the strip.
  let span = [0, 1];
  const setSpan = (frame) => {
    const [low, high] = data.spans[spanned.value][frame], [least, largest] = data.limits;
    span = [low, high].map((end) => (end - least) / (largest - least));
    const ticks = [...figure.querySelectorAll(".ticks span")], last = ticks.length - 1;
    ticks.forEach((tick, k) => { tick.textContent = number(low + (k / last) * (high - low)); });
    if (spanned.value === "usual" && high < largest) ticks[last].textContent = "≥ " + ticks[last].textContent;
  };
  const pose = () => {
    const scale = stretch ? Number(stretch.value) : 1;
    figure.querySelector("output[name=clock]").textContent = data.clocks[frame];
    if (stretch) figure.querySelector("output[name=factor]").textContent = `× ${scale}`;
    for (const body of bodies) {
      place(body, frame, scale, body.now);
      fill(body.position, body.now); fill(body.normal, normals(body.now, body.corners));
      const n = body.x.length / 3;
      fill(body.level, body.levels.length ? body.levels.subarray(frame * n, (frame + 1) * n) : new Uint16Array(n));
    }
    if (spanned) setSpan(frame);
    for (const line of lines) fill(line.position, line.points.subarray(3 * line.count * frame, 3 * line.count * (frame + 1)));
    draw();
  };

  const markers = (data.markers ? data.markers.names : []).map((name) => {
    const label = document.createElement("span");
    label.textContent = name; figure.querySelector(".labels").append(label);
    return label;
  });
  const places = data.markers ? new Float32Array(bytes(data.markers.points)) : null;
  // A point of space along the camera's axes, from the middle.
  const seen = (p, k) => {
    const [x, y, z] = [p[k] - data.middle[0], p[k + 1] - data.middle[1], p[k + 2] - data.middle[2]];
    return [0, 3, 6].map((row) => turn[row] * x + turn[row + 1] * y + turn[row + 2] * z);
  };
  const label = () => {
    const shown = named && named.checked, [across, up] = shape();
    markers.forEach((marker, k) => {
      const [x, y] = seen(places, 3 * (frame * markers.length + k));
      marker.hidden = !shown;
      marker.style.left = `${50 * (1 + (x * zoom + move[0]) * across)}%`;
      marker.style.top = `${50 * (1 - (y * zoom + move[1]) * up)}%`;
    });
  };
  // What is nearest to the viewer under a place of the canvas, from its upper left [pixels].
  const pick = (left, top) => {
    const [across, up] = shape();
    const at = [((2 * left / canvas.clientWidth - 1) / across - move[0]) / zoom, ((1 - 2 * top / canvas.clientHeight) / up - move[1]) / zoom];
    let nearest = -Infinity, found = "";
    for (const body of bodies) {
      const points = [];
      for (let k = 0; k < body.now.length; k += 3) points.push(seen(body.now, k));
      for (let k = 0; k < body.corners.length; k += 3) {
        const [a, b, c] = [0, 1, 2].map((j) => points[body.corners[k + j]]);
        const area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        const s = ((at[0] - a[0]) * (c[1] - a[1]) - (at[1] - a[1]) * (c[0] - a[0])) / area;
        const t = ((b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])) / area;
        const depth = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2]);
        if (!(s >= 0 && t >= 0 && s + t <= 1 && depth > nearest)) continue;
        nearest = depth; found = body.name;
        const face = body.faces_at ? body.face_names[body.faces_at[k / 3]] : undefined;
        if (face) found += `, face ${face}`;
      }
    }
    return found;
  };

  function paint() {
    waiting = false;
    const dense = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * dense); canvas.height = Math.round(canvas.clientHeight * dense);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform2fv(uniform.shape, shape()); gl.uniform1f(uniform.depth, 0.25 / data.radius);
    gl.uniformMatrix3fv(uniform.turn, true, turn); gl.uniform2fv(uniform.move, move); gl.uniform3fv(uniform.middle, data.middle);
    gl.uniform1f(uniform.zoom, zoom); gl.uniform2fv(uniform.span, span);
    for (const body of bodies) {
      gl.bindVertexArray(body.array);
      gl.uniform4f(uniform.line, 0, 0, 0, 0); gl.uniform1f(uniform.lift, 0);
      gl.uniform4f(uniform.flat_, ...(body.rgb ? [...body.rgb, 1] : [0, 0, 0, 0]));
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, body.faces);
      gl.drawElements(gl.TRIANGLES, body.corners.length, gl.UNSIGNED_INT, 0);
      if (meshed && meshed.checked && body.edges.length) {
        gl.uniform4f(uniform.line, 0.1, 0.1, 0.1, 0.35); gl.uniform1f(uniform.lift, 0.0005);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, body.lines);
        gl.drawElements(gl.LINES, body.edges.length, gl.UNSIGNED_INT, 0);
      }
    }
    gl.uniform1f(uniform.lift, 0);
    for (const line of lines) {
      gl.bindVertexArray(line.array);
      gl.uniform4f(uniform.line, ...line.rgb, 1);
      gl.drawArrays(gl.LINE_STRIP, 0, line.count);
    }
    label();
    canvas.dataset.drawn = ++drawn;
  }
  const draw = () => { if (!waiting) { waiting = true; requestAnimationFrame(paint); } };
  const rotate = (right, down) => { turn = product(rotation(right, down), turn); draw(); };
  const magnify = (factor) => { zoom *= factor; move = move.map((m) => m * factor); draw(); };

  const stop = () => { clearInterval(playing); playing = null; play.textContent = "play"; };
  const film = time ? { first: 0, count: data.clocks.length } : (data.clips || [])[data.film];
  const leave = (k) => clips.forEach((other, j) => { if (j !== k) other.value = data.clips[j].start; });
  const begin = () => {
    play.textContent = "stop"; leave(data.film);
    playing = setInterval(() => {
      const shown = (Math.max(frame - film.first, -1) + 1) % film.count;
      (time || clips[data.film]).value = shown; frame = film.first + shown; pose();
    }, 60);
  };
  if (play) play.addEventListener("click", () => (playing ? stop() : begin()));
  if (time) time.addEventListener("input", () => { stop(); frame = Number(time.value); pose(); });
  clips.forEach((slider, k) => slider.addEventListener("input", () => {
    if (play) stop();
    leave(k); frame = data.clips[k].first + Number(slider.value); pose();
  }));

  const fingers = new Map();
  const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, { x: e.clientX, y: e.clientY }); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const finger = fingers.get(e.pointerId);
    if (!finger) {
      const box = canvas.getBoundingClientRect(), over = figure.querySelector("output[name=over]");
      over.textContent = pick(e.clientX - box.left, e.clientY - box.top);
      return;
    }
    const [right, down] = [e.clientX - finger.x, e.clientY - finger.y], before = fingers.size === 2 ? apart() : 0;
    finger.x = e.clientX; finger.y = e.clientY;
    if (before) magnify(apart() / before);
    else if (e.shiftKey) { const one = 2 / Math.min(canvas.clientWidth, canvas.clientHeight); move = [move[0] + right * one, move[1] - down * one]; draw(); }
    else rotate(right * 0.01, down * 0.01);
  });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); magnify(Math.exp(-e.deltaY * 0.0015)); }, { passive: false });
  canvas.addEventListener("dblclick", home);
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
    const factor = { "+": 1.15, "-": 1 / 1.15 }[e.key];
    if (step) rotate(...step); else if (factor) magnify(factor); else return;
    e.preventDefault();
  });
  if (stretch) stretch.addEventListener("input", pose);
  if (spanned) spanned.addEventListener("change", pose);
  for (const choice of [meshed, named]) if (choice) choice.addEventListener("change", draw);
  control("reset").addEventListener("click", home);
  new ResizeObserver(draw).observe(canvas);
  home(); pose();
}

for (const figure of document.querySelectorAll("figure.part")) show(figure);
