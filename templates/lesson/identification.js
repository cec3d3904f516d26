// What a motion identifies: the reader draws it, plays it, and watches deviations fall.
const B = D.parameters.length, POINTS = 12, RATE = 50, QUARTERS = 4, FAINT = 1e-9, ALONE = 1e-6;

// A motion: of each joint twelve points in equal times, through them the periodic spline of third degree.
// Second slopes m solve m[i-1] + 4 m[i] + m[i+1] = r[i], whose inverse falls by the root sqrt(3) - 2.
const buildSpline = (points, seconds) => {
  const n = points.length, h = seconds / n, root = Math.sqrt(3) - 2, at = (list, k) => list[(k + n) % n];
  const weight = (k) => (root ** k + root ** (n - k)) / ((1 - root ** n) * 2 * Math.sqrt(3));
  const right = points.map((y, i) => 6 * (at(points, i - 1) - 2 * y + at(points, i + 1)) / (h * h));
  const m = points.map((_, i) => right.reduce((sum, value, j) => sum + weight(Math.abs(i - j)) * value, 0));
  return (t) => {
    const whole = Math.floor(t / h), i = ((whole % n) + n) % n, u = t - whole * h;
    const b = (at(points, i + 1) - points[i]) / h - h * (2 * m[i] + at(m, i + 1)) / 6, c = m[i] / 2, d = (at(m, i + 1) - m[i]) / (6 * h);
    return [points[i] + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), 2 * c + 6 * u * d];
  };
};

// The information matrix of all rows is U'U. A row is turned into U, which keeps the digits that squares lose.
const addRow = (U, row) => {
  for (let i = 0; i < B; i += 1) {
    if (row[i] === 0) continue;
    const a = U[i * B + i], length = Math.sqrt(a * a + row[i] * row[i]), c = a / length, s = row[i] / length;
    for (let j = i; j < B; j += 1) {
      const u = U[i * B + j];
      U[i * B + j] = c * u + s * row[j];
      row[j] = c * row[j] - s * u;
    }
  }
};
// Singular values of the columns of A, and their right vectors, by turning pairs of columns (Hestenes 1958).
const decompose = (A) => {
  const V = A.map((_, i) => A.map((__, j) => Number(i === j)));
  const dot = (a, b) => { let sum = 0; for (let k = 0; k < B; k += 1) sum += a[k] * b[k]; return sum; };
  const turn = (a, b, c, s) => { for (let k = 0; k < B; k += 1) { const x = a[k]; a[k] = c * x - s * b[k]; b[k] = s * x + c * b[k]; } };
  for (let sweep = 0, turned = true; turned && sweep < 15; sweep += 1) {
    turned = false;
    for (let p = 0; p < B; p += 1) for (let q = p + 1; q < B; q += 1) {
      const pp = dot(A[p], A[p]), qq = dot(A[q], A[q]), pq = dot(A[p], A[q]);
      if (pq === 0 || Math.abs(pq) <= 1e-15 * Math.sqrt(pp * qq)) continue;
      const half = (qq - pp) / (2 * pq), t = (half < 0 ? -1 : 1) / (Math.abs(half) + Math.sqrt(1 + half * half)), c = 1 / Math.sqrt(1 + t * t);
      turn(A[p], A[q], c, c * t); turn(V[p], V[q], c, c * t);
      turned = true;
    }
  }
  return { S: A.map((column) => Math.sqrt(dot(column, column))), V };
};
// Rank, condition of the columns scaled to length one, deviations; what is seen, and with what the others go.
const analyse = (U) => {
  const columns = D.parameters.map((_, j) => Array.from({ length: B }, (__, i) => U[i * B + j]));
  const norms = columns.map((column) => norm(column)), most = Math.max(...norms);
  const lengths = norms.map((length) => (length > 1e-12 * most ? length : 0));
  const { S, V } = decompose(columns.map((column, j) => column.map((value) => (lengths[j] ? value / lengths[j] : 0))));
  const top = Math.max(...S), places = S.map((_, k) => k), shown = places.filter((k) => top > 0 && S[k] > FAINT * top), dark = places.filter((k) => !shown.includes(k));
  const sum = (list, i, j, floor) => list.reduce((total, k) => total + V[k][i] * V[k][j] / (floor ? Math.max(S[k], floor) ** 2 : 1), 0);
  const seen = places.map((i) => lengths[i] > 0 && Math.sqrt(sum(dark, i, i, 0)) < ALONE);
  const scale = (i) => lengths[i] || 1;
  return {
    rank: shown.length, condition: dark.length ? Infinity : top / Math.min(...S), seen,
    deviations: places.map((i) => (seen[i] ? Math.sqrt(sum(shown, i, i, FAINT * top)) / scale(i) : Infinity)),
    partners: (i) => places.filter((j) => j !== i && Math.abs(sum(dark, i, j, 0)) > ALONE).sort((a, b) => Math.abs(sum(dark, i, b, 0)) - Math.abs(sum(dark, i, a, 0))),
    // What is not seen is an ellipse without an end.
    covariance: (i, j) => sum(places, i, j, FAINT * (top || 1)) / (scale(i) * scale(j)),
  };
};

