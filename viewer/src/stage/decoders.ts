/** Decoders of compressed data in assets, in their own script because few assets need them. */

import makeDraco from "draco";
import binary from "draco.wasm";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";

export { MeshoptDecoder };

/** Typed arrays by the names that three.js uses. */
const ARRAYS = { Float32Array, Int8Array, Int16Array, Int32Array, Uint8Array, Uint16Array, Uint32Array };

/** The numbers of one attribute. */
export interface Attribute {
  array: InstanceType<(typeof ARRAYS)[keyof typeof ARRAYS]>;
  itemSize: number;
}

/** A decompressed mesh or point cloud. */
export interface Decoded {
  index: Uint32Array | null;
  attributes: Record<string, Attribute>;
}

type Draco = Awaited<ReturnType<typeof makeDraco>>;

let draco: Promise<Draco> | null = null;

/** Decodes Draco data. `ids` and `types` have the number and the value type of each attribute by name. */
export async function decodeDraco(bytes: Uint8Array, ids: Record<string, number>, types: Record<string, string>): Promise<Decoded> {
  draco ??= makeDraco({ wasmBinary: binary });
  const module = await draco;
  const decoder = new module.Decoder();
  const isMesh = decoder.GetEncodedGeometryType(bytes) === module.TRIANGULAR_MESH;
  const geometry = isMesh ? new module.Mesh() : new module.PointCloud();
  try {
    const status = isMesh ? decoder.DecodeArrayToMesh(bytes, bytes.length, geometry) : decoder.DecodeArrayToPointCloud(bytes, bytes.length, geometry);
    if (!status.ok()) throw new Error(`Draco: ${status.error_msg()}`);
    const attributes = Object.entries(ids).map(([name, id]) => {
      const kind = ARRAYS[types[name] as keyof typeof ARRAYS];
      const attribute = decoder.GetAttributeByUniqueId(geometry, id);
      const itemSize = attribute.num_components();
      const count = geometry.num_points() * itemSize;
      const array = copied(module, count * kind.BYTES_PER_ELEMENT, (at, size) => {
        decoder.GetAttributeDataArrayForAllPoints(geometry, attribute, dataType(module, types[name]), size, at);
        return new kind(module.HEAPF32.buffer, at, count).slice();
      });
      return [name, { array, itemSize }];
    });
    const indices = 3 * (isMesh ? geometry.num_faces() : 0);
    const index = copied(module, 4 * indices, (at, size) => {
      if (isMesh) decoder.GetTrianglesUInt32Array(geometry, size, at);
      return new Uint32Array(module.HEAPF32.buffer, at, indices).slice();
    });
    return { index: isMesh ? index : null, attributes: Object.fromEntries(attributes) };
  } finally {
    module.destroy(geometry);
    module.destroy(decoder);
  }
}

/** The result of `read` on `size` allocated bytes, which are freed afterwards. */
function copied<T>(module: Draco, size: number, read: (at: number, size: number) => T): T {
  const at = module._malloc(size);
  try {
    return read(at, size);
  } finally {
    module._free(at);
  }
}

/** The Draco constant of a type. */
function dataType(module: Draco, name: string): number {
  const { DT_FLOAT32, DT_INT8, DT_INT16, DT_INT32, DT_UINT8, DT_UINT16, DT_UINT32 } = module;
  return { Float32Array: DT_FLOAT32, Int8Array: DT_INT8, Int16Array: DT_INT16, Int32Array: DT_INT32, Uint8Array: DT_UINT8, Uint16Array: DT_UINT16, Uint32Array: DT_UINT32 }[name]!;
}
