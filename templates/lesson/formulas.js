// Typed formulas: rewritten by the rules of spelling.toml, read by the grammar of symid/lessons/exercises.py.
// `reading` has these rules, `names` in code by what may be typed, and the number of `joints`.
const fillIn = (text, ...values) => text.replace(/\{(\d)\}/g, (_, k) => values[k]);
const FUNCTIONS = ["sin", "cos", "sqrt"];
const rewriteFormula = (text, reading) => {
  const apply = (rules, start) => rules.reduce((found, [pattern, form]) => {
    const rule = new RegExp(pattern, "g");
    for (let before = null; found !== before;) { before = found; found = found.replace(rule, form); }
    return found;
  }, start);
  return apply(reading.rules, apply(reading.powers, text).normalize("NFKD"));
};
// A tree of { kind, text, parts }, as `Expression` in Python.
const readFormula = (text, reading, say = fillIn) => {
  const stop = (message, ...values) => { throw new Error(say(message, ...values)); };
  if (text.length > reading.longest) stop("the formula is longer than {0} letters", reading.longest);
  const tokens = rewriteFormula(text, reading).match(new RegExp(reading.token, "g")) || [];
  const node = (kind, ...parts) => ({ kind, text: "", parts, typed: "" }), leaf = (kind, word, typed = "") => ({ kind, text: word, parts: [], typed });
  let at = 0, depth = 0;
  const take = (...wanted) => (wanted.includes(tokens[at]) ? tokens[at++] : "");
  const sum = () => { let left = product(); for (let sign = take("+", "-"); sign; sign = take("+", "-")) left = node(sign, left, product()); return left; };
  const product = () => {
    let left = signed();
    while (at < tokens.length) {
      const sign = take("*", "/");
      if (sign) left = node(sign, left, signed());
      else if (/^[\w.(]/.test(tokens[at])) left = node("*", left, power());
      else break;
    }
    return left;
  };
  const signed = () => {
    depth += 1;
    if (depth > reading.deepest) stop("brackets and signs are nested more than {0} deep", reading.deepest);
    const sign = take("+", "-"), inner = sign ? signed() : power();
    depth -= 1;
    return sign === "-" ? node("-", leaf("number", "0"), inner) : inner;
  };
  const power = () => { const base = atom(); return take("^") ? node("^", base, signed()) : base; };
  const atom = () => {
    if (at >= tokens.length) stop("the formula is not finished");
    const first = tokens[at++];
    if (first === "(") {
      const inner = sum();
      if (!take(")")) { if (at < tokens.length) stop('expected ")" in place of "{0}"', tokens[at]); stop('expected ")" at the end'); }
      return inner;
    }
    if (/^(?:\d|\.\d)/.test(first)) {
      const exponent = /[eE][-+]?(\d+)$/.exec(first);
      if (exponent && Number(exponent[1]) > reading.exponent) stop('the number "{0}" is too large or too small', first);
      return leaf("number", first);
    }
    if (FUNCTIONS.includes(first)) {
      const above = take("^") ? atom() : null;
      if (FUNCTIONS.includes(tokens[at])) stop("write the argument of {0} in brackets", first);
      const value = node(first, atom());
      return above ? node("^", value, above) : value;
    }
    if (/^[A-Za-z]/.test(first)) {
      const known = (word) => (Object.hasOwn(reading.names, word) ? reading.names[word] : undefined);
      return leaf("letter", known(first) || known(first.replaceAll("_", "")) || first, first);
    }
    return stop('"{0}" was not expected', first);
  };
  const whole = sum();
  if (at < tokens.length) stop('"{0}" was not expected', tokens[at]);
  return whole;
};
const listLetters = (tree) => [...(tree.kind === "letter" ? [tree] : []), ...tree.parts.flatMap(listLetters)];
// The joints of a sine or cosine such as c12, with the n of a minus; nothing of another letter.
const readWave = (name, reading) => {
  const match = new RegExp(reading.wave).exec(name);
  return match ? [...match[2].matchAll(reading.joints < 10 ? /(n?)(\d)/g : /(n?)(\d+)/g)] : [];
};
// The numbers of the joints whose coordinates, sines or cosines a formula has.
const listJoints = (tree, reading) => listLetters(tree).flatMap(({ text }) => (/^q\d+$/.test(text) ? [Number(text.slice(1))] : readWave(text, reading).map(([, , joint]) => Number(joint))));
const OPERATIONS = { "+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b, "^": (a, b) => a ** b };
// A formula of numbers alone; null where it has letters, roots or powers.
const readRational = (tree) => {
  if (tree.kind === "number") return Number(tree.text);
  const parts = tree.parts.map(readRational);
  return !"+-*/".includes(tree.kind) || parts.length < 2 || parts.includes(null) || (tree.kind === "/" && parts[1] === 0) ? null : OPERATIONS[tree.kind](...parts);
};
// The value where letters are those of `v`; sines take sums of joint angles, powers are whole numbers.
const evaluateFormula = (tree, v, reading, say = fillIn) => {
  const stop = (message, ...values) => { throw new Error(say(message, ...values)); };
  const whole = (number) => number !== null && Number.isInteger(number) && Math.abs(number) <= reading.highest;
  const angle = (part) => {
    if (part.kind === "letter" && /^q[1-9]\d*$/.test(part.text) && reading.turning.includes(Number(part.text.slice(1)))) return v[part.text];
    if (part.kind === "+" || part.kind === "-") return OPERATIONS[part.kind](...part.parts.map(angle));
    if (part.kind === "*") for (const [factor, other] of [part.parts, [...part.parts].reverse()]) if (whole(readRational(factor))) return readRational(factor) * angle(other);
    if (readRational(part) === 0) return 0;
    return stop("sin and cos take a sum of joint angles, as q1 + q2");
  };
  const wave = (kind, numbers) => (kind.toLowerCase() === "s" ? Math.sin : Math.cos)(numbers.reduce((total, [, sign, joint]) => {
    if (!reading.turning.includes(Number(joint))) stop("joint {0} has no angle", joint);
    return total + (sign ? -1 : 1) * v[`q${joint}`];
  }, 0));
  const value = (part) => {
    if (part.kind === "number") return Number(part.text);
    if (part.kind === "letter") {
      if (Object.hasOwn(v, part.text)) return v[part.text];
      const joints = readWave(part.text, reading);
      if (!joints.length) stop('"{0}" is no letter of this lesson', part.typed);
      return wave(part.text[0], joints);
    }
    if (part.kind === "sqrt") {
      const number = readRational(part.parts[0]);
      if (number === null || number < 0) stop("sqrt takes a number whose root stands in the formulas of this robot");
      return Math.sqrt(number);
    }
    if (FUNCTIONS.includes(part.kind)) return Math[part.kind](angle(part.parts[0]));
    const a = value(part.parts[0]), b = part.kind === "^" ? readRational(part.parts[1]) : value(part.parts[1]);
    if (part.kind === "^" && !whole(b)) stop("a power is a whole number up to {0}; use sqrt for roots", reading.highest);
    if ((part.kind === "/" && b === 0) || (part.kind === "^" && a === 0 && b < 0)) stop("the formula divides by zero");
    return OPERATIONS[part.kind](a, b);
  };
  return value(tree);
};
// A number as a formula of numbers, and of letters with values.
const evaluateNumber = (tree, values, reading, say = fillIn) => {
  if (tree.kind === "number") return Number(tree.text);
  if (tree.kind === "letter") {
    if (Object.hasOwn(values, tree.text)) return values[tree.text];
    if (/^d{0,2}q\d+$/.test(tree.text) || readWave(tree.text, reading).length) throw new Error(say('put in the numbers of the question for "{0}"', tree.typed));
    throw new Error(say('"{0}" has no value in this lesson', tree.typed));
  }
  const parts = tree.parts.map((part) => evaluateNumber(part, values, reading, say));
  const value = FUNCTIONS.includes(tree.kind) ? Math[tree.kind](parts[0]) : OPERATIONS[tree.kind](...parts);
  if (!Number.isFinite(value)) throw new Error(say("the formula has no finite value"));
  return value;
};
// Whether a typed formula equals the answer at random points that `draw` gives.
const compareFormula = (typed, answer, draw, reading, say = fillIn) => {
  const tree = readFormula(typed, reading, say);
  for (const letter of listLetters(tree)) if (reading.closed.includes(letter.text)) throw new Error(say('write out what "{0}" stands for', letter.typed));
  for (let trial = 0; trial < 8; trial += 1) {
    const v = draw(), right = answer(v);
    if (!(Math.abs(evaluateFormula(tree, v, reading, say) - right) <= 1e-9 * Math.max(1, Math.abs(right)))) return false;
  }
  return true;
};
