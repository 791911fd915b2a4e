/** What the page and the worker say to each other. */

import type { DecodedLevel } from "./level.js";
import type { Opened } from "./loader.js";
import type { DeviceLimits } from "./plan.js";
import type { OwnSource } from "./source.js";

export type Request = { kind: "load"; source: OwnSource; device: DeviceLimits } | { kind: "again" };

export type Reply =
  | { kind: "opened"; opened: Opened }
  | { kind: "progress"; arrived: number }
  | { kind: "level"; level: DecodedLevel }
  | { kind: "done" }
  | { kind: "failed"; message: string; remedy: string };
