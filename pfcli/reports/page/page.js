"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const make = (name, attributes = {}, ...children) => {
  const node = name.includes(":") ? document.createElementNS("http://www.w3.org/2000/svg", name.slice(4)) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
};
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const decode = (text, kind) => {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new kind(bytes.buffer);
};
const nearest = (sorted, value) => {
  let low = 0, high = sorted.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < value) low = middle + 1; else high = middle;
  }
  return low > 0 && value - sorted[low - 1] < sorted[low] - value ? low - 1 : low;
};
const tidy = (value) => value === null || Number.isNaN(value) ? "–"
  : Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(2) : String(Math.round(value * 1e4) / 1e4);
const clock = (seconds) => `${seconds.toFixed(1)} s`;

/* --- theme ------------------------------------------------------------------------------------------------- */
const dark = matchMedia("(prefers-color-scheme: dark)");
const theme = (wanted) => { document.documentElement.dataset.theme = wanted; draw(); };
$("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
dark.addEventListener("change", () => theme(dark.matches ? "dark" : "light"));

/* --- summary and details ----------------------------------------------------------------------------------- */
const list = make("dl");
for (const [label, value] of data.summary) list.append(make("div", {}, make("dt", {}, label), make("dd", {}, value)));
$("summary").append(list);
for (const note of data.notes) $("summary").append(make("p", {class: "note"}, note));
const table = (title, rows) => {
  const body = make("table", {}, ...rows.map((row) => make("tr", {}, make("th", {scope: "row"}, row[0]), ...row.slice(1).map((cell) => make("td", {}, cell)))));
  return make("div", {}, make("h2", {}, title), body);
};
const columns = make("div", {class: "columns"});
for (const [title, rows] of data.tables) if (rows.length) columns.append(table(title, rows));
$("details").append(make("h2", {}, "Command"), make("p", {}, make("code", {}, data.command)), columns);

/* --- map --------------------------------------------------------------------------------------------------- */
const canvas = $("map"), context = canvas.getContext("2d");
const shown = {};
const frames = data.frames;
for (const key of ["x", "y", "sx", "sy"]) frames[key] = decode(frames[key], Int16Array);
frames.kind = decode(frames.kind, Uint8Array);
const image = (text) => { const found = new Image(); found.addEventListener("load", draw); found.src = text; return found; };
const layers = data.layers.map((layer) => ({...layer, image: image(layer.png), tinted: null}));
let view = null, at = 0;

/* Map images hold classes as grey values: 0 occupied, 1 free, 2 unknown; they are painted in the theme's colours. */
const painted = (layer) => {
  const key = document.documentElement.dataset.theme;
  if (layer.tinted && layer.key === key) return layer.tinted;
  if (!layer.image.complete || !layer.image.naturalWidth) return null;
  const sheet = make("canvas", {width: layer.image.naturalWidth, height: layer.image.naturalHeight}), pen = sheet.getContext("2d");
  pen.drawImage(layer.image, 0, 0);
  const pixels = pen.getImageData(0, 0, sheet.width, sheet.height), values = pixels.data;
  const rgb = (name) => { const c = colour(name); return [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16)); };
  const classes = layer.overlay ? [[...rgb("--obstacle"), 255], [0, 0, 0, 0], [0, 0, 0, 0]]
    : [[...rgb("--wall"), 255], [...rgb("--free"), 255], [...rgb("--unknown"), 255]];
  for (let k = 0; k < values.length; k += 4) {
    const [r, g, b, a] = classes[values[k] < 64 ? 0 : values[k] < 192 ? 1 : 2];
    values[k] = r; values[k + 1] = g; values[k + 2] = b; values[k + 3] = a;
  }
  pen.putImageData(pixels, 0, 0);
  layer.tinted = sheet; layer.key = key;
  return sheet;
};
const whole = () => {
  const [x0, y0, x1, y1] = data.bounds, w = canvas.clientWidth, h = canvas.clientHeight;
  const scale = 0.94 * Math.min(w / Math.max(x1 - x0, 1e-3), h / Math.max(y1 - y0, 1e-3));
  view = {scale, x: (x0 + x1) / 2, y: (y0 + y1) / 2};
};
const px = (x, y) => [canvas.clientWidth / 2 + (x - view.x) * view.scale, canvas.clientHeight / 2 - (y - view.y) * view.scale];
const metres = (u, v) => [view.x + (u - canvas.clientWidth / 2) / view.scale, view.y - (v - canvas.clientHeight / 2) / view.scale];
const zoom = (factor, u = canvas.clientWidth / 2, v = canvas.clientHeight / 2) => {
  const [x, y] = metres(u, v);
  view.scale = Math.min(Math.max(view.scale * factor, 0.01), 1e5);
  view.x = x - (u - canvas.clientWidth / 2) / view.scale;
  view.y = y + (v - canvas.clientHeight / 2) / view.scale;
  draw();
};
const line = (xs, ys, name, width, dash = []) => {
  context.beginPath(); context.strokeStyle = colour(name); context.lineWidth = width; context.setLineDash(dash);
  let open = false;
  for (let k = 0; k < xs.length; k++) {
    if (xs[k] === null) { open = false; continue; }
    const [u, v] = px(xs[k], ys[k]);
    if (open) context.lineTo(u, v); else context.moveTo(u, v);
    open = true;
  }
  context.stroke(); context.setLineDash([]);
};
const KINDS = ["--s0", "--s2", "--s3", "--s4", "--s5", "--s6", "--s1", "--s7"];
function draw() {
  if (!view) return;
  const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, w, h);
  for (const layer of layers) {
    if (!shown[layer.name]) continue;
    const sheet = painted(layer);
    if (!sheet) continue;
    context.save();
    const [u, v] = px(layer.x, layer.y);
    context.translate(u, v); context.rotate(-layer.yaw); context.imageSmoothingEnabled = view.scale * layer.cell < 1;
    context.drawImage(sheet, 0, -sheet.height * layer.cell * view.scale, sheet.width * layer.cell * view.scale, sheet.height * layer.cell * view.scale);
    context.restore();
  }
  if (shown.truth) line(data.truth.x, data.truth.y, "--truth", 1.6, [5, 3]);
  if (shown.track) line(data.track.x, data.track.y, "--accent", 1.5);
  if (shown.landmarks) {
    context.strokeStyle = colour("--ink"); context.lineWidth = 1;
    for (const [x, y, a, b, angle] of data.landmarks) {
      const [u, v] = px(x, y);
      context.beginPath(); context.ellipse(u, v, Math.max(2, a * view.scale), Math.max(2, b * view.scale), -angle, 0, 7); context.stroke();
    }
  }
  moment();
}
function moment() {
  if (!frames.t.length) return;
  const [p0, p1] = [frames.first[at], frames.first[at + 1]], [s0, s1] = [frames.scan[at], frames.scan[at + 1]];
  const [x, y, yaw] = frames.pose[at], unit = frames.unit, [ox, oy] = frames.origin;
  if (shown.particles) for (let k = p0; k < p1; k++) {
    const [u, v] = px(ox + frames.x[k] * unit, oy + frames.y[k] * unit);
    context.fillStyle = colour(KINDS[frames.kind[k] % KINDS.length]); context.fillRect(u - 1.5, v - 1.5, 3, 3);
  }
  if (x === null) return;
  const c = Math.cos(yaw), s = Math.sin(yaw);
  if (shown.scan) {
    context.fillStyle = colour("--scan");
    for (let k = s0; k < s1; k++) {
      const a = frames.sx[k] * 0.01, b = frames.sy[k] * 0.01, [u, v] = px(x + c * a - s * b, y + s * a + c * b);
      context.fillRect(u - 1, v - 1, 2, 2);
    }
  }
  const [u, v] = px(x, y), size = Math.max(7, 0.25 * view.scale);
  context.beginPath(); context.fillStyle = colour("--robot");
  context.moveTo(u + size * 1.5 * c, v - size * 1.5 * s);
  context.lineTo(u + size * Math.cos(yaw + 2.4), v - size * Math.sin(yaw + 2.4));
  context.lineTo(u + size * Math.cos(yaw - 2.4), v - size * Math.sin(yaw - 2.4));
  context.closePath(); context.fill();
}
const legend = [
  ...layers.map((layer) => [layer.name, layer.overlay ? "--obstacle" : "--wall"]), ["track", "--accent"],
  ...(data.truth ? [["truth", "--truth"]] : []), ...(data.landmarks.length ? [["landmarks", "--ink"]] : []),
  ...(frames.t.length ? [["particles", "--s0"]] : []), ...(frames.sx.length ? [["scan", "--scan"]] : []),
];
for (const [name, swatch] of legend) {
  shown[name] = true;
  const box = make("input", {type: "checkbox", checked: ""});
  box.addEventListener("change", () => { shown[name] = box.checked; draw(); });
  const patch = make("span", {class: "swatch", style: `background: var(${swatch})`});
  $("legend").append(make("label", {}, box, patch, name.replaceAll("_", " ")));
}
data.kinds.forEach((name, k) => { if (name) $("legend").append(make("label", {}, make("span", {class: "swatch", style: `background: var(${KINDS[k]})`}), name)); });

