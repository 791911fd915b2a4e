/**
 * Compressed data in assets. Decoders are loaded when the first asset needs them; data without a decoder is left out.
 */

import { BufferAttribute, BufferGeometry, type Texture } from "three";
import type { DRACOLoader } from "three/addons/loaders/DRACOLoader.js";
import type { GLTFLoader, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { EXTENSION } from "../asset.js";

/** Compression extensions and their decoders. */
const DECODERS: Record<string, string> = {
  KHR_draco_mesh_compression: "Draco",
  EXT_meshopt_compression: "meshoptimizer",
  KHR_meshopt_compression: "meshoptimizer",
  KHR_texture_basisu: "Basis Universal (KTX2 textures)",
};

/** The parts of three.js's loaders of compressed data that its glTF loader uses. */
const draco = {
  preload() {},
  decodeDracoFile(buffer: ArrayBuffer, then: (geometry: BufferGeometry) => void, ids: Record<string, number>, types: Record<string, string>, _space: string, failed: (error: unknown) => void) {
    import("./decoders.js")
      .then(({ decodeDraco }) => decodeDraco(new Uint8Array(buffer), ids, types))
      .then(({ index, attributes }) => {
        const geometry = new BufferGeometry();
        if (index) geometry.setIndex(new BufferAttribute(index, 1));
        for (const [name, { array, itemSize }] of Object.entries(attributes)) geometry.setAttribute(name, new BufferAttribute(array, itemSize));
        then(geometry);
      })
      .catch(failed);
  },
};

const meshopt = {
  supported: true,
  ready: Promise.resolve(),
  async decodeGltfBufferAsync(count: number, size: number, source: Uint8Array, mode: string, filter?: string): Promise<Uint8Array> {
    const { MeshoptDecoder } = await import("./decoders.js");
    await MeshoptDecoder.ready;
    const target = new Uint8Array(count * size);
    MeshoptDecoder.decodeGltfBuffer(target, count, size, source, mode, filter);
    return target;
  },
};

/** The compressed data that the loader of one asset has found. */
export class Compressed {
  /** Decoders of the parts that were left out. */
  readonly missing = new Set<string>();
  private parser: GLTFParser | null = null;

  /** Gives decoders to a loader. If the meshes of an asset are left out, only its fields are shown. */
  constructor(loader: GLTFLoader, withMeshes: boolean) {
    loader.setDRACOLoader(draco as unknown as DRACOLoader).setMeshoptDecoder(meshopt as never);
    loader.register((parser) => {
      this.parser = parser;
      if (!withMeshes) leaveOutMeshes(parser);
      return this.textures(parser);
    });
  }

  /** The decoders that the asset needs. */
  get decoders(): string[] {
    const used: string[] = this.parser?.json.extensionsUsed ?? [];
    return [...new Set(used.flatMap((name) => DECODERS[name] ?? []))];
  }

  /** Replaces three.js's own plugin, which cannot show an asset with such textures at all. */
  private textures(parser: GLTFParser): GLTFLoaderPlugin {
    const name = "KHR_texture_basisu";
    return {
      name,
      loadTexture: (index) => {
        const { extensions, source } = parser.json.textures[index];
        if (!extensions?.[name] || source !== undefined) return null;
        this.missing.add(DECODERS[name]);
        // Its material is drawn without it.
        return Promise.resolve(null) as unknown as Promise<Texture>;
      },
    };
  }
}

function leaveOutMeshes({ json }: GLTFParser): void {
  for (const node of json.nodes ?? []) for (const part of ["mesh", "skin", "camera"]) delete node[part];
  for (const part of ["animations", "extensionsRequired"]) delete json[part];
  json.extensionsUsed = [EXTENSION];
}
