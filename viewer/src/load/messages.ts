/** What the page and the worker say to each other. */

import type { DecodedPart, LevelEntry } from "./level.js";
import type { Opened } from "./loader.js";
import type { DeviceLimits } from "./plan.js";
import type { Look } from "./residents.js";
import type { OwnSource, RequestOptions } from "./source.js";

/**
 * Ask the device for its limits; load a container; decode again what was loaded; load no more; where not all has room, keep what is near the
 * camera, at a place in the field's axes; let the helpers at `ports` decode, too; go on
 * without the one of a number; be one, at `port`.
 */
export type Request =
  | { kind: "device" }
  | { kind: "load"; source: OwnSource; request: RequestOptions; device: DeviceLimits }
  | { kind: "again" }
  | { kind: "stop" }
  | { kind: "look"; camera: Look }
  | { kind: "crew"; ports: MessagePort[] }
  | { kind: "left"; helper: number }
  | { kind: "help"; port: MessagePort };

/** The first reply says that the script runs. `limits` are null where workers have no WebGL. `round` counts the times that levels were asked for again; what is of an earlier round is of no use. */
export type Reply =
  | { kind: "running" }
  | { kind: "device"; limits: DeviceLimits | null }
  | { kind: "opened"; opened: Opened }
  | { kind: "progress"; arrived: number }
  | { kind: "begun"; part: number; round: number }
  | { kind: "part"; part: DecodedPart; round: number }
  | { kind: "entry"; entry: LevelEntry; round: number }
  | { kind: "residents"; held: number; known: number; isAnswer: boolean }
  /** What was asked for again has come. */
  | { kind: "again" }
  | { kind: "done" }
  | { kind: "failed"; message: string; remedy: string };
