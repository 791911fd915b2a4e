/** Opens containers and assets as objects of a scene. */

import { Box3, Group, HemisphereLight, Light, type Material, type Mesh, type Object3D, type SkinnedMesh, Texture, type Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { FieldError, REMEDY } from "../errors.js";
import { Compressed } from "./compressed.js";
import { isAsset } from "../format/kinds.js";
import { RadianceField } from "../three/field.js";
import { RadianceFieldExtension } from "../three/gltf.js";
import type { Source } from "../load/source.js";
import type { FieldOptions } from "../fieldOptions.js";

/** Number of bytes that identify the kind of a file. */
const FIRST = 64;

export interface Opened {
  object: Object3D;
  /** The fields in the file. */
  fields: RadianceField[];
  name: string;
  /** What the file contains but is not shown, and why; null if everything is shown. */
  lacks: FieldError | null;
}

/** Options for opening files. */
export type OpenOptions = Pick<FieldOptions, "maxBytes">;

/**
 * Opens an address. Its extension tells containers, which are then loaded in parts, from assets; other addresses are
 * told apart by their first bytes.
 */
export async function openAddress(address: string, options: OpenOptions = {}): Promise<Opened> {
  const name = fileName(address);
  const ending = /\.(mipvog|glb|gltf)$/i.exec(name);
  const isOne = ending ? !/mipvog/i.test(ending[1]) : isAsset(await firstBytes(address));
  return isOne ? openAsset(name, (loader) => loader.loadAsync(address), options) : openField(address, name, options);
}

/** Opens a file that was dropped or chosen. Its first bytes tell its kind. */
export async function openFile(file: File, options: OpenOptions = {}): Promise<Opened> {
  const head = new Uint8Array(await file.slice(0, FIRST).arrayBuffer());
  if (isAsset(head)) return openAsset(file.name, (loader) => file.arrayBuffer().then((bytes) => loader.parseAsync(bytes, "")), options);
  return openField(file, file.name, options);
}

/** The first bytes of a file; none if it is unreachable, which opening it then reports. */
async function firstBytes(address: string): Promise<Uint8Array> {
  const ending = new AbortController();
  try {
    const response = await fetch(address, { headers: { Range: `bytes=0-${FIRST - 1}` }, signal: ending.signal });
    // A part is read to its end, so that nothing is broken off.
    if (response.status === 206) return new Uint8Array(await response.arrayBuffer());
    const { value } = response.ok && response.body ? await response.body.getReader().read() : {};
    return value ?? new Uint8Array(0);
  } catch {
    return new Uint8Array(0);
  } finally {
    ending.abort();
  }
}

function fileName(address: string): string {
  let path: string;
  try {
    path = new URL(address, location.href).pathname;
  } catch {
    throw new FieldError(`${address} is no address of a file.`, REMEDY.network);
  }
  const name = path.split("/").pop() ?? path;
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}

/** A container on its own: training's z becomes the world's y. */
export function openField(source: Source, name: string, options: OpenOptions = {}): Opened {
  const field = new RadianceField(source, options);
  const object = new Group().add(field);
  object.rotation.x = -Math.PI / 2;
  return { object, fields: [field], name, lacks: null };
}

/** An asset; `load` runs the loader on it. */
export async function openAsset(name: string, load: Load, options: OpenOptions = {}): Promise<Opened> {
  const whole = await loadAsset(name, load, true, options);
  if (!(whole instanceof Undecoded)) return lit(whole);
  // Its fields can be shown, at least.
  const alone = await loadAsset(name, load, false, options);
  if (alone instanceof Undecoded) throw alone.error;
  if (alone.fields.length === 0) throw whole.error;
  return { ...alone, lacks: new FieldError(`${name} is shown without its meshes, which ${whole.decoders} could not decode: ${wordsOf(whole.error)}`, REMEDY.decompress) };
}

type Load = (loader: GLTFLoader) => Promise<{ scene: Group }>;

/** An asset with compressed data that could not be decoded. */
class Undecoded {
  constructor(
    readonly error: unknown,
    readonly decoders: string,
  ) {}
}

function wordsOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

async function loadAsset(name: string, load: Load, withMeshes: boolean, options: OpenOptions): Promise<Opened | Undecoded> {
  const extensions: RadianceFieldExtension[] = [];
  const loader = new GLTFLoader().register((parser) => {
    const extension = new RadianceFieldExtension(parser, options);
    extensions.push(extension);
    return extension;
  });
  const compressed = new Compressed(loader, withMeshes);
  let scene: Group;
  try {
    ({ scene } = await load(loader));
  } catch (error) {
    extensions.forEach((extension) => extension.dispose());
    if (error instanceof FieldError) throw error;
    const told = new FieldError(`${name} is no glTF asset that can be read: ${wordsOf(error)}`, REMEDY.foreign);
    const decoders = compressed.decoders.join(" and ");
    if (withMeshes && decoders) return new Undecoded(told, decoders);
    throw told;
  }
  const missing = [...compressed.missing].join(" and ");
  const lacks = missing ? new FieldError(`${name} is shown without what ${missing} decodes: this viewer has no such decoder.`, REMEDY.decompress) : null;
  const opened: Opened = { object: scene, fields: [], name, lacks };
  let failure: unknown = null;
  scene.traverse((object) => {
    failure ??= object.userData.radianceFieldError;
    if (object instanceof RadianceField) opened.fields.push(object);
  });
  if (failure) {
    release(opened);
    throw failure;
  }
  return opened;
}

/** Adds light for meshes, if the asset has none. Fields need no light. */
function lit(opened: Opened): Opened {
  let isLit = false;
  opened.object.traverse((object) => (isLit ||= object instanceof Light));
  if (!isLit) opened.object.add(new HemisphereLight(0xffffff, 0x777777, 3));
  return opened;
}

/** The position from which a world is viewed, in the scene; null for content that is viewed from outside. */
export function standpoint({ fields }: Opened): Vector3 | null {
  const world = fields.find(({ isWorld }) => isWorld);
  if (!world) return null;
  world.updateWorldMatrix(true, false);
  return world.standpoint.applyMatrix4(world.matrixWorld);
}

/** The visible box in the scene, as far as loaded; for worlds, the innermost box. */
export function visibleBox({ object }: Opened): Box3 {
  const box = new Box3();
  object.updateWorldMatrix(true, true);
  object.traverse((part) => {
    if (part instanceof RadianceField) box.union(part.visibleBounds.applyMatrix4(part.matrixWorld));
    else if ((part as Partial<Mesh>).isMesh) box.union(new Box3().setFromObject(part));
  });
  return box;
}

/** Frees the device memory of a file that is no longer shown. */
export function release({ object }: Opened): void {
  object.traverse((part) => {
    if (part instanceof RadianceField) {
      part.dispose();
      return;
    }
    const { geometry, material, skeleton } = part as Partial<SkinnedMesh> & Partial<Mesh>;
    geometry?.dispose();
    skeleton?.dispose();
    for (const one of [material ?? []].flat() as Material[]) {
      for (const texture of Object.values(one)) if (texture instanceof Texture) texture.dispose();
      one.dispose();
    }
  });
}
