// The three ways to ask (picture, drawing, words), and which generator is meant.
import { capital, find, make, percent } from "./dom.js";
import { estimate } from "./estimating.js";
import * as state from "./state.js";
import { say } from "./toast.js";

export function start({ limits, words: reads }, generators) {
  const tabs = [...document.querySelectorAll("#ask [role=tab]")];
  for (const tab of tabs) {
    tab.addEventListener("click", () => choose(tabs, tab));
    tab.addEventListener("keydown", (event) => step(event, tabs, tab));
  }
  find("#tab-words").hidden = !reads;
  const words = find("#words");
  words.maxLength = limits.letters;
  words.value = state.get().asked?.text ?? "";
  if (words.value) choose(tabs, find("#tab-words"));
  find("#use-words").addEventListener("click", () => describe(words.value.trim()));
  words.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && !event.shiftKey) event.preventDefault(), describe(words.value.trim());
  });
  find("#wanted").addEventListener("change", ({ target }) => want(target.value));
  state.listen((now, before) => menu(now, before, generators));
}

/** Open one of the tabs. */
export function open(name) {
  choose([...document.querySelectorAll("#ask [role=tab]")], find(`#tab-${name}`));
}

function choose(tabs, chosen) {
  for (const tab of tabs) {
    tab.setAttribute("aria-selected", String(tab === chosen));
    tab.tabIndex = tab === chosen ? 0 : -1;
    find(`#${tab.getAttribute("aria-controls")}`).hidden = tab !== chosen;
  }
}

function step(event, tabs, tab) {
  const move = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!move) return;
  const next = tabs[(tabs.indexOf(tab) + move + tabs.length) % tabs.length];
  choose(tabs, next);
  next.focus();
}

function describe(text) {
  if (!text) return say("Say in a few words what it is like, for example “a tall bar chair with arms”.", "wrong");
  const asked = { text };
  state.set({ asked });
  return estimate(asked);
}

function want(wanted) {
  state.set({ wanted });
  const { asked } = state.get();
  if (asked) estimate(asked);
}

/** The menu says how likely each generator is for the result that is open. */
function menu(now, before, generators) {
  const result = now.results[now.open?.result];
  // The option above them says "Recognise it".
  const all = find("#wanted").options.length === generators.length + 1;
  if (all && now.wanted === before.wanted && result === before.results[before.open?.result]) return;
  const chances = Object.keys(result?.generators ?? {}).length > 1 ? result.generators : {};
  const options = generators.map(({ name, label }) => {
    const chance = chances[name] === undefined ? "" : ` · ${percent(chances[name])}`;
    return make("option", { value: name, textContent: capital(label) + chance });
  });
  const [likeliest, chance] = Object.entries(chances).sort((one, other) => other[1] - one[1])[0] ?? [];
  const seen = likeliest && `Recognised: ${capital(generators.find(({ name }) => name === likeliest)?.label ?? likeliest)} · ${percent(chance)}`;
  find("#wanted").replaceChildren(make("option", { value: "", textContent: seen ?? "Recognise it" }), ...options);
  find("#wanted").value = now.wanted;
  find("#wanted-part").hidden = generators.length < 2;
}
