// The lesson's page: typesets formulas, follows the posture, draws the arm, plots energies and hysteresis.
const D = LESSON_DATA, F = LESSON_FUNCTIONS, N = D.coordinates.length, L = D.letters;
const SVG = "http://www.w3.org/2000/svg";
// A text in the language of the page: as the table has it, or by the longest form with {0}, {1} that fits.
const FORMS = Object.keys(D.words).filter((text) => text.includes("{0}")).sort((a, b) => b.length - a.length).map((text) => {
  const seen = new Set(), escaped = (part) => part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
  const pattern = text.split(/\{(\d)\}/).map((part, k, parts) => { if (k % 2 === 0) return escaped(part); if (seen.has(part)) return `\\k<p${part}>`; seen.add(part); return `(?<p${part}>${k === parts.length - 2 && !parts[k + 1] && /[:.] $/.test(parts[k - 1]) ? "." : "(?:(?!; |: ).)"}+?)`; }).join("");
  return [new RegExp(`^${pattern}$`, "s"), D.words[text]];
});
const translate = (text) => {
  if (Object.hasOwn(D.words, text)) return D.words[text];
  if (FORMS.length === 0 || !/[A-Za-z]{2}/.test(text)) return text;
  for (const [pattern, form] of FORMS) {
    const match = pattern.exec(text);
    if (match) return form.replace(/\{(\d)\}/g, (_, k) => translate(match.groups[`p${k}`]));
  }
  for (const mark of ["; ", ": "]) if (text.includes(mark)) return text.split(mark).map(translate).join(mark);
  return text;
};
const tr = (text, ...values) => fillIn(translate(text), ...values);
const inWords = (key, value) => (key === "aria-label" ? translate(String(value)) : value);
const make = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, inWords(key, value));
  node.append(...children.map((child) => (typeof child === "string" ? translate(child) : child)));
  return node;
};
const draw = (parent, tag, attributes = {}, text = "") => {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, inWords(key, value));
  if (text !== "") node.textContent = translate(text);
  parent.append(node);
  return node;
};
// Numbers with a minus sign, and the decimal mark of the language.
const typeset = (text) => text.replaceAll("-", "\u2212").replace(".", document.documentElement.lang === "de" ? "," : ".");
const rough = (x) => typeset(x.toExponential(1));
const show = (x) => {
  if (!Number.isFinite(x)) return "-";
  if (Math.abs(x) < 5e-13) return "0";
  const size = Math.abs(x);
  const text = size >= 1e5 || size < 1e-3 ? x.toExponential(2) : String(Number(x.toPrecision(4)));
  return typeset(text);
};
const short = (x) => {
  if (Math.abs(x) < 5e-13) return "0";
  return typeset(Math.abs(x) < 1e-3 ? x.toExponential(0) : String(Number(x.toPrecision(2))));
};
const setTex = (node, latex, display = false) =>
  katex.render(latex, node, { displayMode: display, throwOnError: false, strict: "ignore", output: "htmlAndMathml" });
const plain = (latex) => latex.replace(/\\(?:mathit|mathrm|mathsf|,)|[{}\\^]/g, "");
const tex = (latex) => { const node = make("span", { class: "tex" }); setTex(node, latex); return node; };

// The head of a column or row is read with each of its cells: as plain text.
const name = (node, latex) => { node.setAttribute("role", "math"); node.setAttribute("aria-label", plain(latex)); return node; };
const named = (latex) => name(tex(latex), latex);

// Formulas.
// C divides whole numbers whole, and has no powers.
const writeC = (text) => text.replace(/\((\d+)\/(\d+)\)/g, "($1.0/$2.0)").replace(/(\w+(?:\([^()]*\))?)\*\*(\d+)/g, "pow($1, $2)");
for (const node of document.querySelectorAll(".tex")) {
  const latex = node.textContent, formula = node.closest(".formula");
  const wide = formula !== null && formula.classList.contains("wide");
  setTex(node, formula && !wide ? `\\displaystyle ${latex}` : latex, wide);
  if (node.closest("th")) name(node, latex);
  if (!formula) continue;
  formula.dataset.tex = latex;
  const bar = make("span", { class: "copy" });
  const add = (label, text) => {
    const button = make("button", { type: "button", "aria-label": `Copy as ${label}` }, label);
    button.addEventListener("click", () => {
      const done = () => { button.textContent = tr("copied"); setTimeout(() => { button.textContent = label; }, 1200); };
      if (navigator.clipboard) navigator.clipboard.writeText(text).then(done, () => {});
    });
    bar.append(button);
  };
  add("LaTeX", latex);
  if (formula.dataset.sympy) { add("SymPy", formula.dataset.sympy); add("C", writeC(formula.dataset.sympy)); }
  formula.append(bar);
}
document.querySelectorAll(".scroll").forEach((node, k) => node.setAttribute("aria-label", tr("Table {0}", k + 1)));
const fitWide = () => {
  for (const set of document.querySelectorAll(".formula.wide .set")) {
    const inner = set.querySelector(".katex-display");
    if (!inner) continue;
    inner.style.fontSize = "";
    const room = set.clientWidth, need = set.scrollWidth;
    if (need > room && room > 0) inner.style.fontSize = `${Math.max(0.55, room / need - 0.01)}em`;
    set.toggleAttribute("tabindex", set.scrollWidth > set.clientWidth + 1);
  }
};

// Posture, and all that follows from it.
const middle = (joint, place) => {
  const start = joint.prismatic ? 0.12 : [0.5, 0.7, -0.6, 0.8, 0.5, -0.4, 0.3][place % 7];
  if (!joint.limits) return start;
  const [low, high] = joint.limits;
  return Math.min(Math.max(start, low + 0.1 * (high - low)), high - 0.1 * (high - low));
};
const state = {
  q: D.coordinates.map((joint, place) => middle(D.joints[joint], place)),
  dq: D.coordinates.map((_, place) => [0.8, -0.6, 1.1, 0.5, -0.9, 0.7, 0.4][place % 7]),
};
const spread = (values) => D.joints.map((joint) => joint.multiplier * values[D.coordinates.indexOf(joint.master)]);
const computeValues = (q, dq) => {
  const v = { ...D.values };
  spread(q).forEach((value, k) => { v[`q${k + 1}`] = value; });
  spread(dq).forEach((value, k) => { v[`dq${k + 1}`] = value; v[`ddq${k + 1}`] = 0; });
  for (const [name, formula] of LESSON_FORMULAS) v[name] = formula(v);
  return v;
};
const computePoses = (q) => {
  const angles = spread(q), poses = [];
  D.joints.forEach((joint, k) => {
    const c = joint.prismatic ? 1 : Math.cos(angles[k]), s = joint.prismatic ? 0 : Math.sin(angles[k]);
    const own = joint.rotation.map(([x, y, z]) => [x * c + y * s, -x * s + y * c, z]);
    const start = joint.origin.map((value, i) => value + (joint.prismatic ? joint.rotation[i][2] * angles[k] : 0));
    if (joint.parent < 0) { poses.push({ R: own, p: start }); return; }
    const { R, p } = poses[joint.parent];
    const R2 = R.map((row) => [0, 1, 2].map((j) => row[0] * own[0][j] + row[1] * own[1][j] + row[2] * own[2][j]));
    poses.push({ R: R2, p: p.map((value, i) => value + R[i][0] * start[0] + R[i][1] * start[1] + R[i][2] * start[2]) });
  });
  return poses;
};
const along = (pose, vector) => pose.p.map((value, i) => value + pose.R[i][0] * vector[0] + pose.R[i][1] * vector[1] + pose.R[i][2] * vector[2]);
const jointPath = (k) => { const path = []; for (let j = k; j >= 0; j = D.joints[j].parent) path.push(j); return path; };
const norm = (vector) => Math.hypot(...vector);
const REACH = Math.max(0.2, ...D.joints.map((_, k) => jointPath(k).reduce(
  (total, j) => total + norm(D.joints[j].origin) + (D.joints[j].prismatic ? 0.2 : 0), norm(D.joints[k].tip))));

