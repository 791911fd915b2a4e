/** Fields in glTF assets, independent of the framework that loads them. */

import { FieldError } from "./errors.js";

export const EXTENSION = "MIPVOG_radiance_field";

/** Place of a container: at an address beside the asset, or in a buffer view. */
export type Place = { uri: string } | { bufferView: number };

/** A node's properties for the extension. */
export interface FieldReference {
  radianceField?: unknown;
}

/** The place of the field with this index in an asset. */
export function placeOf(asset: { extensions?: Record<string, { radianceFields?: unknown[] }> }, { radianceField: number }: FieldReference): Place {
  const fields = asset.extensions?.[EXTENSION]?.radianceFields ?? [];
  const field = (typeof number === "number" ? fields[number] : undefined) as Partial<{ uri: string; bufferView: number }> | undefined;
  if (!field) throw new FieldError(`A node shows radiance field ${number}; the asset has ${fields.length}.`);
  const { uri, bufferView } = field;
  if (bufferView !== undefined) return { bufferView };
  if (uri === undefined) throw new FieldError(`Radiance field ${number} has neither uri nor bufferView.`);
  return { uri };
}
