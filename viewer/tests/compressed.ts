/** Assets of a field and a green floor below it, compressed in every way that there is. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import draco3d from "draco3d";
import { MeshoptEncoder } from "meshoptimizer";
import { glb } from "./glb.js";
import { ROOT } from "./support.js";

/** The field's container. */
export const container = readFileSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog"));
/** Squares along each side of the floor. */
export const SQUARES = 8;
const side = SQUARES + 1;
const POSITIONS = Float32Array.from({ length: 3 * side * side }, (_, at) => {
  const [corner, axis] = [Math.floor(at / 3), at % 3];
  return axis === 1 ? -2 : ((axis === 0 ? corner % side : Math.floor(corner / side)) / SQUARES - 0.5) * 6;
});
const INDICES = Uint16Array.from(
  Array.from({ length: SQUARES * SQUARES }, (_, square) => {
    const corner = Math.floor(square / SQUARES) * side + (square % SQUARES);
    return [corner, corner + side, corner + 1, corner + 1, corner + side, corner + side + 1];
  }).flat(),
);
const UPRIGHT = [-Math.SQRT1_2, 0, 0, Math.SQRT1_2];

/** An asset of the field and the floor, whose parts lie one behind the other in its binary. */
function asset(parts: Uint8Array[], floor: { views?: object[]; accessors: object[]; primitive?: object; material?: object; more?: object; required: string[] }): Buffer {
  const starts: number[] = [];
  let length = 0;
  const pieces = [container, ...parts].map((part) => {
    starts.push(length);
    const padded = Buffer.concat([part, Buffer.alloc((4 - (part.length % 4)) % 4)]);
    length += padded.length;
    return padded;
  });
  const document = {
    asset: { version: "2.0" },
    extensionsUsed: ["MIPVOG_radiance_field", ...floor.required],
    extensionsRequired: floor.required,
    extensions: { MIPVOG_radiance_field: { radianceFields: [{ bufferView: 0, mimeType: "model/vnd.mipvog" }] } },
    scene: 0,
    scenes: [{ nodes: [0, 1] }],
    nodes: [{ rotation: UPRIGHT, extensions: { MIPVOG_radiance_field: { radianceField: 0 } } }, { name: "floor", mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 1 }, indices: 0, material: 0, ...floor.primitive }] }],
    materials: [{ pbrMetallicRoughness: { baseColorFactor: [0, 1, 0, 1], metallicFactor: 0, roughnessFactor: 1 }, ...floor.material }],
    accessors: floor.accessors,
    bufferViews: [{ buffer: 0, byteLength: container.length }, ...(floor.views ?? parts.map((part, i) => ({ buffer: 0, byteOffset: starts[i + 1], byteLength: part.length })))],
    buffers: [{ byteLength: length }],
    ...floor.more,
  };
  return glb(JSON.parse(JSON.stringify(document).replaceAll('"START1"', String(starts[1])).replaceAll('"START2"', String(starts[2]))), Buffer.concat(pieces));
}

const bytesOf = (values: Float32Array | Uint16Array) => new Uint8Array(values.buffer, values.byteOffset, values.byteLength);
const indices = { componentType: 5123, count: INDICES.length, type: "SCALAR" };
const positions = { componentType: 5126, count: side * side, type: "VEC3", min: [-3, -2, -3], max: [3, -2, 3] };
export const plain = () => asset([bytesOf(INDICES), bytesOf(POSITIONS)], { accessors: [{ bufferView: 1, ...indices }, { bufferView: 2, ...positions }], required: [] });

export async function withDraco(): Promise<Buffer> {
  const encoder = await draco3d.createEncoderModule({});
  const [builder, mesh, coder] = [new encoder.MeshBuilder(), new encoder.Mesh(), new encoder.Encoder()];
  builder.AddFacesToMesh(mesh, INDICES.length / 3, Uint32Array.from(INDICES));
  const id = builder.AddFloatAttributeToMesh(mesh, encoder.POSITION, side * side, 3, POSITIONS);
  const out = new encoder.DracoInt8Array();
  const count = coder.EncodeMeshToDracoBuffer(mesh, out);
  const coded = Uint8Array.from({ length: count }, (_, at) => out.GetValue(at));
  const primitive = { extensions: { KHR_draco_mesh_compression: { bufferView: 1, attributes: { POSITION: id } } } };
  return asset([coded], { accessors: [indices, positions], primitive, required: ["KHR_draco_mesh_compression"] });
}

export async function withMeshopt(name: string): Promise<Buffer> {
  await MeshoptEncoder.ready;
  const parts = [
    MeshoptEncoder.encodeGltfBuffer(bytesOf(INDICES), INDICES.length, 2, "TRIANGLES"),
    MeshoptEncoder.encodeGltfBuffer(bytesOf(POSITIONS), side * side, 12, "ATTRIBUTES"),
  ];
  const view = (number: 1 | 2, count: number, byteStride: number, mode: string) => ({
    buffer: 1,
    byteLength: count * byteStride,
    ...(mode === "ATTRIBUTES" && { byteStride }),
    extensions: { [name]: { buffer: 0, byteOffset: `START${number}`, byteLength: parts[number - 1].length, byteStride, count, mode } },
  });
  const views = [view(1, INDICES.length, 2, "TRIANGLES"), view(2, side * side, 12, "ATTRIBUTES")];
  const length = container.length + parts.reduce((sum, part) => sum + part.length + ((4 - (part.length % 4)) % 4), 0) + ((4 - (container.length % 4)) % 4);
  const more = { buffers: [{ byteLength: length }, { byteLength: bytesOf(INDICES).length + bytesOf(POSITIONS).length, extensions: { [name]: { fallback: true } } }] };
  return asset(parts, { views, accessors: [{ bufferView: 1, ...indices }, { bufferView: 2, ...positions }], more, required: [name] });
}

/** An asset whose floor has a texture in KTX2, which nobody has to be able to read for this. */
export function withKtx2(): Buffer {
  const more = { textures: [{ extensions: { KHR_texture_basisu: { source: 0 } } }], images: [{ bufferView: 3, mimeType: "image/ktx2" }] };
  const material = { pbrMetallicRoughness: { baseColorFactor: [0, 1, 0, 1], metallicFactor: 0, baseColorTexture: { index: 0 } } };
  return asset([bytesOf(INDICES), bytesOf(POSITIONS), Uint8Array.of(0xab, 0x4b, 0x54, 0x58)], { accessors: [{ bufferView: 1, ...indices }, { bufferView: 2, ...positions }], material, more, required: ["KHR_texture_basisu"] });
}
