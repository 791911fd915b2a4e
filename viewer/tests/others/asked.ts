/** What tests ask of pages that are somebody else's. */

/** A camera that looks at a point, y up, on a canvas as wide as high. */
export interface Look {
  address: string;
  size: number;
  position: [number, number, number];
  target: [number, number, number];
  /** Radians, from edge to edge. */
  angle: number;
  /** Display-referred. */
  background: [number, number, number];
}

/** A look at a field in Babylon.js, of either hand; `wall` is the distance of a red wall. */
export interface BabylonLook extends Look {
  rightHanded: boolean;
  wall?: number;
  /** Whether the device is taken away and given back before the picture. */
  losesDevice?: boolean;
}

/** An object of a loaded scene. */
export interface Found {
  name: string;
  kind: string;
  /** `radianceFieldError`, in words. */
  error: string | null;
}

declare global {
  interface Window {
    /** Loads an asset and draws it once: four bytes a pixel, rows from the top. */
    draw(look: Look): Promise<number[]>;
    /** Loads an asset and says what is in it. */
    list(address: string): Promise<Found[]>;
    /** Gives a container up before it is there: how its two promises end. */
    giveUp(address: string): Promise<string[]>;
    /** Draws a container from one side: four bytes a pixel, rows from the top. */
    drawField(address: string): Promise<number[]>;
    /** As `draw`, of a container or an asset with a field. */
    drawBabylon(look: BabylonLook): Promise<number[]>;
    /** As `list`. */
    listBabylon(address: string): Promise<Found[]>;
    /** What engines without WebGL 2 say. */
    refuseBabylon(address: string): Promise<string[]>;
  }
}

/** Rows from the top, of pixels whose rows go from the bottom. */
export function fromTop(pixels: Uint8Array, size: number): number[] {
  return Array.from({ length: size }, (_, row) => Array.from(pixels.subarray(4 * size * (size - 1 - row), 4 * size * (size - row)))).flat();
}
