// The HTTP API of the server (docs/app.md). Every failure is a Problem with one sentence for the visitor.

const API = "api/v1/";
const ENDED = new Set(["done", "failed", "cancelled"]);
const MOST_LOST = 5;
const LOST = "The server cannot be reached; check the connection and try again.";

export class Problem extends Error {}

/** True for what a request throws when the page itself called it off. */
export const calledOff = (error) => error.name === "AbortError";

async function ask(path, { method = "GET", body, signal } = {}) {
  const plain = body === undefined || body instanceof Blob;
  const headers = plain ? {} : { "Content-Type": "application/json" };
  let answer;
  try {
    answer = await fetch(API + path, { method, signal, headers, body: plain ? body : JSON.stringify(body) });
  } catch (error) {
    throw calledOff(error) ? error : new Problem(LOST);
  }
  if (!answer.ok) throw new Problem(await sentence(answer));
  return answer;
}

async function sentence(answer) {
  const { error } = await answer.json().catch(() => ({}));
  return error ?? `The server answered with the status ${answer.status}.`;
}

const json = async (path, options) => (await ask(path, options)).json();
const post = (path, body, signal) => json(path, { method: "POST", body, signal });

export const about = () => json("about");
export const generators = () => json("generators");
export const upload = (file) => post("pictures", file);
export const pictureUrl = (id) => `${API}pictures/${encodeURIComponent(id)}`;
export const cutOut = (id, corrections, signal) => post(`pictures/${encodeURIComponent(id)}/object`, corrections, signal);
export const startEstimate = async (request) => (await post("estimates", request)).job;
export const startAsset = async (request) => (await post("assets", request)).job;

const training = (id, rest = "") => `trainings/${encodeURIComponent(id)}${rest}`;
export const trainings = () => json("trainings");
export const propose = (file) => post(`trainings?file=${encodeURIComponent(file.name)}`, file);
export const setRanges = (id, ranges, hold) => json(training(id, "/ranges"), { method: "PUT", body: { ranges, hold } });
export const learn = (id, shapes, minutes) => post(training(id, "/learn"), { shapes, minutes });
export const stopTraining = (id) => post(training(id, "/stop"), {});
export const deleteTraining = (id) => ask(training(id), { method: "DELETE" });

/** Calls `report` with the training after each change; `over` when nothing is done for it any more. */
export function followTraining(id, report, over) {
  const events = new EventSource(API + training(id, "/events"));
  const working = new Set(["waiting", "proposing", "learning", "stopping"]);
  events.onmessage = ({ data }) => {
    const now = JSON.parse(data);
    report(now);
    if (!working.has(now.state)) events.close(), over(now);
  };
  return () => events.close();
}

/** The light GLB of parameters. */
export async function preview(generator, params, signal) {
  const answer = await ask("assets/preview", { method: "POST", body: { generator, params }, signal });
  return answer.arrayBuffer();
}

/** The bytes of an address that a result named, such as a finished file. */
export async function bytes(url) {
  const answer = await fetch(url).catch(() => null);
  if (!answer) throw new Problem(LOST);
  if (!answer.ok) throw new Problem(await sentence(answer));
  return answer.blob();
}

/** Follow a job to its result; `report` sees all of its states. When the signal is aborted the server cancels it. */
export function follow(id, report, signal) {
  const path = `${API}jobs/${encodeURIComponent(id)}`;
  return new Promise((resolve, reject) => {
    const events = new EventSource(`${path}/events`);
    let lost = 0;
    const end = (settle, value) => {
      events.close();
      settle(value);
    };
    signal?.addEventListener("abort", () => {
      fetch(path, { method: "DELETE" }).catch(() => {});
      end(reject, new DOMException("The job was cancelled.", "AbortError"));
    });
    events.onmessage = ({ data }) => {
      const job = JSON.parse(data);
      lost = 0;
      if (job.state === "failed") return end(reject, new Problem(job.error));
      if (job.state === "cancelled") return end(reject, new DOMException("The job was cancelled.", "AbortError"));
      report(job);
      if (ENDED.has(job.state)) end(resolve, job.result);
    };
    events.onerror = () => {
      lost += 1;
      if (events.readyState === EventSource.CLOSED) end(reject, new Problem("The server no longer knows this job; ask again."));
      else if (lost > MOST_LOST) end(reject, new Problem(LOST));
    };
  });
}
