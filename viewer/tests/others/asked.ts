/** What tests ask of pages that are somebody else's. */

import type { Statistics } from "../../src/render/measures.js";

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

/** What a field in Babylon.js tells of itself under a look. */
export interface Told {
  bounds: { min: number[]; max: number[] };
  /** With and without what is known of empty space. */
  statistics: { sparse: Statistics; dense: Statistics };
  /** The world's points that were picked at shares of the picture, and the shares at which the camera sees them. */
  picked: ({ point: number[]; seen: number[] } | null)[];
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
    /** What a field tells, with points picked at these shares of the picture's width and height; then its picture. */
    askBabylon(look: BabylonLook, at: [number, number][]): Promise<{ told: Told; pixels: number[] }>;
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