const nameOf = (k) => plain(D.parameters[k].latex).replace(/[_ ]/g, "");
const plan = { points: [], log: false, seconds: 10, noise: D.coordinates.map(() => 0.1), joint: 0 };
const sums = { U: new Float64Array(B * B), count: 0, results: [], now: null, splines: [] };
const rangeOf = (k) => { const joint = D.joints[D.coordinates[k]]; return joint.limits || (joint.prismatic ? [-0.5, 0.5] : [-Math.PI, Math.PI]); };
const centreOf = (k) => middle(D.joints[D.coordinates[k]], k);
const widestOf = (k) => { const [low, high] = rangeOf(k), c = centreOf(k); return Math.min(c - low, high - c); };
const wave = (k, f) => Array.from({ length: POINTS }, (_, i) => centreOf(k) + f(2 * Math.PI * i / POINTS));
const moveAll = () => D.coordinates.map((_, k) => { const a = 0.3 * Math.min(widestOf(k), 2), n = 1 + k % 3; return wave(k, (x) => a * (Math.sin(n * x + 2.4 * k) + Math.sin((n + 1 + k % 2) * x + k))); });
const countSamples = () => Math.round(plan.seconds * RATE);
const sample = (t) => { const states = sums.splines.map((spline) => spline(t)); return [0, 1, 2].map((order) => states.map((state) => state[order])); };
const goTo = (count) => {
  if (count < sums.count) { sums.count = 0; sums.U.fill(0); }
  for (; sums.count < count; sums.count += 1) {
    const Y = F.torque_regressor(...sample(sums.count / RATE));
    for (let k = 0; k < N; k += 1) addRow(sums.U, Float64Array.from(Y.slice(k * B, (k + 1) * B), (value) => value / plan.noise[k]));
    const quarter = Math.floor((sums.count + 1) * QUARTERS / countSamples());
    if (quarter && !sums.results[quarter - 1]) sums.results[quarter - 1] = analyse(sums.U);
  }
  sums.now = analyse(sums.U);
};
// Of a log, its samples are the motion, and the points lie on it: who moves one goes on from there.
const takeLog = () => {
  const { samples } = D.log;
  plan.log = true;
  plan.seconds = samples.length / RATE;
  plan.points = D.coordinates.map((_, k) => Array.from({ length: POINTS }, (__, i) => samples[Math.floor(i * samples.length / POINTS)][0][k]));
};
const startPlan = () => {
  const last = plan.log ? D.log.samples.length - 1 : 0;
  sums.splines = plan.points.map((points, k) => (plan.log ? (t) => D.log.samples[Math.min(Math.round(t * RATE), last)].map((state) => state[k]) : buildSpline(points, plan.seconds)));
  sums.results = []; sums.count = 0; sums.U.fill(0);
  goTo(countSamples());
};

