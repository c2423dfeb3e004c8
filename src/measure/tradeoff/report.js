"use strict";
// The two pictures, the slider and the view may be given after `#` in the address: #a=0&b=3&slider=30&view=difference&gain=16
const element = (id) => document.getElementById(id);
const asked = new URLSearchParams(location.hash.slice(1));
for (const id of ["a", "b"]) {
  pictures.forEach((picture, i) => element(id).add(new Option(picture.name, i)));
}
const number = (name, least, most, otherwise) => {
  const value = Number(asked.get(name) ?? NaN);
  return value >= least && value <= most ? value : otherwise;
};
element("a").value = number("a", 0, pictures.length - 1, Math.min(1, pictures.length - 1));
element("b").value = number("b", 0, pictures.length - 1, 0);
element("slider").value = number("slider", 0, 100, 50);
element("gain").value = number("gain", 1, 64, 8);
for (const button of document.getElementsByName("view")) {
  button.checked = button.value === (asked.get("view") === "difference" ? "difference" : "slider");
}

function show() {
  const isDifference = document.querySelector("[name=view]:checked").value === "difference";
  const [left, right, canvas] = [element("left"), element("right"), element("canvas")];
  const at = element("slider").value;
  left.style.clipPath = `inset(0 ${100 - at}% 0 0)`;
  element("line").style.left = `${at}%`;
  left.hidden = isDifference;
  element("line").hidden = isDifference;
  element("slider").disabled = isDifference;
  canvas.hidden = !isDifference;
  if (isDifference) difference(left, right, canvas);
}

// Red where the left picture is brighter, blue where it is darker.
function difference(left, right, canvas) {
  const [width, height] = [right.naturalWidth, right.naturalHeight];
  if (width === 0 || left.naturalWidth !== width || left.naturalHeight !== height) return;
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const pixels = (image) => {
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, width, height);
  };
  const [a, b] = [pixels(left), pixels(right)];
  const gain = Number(element("gain").value);
  const luminance = (data, i) => 0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2];
  for (let i = 0; i < a.data.length; i += 4) {
    const d = gain * (luminance(a.data, i) - luminance(b.data, i));
    const [full, tail] = [Math.min(255, Math.abs(d)), Math.max(0, Math.min(255, Math.abs(d) - 255))];
    a.data[i] = d > 0 ? full : 0;
    a.data[i + 1] = tail;
    a.data[i + 2] = d > 0 ? 0 : full;
  }
  context.putImageData(a, 0, 0);
}

function load() {
  element("left").src = pictures[element("a").value].data;
  element("right").src = pictures[element("b").value].data;
  Promise.allSettled([element("left").decode(), element("right").decode()]).then(show);
}

for (const id of ["a", "b"]) element(id).addEventListener("change", load);
for (const id of ["slider", "gain"]) element(id).addEventListener("input", show);
for (const button of document.getElementsByName("view")) button.addEventListener("change", show);
// Picture 0 is the reference, and the others are in the order of the circles.
for (const circle of document.querySelectorAll("circle[data-cell]")) {
  circle.addEventListener("click", () => {
    element("a").value = Number(circle.dataset.cell) + 1;
    load();
    element("stage").scrollIntoView({ block: "center" });
  });
}
load();
