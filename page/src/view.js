// The view, and its text in the address: docs/page.md says what the words mean.
import { MathUtils, Vector3 } from 'three';

const FOV = 50;
/** Direction towards the camera without a viewpoint: from the front, a little from the right and from above. */
const DEFAULT_DIRECTION = new Vector3(0.45, 0.3, 1);
const SAMPLES = 20000;
/** Share of the vertices that the initial view ignores on each side: far shells and outliers. */
const TRIM = 0.1;

/** What the address requests: numbers by word, null where a word is missing or no list of that many numbers. */
export function parse(fragment) {
  const words = new URLSearchParams(fragment.replace(/^#/, ''));
  const numbers = (word, count) => {
    const list = (words.get(word) ?? '').split(',').map(Number);
    return words.get(word) && list.length === count && list.every(Number.isFinite) ? list : null;
  };
  const vector = (word) => numbers(word, 3) && new Vector3(...numbers(word, 3));
  return {
    eye: vector('eye'),
    target: vector('target'),
    up: vector('up'),
    fov: numbers('fov', 1)?.[0] ?? null,
    pinhole: numbers('pinhole', 6),
    near: numbers('near', 1)?.[0] ?? null,
    ssaa: [1, 2, 4, 8].find((n) => n === numbers('ssaa', 1)?.[0]) ?? null,
    background: /^[0-9a-f]{6}$/i.test(words.get('background') ?? '') ? words.get('background') : null,
    bare: words.has('bare'),
  };
}

/** The address's text for a view. */
export function format({ eye, target, up, fov, pinhole, near }) {
  const list = (numbers) => [...numbers].map((x) => Number(x.toPrecision(7))).join(',');
  const lens = pinhole ? `pinhole=${list(pinhole)}` : `fov=${list([fov])}`;
  return `#eye=${list(eye)}&target=${list(target)}&up=${list(up)}&${lens}${near ? `&near=${list([near])}` : ''}`;
}

/** The sine of half of what the widest lens sees that a narrow window gets. */
const MOST_SINE = 0.85;
/** Width of a usual picture, in its height. */
const USUAL_ASPECT = 4 / 3;
/** Part of the way to the backdrop that a view keeps within. */
const ROOM = 0.9;

/** The initial view: the viewpoint of the file, or all of the scene. */
export function initial(viewpoint, bounds, aspect) {
  if (!viewpoint) return first(bounds, aspect);
  const [eye, target, up] = [viewpoint.eye, viewpoint.target, viewpoint.up].map((v) => new Vector3(...v));
  const fov = viewpoint.radius ? widened(viewpoint.fov, viewpoint.radius / eye.distanceTo(target), aspect) : viewpoint.fov;
  return { eye, target, up, fov, pinhole: null };
}

/** A vertical field of view, degrees, in which a ball of this sine is in the picture, whatever the shape of the window. */
function widened(fov, sine, aspect) {
  const tangent = Math.tan(MathUtils.degToRad(fov / 2));
  const limited = Math.min(sine, MOST_SINE);
  const needed = limited / Math.sqrt(1 - limited * limited);
  // What a picture as wide as photos are shows is enough.
  const width = Math.max(tangent * aspect, Math.min(needed, tangent * USUAL_ASPECT));
  return MathUtils.radToDeg(2 * Math.atan(width / aspect));
}

/** The first view of a scene without a viewpoint. */
export function first(bounds, aspect) {
  return framed(null, bounds, aspect, { eye: DEFAULT_DIRECTION, target: new Vector3(), up: new Vector3(0, 1, 0) });
}

/** The whole subject, or everything but outliers, as large as fits, from the side of a view and from before the backdrop. */
export function framed(viewpoint, bounds, aspect, { eye: from, target, up }) {
  const direction = from.clone().sub(target);
  const [center, radius] = viewpoint?.radius ? [new Vector3(...viewpoint.target), viewpoint.radius] : [bounds.center.clone(), bounds.radius];
  const narrow = Math.min(1, aspect);
  const distance = radius / Math.sin(Math.atan(narrow * Math.tan(MathUtils.degToRad(FOV / 2))));
  direction.normalize();
  const away = bounds.behind.map((point) => point.clone().sub(center)).filter((way) => way.dot(direction) > 0.5 * way.length());
  const room = ROOM * away.reduce((near, way) => Math.min(near, way.length()), Infinity);
  const eye = center.clone().addScaledVector(direction, Math.min(distance, room));
  const sine = Math.min(MOST_SINE, radius / Math.min(distance, room));
  const fov = distance <= room ? FOV : MathUtils.radToDeg(2 * Math.atan(sine / Math.sqrt(1 - sine * sine) / narrow));
  return { eye, target: center, up: up.clone(), fov, pinhole: null };
}

/** Names of the nodes that are the backdrop; there are several when its texture has several pages. */
export const BACKDROP = /^backdrop(_\d+)?$/;

/** Some vertices of the meshes, evenly chosen. */
function sampled(meshes) {
  const total = meshes.reduce((sum, mesh) => sum + mesh.geometry.attributes.position.count, 0);
  const step = Math.max(1, Math.floor(total / SAMPLES));
  const points = [];
  for (const mesh of meshes) {
    const position = mesh.geometry.attributes.position;
    for (let i = 0; i < position.count; i += step) {
      points.push(new Vector3().fromBufferAttribute(position, i).applyMatrix4(mesh.matrixWorld));
    }
  }
  return points;
}

/**
 * Centre and radius of what contains most vertices of the scene, the radius around it that contains all, the backdrop's too, and some
 * vertices of the backdrop.
 */
export function boundsOf(meshes) {
  const scene = meshes.filter((mesh) => !BACKDROP.test(mesh.name));
  const points = sampled(scene.length > 0 ? scene : meshes);
  const [low, high] = ['x', 'y', 'z'].reduce(
    ([low, high], axis) => {
      const sorted = Float64Array.from(points, (point) => point[axis]).sort();
      const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
      low[axis] = at(TRIM);
      high[axis] = at(1 - TRIM);
      return [low, high];
    },
    [new Vector3(), new Vector3()],
  );
  const center = low.clone().add(high).multiplyScalar(0.5);
  const radius = Math.max(low.distanceTo(high) / 2, 1e-6);
  const behind = scene.length > 0 ? sampled(meshes.filter((mesh) => BACKDROP.test(mesh.name))) : [];
  const reach = [...points, ...behind].reduce((far, point) => Math.max(far, point.distanceTo(center)), radius);
  return { center, radius, reach, behind };
}

/** Sets a three.js camera to a view, for a picture of these many pixels; `shift` moves the samples, in pixels. */
export function applyView(camera, view, width, height, shift = [0, 0]) {
  const { fx, fy, cx, cy } = lens(view, width, height);
  camera.fov = MathUtils.radToDeg(2 * Math.atan(height / (2 * fy)));
  camera.setViewOffset(width, height, width / 2 - cx + shift[0], height / 2 - cy + shift[1], width, height);
  // After the offset, which assumes square pixels.
  camera.aspect = width / fx / (height / fy);
  camera.updateProjectionMatrix();
}

/** Focal lengths and principal point, px: the whole pinhole picture is visible whatever the window's shape. */
function lens({ fov, pinhole }, width, height) {
  if (!pinhole) {
    const f = height / (2 * Math.tan(MathUtils.degToRad(fov / 2)));
    return { fx: f, fy: f, cx: width / 2, cy: height / 2 };
  }
  const [fx, fy, cx, cy, w, h] = pinhole;
  const scale = Math.min(width / w, height / h);
  return { fx: fx * scale, fy: fy * scale, cx: width / 2 + (cx - w / 2) * scale, cy: height / 2 + (cy - h / 2) * scale };
}