// The arm.
const flat = D.joints.every((joint) => joint.prismatic || Math.abs(joint.rotation[2][2]) > 0.999) && Math.abs(D.gravity[2]) < 1e-9;
const view = flat ? { turn: 0, tilt: Math.PI / 2 } : { turn: -0.9, tilt: 0.42 };
const project = ([x, y, z]) => {
  // A flat arm is seen along z; any other from a side, z upwards.
  const a = x * Math.cos(view.turn) - y * Math.sin(view.turn), b = x * Math.sin(view.turn) + y * Math.cos(view.turn);
  return [a, b * Math.sin(view.tilt) + z * Math.cos(view.tilt)];
};
let playing = null;
// Frames of the joints, or those of the standard rows from the base on, each with its number.
const listFrames = (poses, rows) => {
  if (!rows) return poses.map((pose, k) => ({ ...pose, number: k + 1 }));
  const placed = poses.map((pose, k) => {
    const own = D.joints[k].row;
    return { R: pose.R.map((row) => [0, 1, 2].map((j) => row[0] * own[0][j] + row[1] * own[1][j] + row[2] * own[2][j])), p: along(pose, own.map((row) => row[3])), number: k + 1 };
  });
  return [{ R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], p: [0, 0, 0], number: 0 }, ...placed];
};
const drawArm = (svg, { triads, rows, labels, width, height }) => {
  svg.replaceChildren();
  const q = playing ? playing.q() : state.q, poses = computePoses(q);
  const points = [[0, 0, 0], ...poses.map((pose, k) => along(pose, D.joints[k].tip)), ...poses.map((pose) => pose.p)];
  const flatPoints = points.map(project), reach = REACH;
  let [x0, x1] = [Math.min(...flatPoints.map((p) => p[0])), Math.max(...flatPoints.map((p) => p[0]))];
  let [y0, y1] = [Math.min(...flatPoints.map((p) => p[1])), Math.max(...flatPoints.map((p) => p[1]))];
  const size = Math.max((x1 - x0) / (width - 90), (y1 - y0) / (height - 90), 1.05 * reach / Math.min(width, height) * 0.95);
  const [cx, cy] = [(x0 + x1) / 2, (y0 + y1) / 2];
  const place = (point) => { const [a, b] = project(point); return [width / 2 + (a - cx) / size, height / 2 - (b - cy) / size]; };
  const line = (a, b, attributes) => {
    const [[xa, ya], [xb, yb]] = [place(a), place(b)];
    return draw(svg, "line", { x1: xa.toFixed(1), y1: ya.toFixed(1), x2: xb.toFixed(1), y2: yb.toFixed(1), ...attributes });
  };
  const grid = reach / 2;
  if (!flat) for (let k = -2; k <= 2; k += 1) {
    line([k * grid / 2, -grid, 0], [k * grid / 2, grid, 0], { stroke: "var(--rule)" });
    line([-grid, k * grid / 2, 0], [grid, k * grid / 2, 0], { stroke: "var(--rule)" });
  }
  const pull = norm(D.gravity);
  if (pull > 0) {
    const g = D.gravity.map((value) => value / pull), [ax, ay] = project(g);
    const length = Math.hypot(ax, ay);
    if (length > 0.1) {
      const [bx, by] = [width - 46, 26], [ex, ey] = [bx + 30 * ax / length * Math.abs(length), by - 30 * ay / length * Math.abs(length)];
      const shift = ey < by ? 30 : 0;
      draw(svg, "line", { x1: bx, y1: by + shift, x2: ex.toFixed(1), y2: (ey + shift).toFixed(1), stroke: "var(--soft)", "stroke-width": 1.6 });
      draw(svg, "circle", { cx: ex.toFixed(1), cy: (ey + shift).toFixed(1), r: 3, fill: "var(--soft)" });
      draw(svg, "text", { x: bx - 14, y: by + shift + 12, class: "soft" }, "g");
    }
  }
  const footOf = (k, before) => {
    const { R, p } = poses[k], z = R.map((row) => row[2]), way = z.reduce((sum, value, i) => sum + value * (before[i] - p[i]), 0);
    return p.map((value, i) => value + way * z[i]);
  };
  const thick = { stroke: "var(--link)", "stroke-width": Math.max(5, Math.min(12, 60 / D.joints.length)), "stroke-linecap": "round", opacity: 0.75 };
  D.joints.forEach((joint, k) => {
    const before = joint.parent < 0 ? [0, 0, 0] : poses[joint.parent].p;
    const style = joint.parent < 0 ? { ...thick, stroke: "var(--rule)" } : thick;
    line(before, joint.prismatic ? footOf(k, before) : poses[k].p, style);
    // A prismatic joint: its guide stays with the parent, the link moves along the axis.
    if (joint.prismatic) line(footOf(k, before), poses[k].p, { ...thick, "stroke-width": 0.6 * thick["stroke-width"] });
    if (!D.joints.some((other) => other.parent === k)) line(poses[k].p, along(poses[k], joint.tip), thick);
  });
  const arm = reach * (triads ? 0.13 : 0.09);
  const taken = [];
  D.joints.forEach((joint, k) => {
    const pose = poses[k], focus = playing && playing.joint === k;
    if (triads || focus) line(along(pose, [0, 0, -1.3 * arm]), along(pose, [0, 0, 1.3 * arm]), { stroke: "var(--z)", "stroke-dasharray": "5 3", "stroke-width": focus ? 2.4 : 1 });
    const [x, y] = place(joint.prismatic ? footOf(k, joint.parent < 0 ? [0, 0, 0] : poses[joint.parent].p) : pose.p);
    draw(svg, joint.prismatic ? "rect" : "circle", joint.prismatic
      ? { x: (x - 5).toFixed(1), y: (y - 5).toFixed(1), width: 10, height: 10, fill: "var(--ground)", stroke: "var(--accent)", "stroke-width": 2 }
      : { cx: x.toFixed(1), cy: y.toFixed(1), r: 5, fill: "var(--ground)", stroke: "var(--accent)", "stroke-width": 2 });
  });
  for (const pose of triads ? listFrames(poses, rows) : []) {
    const end = (x, y, z) => along(pose, [x * arm, y * arm, z * arm]);
    line(pose.p, end(1, 0, 0), { stroke: "var(--x)", "stroke-width": 2.2 });
    line(pose.p, end(0, 1, 0), { stroke: "var(--y)", "stroke-width": 1.6 });
    line(pose.p, end(0, 0, 1), { stroke: "var(--z)", "stroke-width": 2.2 });
    if (labels) {
      const write = (point, text, colour) => {
        let [u, w] = place(point);
        u += 4; w -= 4;
        for (let tries = 0; tries < 8 && taken.some(([a, b]) => Math.abs(a - u) < 17 && Math.abs(b - w) < 12); tries += 1) w += tries % 2 ? -13 * (tries + 1) : 13 * (tries + 1);
        taken.push([u, w]);
        draw(svg, "text", { x: Math.min(Math.max(u, 2), width - 18).toFixed(1), y: Math.min(Math.max(w, 12), height - 4).toFixed(1), style: `fill: ${colour}; font-weight: 600` }, text);
      };
      write(end(1.15, 0, 0), `x${pose.number}`, "var(--x)");
      write(end(0, 0, 1.15), `z${pose.number}`, "var(--z)");
    }
  }
  if (playing && playing.kind) {
    const pose = poses[playing.joint], ball = along(pose, [0, 0, arm * 0.9]);
    const [x, y] = place(ball);
    draw(svg, "circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: 8, fill: "var(--warm)" });
    if (playing.kind === "YY") {
      const [x2, y2] = place(along(pose, [0, 0, -arm * 0.9]));
      draw(svg, "circle", { cx: x2.toFixed(1), cy: y2.toFixed(1), r: 8, fill: "var(--warm)" });
    }
  }
};
const pictures = [];
const addPicture = (parent, label, options) => {
  const svg = draw(parent, "svg", { viewBox: `0 0 ${options.width} ${options.height}`, class: "turn", role: "img", "aria-label": label, tabindex: 0 });
  let last = null;
  svg.addEventListener("pointerdown", (event) => { last = [event.clientX, event.clientY]; svg.setPointerCapture(event.pointerId); });
  svg.addEventListener("pointermove", (event) => {
    if (!last) return;
    turnView(0.01 * (event.clientX - last[0]), 0.01 * (event.clientY - last[1]));
    last = [event.clientX, event.clientY];
  });
  svg.addEventListener("pointerup", () => { last = null; });
  svg.addEventListener("pointercancel", () => { last = null; });
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (step) { turnView(...step); event.preventDefault(); }
  });
  pictures.push(() => drawArm(svg, options));
};
const turnView = (turn, tilt) => {
  view.turn -= turn;
  view.tilt = Math.min(Math.max(view.tilt + tilt, -Math.PI / 2), Math.PI / 2);
  for (const picture of pictures) picture();
};

