"use strict";
// A part that turns: drag to rotate, wheel or pinch to zoom, with shift to move, arrow keys, double click to go back.

const VERTEX = `#version 300 es
in vec3 position, displacement, normal; in float value;
uniform mat3 turn; uniform vec2 move, shape; uniform float zoom, scale, depth, lift;
out float level; out vec3 facing;
void main() {
  vec3 p = turn * (position + scale * displacement);
  level = value; facing = turn * normal;
  gl_Position = vec4((p.xy * zoom + move) * shape, -p.z * depth - lift, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in float level; in vec3 facing; out vec4 colour;
uniform sampler2D colours; uniform vec2 limits; uniform vec4 line;
void main() {
  vec3 light = normalize(vec3(-0.3, 0.4, 1.0));
  float shade = 0.7 + 0.3 * max(0.0, dot(normalize(facing), light));
  vec3 hue = texture(colours, vec2((level - limits.x) / (limits.y - limits.x), 0.5)).rgb;
  colour = line.a > 0.0 ? line : vec4(hue * shade, 1.0);
}`;

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const product = (a, b) => a.map((_, k) => [0, 1, 2].reduce((sum, j) => sum + a[3 * Math.floor(k / 3) + j] * b[3 * j + (k % 3)], 0));

function rotation(aboutUp, aboutRight) {
  const [c, s, d, t] = [Math.cos(aboutUp), Math.sin(aboutUp), Math.cos(aboutRight), Math.sin(aboutRight)];
  return product([1, 0, 0, 0, d, -t, 0, t, d], [c, 0, s, 0, 1, 0, -s, 0, c]);
}

function normals(positions, displacements, scale, triangles) {
  const p = positions.map((x, k) => x + scale * displacements[k]), sum = new Float32Array(p.length);
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
  const fill = (target, values) => { const b = gl.createBuffer(); gl.bindBuffer(target, b); gl.bufferData(target, values, gl.STATIC_DRAW); return b; };
  const attribute = (name, size, values) => {
    fill(gl.ARRAY_BUFFER, values);
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  };
  const positions = new Float32Array(bytes(data.positions)), displacements = new Float32Array(bytes(data.displacements));
  const triangles = new Uint32Array(bytes(data.triangles)), edges = new Uint32Array(bytes(data.edges));
  attribute("position", 3, positions); attribute("displacement", 3, displacements);
  attribute("value", 1, new Float32Array(bytes(data.values)));
  const faceBuffer = fill(gl.ELEMENT_ARRAY_BUFFER, triangles), edgeBuffer = fill(gl.ELEMENT_ARRAY_BUFFER, edges);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(bytes(data.colours)));
  for (const [key, how] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]])
    gl.texParameteri(gl.TEXTURE_2D, gl["TEXTURE_" + key], gl[how]);
  gl.uniform2fv(at("limits"), data.limits);
  gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

  const slider = figure.querySelector("input[type=range]"), meshed = figure.querySelector("input[type=checkbox]");
  let turn, zoom, move, waiting = false, drawn = 0;
  // Lengths in the picture are half of its shorter side.
  const shape = () => { const wide = canvas.clientWidth / canvas.clientHeight; return [Math.min(1, 1 / wide), Math.min(1, wide)]; };
  const home = () => {
    const reach = [0, 1].map((row) => shape()[row] * positions.reduce((most, _, k) => k % 3 ? most : Math.max(most, Math.abs(
      [0, 1, 2].reduce((sum, j) => sum + data.axes[3 * row + j] * (positions[k + j] + data.scale * displacements[k + j]), 0))), 0));
    turn = data.axes; zoom = 0.9 / Math.max(...reach); move = [0, 0]; draw();
  };
  const deform = () => {
    figure.querySelector("output").textContent = `× ${Number(slider.value)}`;
    attribute("normal", 3, normals(positions, displacements, Number(slider.value), triangles));
    draw();
  };

  function paint() {
    waiting = false;
    const dense = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * dense); canvas.height = Math.round(canvas.clientHeight * dense);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform2fv(at("shape"), shape()); gl.uniform1f(at("depth"), 0.25 / data.radius);
    gl.uniformMatrix3fv(at("turn"), true, turn); gl.uniform2fv(at("move"), move);
    gl.uniform1f(at("zoom"), zoom); gl.uniform1f(at("scale"), Number(slider.value));
    gl.uniform4f(at("line"), 0, 0, 0, 0); gl.uniform1f(at("lift"), 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, faceBuffer);
    gl.drawElements(gl.TRIANGLES, triangles.length, gl.UNSIGNED_INT, 0);
    if (meshed.checked) {
      gl.uniform4f(at("line"), 0.1, 0.1, 0.1, 0.35); gl.uniform1f(at("lift"), 0.0005);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, edgeBuffer);
      gl.drawElements(gl.LINES, edges.length, gl.UNSIGNED_INT, 0);
    }
    canvas.dataset.drawn = ++drawn;
  }
  const draw = () => { if (!waiting) { waiting = true; requestAnimationFrame(paint); } };
  const rotate = (right, down) => { turn = product(rotation(right, down), turn); draw(); };
  const magnify = (factor) => { zoom *= factor; move = move.map((m) => m * factor); draw(); };

  const fingers = new Map();
  const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, { x: e.clientX, y: e.clientY }); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const finger = fingers.get(e.pointerId);
    if (!finger) return;
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
  slider.addEventListener("input", deform); meshed.addEventListener("change", draw);
  figure.querySelector("button").addEventListener("click", home);
  new ResizeObserver(draw).observe(canvas);
  home(); deform();
}

for (const figure of document.querySelectorAll("figure.part")) show(figure);
