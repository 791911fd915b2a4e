/** Who has a stage. Browsers limit the WebGL contexts of a page, and other content needs some. */

/** Maximum number of stages. */
const MOST = 8;

/** What can have a stage, and give it up. */
export interface StageHolder {
  /** Whether it is near the window. */
  readonly isInView: boolean;
  /** Whether it can give up its stage without a visible change. */
  readonly isAtRest: boolean;
  /** Ends its stage, and calls {@link drop}. */
  giveUp(): void;
  /** Called when a stage is available again. */
  resume(): void;
}

/** Those with a stage, the most recently used last; and those that wait for one. */
const live: StageHolder[] = [];
const waiting = new Set<StageHolder>();

/** Whether a stage is available: the offscreen or least recently used holder gives up its own. */
export function makeRoom(holder: StageHolder): boolean {
  if (live.length >= MOST) {
    const other = live.find((one) => !one.isInView) ?? live.find((one) => one.isAtRest);
    if (!other) {
      waiting.add(holder);
      return false;
    }
    other.giveUp();
  }
  waiting.delete(holder);
  return true;
}

/** Serves the next one that waits, after another has finished or left the page. */
export function serveWaiting(): void {
  const [next] = waiting;
  if (!next || (live.length >= MOST && !live.some((one) => one.isAtRest || !one.isInView))) return;
  waiting.delete(next);
  next.resume();
}

/** Notes a new stage. */
export function hold(holder: StageHolder): void {
  live.push(holder);
}

/** Marks a stage as recently used, so that it is given up last. False for a holder without one. */
export function use(holder: StageHolder): boolean {
  const at = live.indexOf(holder);
  if (at >= 0) live.push(...live.splice(at, 1));
  return at >= 0;
}

/** Notes the end of a stage. */
export function drop(holder: StageHolder): void {
  const at = live.indexOf(holder);
  if (at >= 0) live.splice(at, 1);
}

/** Waits for a stage no longer. */
export function forget(holder: StageHolder): void {
  waiting.delete(holder);
}
