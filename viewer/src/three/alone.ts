/** What draws a field alone, and picks points of it. */

import { type BufferGeometry, type Camera, type Matrix4, Mesh, PerspectiveCamera, Scene, type ShaderMaterial, Vector3 } from "three";
import { pickedPoint } from "../render/measures.js";

/** A camera of one pixel. It has the conventions of `like`, so that no renderer replaces its projection. */
export function onePixel(place: Matrix4, projection: readonly number[], like?: Camera): Camera {
  const one = new PerspectiveCamera();
  one.matrixWorldAutoUpdate = one.matrixAutoUpdate = false;
  one.matrixWorld.copy(place);
  one.matrixWorldInverse.copy(place).invert();
  if (like) one.coordinateSystem = like.coordinateSystem;
  one.projectionMatrix.fromArray(projection);
  return one;
}

export function pointAt(pixel: Float32Array, place: Matrix4, projection: readonly number[]): Vector3 | null {
  const point = pickedPoint(pixel, place.elements, projection);
  return point && new Vector3(...point);
}

/** A scene with a mesh to draw instead of a field. */
export function aloneOf(field: Mesh<BufferGeometry, ShaderMaterial>): { scene: Scene; mesh: Mesh } {
  const mesh = new Mesh<BufferGeometry, ShaderMaterial>(field.geometry, field.material);
  mesh.matrixWorldAutoUpdate = mesh.matrixAutoUpdate = mesh.frustumCulled = false;
  const scene = new Scene();
  scene.matrixWorldAutoUpdate = false;
  return { scene: scene.add(mesh) as Scene, mesh };
}