// The panel.
const panel = document.getElementById("panel");
const left = make("div"), right = make("div");
panel.append(left, right);
addPicture(left, "The arm at the chosen posture; drag or use the arrow keys to turn it", { width: 360, height: 300, triads: false, labels: false });
const told = make("p", { class: "caption", "aria-live": "polite" }, "Drag the picture to turn it.");
left.append(told);
const sliders = [];
const addSlider = (parent, latex, name, low, high, value, unit, change) => {
  const range = make("input", { type: "range", min: low, max: high, step: (high - low) / 2000, "aria-label": name });
  const output = make("output"), label = make("span");
  setTex(label, latex);
  range.value = value;
  const write = () => { output.textContent = unit(Number(range.value)); };
  range.addEventListener("input", () => { write(); change(Number(range.value)); });
  write();
  parent.append(make("div", { class: "slider" }, label, range, output));
  return { set: (x) => { range.value = x; write(); } };
};
const degrees = (x) => `${show(Number((x * 180 / Math.PI).toFixed(1)))}\u00b0`, metres = (x) => `${show(Number(x.toFixed(4)))} m`;
D.coordinates.forEach((index, place) => {
  const joint = D.joints[index], [low, high] = joint.limits || (joint.prismatic ? [-0.5, 0.5] : [-Math.PI, Math.PI]);
  sliders.push(addSlider(right, joint.latex, `Position of joint ${index + 1}`, low, high, state.q[place], joint.prismatic ? metres : degrees,
    (value) => { state.q[place] = value; stopPlaying(); update(); }));
});
const rates = make("details", {}, make("summary", {}, "Velocities"));
D.coordinates.forEach((index, place) => {
  const joint = D.joints[index];
  addSlider(rates, `\\dot{${joint.latex.split("_")[0]}}_{${index + 1}}`, `Velocity of joint ${index + 1}`, -2, 2, state.dq[place],
    (x) => `${show(x)} ${joint.prismatic ? "m/s" : "rad/s"}`, (value) => { state.dq[place] = value; update(); });
});
right.append(rates);
const readout = make("dl", { class: "readout" });
right.append(readout);
const numbers = {};
const addNumber = (key, ...title) => { numbers[key] = make("dd"); readout.append(make("dt", {}, ...title), numbers[key]); };
addNumber("kinetic", "kinetic energy ", tex(L.kinetic));
addNumber("potential", "potential energy ", tex(L.potential));
addNumber("manipulability", "manipulability");
addNumber("agreement", "formulas - code");
const buttons = make("div", { class: "buttons" });
right.append(buttons);
const addButton = (text, action) => { const button = make("button", { type: "button" }, text); button.addEventListener("click", action); buttons.append(button); };
const move = (q) => { state.q = q; q.forEach((value, k) => sliders[k].set(value)); stopPlaying(); update(); };
addButton("zero posture", () => move(state.q.map((_, k) => { const limits = D.joints[D.coordinates[k]].limits; return limits ? Math.min(Math.max(0, limits[0]), limits[1]) : 0; })));
addButton("start again", () => move(D.coordinates.map((joint, place) => middle(D.joints[joint], place))));

