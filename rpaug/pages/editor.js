const recipe = structuredClone(DATA.recipe);
const waiting = {timer: 0, turn: 0};
const SCHEMA = DATA.schema;

function resolved(schema) {
  if (schema && schema.$ref) return resolved(SCHEMA.$defs[schema.$ref.split("/").pop()]);
  const some = schema && (schema.anyOf || schema.oneOf);
  const one = some && some.length === 2 && some.find((s) => s.type === "null") && some.find((s) => s.type !== "null");
  return one ? {...resolved(one), default: schema.default} : schema || {};
}
function operators() {
  return Object.keys(SCHEMA.$defs).filter((name) => name.startsWith("op_")).map((name) => name.slice(3)).sort();
}
function written(value) {
  if (value === undefined || value === null) return "";
  if (value && value.$yaml !== undefined) return value.$yaml;
  return typeof value === "string" ? value : JSON.stringify(value).replace(/"([A-Za-z_]+)":/g, "$1: ").replace(/,/g, ", ");
}
function field(name, schema, value, set) {
  const kind = resolved(schema), id = "f" + Math.random().toString(36).slice(2);
  let made;
  if (kind.enum) {
    made = element("select", {id}, element("option", {value: "", textContent: written(kind.default) || "–"}),
      ...kind.enum.map((one) => element("option", {value: one, textContent: one, selected: one === value})));
    made.onchange = () => set(made.value || undefined);
  } else if (kind.type === "boolean") {
    made = element("input", {id, type: "checkbox", checked: value === undefined ? Boolean(kind.default) : value});
    made.onchange = () => set(made.checked);
  } else if (kind.type === "number" || kind.type === "integer") {
    made = element("input", {id, type: "number", step: kind.type === "integer" ? 1 : "any", value: value === undefined ? "" : value,
      placeholder: written(kind.default)});
    for (const [from, to] of [["minimum", "min"], ["maximum", "max"]]) if (kind[from] !== undefined) made[to] = kind[from];
    made.oninput = () => set(made.value === "" ? undefined : Number(made.value));
  } else {
    made = element("input", {id, type: "text", value: written(value), placeholder: written(kind.default)});
    made.oninput = () => set(made.value.trim() === "" ? undefined : {$yaml: made.value});
  }
  return element("div", {className: "field"}, element("label", {htmlFor: id, textContent: name, title: kind.description || ""}), made);
}
function edit(one, number) {
  const box = element("fieldset"), title = element("legend", {textContent: `${number + 1}. ${one.op || "one of"}`});
  const change = (name) => (value) => { if (value === undefined) delete one[name]; else one[name] = value; soon(); };
  box.append(title);
  if (one.op) {
    const fields = SCHEMA.$defs["op_" + one.op].properties;
    for (const [name, schema] of Object.entries(fields)) if (name !== "op") box.append(field(name, schema, one[name], change(name)));
  } else {
    const text = element("textarea", {rows: 5, value: JSON.stringify(one, null, 1)});
    text.setAttribute("aria-label", `edit ${number + 1} as JSON`);
    text.oninput = () => { recipe.edits[number] = {$yaml: text.value}; soon(); };
    box.append(element("div", {className: "field"}, element("span", {textContent: "as JSON"}), text));
  }
  box.append(element("div", {className: "group"},
    button("remove", () => { recipe.edits.splice(number, 1); form(); soon(); }, `remove edit ${number + 1}`),
    button("earlier", () => { if (number) recipe.edits.splice(number - 1, 0, recipe.edits.splice(number, 1)[0]); form(); soon(); },
      `move edit ${number + 1} earlier`)));
  return box;
}
function form() {
  const change = (name) => (value) => { if (value === undefined) delete recipe[name]; else recipe[name] = value; soon(); };
  const add = element("select", {}, element("option", {value: "", textContent: "add an edit …"}),
    ...operators().map((name) => element("option", {value: name, textContent: name})));
  add.setAttribute("aria-label", "add an edit");
  add.onchange = () => {
    if (!add.value) return;
    const needed = (SCHEMA.$defs["op_" + add.value].required || []).filter((name) => name !== "op");
    const made = {op: add.value};
    for (const name of needed) made[name] = {target: {role: "manipulated"}, color: "blue", camera: "static"}[name];
    recipe.edits.push(made);
    form();
    soon();
  };
  recipe.edits = recipe.edits || [];
  $("editor").replaceChildren(
    element("p", {id: "status", textContent: ""}),
    field("seed", SCHEMA.properties.seed, recipe.seed, change("seed")),
    field("copies", SCHEMA.properties.copies, recipe.copies, change("copies")),
    ...recipe.edits.map(edit), add);
  $("status").setAttribute("role", "status");
}
function soon() {
  clearTimeout(waiting.timer);
  waiting.timer = setTimeout(ask, 250);
}
function say(words, bad) {
  $("status").textContent = words;
  $("status").className = bad ? "bad" : "soft";
}
async function ask() {
  const turn = ++waiting.turn;
  sync();
  say("drawing …");
  const body = JSON.stringify({episode: episode.key, recipe, copy: state.draw + 1, frame: episode.frames[state.frame]});
  let told;
  try {
    const answer = await fetch("/draw", {method: "POST", headers: {"Content-Type": "application/json"}, body});
    told = await answer.json();
  } catch { say("the server does not answer: is rpaug preview --serve still running?", true); return; }
  if (turn !== waiting.turn) return;
  if (told.error) { say(told.error, true); return; }
  shot = told.draw;
  episode.before = told.before;
  $("yaml").textContent = told.yaml;
  say(`${told.seconds} s`);
  refresh();
}
async function load() {
  say("finding what is in the scene …");
  const answer = await fetch("/episode?key=" + encodeURIComponent(DATA.keys[state.episode]));
  const told = await answer.json();
  if (told.error) { say(told.error, true); return; }
  episode = told;
  shot = null;
  state.frame = Math.min(state.frame, episode.frames.length - 1);
  cameras();
  ask();
}
state.episode = DATA.first;
form();
open();
