// The declared parameters of a generator: which of them are active, random values, doubt, and the command line.

// Above these a value is marked as uncertain: the spread as a share of the range, and what is left of a probability.
const UNSURE_SPREAD = 0.15;
const UNSURE_CHANCE = 0.75;
const STEPS = 100;

export const isSwitch = ({ kind, options }) => kind === "choice" && options.every(({ value }) => typeof value === "boolean");

/** A unit such as "m" stands beside its number; a longer one such as "of width" in the line below. */
export const shortUnit = ({ unit }) => (unit?.length <= 3 ? unit : "");

/** Whether a parameter can change the mesh: its conditions hold, and what they name is active too. */
export function isActive(parameters, name, params) {
  const { when } = parameters.find((one) => one.name === name);
  return Object.entries(when ?? {}).every(([other, allowed]) => allowed.includes(params[other]) && isActive(parameters, other, params));
}

export function random(parameters) {
  return Object.fromEntries(parameters.map((parameter) => [parameter.name, draw(parameter)]));
}

function draw({ kind, low, high, options }) {
  if (kind === "choice") return options[Math.floor(Math.random() * options.length)].value;
  const value = low + Math.random() * (high - low);
  return kind === "integer" ? Math.round(value) : value;
}

/** The step of a slider, a power of ten, and the digits behind the point that it needs. */
export function grain({ kind, low, high }) {
  const power = kind === "integer" ? 0 : Math.floor(Math.log10((high - low) / STEPS));
  return { step: 10 ** power, digits: Math.max(0, -power) };
}

/** The parameters in the parts that they belong to; a part takes the place of its first parameter. */
export function parts(parameters) {
  const found = new Map();
  for (const parameter of parameters) {
    const part = parameter.part || "parameters";
    found.set(part, [...(found.get(part) ?? []), parameter]);
  }
  return [...found];
}

/** The ends of the spread over the candidates, as shares of the slider. */
export function band({ low, high }, value, spread) {
  const share = (end) => Math.min(1, Math.max(0, (end - low) / (high - low)));
  return [share(value - spread), share(value + spread)];
}

/** In a few signs how uncertain a parameter is, or "" where the picture decides it. */
export function doubt(parameter, value, { spread, probabilities }) {
  const chances = probabilities?.[parameter.name];
  if (parameter.kind === "choice") {
    const chance = chances?.[spelt(value)];
    return chance !== undefined && chance < UNSURE_CHANCE ? `${Math.round(100 * chance)} % sure` : "";
  }
  const wide = spread?.[parameter.name] ?? 0;
  return wide > UNSURE_SPREAD * (parameter.high - parameter.low) ? `± ${wide.toFixed(grain(parameter).digits)}` : "";
}

/** An option as Python writes it, which is how the API names it in probabilities and the command takes it. */
export const spelt = (value) => (typeof value === "boolean" ? (value ? "True" : "False") : String(value));

/** The command line that makes the asset again, to the last digit and with the colours of the photo. */
export function command({ name, ref, parameters }, { params, format, detail, faces, texture, colours = {} }) {
  const active = parameters.filter((one) => isActive(parameters, one.name, params));
  const settings = active.map((one) => quoted(`${one.name}=${spelt(params[one.name])}`));
  const painted = Object.entries(colours).map(([part, colour]) => quoted(`${part}=${hex(colour)}`));
  const options = [painted.length && `--paint ${painted.join(" ")}`, detail !== "standard" && `--detail ${detail}`, faces && `--faces ${faces}`, texture && `--texture ${texture}`];
  const file = quoted(`${name}${format}`);
  return ["dipcg sample", quoted(ref ?? name), "--set", ...settings, ...options.filter(Boolean), "-o", file].join(" ");
}

const hex = (colour) => "#" + colour.map((share) => Math.round(255 * share).toString(16).padStart(2, "0")).join("");

const quoted = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'"'"'`)}'`);