// Motions that do not separate parameters.
const stopPlaying = () => { playing = null; };
const WHY = {
  M: (j) => `Joint ${j} turns: a mass on its axis stays where it is. No torque of joint ${j} shows it, and the link before carries it.`,
  MZ: (j) => `Joint ${j} turns: a mass shifted along its axis stays where it is. Only the link before feels it.`,
  YY: (j) => `Joint ${j} turns: masses on its axis add as much to XX as to YY and nothing to ZZ. Only XX \u2212 YY turns with the link; the rest belongs to the link before.`,
};
for (const button of document.querySelectorAll("button.show")) {
  const joint = Number(button.dataset.joint) - 1, kind = button.dataset.kind;
  button.setAttribute("aria-label", tr("Show the motion of joint {0}", joint + 1));
  button.addEventListener("click", () => {
    const start = performance.now(), place = D.coordinates.indexOf(D.joints[joint].master), from = [...state.q];
    told.textContent = translate(WHY[kind](joint + 1));
    playing = { joint, kind, q: () => from.map((value, k) => (k === place ? value + 0.9 * Math.sin((performance.now() - start) / 350) : value)) };
    const mine = playing, still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (window.innerWidth < 1024) panel.scrollIntoView({ block: "start" });
    const step = () => {
      if (playing !== mine) return;
      pictures[0]();
      if (performance.now() - start > 5500 || still) { if (!still) { playing = null; for (const picture of pictures) picture(); } return; }
      requestAnimationFrame(step);
    };
    step();
  });
}

// Small plots.
const plot = (svg, series, { width = 640, height = 260, x: xTitle = "", y: yTitle = "", equal = null, marks = [] } = {}) => {
  svg.replaceChildren();
  const every = series.flatMap((one) => one.points).filter(([a, b]) => Number.isFinite(a) && Number.isFinite(b));
  if (!every.length) return;
  let [x0, x1, y0, y1] = equal || [Infinity, -Infinity, Infinity, -Infinity];
  if (!equal) for (const [a, b] of every) { x0 = Math.min(x0, a); x1 = Math.max(x1, a); y0 = Math.min(y0, b); y1 = Math.max(y1, b); }
  if (y1 - y0 < 1e-9) { y0 -= 1; y1 += 1; }
  if (x1 - x0 < 1e-12) { x0 -= 1; x1 += 1; }
  const pad = 0.06 * (y1 - y0);
  y0 -= pad; y1 += pad;
  const X = (a) => 54 + (a - x0) / (x1 - x0) * (width - 68), Y = (b) => height - 34 - (b - y0) / (y1 - y0) * (height - 48);
  const ticks = (low, high) => { const raw = (high - low) / 5, ten = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find((k) => k * ten >= raw) * ten; const list = []; for (let t = Math.ceil(low / step) * step; t <= high + 1e-9 * step; t += step) list.push(Math.abs(t) < 1e-9 * step ? 0 : t); return list; };
  for (const t of ticks(y0, y1)) { draw(svg, "line", { x1: 54, x2: width - 14, y1: Y(t), y2: Y(t), stroke: "var(--rule)" }); if (!yTitle || Y(t) > 24) draw(svg, "text", { x: 48, y: Y(t) + 4, "text-anchor": "end", class: "soft" }, show(Number(t.toPrecision(3)))); }
  for (const t of ticks(x0, x1)) draw(svg, "text", { x: X(t), y: height - 18, "text-anchor": "middle", class: "soft" }, show(Number(t.toPrecision(3))));
  draw(svg, "text", { x: width - 14, y: height - 4, "text-anchor": "end", class: "soft" }, xTitle);
  draw(svg, "text", { x: 4, y: 12, class: "soft" }, yTitle);
  for (const one of series) {
    if (one.points.length < 2) continue;
    draw(svg, "polyline", { points: one.points.map(([a, b]) => `${X(a).toFixed(1)},${Y(b).toFixed(1)}`).join(" "), fill: "none", stroke: one.colour, "stroke-width": one.wide || 1.8, "stroke-dasharray": one.dash || "none", opacity: one.fade || 1, "stroke-linejoin": "round" });
  }
  for (const [a, b, colour] of marks) draw(svg, "circle", { cx: X(a), cy: Y(b), r: 5, fill: colour });
  return { X, Y };
};
const legend = (entries) => {
  const node = make("p", { class: "caption" });
  entries.forEach(([colour, text], k) => { const dot = make("span", { style: `color: ${colour}`, "aria-hidden": "true" }, "\u25ac "); node.append(k ? "   " : "", dot, translate(text)); });
  return node;
};