// Why a motion does not show a parameter, in the words of the groupings.
const stands = (k) => { const place = D.coordinates.indexOf(D.joints[k].master), points = plan.log ? D.log.samples.map((states) => states[0][place]) : plan.points[place]; return Math.max(...points) - Math.min(...points) < 1e-9; };
const explain = (i) => {
  const { link } = D.parameters[i];
  if (link < 0) return "its drive";
  const path = jointPath(link).reverse(), still = path.filter(stands), next = D.joints.map((_, k) => k).filter((k) => D.joints[k].parent === link && stands(k)), after = (k) => (D.joints[k].parent < 0 ? "the base" : `link ${D.joints[k].parent + 1}`);
  if (still.length === path.length) return `no joint that carries link ${link + 1} moves`;
  // A link that moves has what does not move behind it for a part of it.
  if (still.length || next.length) return (still.length ? still : next).map((k) => `joint ${k + 1} is at rest, so link ${k + 1} moves with ${after(k)}`).join("; ");
  return `link ${link + 1} moves, but this motion does not separate its parameters from others`;
};

const buildEditor = (node, change) => {
  const svg = draw(node, "svg", { viewBox: "0 0 460 300", role: "group", "aria-label": "Positions over time, points to drag" });
  const curves = draw(svg, "g"), handles = draw(svg, "g"), circles = [];
  let scale = null, held = -1;
  const unit = () => (D.joints[D.coordinates[plan.joint]].prismatic ? 1 : 180 / Math.PI);
  const put = (i, value) => { const [low, high] = rangeOf(plan.joint); plan.points[plan.joint][i] = Math.min(Math.max(value, low), high); change(); };
  for (let i = 0; i < POINTS; i += 1) {
    const circle = draw(handles, "circle", { r: 7, fill: "var(--accent)", stroke: "var(--ground)", "stroke-width": 2, role: "slider", tabindex: 0, class: "turn" });
    circle.addEventListener("pointerdown", (event) => { held = i; svg.setPointerCapture(event.pointerId); event.preventDefault(); });
    circle.addEventListener("keydown", (event) => {
      const step = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key], [low, high] = rangeOf(plan.joint);
      if (step) { put(i, plan.points[plan.joint][i] + step * (high - low) / 50); event.preventDefault(); }
    });
    circles.push(circle);
  }
  svg.addEventListener("pointermove", (event) => {
    if (held < 0 || !scale) return;
    const box = svg.getBoundingClientRect(), y = (event.clientY - box.top) / box.height * 300, one = scale.Y(1) - scale.Y(0);
    put(held, (y - scale.Y(0)) / one / unit());
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { held = -1; });
  return () => {
    const size = unit(), [low, high] = rangeOf(plan.joint).map((x) => x * size), fit = (k, x) => { const [a, b] = rangeOf(k); return low + (x - a) / (b - a) * (high - low); };
    const trace = (k) => Array.from({ length: 121 }, (_, i) => { const t = plan.seconds * i / 120; return [t, fit(k, sums.splines[k](t)[0])]; });
    const others = D.coordinates.map((_, k) => k).filter((k) => k !== plan.joint);
    const series = [...others.map((k) => ({ points: trace(k), colour: "var(--soft)", wide: 1, fade: 0.35 })), { points: trace(plan.joint), colour: "var(--accent)", wide: 2.2 }];
    const t = sums.count / RATE;
    scale = plot(curves, [...series, { points: [[t, low], [t, high]], colour: "var(--warm)", wide: 1.2 }], { width: 460, height: 300, x: "time, s", y: `joint ${D.coordinates[plan.joint] + 1}, ${size === 1 ? "m" : "degrees"}`, equal: [0, plan.seconds, low, high] });
    circles.forEach((circle, i) => {
      const value = plan.points[plan.joint][i] * size;
      const attributes = { cx: scale.X(plan.seconds * i / POINTS).toFixed(1), cy: scale.Y(value).toFixed(1), "aria-label": `Joint ${D.coordinates[plan.joint] + 1}, point ${i + 1} of ${POINTS}`, "aria-valuemin": low.toFixed(3), "aria-valuemax": high.toFixed(3), "aria-valuenow": value.toFixed(3) };
      for (const [key, text] of Object.entries(attributes)) circle.setAttribute(key, inWords(key, text));
    });
  };
};