const fingers = new Map();
canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, event); });
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) { tell(event); return; }
  if (fingers.size === 2) {
    const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
    const reach = (finger) => Math.hypot(finger.offsetX - other.offsetX, finger.offsetY - other.offsetY);
    zoom(reach(event) / Math.max(reach(before), 1), (event.offsetX + other.offsetX) / 2, (event.offsetY + other.offsetY) / 2);
  } else {
    view.x -= (event.offsetX - before.offsetX) / view.scale; view.y += (event.offsetY - before.offsetY) / view.scale; draw();
  }
  fingers.set(event.pointerId, event);
});
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(-event.deltaY * 0.002), event.offsetX, event.offsetY); }, {passive: false});
canvas.addEventListener("dblclick", (event) => zoom(2, event.offsetX, event.offsetY));
canvas.addEventListener("pointerleave", () => { $("hover").hidden = true; });
canvas.addEventListener("keydown", (event) => {
  const step = 60 / view.scale, moves = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step]};
  if (moves[event.key]) { view.x += moves[event.key][0]; view.y += moves[event.key][1]; draw(); }
  else if (event.key === "+" || event.key === "=") zoom(1.5);
  else if (event.key === "-") zoom(1 / 1.5);
  else if (event.key === "0") { whole(); draw(); }
  else return;
  event.preventDefault();
});
function tell(event) {
  const [x, y] = metres(event.offsetX, event.offsetY), {track} = data;
  let best = -1, least = (12 / view.scale) ** 2;
  for (let k = 0; k < track.t.length; k++) {
    if (track.x[k] === null) continue;
    const far = (track.x[k] - x) ** 2 + (track.y[k] - y) ** 2;
    if (far < least) { least = far; best = k; }
  }
  const lines = [`${x.toFixed(2)}, ${y.toFixed(2)} m`];
  if (best >= 0) {
    lines.push(`at ${clock(track.t[best])}: ${track.x[best].toFixed(3)}, ${track.y[best].toFixed(3)} m, ${(track.yaw[best] * 180 / Math.PI).toFixed(1)}°`);
    if (data.truth) lines.push(`error ${tidy(track.error[best])} m`);
  }
  const box = $("hover");
  box.textContent = lines.join("\n"); box.hidden = false;
  box.style.left = `${Math.min(event.offsetX + 14, canvas.clientWidth - box.offsetWidth - 4)}px`;
  box.style.top = `${Math.max(4, event.offsetY - box.offsetHeight - 8)}px`;
}
for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => zoom(Number(button.dataset.zoom)));
$("whole").addEventListener("click", () => { whole(); draw(); });