// Widgets, each with what it does when the posture changes.
const updates = [];
const widget = (name, build) => { for (const node of document.querySelectorAll(`.widget[data-widget="${name}"]`)) build(node); };
for (const [name, label, text] of [["rows", "Frames of the table; drag or use the arrow keys to turn them", "The frames of the table and of the matrices A."], ["frames", "Frames of all links; drag or use the arrow keys to turn them", ""]]) widget(name, (node) => {
  addPicture(node, label, { width: 680, height: 400, triads: true, rows: name === "rows", labels: D.joints.length < 9 });
  const note = tr("x red, y green, z blue; circles: revolute joints, squares: prismatic joints. Drag the picture to turn it; sliders move the joints.");
  node.append(make("p", { class: "caption" }, text ? `${tr(text)} ${note}` : note));
});
const heat = (node, rows, title, unit) => {
  const most = Math.max(1e-12, ...rows.flat().map(Math.abs)), box = make("div", { class: `heat${rows.length > 5 ? " many" : ""}`, role: "img", "aria-label": title, tabindex: rows.length > 8 ? 0 : -1, style: `grid-template-columns: repeat(${rows[0].length}, minmax(${rows.length > 8 ? "2.7rem" : "0"}, 1fr))` });
  for (const row of rows) for (const value of row) {
    const share = Math.abs(value) / most;
    box.append(make("span", { style: `background: rgba(var(--heat), ${(0.06 + 0.42 * Math.sqrt(share)).toFixed(3)})` }, rows.length > 5 ? short(value) : show(value)));
  }
  node.replaceChildren(box, make("p", { class: "caption" }, `${title}${unit}`));
};
const square = (flatMatrix, columns) => Array.from({ length: flatMatrix.length / columns }, (_, i) => Array.from(flatMatrix.slice(i * columns, (i + 1) * columns)));
widget("mass", (node) => updates.push((now) => heat(node, now.M, "The inertia matrix at this posture, from generated code", ", in kg m\u00b2 (kg m, kg at prismatic joints)")));
widget("gravity", (node) => {
  const height = 26 * N + 30, svg = draw(node, "svg", { viewBox: `0 0 640 ${height}`, role: "img", "aria-label": "Torques and forces that hold the arm at rest" });
  node.append(make("p", { class: "caption" }, D.coordinates.some((k) => D.joints[k].prismatic) ? "Torques (N m) and forces of prismatic joints (N) that hold the arm at rest at this posture." : "Torques (N m) that hold the arm at rest at this posture."));
  updates.push((now) => {
    svg.replaceChildren();
    const most = Math.max(1e-9, ...Array.from(now.g, Math.abs));
    now.g.forEach((value, k) => {
      const y = 26 * k + 16, width = 225 * Math.abs(value) / most;
      draw(svg, "text", { x: 8, y: y + 13, class: "soft" }, `joint ${D.coordinates[k] + 1}`);
      draw(svg, "rect", { x: value < 0 ? 330 - width : 330, y, width: Math.max(width, 0.5), height: 17, rx: 3, fill: value < 0 ? "var(--warm)" : "var(--accent)", opacity: 0.75 });
      draw(svg, "text", { x: 632, y: y + 13, "text-anchor": "end" }, show(value));
    });
    draw(svg, "line", { x1: 330, x2: 330, y1: 8, y2: height - 8, stroke: "var(--soft)" });
  });
});
widget("jacobian", (node) => updates.push((now) => {
  const heads = ["part", ...D.coordinates.map((k) => `joint ${k + 1}`)], rows = ["v_x", "v_y", "v_z", "\\omega_x", "\\omega_y", "\\omega_z"];
  const table = make("table", {}, make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, text)))));
  const body = make("tbody");
  now.J.forEach((row, k) => body.append(make("tr", {}, make("th", { scope: "row" }, named(rows[k])), ...row.map((value) => make("td", {}, show(value))))));
  table.append(body);
  node.replaceChildren(make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Jacobian" }, table), make("p", { class: "caption" }, `The Jacobian of the last link at this posture. Manipulability, the root of det ${N < 6 ? "J\u1d40J" : "JJ\u1d40"}: ${show(now.manipulability)}.`));
}));
const rateOfMass = (q, dq) => {
  const h = 1e-5, near = (sign) => F.mass_matrix(q.map((value, k) => value + sign * h * dq[k]), D.beta);
  const [ahead, behind] = [near(1), near(-1)];
  return ahead.map((value, k) => (value - behind[k]) / (2 * h));
};
widget("skew", (node) => updates.push((now) => {
  const slope = rateOfMass(state.q, state.dq), C = F.coriolis_matrix(state.q, state.dq, D.beta);
  const S = square(slope.map((value, k) => value - 2 * C[k]), N);
  let worst = 0;
  S.forEach((row, i) => row.forEach((value, j) => { worst = Math.max(worst, Math.abs(value + S[j][i])); }));
  const [M, C2] = [L.mass, L.coriolis].map(plain);
  heat(node, S.map((row) => row.map((x) => (Math.abs(x) < 1e-8 ? 0 : x))), `d${M}/dt \u2212 2${C2} at this posture and these velocities, d${M}/dt by differences`, `; its largest deviation from skew: ${rough(worst)}`);
}));
const determinant = (matrix) => {
  const a = matrix.map((row) => [...row]);
  let result = 1;
  for (let i = 0; i < a.length; i += 1) {
    let best = i;
    for (let k = i; k < a.length; k += 1) if (Math.abs(a[k][i]) > Math.abs(a[best][i])) best = k;
    if (a[best][i] === 0) return 0;
    if (best !== i) { [a[i], a[best]] = [a[best], a[i]]; result = -result; }
    result *= a[i][i];
    for (let k = i + 1; k < a.length; k += 1) for (let j = a.length - 1; j >= i; j -= 1) a[k][j] -= a[k][i] / a[i][i] * a[i][j];
  }
  return result;
};
const gram = (J, byColumns) => {
  const size = byColumns ? J[0].length : J.length;
  return Array.from({ length: size }, (_, i) => Array.from({ length: size }, (_, j) => byColumns ? J.reduce((sum, row) => sum + row[i] * row[j], 0) : J[i].reduce((sum, value, k) => sum + value * J[j][k], 0)));
};
widget("energy", (node) => {
  const svg = draw(node, "svg", { viewBox: "0 0 640 280", role: "img", "aria-label": "Energy and work along a motion" });
  node.append(legend([["var(--accent)", "kinetic"], ["var(--warm)", "potential"], ["var(--ink)", "their sum, less the start"], ["var(--green)", "work of the torques"]]));
  const note = make("p", { class: "caption" });
  node.append(note);
  updates.push(() => {
    const steps = 600, end = 4, h = end / steps, curves = [[], [], [], []];
    let work = 0, worst = 0, first = null, most = 0, before = 0;
    const motion = (t) => {
      const q = [], dq = [], ddq = [];
      state.q.forEach((start, k) => {
        const w = 1.3 + 0.55 * (k % 4), a = D.joints[D.coordinates[k]].prismatic ? 0.06 : 0.5;
        q.push(start + a * (1 - Math.cos(w * t))); dq.push(a * w * Math.sin(w * t)); ddq.push(a * w * w * Math.cos(w * t));
      });
      return [q, dq, ddq];
    };
    const power = (t) => { const [q, dq, ddq] = motion(t), tau = F.inverse_dynamics(q, dq, ddq, D.beta); return tau.reduce((sum, value, k) => sum + value * dq[k], 0); };
    for (let k = 0; k <= steps; k += 1) {
      const t = k * h, [q, dq] = motion(t), { T, V } = F.energy(q, dq, D.beta), now = power(t);
      if (k) work += h / 6 * (before + 4 * power(t - h / 2) + now);
      before = now;
      if (first === null) first = T[0] + V[0];
      worst = Math.max(worst, Math.abs(T[0] + V[0] - first - work)); most = Math.max(most, Math.abs(work), T[0]);
      curves[0].push([t, T[0]]); curves[1].push([t, V[0] - first]); curves[2].push([t, T[0] + V[0] - first]);
      if (k % 12 < 6) curves[3].push([t, work]); else curves[3].push([t, NaN]);
    }
    const dashed = []; let part = [];
    for (const point of curves[3]) { if (Number.isNaN(point[1])) { if (part.length) dashed.push(part); part = []; } else part.push(point); }
    if (part.length) dashed.push(part);
    plot(svg, [{ points: curves[0], colour: "var(--accent)" }, { points: curves[1], colour: "var(--warm)" }, { points: curves[2], colour: "var(--ink)", wide: 1.4 }, ...dashed.map((points) => ({ points, colour: "var(--green)", wide: 4.5, fade: 0.8 }))], { height: 280, x: "time, s", y: "energy, J" });
    note.textContent = translate(`Motion from this posture, torques of generated code. Work and energy differ by at most ${rough(worst)} J, of ${show(most)} J.`);
  });
});

