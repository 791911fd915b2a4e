/** Containers and assets as objects of a scene. */

import { Box3, Group, HemisphereLight, Light, type Material, type Mesh, type Object3D, type SkinnedMesh, Texture } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { FieldError, REMEDY } from "../errors.js";
import { RadianceField } from "../three/field.js";
import { RadianceFieldExtension } from "../three/gltf.js";
import type { Source } from "../load/source.js";

export interface Opened {
  object: Object3D;
  /** The fields in it. */
  fields: RadianceField[];
  name: string;
}

/** Opens an address; told apart by its ending, so that a container can come in parts. */
export async function openAddress(address: string): Promise<Opened> {
  const name = fileName(address);
  return /\.(glb|gltf)$/i.test(name) ? openAsset(name, (loader) => loader.loadAsync(address)) : openField(address, name);
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
export function openField(source: Source, name: string): Opened {
  const field = new RadianceField(source);
  const object = new Group().add(field);
  object.rotation.x = -Math.PI / 2;
  return { object, fields: [field], name };
}

/** An asset; `load` runs the loader on it. */
export async function openAsset(name: string, load: (loader: GLTFLoader) => Promise<{ scene: Group }>): Promise<Opened> {
  const extensions: RadianceFieldExtension[] = [];
  const loader = new GLTFLoader().register((parser) => {
    const extension = new RadianceFieldExtension(parser);
    extensions.push(extension);
    return extension;
  });
  let scene: Group;
  try {
    ({ scene } = await load(loader));
  } catch (error) {
    extensions.forEach((extension) => extension.dispose());
    if (error instanceof FieldError) throw error;
    throw new FieldError(`${name} is no glTF asset that can be read: ${error instanceof Error ? error.message : String(error)}`, REMEDY.foreign);
  }
  const opened: Opened = { object: scene, fields: [], name };
  let failure: unknown = null;
  let isLit = false;
  scene.traverse((object) => {
    failure ??= object.userData.radianceFieldError;
    isLit ||= object instanceof Light;
    if (object instanceof RadianceField) opened.fields.push(object);
  });
  if (failure) {
    release(opened);
    throw failure;
  }
  // Fields need no light, but meshes beside them may; viewers bring it where an asset does not.
  if (!isLit) scene.add(new HemisphereLight(0xffffff, 0x777777, 3));
  return opened;
}

/** Where in the world something is to be seen, as far as has come. */
export function visibleBox({ object }: Opened): Box3 {
  const box = new Box3();
  object.updateWorldMatrix(true, true);
  object.traverse((part) => {
    if (part instanceof RadianceField) box.union(part.visibleBounds.applyMatrix4(part.matrixWorld));
    else if ((part as Partial<Mesh>).isMesh) box.union(new Box3().setFromObject(part));
  });
  return box;
}

/** Frees what the device holds of a file that is shown no more. */
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
