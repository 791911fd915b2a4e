/**
 * How atlases are coded. A coding turns the bytes of an atlas chunk into codes, an unsigned integer
 * for each node; what codes mean is in `values.ts`. A new coding is a file here and a line of the table.
 */

import { GROUPS } from "../generated.js";
import type { Coding } from "./atlas.js";
import { runCoding } from "./runs.js";

export type { Atlas, Codes, Coding } from "./atlas.js";

/** Codings by the chunk type that uses them: so far there is one. */
export const CODINGS: Readonly<Record<string, Coding>> = Object.fromEntries(GROUPS.map(({ kind }) => [kind, runCoding]));
