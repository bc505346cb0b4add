// What can be done to the open asset: functions from a state to the entries that change. None of them knows the page.
import { random } from "./space.js";

const MOST_UNDONE = 100;

/** A state with a step to undo before another asset or other parameters are shown. */
function stepped(state, open) {
  const before = state.open ? [...state.before, state.open].slice(-MOST_UNDONE) : state.before;
  return { open, before, after: [], moving: "", results: named(state.results, open, before, state.job) };
}

/** The results that something still names; the others are forgotten. */
function named(results, open, before, job) {
  const names = new Set([open, ...before].map((one) => one?.result));
  if (job) names.add(job.result);
  return Object.fromEntries(Object.entries(results).filter(([name]) => names.has(name)));
}

const newest = (state) => 1 + Math.max(0, ...[state.open, ...state.before, ...state.after].map((one) => one?.opened ?? 0));

/** Open a candidate of a result. `held` names what was fixed in the estimate. */
export function opened(state, result, chosen, held = []) {
  const { generator, candidates } = state.results[result];
  const { params, view } = candidates[chosen];
  return stepped(state, { generator, params, first: params, result, chosen, held, view, opened: newest(state) });
}

/** The better result of the same estimate: what the visitor has not touched follows it where it differs, what was edited stays. */
export function ranked(state, name, result) {
  const results = { ...state.results, [name]: result };
  const { open } = state;
  if (open?.result !== name) return { results };
  const untouched = open.params === open.first && !open.picked;
  const chosen = untouched ? 0 : result.candidates.findIndex(({ params }) => alike(params, open.first));
  const { params, view } = result.candidates[Math.max(chosen, 0)];
  const same = !result.ranked && alike(params, open.first);
  const better = untouched && !same ? { params, first: params, view, opened: newest(state) } : {};
  return { results, open: { ...open, chosen, ...better } };
}

/** Whether two sets of parameters are the same but for rounding. */
const alike = (one, other) => Object.keys(one).every((name) => one[name] === other[name] || Math.abs(one[name] - other[name]) < 1e-5 * Math.abs(one[name]));

/** One parameter changed; all the moves of one drag are one step. */
export function edited(state, name, value, final) {
  const { open, moving } = state;
  if (!open || open.params[name] === value) return { moving: final ? "" : moving };
  const changed = { ...open, params: { ...open.params, [name]: value } };
  const step = moving === name ? { open: changed } : stepped(state, changed);
  return { ...step, moving: final ? "" : name };
}

/** The asset as it was opened. */
export function reset(state) {
  const { open } = state;
  return open && open.params !== open.first ? stepped(state, { ...open, params: open.first }) : {};
}

/** Random parameters of a generator; what is held in the open asset stays. */
export function drawn(state, space) {
  const params = random(space.parameters);
  const { open } = state;
  if (open?.generator !== space.name) {
    return stepped(state, { generator: space.name, params, first: params, result: null, chosen: -1, held: [], view: null, opened: newest(state) });
  }
  for (const name of open.held) params[name] = open.params[name];
  return stepped(state, { ...open, params });
}

/** Hold a parameter, or let it go. */
export function held({ open }, name) {
  const others = open.held.filter((one) => one !== name);
  return { open: { ...open, held: others.length < open.held.length ? others : [...others, name] } };
}

export function undone({ open, before, after }) {
  return before.length ? { open: before.at(-1), before: before.slice(0, -1), after: [...after, open], moving: "" } : {};
}

export function redone({ open, before, after }) {
  return after.length ? { open: after.at(-1), before: [...before, open], after: after.slice(0, -1), moving: "" } : {};
}

/** The held parameters with their values, as an estimate takes them. */
export const fixed = ({ params, held }) => Object.fromEntries(held.map((name) => [name, params[name]]));
