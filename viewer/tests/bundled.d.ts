/** An encoder of Draco, as far as tests use it. */
declare module "draco3d" {
  interface Encoders {
    POSITION: number;
    MeshBuilder: new () => { AddFacesToMesh(mesh: object, faces: number, indices: Uint32Array): void; AddFloatAttributeToMesh(mesh: object, kind: number, count: number, size: number, values: Float32Array): number };
    Mesh: new () => object;
    Encoder: new () => { EncodeMeshToDracoBuffer(mesh: object, out: object): number };
    DracoInt8Array: new () => { GetValue(at: number): number };
  }
  const draco3d: { createEncoderModule(options: object): Promise<Encoders> };
  export default draco3d;
}
