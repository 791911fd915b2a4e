/** `MIPVOG_radiance_field` for three.js's GLTFLoader: nodes show a field instead of their mesh. */

import { type FileLoader, LoaderUtils, type Mesh, Object3D } from "three";
import type { GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { EXTENSION, type FieldReference, placeOf } from "../asset.js";
import { FieldError, REMEDY } from "../errors.js";
import type { FieldOptions } from "../fieldOptions.js";
import { RadianceField } from "./field.js";

/**
 * Register it with `loader.register((parser) => new RadianceFieldExtension(parser))`. The node of a field holds a
 * `RadianceField`, which continues to load after the scene is ready. If a field cannot be opened, the node shows its
 * own mesh, if any, and `userData.radianceFieldError` has the error.
 */
export class RadianceFieldExtension implements GLTFLoaderPlugin {
  readonly name = EXTENSION;
  private readonly fields: RadianceField[] = [];
  private isDisposed = false;

  /** `maxBytes` limits the textures of each field. */
  constructor(
    private readonly parser: GLTFParser,
    private readonly options: Pick<FieldOptions, "maxBytes"> = {},
  ) {}

  /**
   * Disposes of the fields of an asset that failed to load, which are otherwise unreachable, including those still to
   * come.
   */
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

  /** The address or the bytes of a container. */
  private async source(reference: FieldReference): Promise<string | ArrayBuffer> {
    const place = placeOf(this.parser.json, reference);
    if ("bufferView" in place) return this.parser.getDependency("bufferView", place.bufferView) as Promise<ArrayBuffer>;
    return LoaderUtils.resolveURL(place.uri, this.parser.options.path);
  }

  /** Options with which containers are requested like buffers of the loader. */
  private request(): FieldOptions {
    const { requestHeader, withCredentials } = this.parser.fileLoader as FileLoader;
    return { ...this.options, manager: this.parser.options.manager, headers: requestHeader, ...(withCredentials && { credentials: "include" as const }) };
  }
}
