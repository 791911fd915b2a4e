/** Shaders are bundled as text. */
declare module "*.glsl" {
  const source: string;
  export default source;
}

declare module "*.wgsl" {
  const source: string;
  export default source;
}

/** WebAssembly is bundled as bytes. */
declare module "*.wasm" {
  const bytes: Uint8Array<ArrayBuffer>;
  export default bytes;
}

/** The worker is bundled as text too. */
declare module "*.txt" {
  const text: string;
  export default text;
}

/** Google's Draco decoder as shipped with three.js; only the parts used here. */
declare module "draco" {
  interface Attribute {
    num_components(): number;
  }
  interface Geometry {
    num_points(): number;
    num_faces(): number;
  }
  interface Status {
    ok(): boolean;
    error_msg(): string;
  }
  interface Decoder {
    GetEncodedGeometryType(bytes: Uint8Array): number;
    DecodeArrayToMesh(bytes: Uint8Array, length: number, geometry: Geometry): Status;
    DecodeArrayToPointCloud(bytes: Uint8Array, length: number, geometry: Geometry): Status;
    GetAttributeByUniqueId(geometry: Geometry, id: number): Attribute;
    GetAttributeDataArrayForAllPoints(geometry: Geometry, attribute: Attribute, type: number, size: number, at: number): void;
    GetTrianglesUInt32Array(geometry: Geometry, size: number, at: number): void;
  }
  type Types = "DT_FLOAT32" | "DT_INT8" | "DT_INT16" | "DT_INT32" | "DT_UINT8" | "DT_UINT16" | "DT_UINT32";
  interface Module extends Record<Types, number> {
    Decoder: new () => Decoder;
    Mesh: new () => Geometry;
    PointCloud: new () => Geometry;
    TRIANGULAR_MESH: number;
    HEAPF32: Float32Array<ArrayBuffer>;
    _malloc(size: number): number;
    _free(at: number): void;
    destroy(what: object): void;
  }
  export default function make(options: { wasmBinary: Uint8Array }): Promise<Module>;
}
