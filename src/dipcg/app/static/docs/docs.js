// Shows /openapi.json: a section for each route, and one for each model.

const text = (tag, words, className = "") => {
  const made = document.createElement(tag);
  made.textContent = words;
  made.className = className;
  return made;
};

const link = (name) => {
  const made = text("a", name);
  made.href = `#${name}`;
  return made;
};

// What a schema allows, in words, with a link to each model that it names.
function kind(schema = {}) {
  if (schema.$ref) return [link(schema.$ref.split("/").at(-1))];
  if (schema.anyOf) return schema.anyOf.flatMap((one, i) => (i ? [" or ", ...kind(one)] : kind(one)));
  if (schema.enum || "const" in schema) return [(schema.enum ?? [schema.const]).map((v) => JSON.stringify(v)).join(" or ")];
  if (schema.type === "array") return ["list of ", ...kind(schema.items)];
  if (schema.type === "object" && schema.additionalProperties) return ["object of ", ...kind(schema.additionalProperties)];
  return [schema.type ?? "anything"];
}

const LIMITS = { minimum: "from", exclusiveMinimum: "above", maximum: "to", exclusiveMaximum: "below", maxLength: "up to" };

function limits(schema) {
  const found = [schema, ...(schema.anyOf ?? [])].flatMap((one) =>
    Object.entries(LIMITS).filter(([name]) => name in one).map(([name, words]) => `${words} ${one[name]}`));
  const start = schema.default === undefined || schema.default === null ? [] : [`by default ${JSON.stringify(schema.default)}`];
  return [...found, ...start].join(", ");
}

function fields(model) {
  const table = document.createElement("table");
  for (const [name, schema] of Object.entries(model.properties ?? {})) {
    const row = table.insertRow();
    row.insertCell().append(text("code", name), model.required?.includes(name) ? " *" : "");
    row.insertCell().append(...kind(schema));
    row.insertCell().append([schema.description, limits(schema)].filter(Boolean).join("; "));
  }
  return table;
}

function body(content = {}) {
  return Object.entries(content).flatMap(([type, { schema }]) =>
    type === "application/json" ? kind(schema) : [type, schema?.$ref ? " of " : "", ...(schema?.$ref ? kind(schema) : [])]);
}

function route(path, method, about) {
  const made = document.createElement("details");
  const summary = document.createElement("summary");
  summary.append(text("span", method.toUpperCase(), "method"), text("code", path));
  made.append(summary, text("p", about.description ?? "", "doc"));
  const table = document.createElement("table");
  const add = (name, ...what) => {
    const row = table.insertRow();
    row.insertCell().append(text("code", name));
    row.insertCell().append(...what);
  };
  for (const one of about.parameters ?? []) add(one.name, ...kind(one.schema));
  if (about.requestBody) add("body", ...body(about.requestBody.content));
  for (const [status, answer] of Object.entries(about.responses ?? {})) {
    if (status < 400) add(status, ...body(answer.content));
  }
  made.append(table);
  return made;
}

const api = await (await fetch("/openapi.json")).json();
document.querySelector("main").replaceChildren(
  ...Object.entries(api.paths).flatMap(([path, methods]) =>
    Object.entries(methods).map(([method, about]) => route(path, method, about))));
document.querySelector("section").replaceChildren(
  ...Object.entries(api.components.schemas).map(([name, model]) => {
    const made = document.createElement("details");
    made.id = name;
    made.append(text("summary", name), text("p", model.description ?? "", "doc"), fields(model));
    return made;
  }));
addEventListener("hashchange", () => { document.querySelector(location.hash).open = true; });
