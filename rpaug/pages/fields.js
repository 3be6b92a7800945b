// Fields of a form, each made from its JSON Schema: `field` returns an element, and calls `set` with what was given.
const SCHEMA = DATA.schema;
const PLACES = ["at", "to", "by", "near"];
const TWO = ["from", "to"], AXES = ["x", "y", "z"], COLORS = ["red", "green", "blue"];
const BOX = ["left", "top", "right", "bottom"];
const SHOWN = 4; // fields of a part of which none is given
let fields = 0;

function kinds(schema) {
  if (schema.$ref) return kinds(SCHEMA.$defs[schema.$ref.split("/").pop()]);
  const some = schema.anyOf || schema.oneOf;
  if (some) return some.flatMap(kinds);
  return schema.type === "null" || schema.const === false ? [] : [schema];
}
function tuple(kind) {
  if (kind.prefixItems) return kind.prefixItems;
  return kind.minItems && kind.minItems === kind.maxItems ? Array(kind.minItems).fill(kind.items) : null;
}
function fits(kind, value) {
  if (kind.enum) return kind.enum.includes(value);
  if (kind.const !== undefined) return kind.const === value;
  if (kind.pattern) return typeof value === "string" && new RegExp(kind.pattern).test(value);
  if (kind.type === "integer") return Number.isInteger(value);
  if (kind.type === "array") {
    const parts = Array.isArray(value) && tuple(kind);
    if (!Array.isArray(value) || !parts) return Array.isArray(value);
    return parts.length === value.length && parts.every((part, n) => kinds(part).some((one) => fits(one, value[n])));
  }
  if (kind.type === "object") {
    const given = value && typeof value === "object" && !Array.isArray(value);
    return Boolean(given) && (kind.required || []).every((name) => name in value)
      && Object.entries(value).every(([name, one]) => !kind.properties || (name in kind.properties
        && (kinds(kind.properties[name]).length === 0 || one === null || kinds(kind.properties[name]).some((k) => fits(k, one)))));
  }
  return typeof value === kind.type;
}
function called(kind) {
  if (kind.const !== undefined) return String(kind.const);
  if (kind.enum) return "one of a list";
  if (kind.pattern) return "a color";
  if (kind.required && kind.required.length === 1) {
    const only = kind.properties[kind.required[0]];
    return only.const ? `${kind.required[0]} ${only.const}` : kind.required[0] + (spans(only) ? ", from to" : "");
  }
  if (kind.type === "array") {
    const parts = tuple(kind);
    if (parts) return kinds(parts[0])[0].type === "array" ? "from to" : parts.length === 2 ? "from to" : labelled("", kind).join(", ");
    return "several";
  }
  if (kind.properties) return Object.keys(kind.properties).slice(0, 3).join(", ") + ", …";
  return {number: "a number", integer: "a number", string: "words", object: "as YAML", boolean: "yes or no"}[kind.type] || "other";
}
function spans(schema) {
  return kinds(schema).some((kind) => (tuple(kind) || []).some((part) => kinds(part).some((one) => one.type === "array")));
}
function blank(kind) {
  if (kind.const !== undefined) return kind.const;
  if (kind.default !== undefined && kind.default !== null) return structuredClone(kind.default);
  if (kind.enum) return kind.enum[0];
  if (kind.pattern) return "#808080";
  const parts = tuple(kind);
  if (parts) return parts.map((part) => blank(kinds(part)[0]));
  if (kind.type === "array") return [];
  if (kind.type === "object") return Object.fromEntries((kind.required || []).map((name) => [name, blank(kinds(kind.properties[name])[0])]));
  if (kind.type === "string") return "";
  return kind.minimum !== undefined ? kind.minimum : kind.exclusiveMinimum !== undefined ? kind.exclusiveMinimum + 1 : 0;
}
function written(value) {
  if (value === undefined || value === null) return "";
  if (value && value.$yaml !== undefined) return value.$yaml;
  if (Array.isArray(value)) return value.map((one) => typeof one === "object" ? `(${written(one)})` : one).join(", ");
  if (typeof value !== "object") return String(value);
  return Object.entries(value).filter(([, one]) => one !== null && one !== false).map(([name, one]) => `${name} ${written(one)}`).join(", ");
}
function words(name) {
  return name.replaceAll("_", " ");
}
function number(kind, value, label, fallback, set) {
  const made = element("input", {type: "number", step: kind.type === "integer" ? 1 : "any",
    value: typeof value === "number" ? value : "", placeholder: written(fallback)});
  for (const [from, to] of [["minimum", "min"], ["maximum", "max"]]) if (kind[from] !== undefined) made[to] = kind[from];
  made.setAttribute("aria-label", label);
  made.oninput = () => set(made.value === "" ? undefined : Number(made.value));
  return made;
}
function labelled(name, kind) {
  const parts = tuple(kind), first = kinds(parts[0])[0];
  if (/^(rgb|hsv|lab)$/.test(name)) return [...name];
  if (parts.length === 2) return PLACES.includes(name) ? AXES : TWO;
  if (parts.length === 4) return BOX;
  return first.minimum === 0 && first.maximum === 1 ? COLORS : AXES;
}
// Several numbers side by side, each with its name: where one is left empty, the default stands for it.
function row(name, kind, value, fallback, set) {
  const parts = tuple(kind), labels = labelled(name, kind);
  const given = Array.isArray(value) ? [...value] : [];
  const change = (n) => (one) => {
    given[n] = one;
    if (parts.every((_, i) => given[i] === undefined)) { set(undefined); return; }
    const other = Array.isArray(fallback) ? fallback : [];
    set(parts.map((part, i) => given[i] !== undefined ? given[i] : other[i] !== undefined ? other[i] : given[n]));
  };
  return element("div", {className: "numbers"}, ...parts.map((part, n) => element("label", {},
    element("span", {className: "soft", textContent: labels[n]}),
    number(kinds(part)[0], given[n], `${words(name)}, ${labels[n]}`, Array.isArray(fallback) ? fallback[n] : undefined, change(n)))));
}
function pair(name, kind, value, fallback, set) {
  const parts = tuple(kind), labels = labelled(name, kind);
  const given = Array.isArray(value) ? value : Array.isArray(fallback) ? structuredClone(fallback) : blank(kind);
  return element("div", {}, ...parts.map((part, n) => element("div", {className: "part"},
    element("span", {className: "soft", textContent: labels[n]}),
    widget(`${name} ${labels[n]}`, part, given[n], undefined, (one) => { given[n] = one === undefined ? given[n] : one; set([...given]); }))));
}
function parts(kind, value, set, help) {
  const given = value && typeof value === "object" && !Array.isArray(value) ? value : {};
  const single = (kind.required || []).length === 1 && Object.keys(kind.properties).length === 1;
  const change = (name) => (one) => {
    if (one === undefined) delete given[name]; else given[name] = one;
    set(Object.keys(given).length ? {...given} : undefined);
  };
  if (single) {
    const [name] = kind.required, schema = kind.properties[name];
    if (kinds(schema)[0].const !== undefined) return element("span");
    return widget(name, schema, given[name], undefined, (one) => { if (one !== undefined) change(name)(one); });
  }
  return element("div", {className: "parts"}, ...grouped({description: help, ...kind}, given, change, ""));
}
// Fields that say something come first, then the others, folded.
function grouped(schema, given, change, of) {
  const last = ["probability", "weight"], own = Object.keys(schema.properties).filter((name) => name !== "op" && !last.includes(name));
  const names = [...own, ...last.filter((name) => name in schema.properties)], needed = schema.required || [];
  const first = names.filter((name) => given[name] !== undefined || needed.includes(name));
  const rest = names.filter((name) => !first.includes(name));
  if (!first.length) first.push(...rest.splice(0, SHOWN));
  const made = (name) => field(name, schema.properties[name], given[name], change(name), schema.description);
  return [...first.map(made), ...(rest.length ? [folded(`more ${of}`.trim(), () => rest.map(made))] : [])];
}
// A details whose fields are made when it is opened: a long recipe has hundreds.
function folded(title, make) {
  const made = element("details", {}, element("summary", {textContent: title}));
  made.addEventListener("toggle", () => { if (made.open && made.children.length === 1) made.append(...make()); });
  return made;
}
function list(name, kind, value, set) {
  const given = Array.isArray(value) ? value : [], box = element("div", {className: "parts"});
  const draw = () => box.replaceChildren(
    ...given.map((one, n) => element("div", {className: "part"},
      widget(`${name} ${n + 1}`, kind.items, one, undefined, (changed) => { if (changed !== undefined) given[n] = changed; set([...given]); }),
      button("remove", () => { given.splice(n, 1); set(given.length ? [...given] : undefined); draw(); }, `remove ${words(name)} ${n + 1}`))),
    button("add", () => { given.push(blank(kinds(kind.items).at(-1))); set([...given]); draw(); }, `add to ${words(name)}`));
  draw();
  return box;
}
function text(value, label, fallback, set) {
  const made = element("input", {type: "text", value: written(value), placeholder: written(fallback)});
  made.setAttribute("aria-label", label);
  made.oninput = () => set(made.value.trim() === "" ? undefined : made.value);
  const known = label === "role" ? "known-roles" : label.startsWith("camera") ? "known-cameras" : "";
  if (known) made.setAttribute("list", known);
  return made;
}
// What an episode has, offered where a field names such a thing.
function offer() {
  const all = {"known-roles": Object.keys(episode.roles), "known-cameras": [...Object.keys(episode.cameras), "static"]};
  for (const [id, names] of Object.entries(all)) {
    if ($(id)) $(id).remove();
    document.body.append(element("datalist", {id}, ...names.map((name) => element("option", {value: name}))));
  }
  document.querySelectorAll("select.instances").forEach(offerInstances);
}
function offerInstances(select) {
  const known = episode && episode.instances.length ? episode.instances : [];
  select.replaceChildren(element("option", {value: "", textContent: known.length ? "add an instance …" : "none found yet"}),
    ...known.map((one) => element("option", {value: one.id, textContent: one.words})));
}
// The instances of the episode beside a field of their ids: what is picked is added to what the field says.
function instancesFor(input) {
  const pick = element("select", {className: "instances"});
  pick.setAttribute("aria-label", "instances of this episode");
  pick.onchange = () => {
    const ids = input.value.split(",").map((part) => part.trim()).filter(Boolean);
    if (pick.value && !ids.includes(pick.value)) input.value = [...ids, pick.value].join(", ");
    pick.value = "";
    input.oninput();
  };
  offerInstances(pick);
  return element("div", {className: "widget"}, input, pick);
}
function chosen(kind, value, label, fallback, set) {
  const made = element("select", {}, element("option", {value: "", textContent: written(fallback) || "–"}),
    ...kind.enum.map((one) => element("option", {value: one, textContent: words(one), selected: one === value})));
  made.setAttribute("aria-label", label);
  made.onchange = () => set(made.value || undefined);
  return made;
}
function hex(value, label, set) {
  const long = /^#...$/.test(value || "") ? "#" + [...value.slice(1)].map((one) => one + one).join("") : value;
  const made = element("input", {type: "color", value: long || "#808080"});
  made.setAttribute("aria-label", label);
  made.oninput = () => set(made.value);
  return made;
}
// What one kind of value is given by. A list of words is written with commas; what no field fits is written as YAML.
function one(name, kind, value, fallback, set, help) {
  const label = words(name), inner = tuple(kind) && kinds(tuple(kind)[0])[0];
  if (kind.const !== undefined) return element("span");
  if (kind.enum) return chosen(kind, value, label, fallback, set);
  if (kind.pattern) return hex(value, label, set);
  if (kind.type === "number" || kind.type === "integer") return number(kind, value, label, fallback, set);
  if (kind.type === "boolean") {
    const made = element("input", {type: "checkbox", checked: value === undefined ? Boolean(fallback) : value});
    made.setAttribute("aria-label", label);
    made.onchange = () => set(made.checked);
    return made;
  }
  if (inner) return inner.type === "array" || kinds(tuple(kind)[0]).length > 1 ? pair(name, kind, value, fallback, set) : row(name, kind, value, fallback, set);
  if (kind.type === "object" && kind.properties) return parts(kind, value, set, help);
  if (kind.type === "array" && kinds(kind.items).some((item) => item.type === "object")) return list(name, kind, value, set);
  if (kind.type === "array") {
    const whole = kinds(kind.items)[0].type === "integer";
    return text(value, label, fallback, (given) => {
      const all = given && given.split(",").map((part) => part.trim()).filter(Boolean);
      set(all && all.map((part) => whole && /^-?\d+$/.test(part) ? Number(part) : part));
    });
  }
  if (kind.type === "string") return text(value, label, fallback, set);
  return text(value, `${label}, as YAML`, fallback, (given) => set(given && {$yaml: given}));
}
// One or several: `front`, or `front, wrist`.
function orSeveral(all) {
  const several = all.find((kind) => kind.type === "array" && !tuple(kind) && kind.items);
  return all.length === 2 && several && all.some((kind) => kind.type === kinds(several.items)[0].type && !kind.enum) ? several : null;
}
function widget(name, schema, value, fallback, set, help) {
  const all = kinds(schema), several = orSeveral(all), box = element("div", {className: "widget"});
  if (several) {
    const made = one(name, several, Array.isArray(value) || value === undefined ? value : [value], fallback,
      (given) => set(given && given.length === 1 ? given[0] : given), help);
    return name === "handle" ? instancesFor(made) : made;
  }
  if (all.length < 2) return one(name, all[0] || {}, value, fallback, set, help);
  const meant = value === undefined || value === null ? fallback : value;
  const is = all.findIndex((kind) => fits(kind, meant));
  const pick = element("select", {}, ...(value === undefined ? [element("option", {value: "", textContent: meant === undefined || meant === null ? "–" : `usual: ${written(meant)}`})] : []),
    ...all.map((kind, n) => element("option", {value: n, textContent: called(kind), selected: value !== undefined && n === is})));
  pick.setAttribute("aria-label", `how ${words(name)} is given`);
  const draw = (kind, given) => box.replaceChildren(pick, ...(kind ? [one(name, kind, given, fallback, set, help)] : []));
  pick.onchange = () => {
    const kind = all[Number(pick.value)];
    if (pick.value === "" || !kind) { draw(null); set(undefined); pick.focus(); return; }
    const given = blank(kind);
    draw(kind, given);
    if (given !== "") set(given);
    pick.focus();
  };
  draw(value === undefined ? null : all[is], value);
  return box;
}
// The sentences of a text that name a field.
function about(name, help) {
  const sentences = (help || "").replace(/\s+/g, " ").split(/(?<=[.;])\s+(?=[A-Z`])/);
  return sentences.filter((one) => one.includes("`" + name + "`") || one.includes("`" + name + ":")).join(" ").replaceAll("`", "");
}
function field(name, schema, value, set, help) {
  const hint = schema.description || about(name, help), id = `field${++fields}`;
  const made = widget(name, schema, value === null ? undefined : value, schema.default, set, help);
  const label = element(made.matches("input,select") ? "label" : "span", {textContent: words(name)});
  const box = element("div", {className: "field"}, label, made);
  if (made.matches("input,select")) { made.id = id; label.htmlFor = id; } else { box.setAttribute("role", "group"); box.setAttribute("aria-label", words(name)); }
  if (hint) {
    const said = element("p", {id: id + "-hint", className: "hint soft", textContent: hint});
    box.append(said);
    (made.id ? made : box).setAttribute("aria-describedby", said.id);
  }
  return box;
}
