// An estimate from asking to the ranked candidates: progress, cancelling, and what the answer does to the work.
import { calledOff, follow, startEstimate } from "./api.js";
import { find } from "./dom.js";
import * as state from "./state.js";
import { announce, say, tell } from "./toast.js";
import { fixed, opened, ranked } from "./work.js";

const CANDIDATES = 8;
const NOTHING = "Add a picture or words first: the parameters that are not held are estimated from them.";
let stop = null;

export function start() {
  find("#progress .cancel").addEventListener("click", () => stop?.abort());
  const { job } = state.get();
  if (job) watch(job);
}

/** Estimate from what was asked. A new estimate cancels the one before it. */
export async function estimate(asked, { generator = state.get().wanted, held = [], values = {}, seed = 0 } = {}) {
  stop?.abort();
  const given = asked.text ? { text: asked.text } : { picture: asked.picture.id, object: asked.object };
  const request = { ...given, candidates: CANDIDATES, seed, fixed: values };
  if (generator) request.generator = generator;
  progress({ share: 0, note: "Sending" });
  try {
    const job = { id: await startEstimate(request), result: crypto.randomUUID?.() ?? String(Date.now()), asked, held };
    state.set({ job });
    await watch(job);
  } catch (error) {
    progress(null);
    tell(error);
  }
}

/** Estimate the same again around what is held. */
export function again() {
  const { open, asked, results } = state.get();
  const same = results[open?.result]?.asked ?? asked;
  if (!same || !open) return say(NOTHING, "wrong");
  const seed = 1 + Math.floor(Math.random() * 2 ** 31);
  return estimate(same, { generator: open.generator, held: open.held, values: fixed(open), seed });
}

async function watch(job) {
  const called = (stop = new AbortController());
  let last = "";
  const answer = ({ result }) => {
    // Every event carries the newest result; it is taken when it is another than before.
    const text = JSON.stringify(result ?? null);
    if (result && text !== last && called === stop) take(job, { ...result, asked: job.asked });
    last = text;
  };
  try {
    await follow(job.id, (now) => (progress(now), answer(now)), called.signal);
    announce(`${state.get().results[job.result]?.candidates.length ?? 0} candidates are ready.`);
  } catch (error) {
    if (!calledOff(error)) tell(error);
  }
  if (called !== stop) return;
  stop = null;
  progress(null);
  state.set({ job: null });
}

/** The first answer is opened; a later one only improves it. */
function take({ result: name, held }, result) {
  const now = state.get();
  if (now.results[name]) return state.set(ranked(now, name, result));
  const results = { ...now.results, [name]: result };
  state.set(opened({ ...now, results }, name, 0, held));
  if (find("#result").getBoundingClientRect().top > innerHeight / 2) find("#result").scrollIntoView({ behavior: "smooth" });
}

function progress(job) {
  const bar = find("#progress");
  bar.hidden = !job;
  document.body.classList.toggle("estimating", Boolean(job));
  if (!job) return;
  const place = job.place > 0 ? ` (${job.place} before you)` : "";
  find(".note", bar).textContent = `${job.note || "Waiting for a free place"}${place}`;
  find("progress", bar).value = job.share;
}