/* --- charts ------------------------------------------------------------------------------------------------ */
const H = 118, LEFT = 46, RIGHT = 8, TOP = 8, BOTTOM = 16;
let W = 560, cursors = [];
const span = Math.max(data.span, 1e-9);
const u = (t) => LEFT + (W - LEFT - RIGHT) * t / span;
const ticks = (low, high) => {
  const raw = (high - low) / 3, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9 * step; value += step) found.push(value);
  return found;
};
function plot(chart) {
  const finite = chart.series.flatMap((row) => row.values.filter((value) => value !== null));
  let low = chart.low ?? Math.min(...finite), high = chart.high ?? Math.max(...finite);
  if (chart.kind === "stack") { low = 0; high = 1; }
  if (!(high > low)) { low -= 0.5; high = low + 1; }
  const v = (value) => TOP + (H - TOP - BOTTOM) * (1 - (Math.min(Math.max(value, low), high) - low) / (high - low));
  const svg = make("svg:svg", {viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${chart.title} over time`});
  for (const value of ticks(low, high)) svg.append(make("svg:line", {class: "grid", x1: LEFT, x2: W - RIGHT, y1: v(value), y2: v(value)}),
    make("svg:text", {x: LEFT - 5, y: v(value) + 3, "text-anchor": "end"}, tidy(value)));
  for (const value of ticks(0, span)) svg.append(make("svg:text", {x: u(value), y: H - 3, "text-anchor": "middle"}, `${tidy(value)} s`));
  let below = chart.t.map(() => 0);
  const named = [];
  chart.series.forEach((row, index) => {
    const paint = `var(--s${index % 8})`;
    if (chart.kind === "stack") {
      const above = row.values.map((value, k) => below[k] + (value ?? 0)), foot = below;
      const path = [...above.map((value, k) => `${u(chart.t[k])},${v(value)}`), ...foot.map((value, k) => `${u(chart.t[k])},${v(value)}`).reverse()];
      svg.append(make("svg:polygon", {points: path.join(" "), fill: paint, opacity: 0.85}));
      below = above;
    } else if (chart.kind === "bars") {
      const path = row.values.map((value, k) => value ? `M${u(chart.t[k])},${v(0)}V${v(value)}` : "").join("");
      svg.append(make("svg:path", {d: path || "M0,0", stroke: paint, fill: "none", "vector-effect": "non-scaling-stroke"}));
    } else {
      let open = false;
      const path = row.values.map((value, k) => {
        if (value === null) { open = false; return ""; }
        const word = `${open ? "L" : "M"}${u(chart.t[k]).toFixed(2)},${v(value).toFixed(2)}`;
        open = true;
        return word;
      }).join("");
      svg.append(make("svg:path", {d: path || "M0,0", stroke: paint, fill: "none", "stroke-width": row.thin ? 0.8 : 1.4,
        "stroke-dasharray": row.thin ? "4 3" : "none", "vector-effect": "non-scaling-stroke"}));
    }
    const value = make("output");
    named.push([row, value]);
  });
  for (const [t, text] of chart.marks) svg.append(make("svg:line", {class: "mark", x1: u(t), x2: u(t), y1: TOP, y2: H - BOTTOM}, make("svg:title", {}, text)));
  const cursor = make("svg:line", {class: "cursor", y1: TOP, y2: H - BOTTOM});
  svg.append(cursor);
  const caption = make("figcaption", {}, make("b", {}, chart.unit ? `${chart.title} [${chart.unit}]` : chart.title),
    ...named.map(([row, value], index) => make("span", {}, make("span", {class: "swatch", style: `background: var(--s${index % 8})`}), ` ${row.name} `, value)));
  cursors.push((t) => {
    cursor.setAttribute("x1", u(t)); cursor.setAttribute("x2", u(t));
    const k = nearest(chart.t, t);
    for (const [row, value] of named) value.textContent = tidy(row.values[k]);
  });
  const seconds = (event) => { const box = svg.getBoundingClientRect(); return Math.min(Math.max(((event.clientX - box.left) / box.width * W - LEFT) / (W - LEFT - RIGHT), 0), 1) * span; };
  svg.addEventListener("pointermove", (event) => { const t = seconds(event); for (const move of cursors) move(t); });
  svg.addEventListener("pointerleave", () => { for (const move of cursors) move(frames.t[at] ?? 0); });
  svg.addEventListener("click", (event) => go(nearest(frames.t, seconds(event))));
  $("charts").append(make("figure", {}, caption, svg));
}
function plots() {
  const style = getComputedStyle($("charts")), wide = $("charts").clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
  if (cursors.length && Math.abs(wide - W) < 1) return;
  W = Math.max(wide, 160); cursors = [];
  $("charts").replaceChildren();
  data.charts.forEach(plot);
  for (const move of cursors) move(frames.t[at] ?? 0);
}

/* --- time -------------------------------------------------------------------------------------------------- */
const slider = $("time");
slider.max = Math.max(0, frames.t.length - 1);
function go(index) {
  at = Math.min(Math.max(index, 0), Math.max(0, frames.t.length - 1));
  slider.value = at;
  const t = frames.t[at] ?? 0, pose = frames.pose[at];
  $("now").textContent = clock(t);
  slider.setAttribute("aria-valuetext", clock(t));
  document.body.dataset.pose = pose && pose[0] !== null ? pose.map((value) => value.toFixed(2)).join(" ") : "";
  for (const move of cursors) move(t);
  draw();
}
slider.addEventListener("input", () => go(Number(slider.value)));
let playing = null;
$("play").addEventListener("click", () => {
  if (playing) { clearInterval(playing); playing = null; $("play").textContent = "▶"; return; }
  $("play").textContent = "❚❚";
  if (at >= frames.t.length - 1) go(0);
  playing = setInterval(() => { if (at >= frames.t.length - 1) $("play").click(); else go(at + 1); }, 80);
});
new ResizeObserver(() => draw()).observe(canvas);
new ResizeObserver(() => plots()).observe($("charts"));
addEventListener("beforeprint", () => theme("light"));
document.documentElement.dataset.theme = dark.matches ? "dark" : "light";
whole();
plots();
go(0);
document.body.dataset.ready = "yes";
