/** Rules for single values of the metadata. */

import { FieldError, REMEDY } from "../errors.js";

/** A rule for a value of the metadata; throws if the value breaks it. */
export type Rule = ((value: unknown, key: string) => void) & { optional?: true };

export function fail(key: string, expected: string): never {
  throw new FieldError(`The metadata's ${key || "content"} should be ${expected}.`);
}

const number = (expected: string, holds: (value: number) => boolean): Rule => (value, key) => {
  if (typeof value !== "number" || !Number.isFinite(Math.fround(value)) || !holds(value)) fail(key, expected);
};
export const whole = (from: number, to: number) =>
  number(`a whole number from ${from} to ${to}`, (value) => Number.isInteger(value) && value >= from && value <= to);
export const finite = number("a finite number", () => true);
export const positive = number("a positive number", (value) => value > 0);
export const share = number("a number from 0 to below 1", (value) => value >= 0 && value < 1);
export const fromZero = number("a number from 0", (value) => value >= 0);
export const oneOf = (...names: string[]): Rule => (value, key) => {
  if (!names.includes(value as string)) {
    throw new FieldError(`The metadata's ${key} is ${JSON.stringify(value)}; this viewer knows ${names.join(", ")}.`, REMEDY.newer);
  }
};
export const boolean: Rule = (value, key) => {
  if (typeof value !== "boolean") fail(key, "true or false");
};
export const text: Rule = (value, key) => {
  if (typeof value !== "string") fail(key, "a text");
};
export const nullable = (rule: Rule): Rule => (value, key) => {
  if (value !== null) rule(value, key);
};
/** Makes the key of a rule optional. */
export const optional = (rule: Rule): Rule => Object.assign((value: unknown, key: string) => rule(value, key), { optional: true as const });
export const list = (least: number, most: number, rule: Rule): Rule => (value, key) => {
  if (!Array.isArray(value) || value.length < least || value.length > most) fail(key, `a list of ${least} to ${most}`);
  value.forEach((item, i) => rule(item, `${key}[${i}]`));
};
/** A rule for an object. Unknown keys are errors, and so are missing keys, unless optional. */
export const record = (rules: Record<string, Rule>): Rule => (value, key) => {
  if (typeof value !== "object" || value === null || Array.isArray(value)) fail(key, "an object");
  const found = value as Record<string, unknown>;
  for (const name of Object.keys(found)) {
    if (!Object.hasOwn(rules, name)) throw new FieldError(`The metadata's ${join(key, name)} is not known.`, REMEDY.newer);
  }
  for (const [name, rule] of Object.entries(rules)) {
    if (!Object.hasOwn(found, name) && rule.optional) continue;
    if (!Object.hasOwn(found, name)) fail(join(key, name), "there");
    rule(found[name], join(key, name));
  }
};
const join = (key: string, name: string) => (key ? `${key}.${name}` : name);
/** A rule for one of two objects; only the first one has the key. */
export const choice = (name: string, one: Rule, other: Rule): Rule => (value, key) => {
  const has = typeof value === "object" && value !== null && name in value;
  (has ? one : other)(value, key);
};