// Everything again for a new posture.
const update = () => {
  const v = computeValues(state.q, state.dq), now = { v };
  now.M = square(F.mass_matrix(state.q, D.beta), N);
  now.g = F.gravity(state.q, D.beta);
  now.J = square(F.jacobian(state.q), N);
  const { T, V } = F.energy(state.q, state.dq, D.beta);
  now.manipulability = Math.sqrt(Math.max(0, determinant(gram(now.J, N < 6))));
  for (const node of document.querySelectorAll(".value")) {
    const value = v[node.dataset.name];
    node.textContent = value === undefined ? "" : `= ${show(value)}${node.dataset.unit ? ` ${node.dataset.unit}` : ""}`;
  }
  let worst = 0;
  now.M.forEach((row, i) => row.forEach((value, j) => { const mine = v[`M${i + 1}_${j + 1}`]; if (mine !== undefined) worst = Math.max(worst, Math.abs(mine - value)); }));
  const C = square(F.coriolis_matrix(state.q, state.dq, D.beta), N);
  C.forEach((row, i) => row.forEach((value, j) => { const mine = v[`C${i + 1}_${j + 1}`]; if (mine !== undefined) worst = Math.max(worst, Math.abs(mine - value)); }));
  now.g.forEach((value, k) => { const mine = v[`g${k + 1}_`]; if (mine !== undefined) worst = Math.max(worst, Math.abs(mine - value)); });
  numbers.kinetic.textContent = `${show(T[0])} J`;
  numbers.potential.textContent = `${show(V[0])} J`;
  numbers.manipulability.textContent = show(now.manipulability);
  numbers.agreement.textContent = worst === 0 ? "0" : rough(worst);
  for (const one of updates) one(now);
  for (const picture of pictures) picture();
  window.lesson = { ...window.lesson, state, values: v, mass: now.M, gravity: Array.from(now.g), worst, move, springs };
};

