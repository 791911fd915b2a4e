/** `MIPVOG_radiance_field` for three.js's GLTFLoader: nodes that show a field instead of their mesh. */

import { type FileLoader, LoaderUtils, type Mesh, Object3D } from "three";
import type { GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { EXTENSION, type FieldReference, placeOf } from "../asset.js";
import { FieldError, REMEDY } from "../errors.js";
import type { FieldOptions } from "../streamed.js";
import { RadianceField } from "./field.js";

/**
 * Registers with `loader.register((parser) => new RadianceFieldExtension(parser))`. A field's node holds a
 * `RadianceField`, which goes on loading after the scene is there; a field that cannot be opened leaves the
 * node's own mesh (nothing, where it has none), with the error as `userData.radianceFieldError`.
 */
export class RadianceFieldExtension implements GLTFLoaderPlugin {
  readonly name = EXTENSION;
  private readonly fields: RadianceField[] = [];
  private isDisposed = false;

  /** Fields may take `maxBytes` of textures each. */
  constructor(
    private readonly parser: GLTFParser,
    private readonly options: Pick<FieldOptions, "maxBytes"> = {},
  ) {}

  /** Gives up the fields of an asset that could not be loaded, which nobody else can reach; those that were to come, too. */
  dispose(): void {
    this.isDisposed = true;
    this.fields.forEach((field) => field.dispose());
  }

  createNodeMesh(nodeIndex: number): Promise<Mesh> | null {
    const node = this.parser.json.nodes[nodeIndex];
    const reference = node.extensions?.[EXTENSION];
    // The loader puts whatever comes into the scene; an empty object is as good as a mesh.
    return reference ? (this.create(nodeIndex, reference) as Promise<Mesh>) : null;
  }

  private async create(nodeIndex: number, reference: FieldReference): Promise<Object3D> {
    let field: RadianceField | null = null;
    try {
      const source = await this.source(reference);
      if (this.isDisposed) throw new FieldError("The asset was given up before its field was opened.", REMEDY.again);
      field = new RadianceField(source, this.request());
      this.fields.push(field);
      await field.opened;
      return field;
    } catch (error) {
      field?.dispose();
      const { nodes } = this.parser.json;
      // The loader's own way to a node's mesh, which it does not declare.
      const own = this.parser as unknown as { createNodeMesh(index: number): Promise<Mesh> };
      const fallback = nodes[nodeIndex].mesh === undefined ? new Object3D() : await own.createNodeMesh(nodeIndex);
      fallback.userData.radianceFieldError = error;
      return fallback;
    }
  }

  /** Where the container of a field is. */
  private async source(reference: FieldReference): Promise<string | ArrayBuffer> {
    const place = placeOf(this.parser.json, reference);
    if ("bufferView" in place) return this.parser.getDependency("bufferView", place.bufferView) as Promise<ArrayBuffer>;
    return LoaderUtils.resolveURL(place.uri, this.parser.options.path);
  }

  /** Containers are asked for as the loader asks for buffers. */
  private request(): FieldOptions {
    const { requestHeader, withCredentials } = this.parser.fileLoader as FileLoader;
    return { ...this.options, manager: this.parser.options.manager, headers: requestHeader, ...(withCredentials && { credentials: "include" as const }) };
  }
}
