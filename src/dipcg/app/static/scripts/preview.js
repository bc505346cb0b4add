// The mesh behind the viewer: the newest parameters win, in whatever order the server answers.
import { calledOff, preview } from "./api.js";
import * as state from "./state.js";
import { tell } from "./toast.js";
import { show } from "./viewer.js";

// A build that takes longer than this is called off when newer parameters wait.
const PATIENCE_MS = 1200;
let newest = 0, running = null, wanted = null;

export function start() {
  state.listen(({ open }, { open: before }) => {
    if (!open || (open.params === before?.params && open.opened === before?.opened)) return;
    wanted = open;
    if (!running) next();
    else if (performance.now() - running.since > PATIENCE_MS) running.stop.abort();
    else running.overdue ??= setTimeout(() => wanted && running?.stop.abort(), PATIENCE_MS);
  });
}

async function next() {
  const open = wanted, number = ++newest, stop = new AbortController();
  wanted = null;
  running = { stop, since: performance.now(), overdue: undefined };
  document.body.classList.add("building");
  try {
    const glb = await preview(open.generator, open.params, stop.signal);
    if (number === newest) await show(glb, open);
  } catch (error) {
    if (!calledOff(error)) tell(error);
  }
  clearTimeout(running.overdue);
  running = null;
  if (wanted) next();
  else document.body.classList.remove("building");
}
