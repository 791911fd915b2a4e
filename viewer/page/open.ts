/** From a file or an address to objects of a scene. */

import { Group, type Object3D } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { FieldError, RadianceField, RadianceFieldExtension } from "../src/index.js";
import { REMEDY } from "../src/errors.js";

export interface Opened {
  object: Object3D;
  /** The fields in it. */
  fields: RadianceField[];
  name: string;
}

const GLB_MAGIC = 0x46546c67;

/** Opens a file that was dropped or chosen; told apart by content. */
export async function openFile(file: File): Promise<Opened> {
  const head = new DataView(await file.slice(0, 12).arrayBuffer());
  if (head.byteLength === 12 && head.getUint32(0, true) === GLB_MAGIC) {
    return openAsset(file.name, (loader) => file.arrayBuffer().then((bytes) => loader.parseAsync(bytes, "")));
  }
  return openField(file, file.name);
}

/** Opens an address; told apart by its ending, so that a container can come in parts. */
export async function openAddress(address: string): Promise<Opened> {
  const name = decodeURIComponent(new URL(address, location.href).pathname.split("/").pop() ?? address);
  return /\.(glb|gltf)$/i.test(name) ? openAsset(name, (loader) => loader.loadAsync(address)) : openField(address, name);
}

/** A container on its own: training's z becomes the world's y. */
function openField(source: string | Blob, name: string): Opened {
  const field = new RadianceField(source);
  // A viewer's camera goes where no training camera was.
  field.keepsRange = false;
  const object = new Group().add(field);
  object.rotation.x = -Math.PI / 2;
  return { object, fields: [field], name };
}

async function openAsset(name: string, load: (loader: GLTFLoader) => Promise<{ scene: Group }>): Promise<Opened> {
  const loader = new GLTFLoader().register((parser) => new RadianceFieldExtension(parser));
  let scene: Group;
  try {
    ({ scene } = await load(loader));
  } catch (error) {
    if (error instanceof FieldError) throw error;
    throw new FieldError(`${name} is no glTF asset that can be read: ${error instanceof Error ? error.message : String(error)}`, REMEDY.foreign);
  }
  const fields: RadianceField[] = [];
  scene.traverse((object) => {
    const { radianceFieldError } = object.userData;
    if (radianceFieldError) throw radianceFieldError;
    if (!(object instanceof RadianceField)) return;
    object.keepsRange = false;
    fields.push(object);
  });
  return { object: scene, fields, name };
}