// Springs with hysteresis.
const springs = [];
const readSpring = (place) => {
  const number = D.coordinates[place] + 1, found = { k0: 0, kc: 0, k: [], r: [], s: [], R: [] };
  D.springs.forEach((entry, at) => {
    const match = /^([a-zA-Z]+?)(\d*)_(\d+)$/.exec(entry.name);
    if (!match || Number(match[3]) !== number) return;
    if (entry.name.startsWith("k0_")) found.k0 = at;
    else if (match[1] === "kc") found.kc = at;
    else if (match[2]) found[match[1]][Number(match[2]) - 1] = at;
  });
  return found;
};
const outer = (v, knees) => knees.reduce((total, [R, s]) => total + s * (R > 0 ? Math.max(v - R, 0) : Math.min(v - R, 0)), v);
const outerIntegral = (v, knees) => knees.reduce((total, [R, s]) => total + s * (R > 0 ? Math.max(v - R, 0) : Math.min(v - R, 0)) ** 2 / 2, v * v / 2);
const startSprings = () => {
  const h = D.springs.map((entry) => entry.value), elastic = D.stops.map((count, k) => ({ count, k })).filter(({ k }) => D.springs.some((entry) => entry.name.endsWith(`_${D.coordinates[k] + 1}`)));
  const offsets = D.stops.map((_, k) => D.stops.slice(0, k).reduce((a, b) => a + b, 0)), total = D.stops.reduce((a, b) => a + b, 0);
  const one = { h, joint: elastic[0].k, phi: D.stops.map(() => 0), P: new Float64Array(total), trail: [], work: 0, stored: 0, torque: 0, reversal: [0, 0], way: 0 };
  const parts = () => { const at = readSpring(one.joint); return { k0: h[at.k0], k: at.k.map((i) => h[i]), r: at.r.map((i) => h[i]), knees: at.R.map((i, n) => [h[i], h[at.s[n]]]), at }; };
  const evaluate = (phi) => {
    const torsions = one.phi.map((value, k) => (k === one.joint ? phi : value));
    const found = F.hysteresis_step(torsions, ...(total ? [one.P] : []), h);
    return found instanceof Float64Array ? { tau_J: found, P_next: one.P } : found;
  };
  const inner = (phi) => { const { k0, k } = parts(), start = offsets[one.joint]; return k.reduce((sum, stiffness, i) => sum + stiffness * (phi - one.P[start + i]), k0 * phi); };
  const storedEnergy = () => {
    // phi = sum of w' P'_r'[v]; U of each play is half of what both its edges would hold.
    const { k0, k, r, knees } = parts(), start = offsets[one.joint], v = inner(one.phi[one.joint]);
    let W = k0 + k.reduce((a, b) => a + b, 0), edge = 0, before = 0, energy = outerIntegral(v, knees) / W;
    const rest = (i) => k.slice(i + 1).reduce((sum, stiffness, n) => sum + stiffness * one.P[start + i + 1 + n], 0);
    k.forEach((stiffness, i) => {
      edge += W * (r[i] - before); before = r[i];
      const slope = W - stiffness, play = slope * one.P[start + i] - rest(i);
      energy += 0.5 * (1 / slope - 1 / W) * (outerIntegral(play + edge, knees) + outerIntegral(play - edge, knees) - outerIntegral(edge, knees) - outerIntegral(-edge, knees));
      W = slope;
    });
    return energy;
  };
  const stepTo = (phi) => {
    const from = one.phi[one.joint], pieces = Math.max(1, Math.ceil(Math.abs(phi - from) / (reach() / 400)));
    const way = Math.sign(phi - from);
    if (way && one.way && way !== one.way) { one.reversal = [from, inner(from)]; one.turned = true; }
    if (way) one.way = way;
    for (let n = 1; n <= pieces; n += 1) {
      const target = from + (phi - from) * n / pieces, last = one.phi[one.joint], { tau_J, P_next } = evaluate(target);
      one.P = Float64Array.from(P_next); one.phi[one.joint] = target;
      one.work += 0.5 * (tau_J[one.joint] + one.torque) * (target - last);
      one.torque = tau_J[one.joint]; one.stored = storedEnergy();
      one.trail.push([target, one.torque, one.work, one.stored]);
    }
    if (one.trail.length > 4000) one.trail.splice(0, one.trail.length - 4000);
  };
  const reach = () => { const { r } = parts(); return Math.max(2.2 * Math.max(...r, 0.004), 0.008); };
  const reset = () => { one.P = new Float64Array(total); one.phi = one.phi.map(() => 0); one.trail = [[0, 0, 0, 0]]; one.work = one.stored = one.torque = one.way = 0; one.turned = false; one.reversal = [0, 0]; };
  reset();
  springs.push({ one, stepTo: (phi) => { stepTo(phi); redraw(); }, reset: () => { reset(); redraw(); } });
  const redraws = [], redraw = () => { for (const each of redraws) each(); };
  widget("hysteresis", (node) => {
    const pads = make("div", { class: "pads" }), a = make("div"), b = make("div", { class: "tools" });
    pads.append(a, b); node.append(pads);
    const loop = draw(a, "svg", { viewBox: "0 0 460 330", role: "img", "aria-label": "Torque over torsion", class: "turn" });
    a.append(legend([["var(--accent)", "torque, N m, over torsion, rad"], ["var(--warm)", "branch by Masing's rule"]]));
    const stops = draw(b, "svg", { viewBox: "0 0 340 300", role: "img", "aria-label": "Stops that stick and slip" });
    let scale = null, drag = false;
    const toPhi = (event) => { const box = loop.getBoundingClientRect(), x = (event.clientX - box.left) / box.width * 460; const R = reach(); return Math.min(Math.max((x - 54) / (460 - 68) * 2 * R - R, -R), R); };
    loop.addEventListener("pointerdown", (event) => { drag = true; loop.setPointerCapture(event.pointerId); stepTo(toPhi(event)); redraw(); });
    loop.addEventListener("pointermove", (event) => { if (drag) { stepTo(toPhi(event)); redraw(); } });
    loop.addEventListener("pointerup", () => { drag = false; });
    const bar = make("div", { class: "tools" });
    node.append(bar);
    if (elastic.length > 1) {
      const row = make("div", { class: "buttons" });
      elastic.forEach(({ k }) => { const button = make("button", { type: "button" }, `joint ${D.coordinates[k] + 1}`); button.addEventListener("click", () => { one.joint = k; reset(); build(); redraw(); }); row.append(button); });
      bar.append(row);
    }
    const row = make("div", { class: "buttons" }), again = make("button", { type: "button" }, "start from rest"), run = make("button", { type: "button" }, "run a motion that turns back");
    again.addEventListener("click", () => { reset(); torsion.set(0); redraw(); });
    run.addEventListener("click", () => {
      reset(); const R = reach(), goals = [0.9, -0.6, 0.5, -0.1, 0.9].map((x) => x * R);
      let goal = 0;
      const step = () => { const from = one.phi[one.joint], left = goals[goal] - from, size = R / 28; stepTo(from + Math.sign(left) * Math.min(Math.abs(left), size)); torsion.set(one.phi[one.joint]); redraw(); if (Math.abs(left) <= size) goal += 1; if (goal < goals.length) requestAnimationFrame(step); };
      step();
    });
    row.append(run, again); bar.append(row);
    let torsion;
    const tune = make("div");
    bar.append(tune);
    const build = () => {
      tune.replaceChildren();
      const R = reach(), { at, k, r } = parts();
      torsion = addSlider(tune, "\\varphi", "Torsion", -R, R, 0, (x) => `${show(Number((1000 * x).toFixed(3)))} mrad`, (x) => { stepTo(x); redraw(); });
      one.shown = torsion;
      const more = make("details", {}, make("summary", {}, "Stiffness and thresholds of the stops")), box = make("div", { class: "two" });
      const add = (latex, name, index, high, unit) => addSlider(box, latex, name, high / 200, high, h[index], (x) => `${show(Number(x.toPrecision(3)))} ${unit}`, (x) => { h[index] = x; reset(); torsion.set(0); redraw(); });
      add("k_0", "Stiffness that remains", at.k0, 2 * h[at.k0] || 100, "N m");
      k.forEach((_, i) => { add(`k_${i + 1}`, `Stiffness of stop ${i + 1}`, at.k[i], 3 * h[at.k[i]] || 10, "N m"); add(`r_${i + 1}`, `Threshold of stop ${i + 1}`, at.r[i], 2 * h[at.r[i]] || 0.01, "rad"); });
      more.append(box); tune.append(more);
    };
    build();
    redraws.push(() => {
      const R = reach(), { k0, k, r, knees } = parts();
      const first = (x) => k.reduce((sum, stiffness, i) => sum + stiffness * Math.sign(x) * Math.min(Math.abs(x), r[i]), k0 * x);
      const top = outer(first(R), knees), bottom = outer(first(-R), knees), series = [];
      const curve = (f, low, high) => Array.from({ length: 81 }, (_, n) => { const x = low + (high - low) * n / 80; return [x, f(x)]; });
      series.push({ points: curve((x) => outer(first(x), knees), -R, R), colour: "var(--soft)", dash: "3 4", wide: 1 });
      if (one.turned) series.push({ points: curve((x) => outer(one.reversal[1] + 2 * first((x - one.reversal[0]) / 2), knees), ...(one.way > 0 ? [one.reversal[0], R] : [-R, one.reversal[0]])), colour: "var(--warm)", dash: "7 4", wide: 2 });
      series.push({ points: one.trail.map(([x, y]) => [x, y]), colour: "var(--accent)", wide: 2.2 });
      plot(loop, series, { width: 460, height: 330, x: "torsion, rad", y: "torque, N m", equal: [-R, R, Math.min(bottom, -1e-9), Math.max(top, 1e-9)], marks: [[one.phi[one.joint], one.torque, "var(--accent)"]] });
      stops.replaceChildren();
      const start = offsets[one.joint];
      draw(stops, "text", { x: 8, y: 20, class: "soft" }, "own torsion of each stop, of its threshold");
      k.forEach((stiffness, i) => {
        const y = 40 + i * Math.min(62, 240 / k.length), E = one.phi[one.joint] - one.P[start + i], share = E / r[i], slips = Math.abs(share) > 0.9999;
        draw(stops, "text", { x: 8, y: y + 17 }, `stop ${i + 1}`);
        draw(stops, "rect", { x: 70, y, width: 190, height: 24, fill: "none", stroke: "var(--rule)", rx: 4 });
        draw(stops, "line", { x1: 165, x2: 165, y1: y, y2: y + 24, stroke: "var(--rule)" });
        draw(stops, "rect", { x: share < 0 ? 165 + 95 * share : 165, y: y + 3, width: Math.abs(95 * share), height: 18, fill: slips ? "var(--warm)" : "var(--accent)", opacity: 0.75, rx: 3 });
        draw(stops, "text", { x: 268, y: y + 17, style: `fill: ${slips ? "var(--warm)" : "var(--accent)"}; font-weight: 600` }, slips ? "slips" : "sticks");
      });
      draw(stops, "text", { x: 8, y: 290 }, `torque ${show(one.torque)} N m`);
    });
  });
  widget("balance", (node) => {
    const svg = draw(node, "svg", { viewBox: "0 0 640 240", role: "img", "aria-label": "Energy stored and lost" });
    node.append(legend([["var(--ink)", "work on the torsion"], ["var(--accent)", "stored"], ["var(--warm)", "lost"]]));
    const note = make("p", { class: "caption" });
    node.append(note);
    redraws.push(() => {
      const way = [0];
      one.trail.forEach(([x], k) => { if (k) way.push(way[k - 1] + Math.abs(x - one.trail[k - 1][0])); });
      const line = (f) => one.trail.map((entry, k) => [way[k], 1000 * f(entry)]);
      plot(svg, [{ points: line((e) => e[2]), colour: "var(--ink)" }, { points: line((e) => e[3]), colour: "var(--accent)" }, { points: line((e) => e[2] - e[3]), colour: "var(--warm)" }], { height: 240, x: "way of the torsion, rad", y: "energy, mJ" });
      note.textContent = translate(`Stored ${show(1000 * one.stored)} mJ, lost ${show(1000 * (one.work - one.stored))} mJ: what is lost never decreases.`);
    });
  });
  widget("inverse", (node) => {
    const note = make("p", { class: "caption" });
    node.append(note);
    redraws.push(() => {
      if (!F.hysteresis_inverse_step) return;
      // The inverse goes along the torques of the trail; where it ends is compared.
      let Q = new Float64Array(total), phi = 0;
      for (const [, torque] of one.trail) { const tau = D.stops.map((_, k) => (k === one.joint ? torque : 0)), found = F.hysteresis_inverse_step(tau, ...(total ? [Q] : []), h); Q = found.Q_next ? Float64Array.from(found.Q_next) : Q; phi = (found.phi || found)[one.joint]; }
      note.textContent = translate(`Checked: along the torques of the motion above, the generated inverse comes to ${show(1000 * phi)} mrad; the torsion is ${show(1000 * one.phi[one.joint])} mrad, difference ${rough(Math.abs(phi - one.phi[one.joint]))} rad.`);
    });
  });
  const R = reach();
  for (const goal of [0.85, -0.55, 0.3]) stepTo(goal * R);
  redraws.push(() => { if (one.shown) one.shown.set(one.phi[one.joint]); });
  redraw();
};
// Where joints have the letter theta, that of a motor has an index.
const LINK = L.coordinates.replace("\\Theta", "\u0398").replace("\\theta", "\u03b8"), MOTOR = L.angle.includes("theta") ? "\u03b8\u2098" : "\u03b8";
widget("sides", (node) => {
  const svg = draw(node, "svg", { viewBox: "0 0 640 150", role: "img", "aria-label": "Motor, spring and link" });
  const put = (tag, attributes, text) => draw(svg, tag, { stroke: "var(--accent)", fill: "none", "stroke-width": 2, ...attributes }, text);
  put("circle", { cx: 110, cy: 75, r: 42 }); put("line", { x1: 110, y1: 75, x2: 139, y2: 46 });
  put("polyline", { points: "152,75 190,75 200,55 220,95 240,55 260,95 280,55 300,95 310,75 350,75", stroke: "var(--ink)" });
  put("rect", { x: 350, y: 55, width: 200, height: 40, rx: 20 });
  put("circle", { cx: 370, cy: 75, r: 5 });
  for (const [x, y, text] of [[85, 140, `motor, ${MOTOR}, I\u2090`], [205, 125, `torsion \u03c6 = ${MOTOR} \u2212 ${LINK}`], [400, 125, `link, ${LINK}`], [12, 50, "\u03c4\u2098"], [222, 40, "\u03c4_J".replace("_J", "\u2c7c")]]) draw(svg, "text", { x, y, style: "font-size: 15px" }, text);
  put("path", { d: "M 58 95 A 56 56 0 0 1 58 55", stroke: "var(--warm)" });
});

