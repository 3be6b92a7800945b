"use strict";
const DATA = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const MODES = ["before", "after", "split", "difference", "depth", "instances"];
const state = {episode: 0, draw: 0, frame: 0, mode: "split", split: 0.5, playing: false, turn: 0};
const images = new Map();
let episode = null, shot = null;

function element(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties || {});
  made.append(...children);
  return made;
}
function image(given) {
  const url = typeof given === "number" ? DATA.images[given] : given;
  if (!images.has(url)) {
    if (images.size > 400) images.clear();
    const made = new Image();
    made.src = url;
    images.set(url, made.decode().then(() => made));
  }
  return images.get(url);
}
function place(sheet, index) {
  return [(index % sheet.columns) * sheet.tile[0], Math.floor(index / sheet.columns) * sheet.tile[1]];
}
async function pixels(sheet, index, size) {
  const made = await image(sheet.url), [x, y] = place(sheet, index);
  const canvas = new OffscreenCanvas(size.width, size.height);
  const context = canvas.getContext("2d", {willReadFrequently: true});
  context.drawImage(made, x, y, size.width, size.height, 0, 0, size.width, size.height);
  return {canvas, data: context.getImageData(0, 0, size.width, size.height)};
}
function instances() {
  return [...episode.instances, ...(shot ? shot.added : [])];
}
async function paint(canvas, name) {
  const size = episode.cameras[name], scale = Math.max(1, Math.round(512 / size.width));
  if (!episode.before) return;
  const made = shot && shot.images[name], old = episode.before[name];
  const index = episode.single ? 0 : state.frame, turn = ++canvas.turn;
  canvas.setAttribute("aria-busy", "true");
  const context = canvas.getContext("2d");
  const before = await pixels(old.before, index, size);
  const after = made ? await pixels(made.after, index, size) : before;
  let other = null;
  if (state.mode === "depth" && made && made.depth) other = await pixels(made.depth, index, size);
  if (state.mode === "instances" && made && made.ids) other = await pixels(made.ids, index, size);
  if (turn !== canvas.turn) return;
  canvas.width = size.width * scale;
  canvas.height = size.height * scale;
  context.imageSmoothingEnabled = false;
  const put = (source) => context.drawImage(source.canvas, 0, 0, canvas.width, canvas.height);
  if (state.mode === "before") put(before);
  else if (state.mode === "difference") put(difference(before, after, size));
  else if (state.mode === "depth" && other) put(other);
  else put(after);
  if (state.mode === "split" && made) split(context, canvas, before, size, scale);
  if (state.mode === "instances" && other) outline(context, other.data, size, scale);
  canvas.setAttribute("aria-busy", "false");
}
function difference(before, after, size) {
  const canvas = new OffscreenCanvas(size.width, size.height), context = canvas.getContext("2d");
  const out = context.createImageData(size.width, size.height), a = before.data.data, b = after.data.data;
  for (let i = 0; i < a.length; i += 4) {
    for (let c = 0; c < 3; c++) out.data[i + c] = 128 + (b[i + c] - a[i + c]);
    out.data[i + 3] = 255;
  }
  context.putImageData(out, 0, 0);
  return {canvas};
}
function split(context, canvas, before, size, scale) {
  const width = Math.round(state.split * size.width);
  if (width > 0) context.drawImage(before.canvas, 0, 0, width, size.height, 0, 0, width * scale, canvas.height);
  context.fillStyle = "#fff";
  context.fillRect(width * scale - 1, 0, 2, canvas.height);
}
function outline(context, ids, size, scale) {
  const all = instances(), at = (x, y) => ids.data[4 * (y * size.width + x)], sums = new Map();
  for (let y = 0; y < size.height; y++) for (let x = 0; x < size.width; x++) {
    const id = at(x, y), one = all[id - 1];
    if (!one) continue;
    const sum = sums.get(id) || [0, 0, 0];
    sums.set(id, [sum[0] + x, sum[1] + y, sum[2] + 1]);
    context.fillStyle = `rgb(${one.color})`;
    const edge = Math.max(1, scale / 2);
    if (x + 1 < size.width && at(x + 1, y) !== id) context.fillRect((x + 1) * scale - edge, y * scale, edge, scale);
    if (x > 0 && at(x - 1, y) !== id) context.fillRect(x * scale, y * scale, edge, scale);
    if (y + 1 < size.height && at(x, y + 1) !== id) context.fillRect(x * scale, (y + 1) * scale - edge, scale, edge);
    if (y > 0 && at(x, y - 1) !== id) context.fillRect(x * scale, y * scale, scale, edge);
  }
  context.font = "600 15px system-ui,sans-serif";
  context.textAlign = "center";
  for (const [id, [x, y, count]] of sums) {
    const one = all[id - 1];
    if (!one.name || count < 40) continue;
    const right = x / count * scale, down = y / count * scale, width = context.measureText(one.name).width;
    context.fillStyle = "#141414";
    context.fillRect(right - width / 2 - 3, down - 14, width + 6, 19);
    context.fillStyle = `rgb(${String(one.color).split(",").map((channel) => (Number(channel) + 255) / 2)})`;
    context.fillText(one.name, right, down);
  }
}
function repaint() {
  return Promise.all([...$("views").querySelectorAll("canvas")].map((canvas) => paint(canvas, canvas.dataset.camera)));
}
function count() {
  return DATA.served ? DATA.keys.length : DATA.episodes.length;
}
function button(words, act, label) {
  const made = element("button", {type: "button", textContent: words, onclick: act});
  if (label) made.setAttribute("aria-label", label);
  return made;
}
function bar() {
  const modes = element("div", {className: "group"});
  modes.setAttribute("role", "group");
  modes.setAttribute("aria-label", "what is shown");
  MODES.forEach((mode) => {
    const made = button(mode, () => { state.mode = mode; sync(); repaint(); });
    made.dataset.mode = mode;
    modes.append(made);
  });
  const slide = (id, label, most, step, act) => {
    const made = element("input", {type: "range", id, min: 0, max: most, step, value: 0});
    made.oninput = () => act(Number(made.value));
    return element("label", {className: "slide"}, element("span", {id: id + "-label", textContent: label}), made);
  };
  $("bar").replaceChildren(
    modes,
    slide("split", "recorded | edited", 1, 0.01, (value) => { state.split = value; state.mode = "split"; sync(); repaint(); }),
    slide("frame", "frame", 0, 1, (value) => go(value)),
    element("div", {className: "group"}, button("play", play, "play or stop"), button("next draw", next),
      ...(count() > 1 ? [button("‹", () => turn(-1), "previous episode"), turner(), button("›", () => turn(1), "next episode")]
        : [])));
  $("split").value = state.split;
}
function turner() {
  const made = element("input", {id: "episode", type: "number", min: 1, max: count(), value: state.episode + 1});
  made.setAttribute("aria-label", `episode, 1 to ${count()}`);
  made.onchange = () => turn(Math.min(count(), Math.max(1, Math.round(made.value))) - 1 - state.episode);
  return made;
}
function sync() {
  if ($("episode")) $("episode").value = state.episode + 1;
  for (const made of $("bar").querySelectorAll("[data-mode]"))
    made.setAttribute("aria-pressed", String(made.dataset.mode === state.mode));
  $("frame").max = episode.frames.length - 1;
  $("frame").value = state.frame;
  $("frame-label").textContent = `frame ${episode.frames[state.frame]} of ${episode.length - 1}`;
}
const UNITS = {outside: "pixels", reprojection: "mm", holes: "%", moving: "%", torn: "%", flicker: "levels of 255", color: "CIEDE2000"};
function measured([name, value]) {
  return `${name} ${+(UNITS[name] === "%" ? 100 * value : value).toPrecision(3)} ${UNITS[name] || ""}`.trim();
}
function told() {
  const instruction = (shot && shot.instruction) || episode.instruction;
  $("title").textContent = instruction.trim() ? `“${instruction}”` : "no instruction";
  const all = episode.frames.length === episode.length;
  const facts = [["episode", episode.key], ["frames", all ? episode.length : `${episode.length}, of which ${episode.frames.length} are here`], ["cameras", Object.keys(episode.cameras).length]];
  if (shot) facts.push(["draw", `seed ${shot.seed}, copy ${shot.copy}`]);
  if (count() > 1) facts.push(["number", `${state.episode + 1} of ${count()} episodes`]);
  $("facts").replaceChildren(element("ul", {className: "facts"}, ...facts.map(([name, value]) =>
    element("li", {}, element("span", {className: "soft", textContent: name + " "}), element("b", {textContent: value})))));
  const drawn = shot ? shot.words : [];
  const list = element("ul", {className: "told"}, ...drawn.map(([op, what]) =>
    element("li", {}, element("span", {className: "soft", textContent: op + " "}), what)));
  if (!drawn.length) list.append(element("li", {textContent: shot ? "nothing was drawn in this copy" : "nothing yet"}));
  const gates = element("p", {});
  if (shot && shot.faults.length) {
    gates.className = "bad";
    gates.textContent = "rejected: " + shot.faults.join("; ");
  } else if (shot && shot.judged) {
    const figures = Object.entries(shot.measured).map(measured).join(", ");
    gates.textContent = figures ? "gates passed: " + figures : "gates passed";
  } else if (shot && DATA.served) gates.textContent = "gates are being measured, over all frames";
  else if (shot) gates.textContent = "gates were not measured (--quick): a run may draw it again";
  if (shot && shot.failed.length) gates.textContent += `. It was drawn again, since a draw before it failed: ${shot.failed.join("; ")}`;
  const change = element("p", {className: "soft", textContent: shot ? "mean change, levels of 255: " + Object.entries(shot.change).map(([k, v]) => `${k} ${v}`).join(", ") : ""});
  $("drawn").replaceChildren(list, gates, change);
  $("roles").replaceChildren(...Object.entries(episode.roles).map(([role, one]) => {
    const color = (episode.instances.find((i) => i.id === one.ids[0]) || {color: [127, 127, 127]}).color;
    const dot = element("span", {className: "dot"});
    dot.style.background = `rgb(${color})`;
    const why = element("details", {}, element("summary", {textContent: "why"}),
      ...one.why.map((words) => element("p", {className: "soft", textContent: words})));
    return element("li", {}, dot, element("b", {textContent: role}), `: ${one.ids.join(", ") || "none"}`, one.why.length ? why : "");
  }));
}
function cameras() {
  $("views").replaceChildren(...Object.keys(episode.cameras).map((name) => {
    const canvas = element("canvas", {turn: 0});
    canvas.dataset.camera = name;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `camera ${name}`);
    const lossy = episode.before && episode.before[name] && !episode.before[name].before.exact;
    const words = lossy ? `${name} (JPEG: differences of some levels are its own)` : name;
    return element("figure", {}, canvas, element("figcaption", {textContent: words}));
  }));
}
function refresh() { told(); sync(); repaint(); }
function go(frame) {
  state.frame = Math.max(0, Math.min(episode.frames.length - 1, frame));
  if (DATA.served) return ask();
  sync();
  return repaint();
}
function next() {
  if (DATA.served) { state.draw += 1; ask(); return; }
  state.draw = (state.draw + 1) % episode.draws.length;
  shot = episode.draws[state.draw];
  refresh();
}
function turn(step) {
  const total = count();
  state.episode = (((state.episode + step) % total) + total) % total;
  open();
}
async function play() {
  state.playing = !state.playing;
  const turn = ++state.turn;
  while (state.playing && turn === state.turn) {
    await go((state.frame + 1) % episode.frames.length);
    await new Promise((done) => setTimeout(done, 150));
  }
}
function open() {
  if (DATA.served) { load(); return; }
  episode = DATA.episodes[state.episode];
  shot = episode.draws[Math.min(state.draw, episode.draws.length - 1)] || null;
  state.frame = Math.min(state.frame, episode.frames.length - 1);
  cameras();
  refresh();
}
document.addEventListener("keydown", (event) => {
  if (/INPUT|TEXTAREA|SELECT|BUTTON|SUMMARY/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
  if (!episode) return;
  if (event.key === "ArrowRight") go(state.frame + 1);
  else if (event.key === "ArrowLeft") go(state.frame - 1);
  else if (event.key === " ") play();
  else if (event.key === "n") next();
  else if (event.key === "[" && count() > 1) turn(-1);
  else if (event.key === "]" && count() > 1) turn(1);
  else if (MODES[Number(event.key) - 1]) { state.mode = MODES[Number(event.key) - 1]; sync(); repaint(); }
  else return;
  event.preventDefault();
});
$("copy").onclick = async () => {
  const words = $("yaml").textContent;
  try { await navigator.clipboard.writeText(words); $("copied").textContent = "copied"; }
  catch { $("folded").open = true; getSelection().selectAllChildren($("yaml")); $("copied").textContent = "selected: copy it"; }
};
$("yaml").textContent = DATA.yaml;
bar();
if (!DATA.served) open();
