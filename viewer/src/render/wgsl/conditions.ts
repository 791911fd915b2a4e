/**
 * The preprocessor that WGSL lacks: conditions keep or drop lines, and names are replaced by their definitions.
 *
 * `#if`, `#ifdef NAME`, `#ifndef NAME`, `#elif`, `#else` and `#endif` have the same meaning as in GLSL. A condition
 * joins `defined(NAME)`, `!defined(NAME)` and `NAME == NUMBER` with `&&`, and these with `||`.
 */
export function applyConditions(source: string, defined: Record<string, string | number>): string {
  const kept: string[] = [];
  /** For each enclosing condition, whether its lines are kept, and whether any branch was. */
  const around: { keeps: boolean; had: boolean }[] = [];
  for (const line of source.split("\n")) {
    const [, directive, condition = ""] = /^\s*#(\w+)\s*(.*)$/.exec(line) ?? [];
    const inner = around.at(-1);
    if (directive === undefined) {
      if (around.every(({ keeps }) => keeps)) kept.push(withValues(line, defined));
    } else if (directive === "endif" && inner) {
      around.pop();
    } else if (directive === "else" && inner) {
      inner.keeps = !inner.had;
    } else if (directive === "elif" && inner) {
      inner.keeps = !inner.had && holds(condition, defined);
      inner.had ||= inner.keeps;
    } else if (/^if(n?def)?$/.test(directive)) {
      const keeps = holds({ if: condition, ifdef: `defined(${condition})`, ifndef: `!defined(${condition})` }[directive]!, defined);
      around.push({ keeps, had: keeps });
    } else {
      throw new Error(`unexpected line of a shader: ${line}`);
    }
  }
  if (around.length > 0) throw new Error("a condition of a shader has no end");
  return kept.join("\n");
}

function holds(condition: string, defined: Record<string, string | number>): boolean {
  return condition.split("||").some((all) => all.split("&&").every((one) => holdsOne(one.trim(), defined)));
}

function holdsOne(condition: string, defined: Record<string, string | number>): boolean {
  const [, not, name, other, number] = /^(?:(!?)defined\((\w+)\)|(\w+) == (\d+))$/.exec(condition) ?? [];
  if (name !== undefined) return name in defined !== (not === "!");
  if (other === undefined) throw new Error(`unexpected condition of a shader: ${condition}`);
  return String(defined[other]) === number;
}

/** Replaces defined names, which consist of capital letters. Comments are kept. */
function withValues(line: string, defined: Record<string, string | number>): string {
  if (line.trimStart().startsWith("//")) return line;
  return line.replace(/\b[A-Z][A-Z0-9_]+\b/g, (name) => (Object.hasOwn(defined, name) ? String(defined[name]) : name));
}
