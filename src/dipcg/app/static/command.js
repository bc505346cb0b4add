// The command that makes the open asset again, with a button that copies it.
const line = element.querySelector("pre"), copy = element.querySelector(".copy");
let newest = 0; // an answer that was overtaken by a later one is left out

function show() {
  const { text, version } = props.value || { text: "", version: 0 };
  if (version < newest) return;
  newest = version;
  element.querySelector(".empty").hidden = Boolean(text);
  line.hidden = copy.hidden = !text;
  line.textContent = text;
}

copy.addEventListener("click", () => {
  getSelection().selectAllChildren(line); // for pages without the clipboard: those not served from this machine
  if (navigator.clipboard) navigator.clipboard.writeText(line.textContent);
});

watch("value", show);
show();
