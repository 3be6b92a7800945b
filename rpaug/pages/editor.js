const recipe = structuredClone(DATA.recipe);
const waiting = {timer: 0, again: false, drawing: null, told: 0, judge: 0};
const USUAL = {target: {role: "manipulated"}, color: "blue", camera: "static"};

function operators(group) {
  return Object.keys(SCHEMA.$defs).filter((name) => name.startsWith(group)).map((name) => name.slice(group.length))
    .filter((name) => name).sort();
}
function fresh(group, name) {
  const needed = (SCHEMA.$defs[group + name].required || []).filter((one) => one !== "op");
  return {op: name, ...structuredClone(Object.fromEntries(needed.map((one) => [one, USUAL[one]])))};
}
// A select that adds what is picked in it: by the button beside it, so that arrow keys look through it.
function adding(label, names, add) {
  const pick = element("select", {}, ...names.map((name) => element("option", {value: name, textContent: words(name)})));
  pick.setAttribute("aria-label", label);
  return element("div", {className: "group adding"}, pick, button("add", () => add(pick.value), label));
}
function fieldsOf(given, schema) {
  const change = (name) => (value) => {
    if (value === undefined) delete given[name]; else given[name] = value;
    soon();
  };
  return grouped(schema, given, change, `of ${words(given.op)}`);
}
function edit(given, number, all, group, path) {
  const several = Boolean(given.one_of), schema = several ? SCHEMA.$defs.one_of : SCHEMA.$defs[group + given.op];
  const title = several ? "one of these, by chance" : words(given.op || "?"), named = `${path}${number + 1}`;
  const box = element("fieldset", {}, element("legend", {textContent: `${named}. ${title}`}));
  box.dataset.edit = named;
  if (schema && schema.description) {
    const [short] = schema.description.replaceAll("`", "").split("\n\n");
    box.append(element("p", {className: "soft", textContent: short}));
  }
  if (several) {
    box.append(...given.one_of.map((one, n) => edit(one, n, given.one_of, "one_of_", named + ".")));
    box.append(adding(`add an alternative to edit ${named}`, operators("one_of_"), (name) => {
      given.one_of.push(fresh("one_of_", name));
      again(`${named}.${given.one_of.length}`);
    }), field("probability", schema.properties.probability, given.probability, (value) => {
      if (value === undefined) delete given.probability; else given.probability = value;
      soon();
    }));
  } else if (schema) box.append(...fieldsOf(given, schema));
  const move = (by) => () => {
    all.splice(number + by, 0, all.splice(number, 1)[0]);
    again(`${path}${number + by + 1}`);
  };
  const last = all.length === 1 && path !== "";
  box.append(element("div", {className: "group"},
    ...(last ? [] : [button("remove", () => { all.splice(number, 1); again(`${path}${Math.max(1, number)}`); }, `remove edit ${named}`)]),
    ...(number ? [button("earlier", move(-1), `move edit ${named} earlier`)] : []),
    ...(number + 1 < all.length ? [button("later", move(1), `move edit ${named} later`)] : [])));
  return box;
}
function gates() {
  const schema = SCHEMA.$defs.Gates, box = element("fieldset", {}, element("legend", {textContent: "gates"}));
  const is = recipe.gates === false ? "off" : recipe.gates ? "limits" : "as usual";
  const pick = element("select", {}, ...["as usual", "limits", "off"].map((one) => element("option", {value: one, textContent: one, selected: one === is})));
  pick.setAttribute("aria-label", "gates: what a copy must keep");
  pick.onchange = () => {
    if (pick.value === "off") recipe.gates = false; else if (pick.value === "limits") recipe.gates = {}; else delete recipe.gates;
    again("gates");
  };
  box.dataset.edit = "gates";
  box.append(element("p", {className: "soft", textContent: "Limits that a copy must keep. Without them copies of moved cameras are held to a few."}), pick);
  if (recipe.gates) box.append(...Object.entries(schema.properties).map(([name, one]) => limit(name, one)));
  return box;
}
// A limit is a number, or none: an empty field is the default, shown in it.
function limit(name, schema) {
  const set = (value) => { if (value === undefined) delete recipe.gates[name]; else recipe.gates[name] = value; soon(); };
  const made = field(name, schema, recipe.gates[name], set), input = made.querySelector("input[type=number]");
  if (!(schema.anyOf || []).some((one) => one.type === "null") || !input) return made;
  const none = element("input", {type: "checkbox", checked: recipe.gates[name] === null});
  input.disabled = none.checked;
  none.onchange = () => { input.disabled = none.checked; set(none.checked ? null : input.value === "" ? undefined : Number(input.value)); };
  const label = element("label", {className: "none"}, none, "no limit");
  none.setAttribute("aria-label", `no limit of ${words(name)}`);
  const both = element("div", {className: "numbers"});
  input.replaceWith(both);
  both.append(input, label);
  return made;
}
function form() {
  const change = (name) => (value) => { if (value === undefined) delete recipe[name]; else recipe[name] = value; soon(); };
  const top = (name) => field(name, SCHEMA.properties[name], recipe[name], change(name), SCHEMA.description);
  const others = Object.keys(SCHEMA.properties).filter((name) => !["version", "seed", "copies", "edits", "gates"].includes(name));
  recipe.edits = recipe.edits || [];
  $("editor").replaceChildren(top("seed"), top("copies"), ...recipe.edits.map((one, n) => edit(one, n, recipe.edits, "op_", "")),
    adding("add an edit", operators("op_").concat("one_of"), (name) => {
      recipe.edits.push(name === "one_of" ? {one_of: [fresh("one_of_", "recolor"), fresh("one_of_", "retexture")]} : fresh("op_", name));
      again(String(recipe.edits.length));
    }),
    gates(), folded("more of the recipe", () => others.map(top)));
}
// The form anew, with the focus on the edit that was changed.
function again(edit) {
  form();
  const box = $("editor").querySelector(`[data-edit="${edit}"]`);
  const first = (box || $("editor")).querySelector("input,select,button");
  if (first) first.focus();
  soon();
}
function soon() {
  clearTimeout(waiting.timer);
  waiting.timer = setTimeout(ask, 200);
}
function say(given, bad) {
  $("status").textContent = given;
  $("status").className = bad ? "bad" : "soft";
}
async function asked(path, body) {
  const answer = await fetch(path, body && {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(body)});
  const told = await answer.json();
  if (told.error) throw Object.assign(new Error(told.error), {told: true});
  return told;
}
function wrong(error) {
  say(error.told ? error.message : "the server does not answer: is rpaug preview --serve still running?", true);
  document.body.classList.toggle("stale", true);
}
// Says what is being done until `work` is there.
async function meanwhile(given, work) {
  const turn = ++waiting.told;
  say(given);
  const timer = setInterval(async () => {
    const {doing} = await asked("/doing").catch(() => ({}));
    if (turn === waiting.told && doing) say(`${given} ${doing}`);
  }, 500);
  try { return await work; } finally { clearInterval(timer); waiting.told++; }
}
// One request at a time: what changed meanwhile is asked for when the answer is there.
function ask() {
  waiting.again = true;
  waiting.drawing = waiting.drawing || (async () => {
    while (waiting.again) { waiting.again = false; await draw(); }
    waiting.drawing = null;
  })();
  return waiting.drawing;
}
async function draw() {
  clearTimeout(waiting.judge);
  sync();
  const of = episode, frame = of.frames[state.frame];
  try {
    if (!of.found) {
      of.before = (await asked(`/recorded?key=${encodeURIComponent(of.key)}&frame=${frame}`)).before;
      if (of === episode) refresh();
      return;
    }
    const told = await meanwhile("drawing …", asked("/draw", {episode: of.key, recipe, copy: state.draw + 1, frame}));
    if (of !== episode) return;
    shot = told.draw;
    episode.before = told.before;
    $("yaml").textContent = told.yaml;
    document.body.classList.toggle("stale", false);
    say(`drawn in ${told.seconds} s`);
    refresh();
    if (!shot.judged) waiting.judge = setTimeout(judge, 500);
  } catch (error) { if (of === episode) wrong(error); }
}
// What gates say of the copy, over all frames: asked for when nothing else is, and given up where something is.
async function judge() {
  const of = shot;
  try {
    const told = await asked("/judge", {episode: episode.key, recipe, copy: of.copy});
    if (of !== shot || !told.judged) return;
    Object.assign(shot, told);
    if (told.again) ask(); else refresh();
  } catch (error) { if (of === shot) wrong(error); }
}
async function load() {
  const key = DATA.keys[state.episode], turn = state.episode, path = encodeURIComponent(key);
  try {
    const recorded = await meanwhile("reading the episode …", asked("/episode?key=" + path));
    if (turn !== state.episode) return;
    episode = {...recorded, found: false};
    shot = null;
    state.frame = 0;
    cameras();
    refresh();
    const found = await meanwhile("as recorded; finding what is in it …", asked("/found?key=" + path));
    if (turn !== state.episode) return;
    const before = found.length === episode.length ? episode.before : null;
    episode = {...found, before, found: true};
    offer();
    state.frame = Math.min(state.frame, episode.frames.length - 1);
    cameras();
    refresh();
    ask();
  } catch (error) { if (turn === state.episode) wrong(error); }
}
state.episode = DATA.first;
form();
open();
