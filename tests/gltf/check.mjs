// Assets that were written, as other programs see them: node check.mjs ASSET...
//
// Khronos' validator finds no errors and no warnings, glTF-Transform reads them and what it writes is valid
// again, and stock three.js builds the fallback mesh. Prints a line for each asset; exits with 1 at the
// first thing that is wrong.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { basename, dirname, resolve } from "node:path";
import { NodeIO } from "@gltf-transform/core";
import { LoadingManager } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import validator from "gltf-validator";

// Browsers have it, node does not; three.js tells of loaded data URIs by it.
globalThis.ProgressEvent ??= class extends Event {};

const EXTENSION = "MIPVOG_radiance_field";

async function validate(name, bytes, folder) {
  const report = await validator.validateBytes(new Uint8Array(bytes), {
    uri: name,
    externalResourceFunction: (uri) =>
      readFile(resolve(folder, decodeURIComponent(uri))).then((found) => new Uint8Array(found)),
  });
  // The validator does not know the attributes that KHR_gaussian_splatting adds.
  const isSplats = ({ code, pointer }) =>
    code === "MESH_PRIMITIVE_INVALID_ATTRIBUTE" && pointer.includes("/KHR_gaussian_splatting:");
  const bad = report.issues.messages.filter((found) => found.severity <= 1 && !isSplats(found));
  assert.deepEqual(bad, [], `${name}: ${JSON.stringify(bad, null, 1)}`);
  return report;
}

function document(bytes) {
  if (bytes.toString("latin1", 0, 4) !== "glTF") return JSON.parse(bytes.toString("utf8"));
  return JSON.parse(bytes.toString("utf8", 20, 20 + bytes.readUInt32LE(12)));
}

async function readWithThree(bytes, isGlb, folder) {
  const data = isGlb ? new Uint8Array(bytes).buffer : bytes.toString("utf8");
  // Node fetches no files, but data.
  const manager = new LoadingManager();
  manager.setURLModifier((url) =>
    /^(data|blob):/.test(url)
      ? url
      : `data:application/octet-stream;base64,${readFileSync(resolve(folder, url), "base64")}`,
  );
  const { scene } = await new GLTFLoader(manager).parseAsync(data, "");
  let triangles = 0;
  scene.updateMatrixWorld(true);
  scene.traverse((object) => {
    if (!object.isMesh) return;
    triangles += object.geometry.index.count / 3;
    const color = object.geometry.getAttribute("color");
    assert.equal(color.itemSize, 3);
    assert.ok(object.material.isMeshBasicMaterial, "colours are shown as trained");
    assert.ok(object.material.vertexColors);
  });
  return triangles;
}

/** Triangles of meshes that viewers show only by MSFT_lod. */
function coarserTriangles({ nodes = [], meshes = [], accessors = [] }) {
  const ids = nodes.flatMap((node) => node.extensions?.MSFT_lod?.ids ?? []);
  const primitives = ids.flatMap((id) => meshes[nodes[id].mesh].primitives);
  return primitives.reduce((sum, { indices }) => sum + accessors[indices].count / 3, 0);
}

for (const path of process.argv.slice(2)) {
  const bytes = await readFile(path);
  const [name, folder] = [basename(path), dirname(resolve(path))];
  const isGlb = name.endsWith(".glb");
  const report = await validate(name, bytes, folder);
  const json = document(bytes);
  const fields = json.extensions?.[EXTENSION]?.radianceFields ?? [];
  assert.equal(Boolean(json.extensionsUsed?.includes(EXTENSION)), fields.length > 0);
  assert.ok(!json.extensionsRequired?.includes(EXTENSION));

  const io = new NodeIO();
  // It says that it drops what it does not know.
  const read = await io.setLogger({ debug() {}, info() {}, warn() {}, error() {} }).read(path);
  const meshes = read.getRoot().listMeshes().length;
  assert.equal(meshes, json.meshes?.length ?? 0);
  await validate(`again.${name}`, await io.writeBinary(read), folder);

  const triangles = await readWithThree(bytes, isGlb, folder);
  assert.equal(triangles + coarserTriangles(json), report.info.totalTriangleCount);
  console.log(`${name}: ${fields.length} fields, ${meshes} meshes, ${triangles} triangles`);
}