const buildBars = (node) => {
  const box = make("div", { class: "bars" }), rows = D.parameters.map((one, i) => {
    const fill = make("span", { class: "fill" }), text = make("output");
    box.append(make("div", { class: "bar" }, tex(one.latex), make("span", { class: "track", "aria-hidden": "true" }, fill), text));
    return { fill, text };
  });
  node.append(box, make("p", { class: "caption" }, "Standard deviations in percent of the values, bars from 0.01 % to 1000 %, each mark ten times more; orange: more than 10 %. The bar of a value that is zero is in percent of the largest of its unit."));
  const isZero = D.beta.map((value) => Math.abs(value) < 1e-12);
  const sizes = D.beta.map((value, i) => (isZero[i] ? Math.max(...D.beta.map((other, j) => (D.parameters[j].unit === D.parameters[i].unit ? Math.abs(other) : 0))) || 1 : Math.abs(value)));
  return () => rows.forEach(({ fill, text }, i) => {
    const deviation = sums.now.deviations[i], percent = 100 * deviation / sizes[i];
    fill.style.width = `${Math.min(Math.max((Math.log10(percent) + 2) / 5, 0.01), 1) * 100}%`;
    fill.className = sums.now.seen[i] ? `fill${percent > 10 ? " loose" : ""}` : "fill none";
    text.textContent = !sums.now.seen[i] ? tr("not seen") : !isZero[i] && percent < 1e5 ? `${show(Number(percent.toPrecision(2)))} %` : `\u00b1 ${show(Number(deviation.toPrecision(2)))} ${D.parameters[i].unit}`;
  });
};

const buildUnseen = (node) => {
  const list = make("ul"), title = make("summary"), box = make("details", { class: "unseen" }, title, list), names = D.parameters.map((one) => tex(one.latex));
  box.open = D.parameters.length <= 16;
  node.append(box);
  let told = "";
  return () => {
    const lost = D.parameters.map((_, i) => i).filter((i) => !sums.now.seen[i]), reasons = lost.map((i) => [i, explain(i), sums.now.partners(i)]), key = JSON.stringify(reasons);
    box.hidden = !lost.length;
    if (key === told) return;
    told = key;
    title.textContent = tr("Not seen by this motion ({0}), and why", lost.length);
    list.replaceChildren(...reasons.map(([i, reason, partners]) => {
      const entry = make("li", {}, names[i].cloneNode(true), `: ${translate(reason)}; `, partners.length ? "identifiable only together with " : "no torque of this motion depends on it");
      partners.slice(0, 5).forEach((j, k) => entry.append(k ? ", " : "", names[j].cloneNode(true)));
      if (partners.length > 5) entry.append(tr(" and {0} more", partners.length - 5));
      return entry;
    }));
  };
};

