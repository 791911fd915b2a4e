/** `MIPVOG_radiance_field` for the glTF loader of Babylon.js: nodes show a field instead of their mesh. */

import type { TransformNode } from "@babylonjs/core/Meshes/transformNode.js";
import { Matrix } from "@babylonjs/core/Maths/math.vector.js";
import { WebRequest } from "@babylonjs/core/Misc/webRequest.js";
import type { GLTFLoader } from "@babylonjs/loaders/glTF/2.0/glTFLoader.js";
import type { IGLTFLoaderExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtension.js";
import type { INode } from "@babylonjs/loaders/glTF/2.0/glTFLoaderInterfaces.js";
import { EXTENSION, type FieldReference, placeOf } from "../asset.js";
import { RadianceField } from "./field.js";

/**
 * The node of a field holds a `RadianceField`, which continues to load after the scene is ready. If a field cannot be
 * opened, the node shows its own mesh, if any, and `metadata.radianceFieldError` has the error.
 */
export class RadianceFieldExtension implements IGLTFLoaderExtension {
  readonly name = EXTENSION;
  enabled = true;
  /** Nodes being loaded, about which the loader asks again. */
  private readonly begun = new Set<INode>();

  constructor(private readonly loader: GLTFLoader) {}

  dispose(): void {}

  loadNodeAsync(context: string, node: INode, assign: (node: TransformNode) => void): Promise<TransformNode> | null {
    const reference = node.extensions?.[EXTENSION] as FieldReference | undefined;
    if (!reference || this.begun.has(node)) return null;
    this.begun.add(node);
    return this.load(context, node, reference, assign);
  }

  private async load(context: string, node: INode, reference: FieldReference, assign: (node: TransformNode) => void): Promise<TransformNode> {
    let field: RadianceField | null = null;
    try {
      field = this.create(await this.source(reference));
      await field.opened;
    } catch (error) {
      field?.dispose();
      return this.loader.loadNodeAsync(context, node, (own) => {
        own.metadata = { ...own.metadata, radianceFieldError: error };
        assign(own);
      });
    }
    // The loader makes a plain node of one without a mesh.
    delete node.mesh;
    // Its list of the asset's meshes.
    node._primitiveBabylonMeshes = [field];
    return this.loader.loadNodeAsync(context, node, (own) => {
      field.parent = own;
      assign(own);
    });
  }

  private create(source: string | Blob): RadianceField {
    const { babylonScene: scene, _assetContainer: container } = this.loader;
    // What a container of assets holds is in no scene before it is asked for.
    scene._blockEntityCollection = container !== null;
    try {
      const field = new RadianceField(source, scene, { headers: WebRequest.CustomRequestHeaders });
      field._parentContainer = container;
      // The asset's root mirrors where the scene is left-handed.
      field.setPreTransformMatrix(Matrix.Identity());
      return field;
    } finally {
      scene._blockEntityCollection = false;
    }
  }

  /** The address or the bytes of a container. */
  private async source(reference: FieldReference): Promise<string | Blob> {
    const { gltf, rootUrl } = this.loader;
    const place = placeOf(gltf as object, reference);
    if ("uri" in place) {
      // What is inside of the asset, or elsewhere, is not below its folder.
      const address = /^[a-z][a-z0-9+.-]*:/i.test(place.uri) ? place.uri : `${rootUrl ?? ""}${place.uri}`;
      return new URL(await this.loader.parent.preprocessUrlAsync(address, rootUrl ?? undefined), document.baseURI).href;
    }
    const view = gltf.bufferViews![place.bufferView];
    const bytes = await this.loader.loadBufferViewAsync(`/bufferViews/${place.bufferView}`, view);
    return new Blob([bytes as ArrayBufferView<ArrayBuffer>]);
  }
}
