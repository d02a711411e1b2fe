// Buttons that change what is shown: the edges of triangles, view-dependent colours, the surroundings.
import { BACKDROP } from './view.js';

/** Binds the buttons and their keys; hides those without effect. */
export function switches({ element, renderer, meshes, sh, sky }) {
  const backdrop = meshes.filter((mesh) => BACKDROP.test(mesh.name));
  const materials = new Set(meshes.map((mesh) => mesh.material));
  const bind = (id, code, isThere, show) => {
    const button = element(id);
    button.hidden = !isThere;
    const turn = () => {
      const on = button.getAttribute('aria-pressed') !== 'true';
      button.setAttribute('aria-pressed', on);
      show(on);
      renderer.restart();
    };
    button.addEventListener('click', turn);
    addEventListener('keydown', (event) => {
      if (event.code === code && isThere && !(event.ctrlKey || event.metaKey || event.altKey || event.repeat)) turn();
    });
  };
  bind('wires', 'KeyT', true, (on) => materials.forEach((material) => (material.wireframe = on)));
  bind('sh', 'KeyC', sh?.isThere, (on) => sh.show(on));
  bind('around', 'KeyB', backdrop.length > 0 || sky, (on) => {
    for (const mesh of backdrop) mesh.visible = on;
    renderer.sky = on ? sky : null;
  });
}