const buildEllipse = (node) => {
  const svg = draw(node, "svg", { viewBox: "0 0 340 300", role: "img" }), axes = draw(svg, "g"), pair = [0, Math.min(1, B - 1)], bar = make("div", { class: "tools" }), choices = [];
  const clip = draw(svg, "clipPath", { id: "ellipses" });
  draw(clip, "rect", { x: 54, y: 14, width: 272, height: 252 });
  const inside = draw(svg, "g", { "clip-path": "url(#ellipses)" });
  const redraw = () => {
    const [i, j] = pair, last = sums.results[QUARTERS - 1], names = pair.map((k) => nameOf(k)), scale = pair.map((k) => Math.sqrt(last.covariance(k, k)));
    // The frame is that of the whole motion; where that does not see a parameter, the size of its value.
    const half = pair.map((k, side) => (last.seen[k] ? 7 * scale[side] : Math.abs(D.beta[k]) || 1)), centre = pair.map((k) => D.beta[k]);
    const equal = [centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1]];
    const { X, Y } = plot(axes, [{ points: [[equal[0], equal[2]], [equal[1], equal[3]]], colour: "none" }], { width: 340, height: 300, x: `${names[0]}, ${D.parameters[i].unit}`, y: `${names[1]}, ${D.parameters[j].unit}`, equal });
    inside.replaceChildren();
    const outline = (found) => {
      const [xx, xy, yy] = [found.covariance(i, i), found.covariance(i, j), found.covariance(j, j)].map((value) => 5.991 * value), a = Math.sqrt(xx), b = xy / a, c = Math.sqrt(Math.max(yy - b * b, 0));
      return Array.from({ length: 181 }, (_, k) => { const w = Math.PI * k / 90; return `${X(centre[0] + a * Math.cos(w)).toFixed(1)},${Y(centre[1] + b * Math.cos(w) + c * Math.sin(w)).toFixed(1)}`; }).join(" ");
    };
    const before = sums.results.filter((_, k) => (k + 1) * countSamples() < QUARTERS * sums.count);
    for (const found of before) draw(inside, "polygon", { points: outline(found), fill: "none", stroke: "var(--soft)", "stroke-dasharray": "4 3" });
    if (sums.count) draw(inside, "polygon", { points: outline(sums.now), fill: "var(--accent)", "fill-opacity": 0.18, stroke: "var(--accent)", "stroke-width": 2 });
    draw(inside, "circle", { cx: X(centre[0]).toFixed(1), cy: Y(centre[1]).toFixed(1), r: 3, fill: "var(--ink)" });
    svg.setAttribute("aria-label", translate(`Confidence of ${names[0]} and ${names[1]}`));
  };
  for (const side of [0, 1]) {
    const select = make("select", { "aria-label": `${side ? "Second" : "First"} parameter of the ellipse` }, ...D.parameters.map((one, k) => make("option", { value: k }, nameOf(k))));
    select.addEventListener("change", () => { pair[side] = Number(select.value); redraw(); });
    choices.push(select);
  }
  const choose = (i, j) => { pair[0] = i; pair[1] = j; choices.forEach((select, side) => { select.value = pair[side]; }); };
  const alike = () => {
    const last = sums.results[QUARTERS - 1], seen = D.parameters.map((_, i) => i).filter((i) => last.seen[i]);
    let most = -1;
    for (const i of seen) for (const j of seen) if (i < j) {
      const share = Math.abs(last.covariance(i, j)) / (last.deviations[i] * last.deviations[j]);
      if (share > most) { most = share; choose(i, j); }
    }
  };
  const button = make("button", { type: "button" }, "the pair most alike");
  button.addEventListener("click", () => { alike(); redraw(); });
  bar.append(make("div", { class: "buttons" }, ...choices, button));
  node.append(make("p", { class: "caption" }, "Where 95 % of all estimates lie; dashed: after each quarter of the motion."), bar);
  return { redraw, start: () => { choose(...pair); alike(); } };
};

