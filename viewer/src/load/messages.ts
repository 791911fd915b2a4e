/** The messages between page and worker. */

import type { DecodedPart, LevelEntry } from "./level.js";
import type { Opened } from "./loader.js";
import type { DeviceLimits } from "./plan.js";
import type { Look } from "./residents.js";
import type { OwnSource, RequestOptions } from "./source.js";

/**
 * In order: query the device's limits; load a container; decode the loaded data again; stop loading; if not everything
 * fits, keep what is near the camera, which is given in the field's axes; let the helpers at `ports` decode too; remove
 * a helper; be a helper, at `port`.
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

/**
 * The first reply reports that the script runs. `limits` are null if workers have no WebGL. `round` counts how often
 * levels were requested again; replies of earlier rounds are obsolete.
 */
export type Reply =
  | { kind: "running" }
  | { kind: "device"; limits: DeviceLimits | null }
  | { kind: "opened"; opened: Opened }
  | { kind: "progress"; arrived: number }
  | { kind: "begun"; part: number; round: number }
  | { kind: "part"; part: DecodedPart; round: number }
  | { kind: "entry"; entry: LevelEntry; round: number }
  | { kind: "residents"; held: number; known: number; isAnswer: boolean }
  /** The requested levels have arrived again. */
  | { kind: "again" }
  | { kind: "done" }
  | { kind: "failed"; message: string; remedy: string };