// Exercises: typed formulas are compared with the answer at random points.
const drawPoint = () => {
  const v = computeValues(state.q.map(() => 4 * Math.random() - 2), state.q.map(() => 4 * Math.random() - 2));
  for (const name of Object.keys(D.values)) v[name] = 0.2 + Math.random();
  for (const [name, formula] of LESSON_FORMULAS) v[name] = formula(v);
  return v;
};
widget("exercises", (node) => LESSON_EXERCISES.forEach((one, place) => {
  const box = make("div", { class: "exercise", id: `exercise-${place + 1}` }), verdict = make("span", { class: "verdict", role: "status" });
  const prompt = make("p", {}, make("strong", {}, `${place + 1}. `));
  one.prompt.split("$").forEach((part, k) => prompt.append(k % 2 ? tex(part) : part));
  box.append(prompt);
  const say = (right, text) => { verdict.textContent = text || tr(right ? "right" : "not yet"); verdict.className = `verdict ${right ? "right" : "wrong"}`; };
  const button = make("button", { type: "button" }, "check");
  const input = make("input", { type: "text", "aria-label": `Answer ${place + 1}`, autocomplete: "off", spellcheck: "false" });
  box.append(input, " ");
  // The unit that the answer shows behind it may be typed too.
  const unit = one.note.split(" ").join("\\s*"), bare = () => unit ? input.value.replace(new RegExp(`\\s*(?:${unit}|\\(${unit}\\))\\s*$`), "") : input.value;
  const check = () => {
    try {
      const tree = readFormula(bare(), D.reading, tr);
      if (one.number !== undefined) { say(Math.abs(evaluateNumber(tree, D.values, D.reading, tr) - one.number) <= 0.01 * Math.max(0.01, Math.abs(one.number))); return; }
      const right = compareFormula(bare(), one.formula, drawPoint, D.reading, tr), asked = !right && listJoints(tree, D.reading).includes(one.joint);
      say(right, asked && `${tr("not yet")}; ${tr("put in {0}", one.given.replaceAll("-", "\u2212"))}`);
    } catch (error) { say(false, error.message); }
  };
  button.addEventListener("click", check);
  input.addEventListener("keydown", (event) => { if (event.key === "Enter") check(); });
  const answer = make("details", {}, make("summary", {}, "Answer")), typed = make("p", {}, make("code", {}, one.answer));
  if (one.note) typed.append(` ${one.note}`);
  answer.append(typed);
  box.append(button, verdict, answer);
  node.append(box);
}));

update();
if (D.springs.length && F.hysteresis_step) startSprings();
fitWide();
if (document.fonts && document.fonts.ready) document.fonts.ready.then(fitWide);
window.addEventListener("resize", fitWide);
for (const node of document.querySelectorAll("details")) node.addEventListener("toggle", fitWide);
let opened = [];
window.addEventListener("beforeprint", () => { opened = [...document.querySelectorAll("main details:not([open], .exercise *)")]; for (const node of opened) node.open = true; fitWide(); });
window.addEventListener("afterprint", () => { for (const node of opened) node.open = false; });
