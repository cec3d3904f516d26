// Reads cases from the standard input, marks them as the page does, and writes the marks.
import fs from "node:fs";
import vm from "node:vm";

const [script] = process.argv.slice(2);
const { lessons, texts } = JSON.parse(fs.readFileSync(0, "utf8"));
vm.runInThisContext(fs.readFileSync(script, "utf8"));
const attempt = (work) => { try { return work(); } catch (error) { return { error: error.message }; } };
const marks = vm.runInThisContext(`(({ lessons, attempt }) => lessons.map(({ reading, letters, formulas, cases }) => {
  const known = formulas.map(([name, code]) => [name, new Function("v", "return " + code)]);
  const draw = () => {
    const v = Object.fromEntries(letters.map((name) => [name, 0.2 + Math.random()]));
    for (const [name, formula] of known) v[name] = formula(v);
    return v;
  };
  return cases.map(([typed, code]) => attempt(() => compareFormula(typed, new Function("v", "return " + code), draw, reading)));
}))`)({ lessons, attempt });
const trees = vm.runInThisContext("(({ texts, attempt }) => texts.map(([text, reading]) => attempt(() => readFormula(text, reading))))")({ texts, attempt });
process.stdout.write(JSON.stringify({ marks, trees }));