widget("identification", (node) => {
  const pads = make("div", { class: "pads" }), first = make("div"), second = make("div"), bar = make("div", { class: "tools" }), below = make("div", { class: "tools" });
  pads.append(first, second);
  const small = make("div", { class: "narrow" });
  node.append(below, pads, bar);
  addPicture(small, "The arm in the motion; drag or use the arrow keys to turn it", { width: 360, height: 240, triads: false, labels: false });
  pictures[pictures.length - 1]();
  plan.points = moveAll();
  const shown = [], redraw = () => { for (const each of shown) each(); };
  let waiting = false, playingTime = null;
  const change = (keepsLog = false) => {
    if (!keepsLog) plan.log = false;
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; stopPlaying(); startPlan(); redraw(); });
  };
  const tune = [], choose = (k) => { plan.joint = k; tabs.forEach((tab, place) => tab.setAttribute("aria-pressed", String(place === k))); for (const one of tune) one(); redraw(); };
  const tabs = D.coordinates.map((index, k) => { const tab = make("button", { type: "button" }, `joint ${index + 1}`); tab.addEventListener("click", () => choose(k)); return tab; });
  below.append(make("div", { class: "buttons" }, ...tabs));
  shown.push(buildEditor(first, change));
  first.append(make("p", { class: "caption" }, "The motion of a joint, once through; drag its points, or move them by arrow keys. Faint: other joints."), small);
  const ellipse = buildEllipse(second);

  const row = make("div", { class: "buttons" }), addAction = (text, action) => { const button = make("button", { type: "button" }, text); button.addEventListener("click", action); row.append(button); };
  addAction("play the motion", () => {
    const start = performance.now(), still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (still) { goTo(countSamples()); redraw(); return; }
    playing = { joint: -1, q: () => sample(sums.count / RATE)[0] };
    const mine = playing;
    const step = () => {
      if (playing !== mine) return;
      goTo(Math.min(countSamples(), Math.floor((performance.now() - start) / 1000 * RATE)));
      redraw();
      for (const picture of pictures) picture();
      if (sums.count < countSamples()) requestAnimationFrame(step);
      else { playing = null; for (const picture of pictures) picture(); }
    };
    step();
  });
  const rest = (k) => wave(k, () => 0);
  addAction("this joint rests", () => { plan.points[plan.joint] = rest(plan.joint); change(); });
  addAction("only this joint moves", () => { const all = moveAll(); plan.points = all.map((points, k) => (k === plan.joint ? points : rest(k))); change(); });
  addAction("all joints move", () => { plan.points = moveAll(); change(); });
  addAction("a random motion", () => { plan.points = D.coordinates.map((_, k) => wave(k, () => 0.8 * Math.min(widestOf(k), 2) * (2 * Math.random() - 1))); change(); });
  if (D.log) addAction(`the motion of ${D.log.name}`, () => { takeLog(); change(true); });
  bar.append(row);
  const numbers = make("dl", { class: "readout" }), cells = ["rank", "condition number", "samples"].map((title) => { const cell = make("dd"); numbers.append(make("dt", {}, title), cell); return cell; });
  const two = make("div", { class: "two" }), left = make("div"), right = make("div");
  two.append(left, right); bar.append(two);
  const sines = D.coordinates.map((_, k) => [0.3 * Math.min(widestOf(k), 2), 1 + k % 3]);
  const lay = () => { const k = plan.joint, [a, n] = sines[k]; plan.points[k] = wave(k, (x) => a * Math.sin(n * x)); change(); };
  const build = () => {
    left.replaceChildren();
    const k = plan.joint, prismatic = D.joints[D.coordinates[k]].prismatic;
    addSlider(left, "a", `Amplitude of a sine of joint ${D.coordinates[k] + 1}`, 0, widestOf(k), sines[k][0], prismatic ? metres : degrees, (x) => { sines[k][0] = x; lay(); });
    addSlider(left, "n", `Periods of a sine of joint ${D.coordinates[k] + 1}`, 1, 4, sines[k][1], (x) => tr(Math.round(x) === 1 ? "1 period" : "{0} periods", Math.round(x)), (x) => { sines[k][1] = Math.round(x); lay(); });
    addSlider(left, "T", "Duration of the motion", 4, 20, plan.seconds, (x) => `${Math.round(x)} s`, (x) => { plan.seconds = Math.round(x); change(); });
  };
  tune.push(build);
  playingTime = addSlider(right, "t", "Time up to which the motion has been played", 0, 1, 1, (x) => `${show(Number((x * plan.seconds).toFixed(2)))} s`, (x) => { stopPlaying(); goTo(Math.round(x * countSamples())); redraw(); });
  right.append(numbers);
  const noise = make("details", {}, make("summary", {}, "Noise of the torques")), sliders = make("div", { class: "two" });
  D.coordinates.forEach((index, k) => addSlider(sliders, `\\sigma_{${index + 1}}`, `Noise of joint ${index + 1}`, -2, 1, Math.log10(plan.noise[k]), (x) => `${show(Number((10 ** x).toPrecision(2)))} ${D.joints[index].prismatic ? "N" : "N m"}`, (x) => { plan.noise[k] = 10 ** x; change(true); }));
  noise.append(sliders); bar.append(noise);
  shown.push(() => {
    playingTime.set(sums.count / countSamples());
    cells[0].textContent = `${sums.now.rank} / ${B}`;
    cells[1].textContent = show(sums.now.condition);
    cells[2].textContent = `${sums.count}`;
  }, ellipse.redraw, buildBars(node), buildUnseen(node));
  startPlan(); ellipse.start(); choose(0);
  window.lesson.identification = { plan, sums, goTo: (count) => { goTo(count); redraw(); }, start: () => { startPlan(); redraw(); } };
});
