// The picture as the model sees it, then the candidates from their own cameras; a click opens one.
const list = element.querySelector(".strip");
let newest = 0; // an answer that was overtaken by a later one is left out

function figure(image, words, description) {
  const picture = document.createElement("img");
  Object.assign(picture, { src: image, alt: description });
  const caption = document.createElement("span");
  caption.textContent = words;
  return [picture, caption];
}

function tile(found, number) {
  const button = document.createElement("button");
  button.type = "button";
  button.append(...figure(found.image, found.label, found.description));
  button.addEventListener("click", () => {
    if (props.value.chosen >= 0) press(number);
    trigger("select", { index: number });
  });
  return button;
}

function show() {
  const value = props.value;
  if (value && value.version < newest) return;
  newest = (value && value.version) || newest;
  element.querySelector(".note").textContent = (value && value.note) || "";
  element.querySelector(".empty").hidden = Boolean(value && value.chosen >= 0); // examples are offered, none is open
  list.replaceChildren();
  if (!value) return;
  if (value.picture) {
    const photo = document.createElement("div");
    photo.className = "photo";
    photo.append(...figure(value.picture, "your picture", "Your picture, as the model sees it"));
    list.append(photo);
  }
  list.append(...value.candidates.map(tile));
  press(value.chosen);
}

function press(number) {
  [...list.querySelectorAll("button")].forEach((button, i) => button.setAttribute("aria-pressed", String(i === number)));
}

watch("value", show);
show();
