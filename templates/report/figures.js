// Cursor and zoom of figures over time: the points that are drawn are the data. Without this script, and on
// paper, the figures are as they were drawn.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
const HINT = "Move to read values, drag to zoom.";
const KEYS = "Arrow keys read values, + and - zoom, 0 shows all.";

function build(name, attributes, parent) {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  parent.append(one);
  return one;
}

function write(value) {
  return String(Number(value.toPrecision(4))).replace("-", "\u2212");
}

// Round numbers between two ends: 1, 2 or 5 times a power of ten.
function listTicks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= raw * 0.99);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k += 1) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

// The place in `values`, which increase, that is nearest to one.
function findNearest(values, value) {
  let low = 0;
  let high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle;
    else high = middle;
  }
  return value - values[low] < values[high] - value ? low : high;
}

function enliven(figure, svg, told) {
  const [left, top, right, bottom, x0, x1, y0, y1] = svg.dataset.frame.split(" ").map(Number);
  const unit = svg.dataset.unit;
  const lines = [...svg.querySelectorAll("polyline[data-label]")].map((line) => {
    const points = line.getAttribute("points").split(" ").map((point) => point.split(",").map(Number));
    return { label: line.dataset.label, x: points.map((one) => one[0]), y: points.map((one) => one[1]) };
  });
  const toTime = (x) => x0 + ((x - left) / (right - left)) * (x1 - x0);
  const toValue = (y) => y0 + ((bottom - y) / (bottom - top)) * (y1 - y0);
  const whole = { left, top, right, bottom };
  let view = whole;

  const ticks = svg.querySelector("g.ticks");
  const drawn = ticks.innerHTML;
  const size = { x: left, y: top, width: right - left, height: bottom - top };
  const plot = build("svg", { ...size, preserveAspectRatio: "none", class: "plot" }, svg);
  plot.style.cssText = `width: ${size.width}px; height: ${size.height}px`;
  plot.append(...svg.querySelectorAll(":scope > polyline.line, :scope > path.line"));
  const chosen = build("rect", { y: top, height: size.height, class: "chosen-part", visibility: "hidden" }, svg);
  const rule = build("path", { class: "cursor", visibility: "hidden" }, svg);

  const tools = document.createElement("div");
  tools.className = "tools";
  tools.innerHTML = '<input type="range" min="0" step="1"><p><span></span> <button type="button" hidden>Whole</button></p>';
  const slider = tools.querySelector("input");
  const read = tools.querySelector("span");
  const back = tools.querySelector("button");
  if (told) read.textContent = HINT;
  slider.setAttribute("aria-label", `Time of the cursor: ${svg.querySelector("title").textContent}`);
  slider.title = KEYS;
  slider.style.cssText = `margin-left: ${(100 * left) / 560}%; width: ${(100 * size.width) / 560}%`;
  svg.after(tools);

  const times = lines[0].x;
  const toShare = (x) => left + ((x - view.left) / (view.right - view.left)) * size.width;

  // The cursor at the sample of the first line that is nearest to x, a place in the whole drawing.
  function point(x) {
    const k = findNearest(times, Math.min(Math.max(x, view.left), view.right));
    slider.value = k;
    const parts = lines.map((line) => {
      const value = write(toValue(line.y[findNearest(line.x, times[k])]));
      return lines.length > 1 ? `${line.label} ${value}` : value;
    });
    read.textContent = `${write(toTime(times[k]))} s: ${parts.join(", ")} ${unit}`;
    slider.setAttribute("aria-valuetext", read.textContent);
    const place = toShare(times[k]);
    rule.setAttribute("d", `M${place},${top}V${bottom}`);
    rule.setAttribute("visibility", "visible");
  }

  function drawTicks() {
    ticks.replaceChildren();
    for (const value of listTicks(toTime(view.left), toTime(view.right), 5)) {
      const x = toShare(left + ((value - x0) / (x1 - x0)) * size.width);
      build("line", { class: "grid", x1: x, y1: top, x2: x, y2: bottom }, ticks);
      const text = write(value);
      // A long number at the end would be cut off.
      const middle = Math.min(x, 556 - 4.05 * text.length);
      build("text", { x: middle, y: bottom + 17, "text-anchor": "middle" }, ticks).textContent = text;
    }
    for (const value of listTicks(toValue(view.bottom), toValue(view.top), 5)) {
      const y = bottom - ((value - toValue(view.bottom)) / (toValue(view.top) - toValue(view.bottom))) * size.height;
      build("line", { class: "grid", x1: left, y1: y, x2: right, y2: y }, ticks);
      build("text", { x: left - 7, y: y + 4, "text-anchor": "end" }, ticks).textContent = write(value);
    }
  }

  // Show the part between two places of the whole drawing, with the height that its lines need.
  function show(from, to) {
    const start = Math.max(left, from);
    const end = Math.min(right, to);
    const inside = lines.flatMap((line) => line.y.filter((_, k) => line.x[k] >= start && line.x[k] <= end));
    if (end - start < size.width * 1e-3 || inside.length < 2) return;
    const all = end - start > size.width * 0.999;
    const low = inside.reduce((one, other) => Math.max(one, other));
    const high = inside.reduce((one, other) => Math.min(one, other));
    const margin = 0.06 * Math.max(low - high, 0.02);
    view = all ? whole : { left: start, right: end, top: high - margin, bottom: low + margin };
    plot.setAttribute("viewBox", `${view.left} ${view.top} ${view.right - view.left} ${view.bottom - view.top}`);
    if (all) ticks.innerHTML = drawn;
    else drawTicks();
    slider.min = times.findIndex((x) => x >= view.left - 1e-9);
    slider.max = times.findLastIndex((x) => x <= view.right + 1e-9);
    back.hidden = all;
    if (rule.getAttribute("visibility") === "visible") point(times[slider.value]);
  }

  function scale(factor) {
    const middle = times[slider.value];
    show(middle - factor * (middle - view.left), middle + factor * (view.right - middle));
  }

  const locate = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()).x;
  const toWhole = (x) => view.left + ((Math.min(Math.max(x, left), right) - left) / size.width) * (view.right - view.left);
  let begin = null;
  svg.addEventListener("pointerdown", (event) => {
    begin = locate(event);
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    const x = locate(event);
    point(toWhole(x));
    if (begin === null) return;
    const [from, to] = [begin, x].map((one) => Math.min(Math.max(one, left), right)).sort((a, b) => a - b);
    chosen.setAttribute("x", from);
    chosen.setAttribute("width", to - from);
    chosen.setAttribute("visibility", "visible");
  });
  svg.addEventListener("pointerup", (event) => {
    const ends = [toWhole(begin ?? 0), toWhole(locate(event))].sort((a, b) => a - b);
    const far = begin !== null && Math.abs(locate(event) - begin) > 6;
    begin = null;
    chosen.setAttribute("visibility", "hidden");
    if (far) show(...ends);
  });
  svg.addEventListener("pointercancel", () => { begin = null; chosen.setAttribute("visibility", "hidden"); });
  svg.addEventListener("dblclick", () => show(left, right));
  back.addEventListener("click", () => { show(left, right); slider.focus(); });
  slider.addEventListener("input", () => point(times[slider.value]));
  slider.addEventListener("focus", () => point(times[slider.value]));
  slider.addEventListener("keydown", (event) => {
    const act = { "+": () => scale(0.5), "=": () => scale(0.5), "-": () => scale(2), 0: () => show(left, right), Escape: () => show(left, right) }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  window.addEventListener("beforeprint", () => show(left, right));
  show(left, right);
  slider.value = Math.floor(times.length / 2);
}

const living = [...document.querySelectorAll("figure")].filter((one) => one.querySelector("svg[data-frame]"));
// The hint once, where it is seen at first.
const first = living.find((one) => !one.closest("details:not([open])")) ?? living[0];
for (const figure of living) enliven(figure, figure.querySelector("svg[data-frame]"), figure === first);
