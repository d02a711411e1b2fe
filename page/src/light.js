// Light for materials that ask for it (`bake --lit`): colours of the file stay as they are where it falls straight on them.
import { DirectionalLight, HemisphereLight } from 'three';

/** Lights of a matt surface are shares of its colour when they are multiples of this. */
const WHITE = Math.PI;

/** Adds a sky and a sun to `scene` if a mesh wants light. */
export function light(scene, meshes) {
  if (!meshes.some(({ material }) => material.isMeshStandardMaterial)) return;
  const sky = new HemisphereLight('#ffffff', '#8a8a8a', 0.6 * WHITE);
  const sun = new DirectionalLight('#ffffff', 0.5 * WHITE);
  sun.position.set(-0.6, 1, 0.8);
  scene.add(sky, sun);
  scene.updateMatrixWorld(true);
}
