// The charts of a page: drawn when they come into view, in the colours of the scheme, with buttons for keyboard and mouse.
"use strict";
const INK = { light: "#222222", dark: "#e8e8e8" }, GRID = { light: "#e4e4e4", dark: "#3a3f44" };
const PAPER = 0.68, PAPER_WITH_WORDS = 0.9; // height of a chart on paper over that on a screen
const MOST_POINTS = 3000; // of a line that is drawn; of more, the least and the largest of each stretch
const dark = matchMedia("(prefers-color-scheme: dark)");
const scheme = () => (dark.matches ? "dark" : "light");

async function unpack(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

// ---- numbers ----

function decode(values) {
  if (!values || values.bdata === undefined) return values;
  const bytes = Uint8Array.from(atob(values.bdata), (c) => c.charCodeAt(0));
  if (values.dtype === "u2") return Float64Array.from(new Uint16Array(bytes.buffer), (code) => values.low + code * values.step);
  const numbers = new Float32Array(bytes.buffer);
  if (!values.shape) return numbers;
  const [rows, columns] = values.shape.split(",").map(Number);
  return Array.from({ length: rows }, (_, k) => numbers.subarray(k * columns, (k + 1) * columns));
}

function rises(x) {
  for (let k = 1; k < x.length; k++) if (!(x[k] > x[k - 1])) return false;
  return true;
}

// the part of a long line between two ends as pairs of its least and largest values, so that no peak is lost
function thin(x, y, low, high) {
  let first = 0, last = x.length;
  while (first < last && x[first] < low) first++;
  while (last > first && x[last - 1] > high) last--;
  first = Math.max(0, first - 1), last = Math.min(x.length, last + 1);
  const n = last - first, step = Math.ceil((2 * n) / MOST_POINTS);
  if (step < 2) return { x: x.slice(first, last), y: y.slice(first, last) };
  const xs = [], ys = [];
  for (let k = first; k < last; k += step) {
    let least = k, most = k;
    for (let j = k; j < Math.min(k + step, last); j++) {
      if (y[j] < y[least]) least = j;
      if (y[j] > y[most]) most = j;
    }
    for (const j of [Math.min(least, most), Math.max(least, most)]) xs.push(x[j]), ys.push(y[j]);
  }
  return { x: xs, y: ys };
}

// ---- dates ----

const DAY = 864e5; // ms

// days since 1970, as the figures have them, to the ms of Plotly
function toDates(chart) {
  for (const [key, axis] of Object.entries(chart.layout)) {
    if (!axis || !axis.days) continue;
    const name = key.replace("axis", ""), own = (each) => each === name || each === `${name} domain`;
    axis.type = "date", axis.range = axis.range.map((end) => end * DAY);
    for (const trace of chart.data) if (trace.xaxis === name) trace.x = Float64Array.from(trace.x, (each) => each * DAY);
    for (const shape of chart.layout.shapes || []) if (shape.xref === name) shape.x0 *= DAY, shape.x1 *= DAY;
    for (const note of chart.layout.annotations || []) if (note.xref === name) note.x *= DAY;
  }
}

// the end of an axis as a number: Plotly writes those of dates as texts
const numberOf = (end) => (typeof end === "string" ? Date.parse(`${end.replace(" ", "T")}${end.includes(" ") ? "Z" : ""}`) : end);

// ---- colours ----

function recolor(value) {
  if (scheme() === "light" || typeof value !== "string") return value;
  const rgb = /^#(..)(..)(..)$/.exec(value);
  if (!rgb) return value === "white" ? "#16191d" : value;
  const [r, g, b] = rgb.slice(1).map((each) => parseInt(each, 16));
  if (Math.max(r, g, b) - Math.min(r, g, b) > 24) return value; // a colour, not a grey
  const level = 255 - (r + g + b) / 3;
  const gray = Math.round(22 + (level / 255) * 210);
  return `rgb(${gray},${gray},${gray})`;
}

function recolored(node) {
  if (Array.isArray(node)) return node.length > 60 ? node : node.map(recolored);
  if (node === null || typeof node !== "object" || ArrayBuffer.isView(node)) return recolor(node);
  if (node.keep) return node;
  return Object.fromEntries(Object.entries(node).map(([key, value]) =>
    [key, ["x", "y", "z", "text", "ticktext", "label", "name", "meta", "hovertemplate", "colorscale", "facecolor", "customdata", "rows"].includes(key) ? value : recolored(value)]));
}

// ---- texts and the room for them ----

const LETTER = 6.2; // px, of a text of 11 or 12 px in the mean
const lengthOf = (html) => Math.max(...html.split("<br>").map((line) => line.replace(/<[^>]*>/g, "").replace(/&#?\w+;/g, "x").length), 0);

// a text in lines of at most so many letters, with its colour and weight around all of them
function broken(html, most) {
  const [, head, words, tail] = /^((?:<(?!br)[^>]*>)*)(.*?)((?:<\/[^>]*>)*)$/s.exec(html);
  const lines = words.split("<br>").flatMap((line) => {
    const parts = [[]];
    for (const word of line.split(" ")) {
      if (lengthOf([...parts.at(-1), word].join(" ")) > most && parts.at(-1).length) parts.push([]);
      parts.at(-1).push(word);
    }
    return parts.map((part) => part.join(" "));
  });
  return head + lines.join("<br>") + tail;
}

const isTitle = (note) => /^<b>/.test(note.text) && note.yanchor === "bottom" && / domain$/.test(note.yref);

// the texts of a chart in lines that its panels have room for, and numbers at logarithmic axes that do not touch
function fitTexts(layout, width) {
  const isNarrow = width < 560, notes = layout.annotations || [];
  const roomOf = (key) => (layout[key].domain[1] - layout[key].domain[0]) * (width - 78);
  for (const key of Object.keys(layout).filter((each) => /^[xy]axis/.test(each))) {
    const axis = layout[key], isAcross = key[0] === "x";
    if (isNarrow && axis.ticktext && !isAcross) axis.ticktext = axis.ticktext.map((text) => broken(text, 24));
    const names = axis.ticktext && !isAcross ? LETTER * Math.max(...axis.ticktext.map(lengthOf)) : 0;
    axis.left = Math.max(0, names - 50); // px that the names beside a panel take from it
    if (names) {
      const part = axis.domain[1] - axis.domain[0], needed = axis.ticktext.length * (4 + 13 * Math.max(...axis.ticktext.map((text) => text.split("<br>").length)));
      layout.height = Math.max(layout.height, needed / part + layout.margin.t + layout.margin.b);
    }
  }
  const leftOf = (key) => layout[key.replace("x", "y")].left || 0;
  for (const key of Object.keys(layout).filter((each) => /^xaxis/.test(each))) {
    const axis = layout[key], room = roomOf(key) - leftOf(key);
    axis.title.text = broken(axis.title.text, Math.max(12, room / LETTER));
    if (axis.dtick === "D2" && room / (axis.range[1] - axis.range[0]) < 105) axis.dtick = 1;
  }
  for (const note of notes.filter(isTitle)) note.text = broken(note.text, Math.max(12, roomOf(note.xref.replace(/x(\d*) domain/, "xaxis$1")) / 7.5));
  // a number beside a point needs room within its panel
  for (const note of notes.filter((each) => each.xanchor === "left" && /^x\d*$/.test(each.xref))) {
    const key = note.xref.replace("x", "xaxis"), axis = layout[key], [low, high] = axis.range, room = roomOf(key) - leftOf(key);
    const free = room - note.xshift - LETTER * lengthOf(note.text) - 6;
    const place = ((note.x - low) / (high - low)) * room;
    if (high > low && place <= room && place > free && free > 40) axis.range = [low, low + ((note.x - low) * room) / free];
  }
  for (const key of Object.keys(layout)) if (/^[xy]axis/.test(key)) delete layout[key].left;
  const heights = notes.filter(isTitle).map((note) => 12 + note.yshift + 18 * note.text.split("<br>").length);
  const more = Math.max(34, ...heights) - layout.margin.t;
  layout.margin.t += more, layout.height += more;
}

function layoutOf(chart, width) {
  const axis = { gridcolor: GRID[scheme()], zeroline: false, linecolor: "#888", showline: true, ticks: "outside", automargin: true,
    exponentformat: "power", minexponent: 5, title: { font: { size: width < 560 ? 11 : 13 }, standoff: 8 } };
  const layout = recolored(chart.layout);
  for (const key of Object.keys(layout))
    if (/^[xy]axis/.test(key)) {
      layout[key] = { ...axis, ...layout[key], title: { ...axis.title, ...layout[key].title } };
      // the powers of ten at an axis are smaller than its numbers, and must not be too small
      const hasPowers = Math.max(...layout[key].range.map(Math.abs)) >= 1e6 && layout[key].type === "linear";
      layout[key].tickfont = { size: hasPowers ? 14.5 : width < 560 && layout[key].type !== "log" ? 10 : 12 };
    }
  return { ...layout, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest", autosize: true,
    margin: { l: 62, r: 16, t: 34, b: 52 }, font: { family: "system-ui, sans-serif", size: 12.5, color: INK[scheme()] },
    hoverlabel: { namelength: -1 }, dragmode: chart.layout.scene ? "orbit" : "zoom" };
}

// a surface in the whole box, seen from farther where that is narrow, so that the words at its axes are within it
function turnable(layout, width) {
  const { eye } = layout.scene.camera, farther = width < 560 ? 1.25 : 1;
  const camera = { ...layout.scene.camera, eye: { x: farther * eye.x, y: farther * eye.y, z: farther * eye.z } };
  return { ...layout, margin: { l: 0, r: 0, t: 0, b: 0 }, scene: { ...layout.scene, camera } };
}

// panels beside each other one below the other, where the page is narrow
function stack(layout) {
  const keys = Object.keys(layout).filter((key) => /^xaxis/.test(key)), columns = new Set(keys.map((key) => layout[key].domain[0]));
  if (columns.size < 2) return;
  const yOf = (key) => key.replace("x", "y"), order = (key) => -layout[yOf(key)].domain[1] * 100 + layout[key].domain[0];
  const heightOf = (key) => Math.max((layout[yOf(key)].domain[1] - layout[yOf(key)].domain[0]) * layout.height, 150);
  // between two panels are the names of an axis and a title; no such gap stands below the last panel
  const gap = 80, total = keys.reduce((sum, key) => sum + heightOf(key) + gap, -gap);
  let top = 1;
  for (const key of keys.sort((a, b) => order(a) - order(b))) {
    const height = heightOf(key) / total;
    layout[key].domain = [0, 1], layout[yOf(key)].domain = [Math.max(0, top - height), top];
    for (const axis of [layout[key], layout[yOf(key)]]) axis.showticklabels = true, axis.title.text ||= axis.label;
    top -= height + gap / total;
  }
  layout.height = total + layout.margin.t + layout.margin.b;
}

// a chart on paper is lower, much lower if no words stand between its rows of panels
function lower(layout) {
  const bottoms = Object.keys(layout).filter((key) => /^yaxis/.test(key)).map((key) => layout[key].domain[0]);
  const inner = Object.keys(layout).filter((key) => /^xaxis/.test(key) && layout[key.replace("x", "y")].domain[0] > Math.min(...bottoms) + 0.01);
  const factor = inner.every((key) => !layout[key].title.text) ? PAPER : PAPER_WITH_WORDS;
  layout.height = Math.max(factor * layout.height, Math.min(layout.height, 220));
  const room = layout.height - layout.margin.t - layout.margin.b;
  for (const key of Object.keys(layout).filter((each) => /^yaxis/.test(each))) {
    const [low, high] = layout[key].domain;
    layout[key].title.text = broken(layout[key].title.text, Math.max(12, ((high - low) * room) / LETTER));
  }
}

// ---- one chart ----

class Chart {
  constructor(box, chart) {
    this.box = box, this.chart = chart;
    // curves that a reader chooses in a table are off at first
    this.off = new Set(box.dataset.chosen === undefined ? [] : chart.data.map((trace) => trace.meta));
    for (const trace of chart.data) for (const key of ["x", "y", "z", "customdata"]) if (trace[key]) trace[key] = decode(trace[key]);
    for (const trace of chart.data)
      if (trace.dx !== undefined) {
        trace.x = Float64Array.from(trace.y, (_, k) => trace.x0 + k * trace.dx);
        delete trace.x0, delete trace.dx;
      }
    // rows with names: those of a map of struts
    for (const trace of chart.data) if (trace.rows) trace.text = trace.z.map((row, j) => Array.from(row, () => trace.rows[j]));
    toDates(chart);
    this.full = chart.data.map((trace) =>
      trace.type === "scatter" && /lines/.test(trace.mode) && trace.x.length > MOST_POINTS && rises(trace.x) ? { x: trace.x, y: trace.y } : null);
    this.plot = document.createElement("div");
    this.plot.className = "plot";
    box.append(this.legend(), this.plot, this.tools());
  }
  data() {
    return this.chart.data.map((trace, k) => ({ ...recolored(trace), ...(this.full[k] ? thin(this.full[k].x, this.full[k].y, ...this.ends(trace.xaxis)) : {}),
      visible: !this.off.has(trace.meta) }));
  }
  ends(name) {
    const key = (name || "x").replace("x", "xaxis"), axis = (this.plot.layout || this.chart.layout)[key] || {};
    const ends = (axis.range || [-Infinity, Infinity]).map((end) => (axis.type === "log" ? 10 ** end : numberOf(end)));
    return [Math.min(...ends), Math.max(...ends)];
  }
  layout() {
    const width = this.box.clientWidth, layout = layoutOf(this.chart, width);
    const isPaper = document.body.classList.contains("paper");
    if (layout.scene) return { ...turnable(layout, width), height: layout.height * (isPaper ? PAPER : 1) };
    if (width < 560) stack(layout);
    fitTexts(layout, width);
    if (isPaper) lower(layout);
    layout.shapes = (layout.shapes || []).filter((shape) => !this.off.has(shape.name));
    return layout;
  }
  // whether half of a sheet of paper is wide enough: for one panel without names beside it
  isSmall() {
    const axes = Object.entries(this.chart.layout).filter(([key]) => /^[xy]axis/.test(key));
    return axes.length <= 2 && !axes.some(([key, axis]) => key[0] === "y" && axis.ticktext);
  }
  async draw() {
    const config = { responsive: true, displayModeBar: false, scrollZoom: false };
    const first = !this.plot.layout, layout = first ? this.layout() : this.kept();
    this.plot.style.height = `${layout.height}px`;
    await Plotly.react(this.plot, this.data(), layout, config);
    if (first) {
      this.start = JSON.parse(JSON.stringify(this.axes()));
      this.plot.on("plotly_relayout", () => this.refine());
      this.plot.on("plotly_click", ({ points: [{ data }] }) => data.link && open(data.link, "_blank", "noopener"));
    }
    this.box.dataset.drawn = "yes";
  }
  axes() {
    return Object.fromEntries(Object.keys(this.plot.layout).filter((key) => /^[xy]axis/.test(key)).map((key) => [`${key}.range`, this.plot.layout[key].range.slice()]));
  }
  kept() { // a new layout, zoomed as the old one
    const layout = this.layout();
    for (const key of Object.keys(layout)) if (/^[xy]axis/.test(key)) layout[key].range = this.plot.layout[key].range;
    if (layout.scene) layout.scene.camera = this.plot.layout.scene.camera;
    return layout;
  }
  refine() {
    const long = this.full.map((each, k) => (each ? k : -1)).filter((k) => k >= 0);
    if (!long.length) return;
    const parts = long.map((k) => thin(this.full[k].x, this.full[k].y, ...this.ends(this.chart.data[k].xaxis)));
    Plotly.restyle(this.plot, { x: parts.map((part) => part.x), y: parts.map((part) => part.y) }, long);
  }
  zoom(factor) {
    const ranges = Object.entries(this.axes()).map(([key, ends]) => {
      const [low, high] = ends.map(numberOf);
      const middle = (low + high) / 2, half = ((high - low) / 2) * factor;
      return [key, [middle - half, middle + half]];
    });
    if (this.chart.layout.scene) {
      const eye = this.plot.layout.scene.camera.eye;
      return Plotly.relayout(this.plot, { "scene.camera.eye": { x: eye.x * factor, y: eye.y * factor, z: eye.z * factor } });
    }
    return Plotly.relayout(this.plot, Object.fromEntries(ranges));
  }
  reset() {
    if (this.chart.layout.scene) return Plotly.relayout(this.plot, { "scene.camera": this.chart.layout.scene.camera });
    return Plotly.relayout(this.plot, structuredClone(this.start));
  }
  choose(curve, on) {
    on ? this.off.delete(curve) : this.off.add(curve);
    for (const each of this.box.querySelectorAll(".legend button"))
      if (each.textContent === curve) each.hidden = !on, each.setAttribute("aria-pressed", String(on));
    return this.draw();
  }
  legend() {
    const list = document.createElement("div");
    list.className = "legend";
    for (const entry of this.chart.legend) {
      const button = document.createElement("button");
      button.type = "button", button.dir = "auto"; // a name may be written from right to left
      button.append(...entry.looks.map(swatch), entry.text);
      const same = this.chart.data.some((trace) => trace.meta === entry.text) || (this.chart.layout.shapes || []).some((shape) => shape.name === entry.text);
      button.disabled = !same;
      button.hidden = this.off.has(entry.text);
      button.setAttribute("aria-pressed", String(!this.off.has(entry.text)));
      button.addEventListener("click", () => {
        this.off.has(entry.text) ? this.off.delete(entry.text) : this.off.add(entry.text);
        for (const each of list.children) if (each.textContent === entry.text) each.setAttribute("aria-pressed", String(!this.off.has(entry.text)));
        this.draw();
      });
      list.append(button);
    }
    return list;
  }
  tools() {
    const bar = document.createElement("div");
    bar.className = "tools";
    const name = this.box.dataset.chart, actions = { "Zoom in": () => this.zoom(0.5), "Zoom out": () => this.zoom(2), "Reset": () => this.reset(),
      "PNG": () => Plotly.downloadImage(this.plot, { format: "png", filename: name, width: 1000, height: this.chart.layout.height, scale: 2 }),
      "CSV": () => save(`${name}.csv`, csv(this.chart)) };
    for (const [label, action] of Object.entries(actions)) {
      const button = document.createElement("button");
      button.type = "button", button.textContent = label;
      button.addEventListener("click", action);
      bar.append(button);
    }
    return bar;
  }
}

function swatch(entry) {
  const sign = document.createElement("span");
  sign.className = "swatch", sign.setAttribute("aria-hidden", "true");
  sign.style.color = recolor(entry.color);
  if (entry.symbol === "patch") sign.style.background = recolor(entry.color), sign.style.height = ".8em";
  else if (entry.dash) sign.style.borderTop = `2px ${entry.dash === "solid" ? "solid" : entry.dash === "dot" ? "dotted" : "dashed"}`;
  const open = /-open/.test(entry.symbol || ""), signs = { circle: "●○", square: "■□", diamond: "◆◇", "diamond-tall": "♦◊", star: "★☆",
    "triangle-up": "▲△", "triangle-down": "▼▽", "triangle-left": "◀◁", "triangle-right": "▶▷", "x-thin": "××", x: "××", "cross-thin": "++", cross: "++" };
  const pair = signs[(entry.symbol || "").replace("-open", "")];
  if (pair && !entry.dash) sign.textContent = pair[open ? 1 : 0], sign.classList.add("sign");
  return sign;
}

function csv(chart) {
  // a spreadsheet takes a text that begins so for a formula, and whoever opens a page need not know who named its runs
  const harmless = (text) => (/^[=+\-@\t\r]/.test(text) ? `'${text}` : text);
  const quoted = (text) => `"${harmless(String(text)).replaceAll('"', '""')}"`;
  const plain = (html) => new DOMParser().parseFromString((html || "").replace(/<[^>]*>/g, " "), "text/html").body.textContent;
  const axis = (trace, letter) => plain((chart.layout[(trace[`${letter}axis`] || letter).replace(letter, `${letter}axis`)] || {}).label);
  const abscissa = (trace, x) => ((chart.layout[(trace.xaxis || "x").replace("x", "xaxis")] || {}).days ? new Date(x).toISOString().slice(0, 10) : x);
  const hasCells = chart.data.some((trace) => trace.type === "heatmap");
  const rows = [["curve", "x is", "y is", "x", "y", ...(hasCells ? ["value"] : [])].map(quoted).join(",")];
  for (const trace of chart.data) {
    if (trace.type === "heatmap" || trace.type === "mesh3d") continue;
    for (let k = 0; k < trace.x.length; k++)
      if (Number.isFinite(trace.x[k]) && Number.isFinite(trace.y[k]))
        rows.push([quoted(plain(trace.name)), quoted(axis(trace, "x")), quoted(axis(trace, "y")), abscissa(trace, trace.x[k]), trace.y[k]].join(","));
  }
  for (const trace of chart.data.filter((each) => each.type === "heatmap"))
    trace.z.forEach((row, j) => row.forEach((value, k) => Number.isFinite(value) &&
      rows.push([quoted(plain(trace.name) || "cell"), quoted(axis(trace, "x")), quoted(axis(trace, "y")), abscissa(trace, (trace.x[k] + trace.x[k + 1]) / 2), trace.rows ? quoted(plain(trace.rows[j])) : (trace.y[j] + trace.y[j + 1]) / 2, (trace.customdata ? trace.customdata[j][k] : value)].join(","))));
  return rows.join("\r\n") + "\r\n";
}

function save(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" })), link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

// ---- the page ----

(async () => {
  const boxes = [...document.querySelectorAll("[data-chart]")];
  if (!boxes.length) return;
  const script = document.createElement("script");
  script.textContent = await unpack("plotly");
  document.head.append(script);
  const charts = new Map();
  const make = (box) => {
    if (!charts.has(box)) charts.set(box, new Chart(box, JSON.parse(box.querySelector("script").textContent)));
    return charts.get(box);
  };
  const show = (box) => make(box).draw();
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) if (isIntersecting) watcher.unobserve(target), show(target);
  }, { rootMargin: "400px" });
  boxes.forEach((box) => watcher.observe(box));
  dark.addEventListener("change", () => charts.forEach((chart) => chart.draw()));
  document.addEventListener("choose", async ({ detail }) => {
    const box = boxes.find((each) => each.dataset.chart === detail.chart);
    await show(box);
    charts.get(box).choose(detail.curve, detail.on);
  });
  const unfolded = [], halves = [];
  addEventListener("beforeprint", () => {
    for (const each of document.querySelectorAll("details.fold:not([open])")) each.open = true, unfolded.push(each);
    document.body.classList.add("paper");
    boxes.forEach(make);
    for (let k = 0; k < boxes.length - 1; k++) {
      const pair = [boxes[k], boxes[k + 1]].map((box) => box.closest("section"));
      if (pair[0].nextElementSibling !== pair[1] || !charts.get(boxes[k]).isSmall() || !charts.get(boxes[k + 1]).isSmall()) continue;
      for (const each of pair) each.classList.add("half"), halves.push(each);
      k++;
    }
    boxes.forEach(show);
  });
  addEventListener("afterprint", () => {
    document.body.classList.remove("paper");
    for (const each of halves.splice(0)) each.classList.remove("half");
    boxes.forEach(show);
    for (const each of unfolded.splice(0)) each.open = false;
  });
})();
