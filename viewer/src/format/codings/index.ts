/**
 * The codings of atlases. A coding turns the bytes of an atlas chunk into codes, one unsigned integer per node;
 * `values.ts` decodes the codes. A new coding is a file here and a line in the table.
 */

import { GROUPS } from "../generated.js";
import type { Coding } from "./atlas.js";
import { runCoding } from "./runs.js";

export type { Atlas, Codes, Coding } from "./atlas.js";

/** Codings by chunk type; so far, there is only one. */
export const CODINGS: Readonly<Record<string, Coding>> = Object.fromEntries(GROUPS.map(({ kind }) => [kind, runCoding]));
