// Draws as a game engine does: depth buffer, opaque, no tone mapping, colours kept in linear light until the end.
//
// Samples are averaged in linear light (the target is SRGB8_ALPHA8, so the GPU encodes after blending), not in
// encoded values as a canvas with antialiasing would. While something moves, the GPU takes four samples per pixel.
// Then pictures with shifted samples are accumulated, one per frame, and the sum is shown once it is complete: N x N
// samples on a regular grid, as trisplat's own renderer takes them.
import {
  AddEquation, Color, CustomBlending, DepthTexture, FloatType, HalfFloatType, Mesh, NearestFilter, OneFactor,
  OrthographicCamera, PerspectiveCamera, PlaneGeometry, Scene, ShaderMaterial, SRGBColorSpace, UnsignedByteType,
  WebGLRenderer, WebGLRenderTarget,
} from 'three';
import { applyView } from './view.js';

/** Samples per pixel that the GPU takes while something moves. */
const MOVING = 4;

export class Renderer {
  #renderer;
  #scene = new Scene();
  #camera = new PerspectiveCamera();
  #background;
  #grid;
  #moving = null;
  #resting = null;
  #sum = null;
  #probe = null;
  #packed = null;
  #copy = copier();
  #passes = 0;
  #size = [0, 0];

  /** Fails without WebGL 2. `grid`: samples per pixel along each axis once nothing moves. */
  constructor(canvas, grid, background) {
    this.#renderer = new WebGLRenderer({ canvas, antialias: false, reversedDepthBuffer: true, powerPreference: 'high-performance' });
    this.#renderer.autoClear = false;
    this.#scene.matrixWorldAutoUpdate = false;
    this.#background = new Color(background);
    const { extensions } = this.#renderer;
    const adds = extensions.has('EXT_color_buffer_float') || extensions.has('EXT_color_buffer_half_float');
    this.#grid = adds ? grid : 1;
    if (grid > 1) this.#moving = target(MOVING);
    if (this.#grid > 1 || grid === 1) this.#resting = target(0);
    if (this.#grid > 1) this.#sum = adder();
    // A browser may drop what a hidden page has drawn, or all of its graphics.
    canvas.addEventListener('webglcontextrestored', () => this.restart());
    document.addEventListener('visibilitychange', () => this.restart());
  }

  get camera() {
    return this.#camera;
  }

  get width() {
    return this.#size[0];
  }

  get height() {
    return this.#size[1];
  }

  /** Shows a scene before a panorama, if there is one. */
  show(scene, sky) {
    this.#scene.add(scene);
    this.#scene.background = sky;
  }

  /** The panorama behind the scene, or null. */
  set sky(sky) {
    this.#scene.background = sky;
  }

  /** Fits the picture to the window; true when its size changed. */
  resize() {
    const canvas = this.#renderer.domElement;
    const ratio = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((px) => Math.max(1, Math.round(px * ratio)));
    if (this.width === width && this.height === height) return false;
    this.#size = [width, height];
    this.#renderer.setSize(width, height, false);
    for (const picture of [this.#moving, this.#resting, this.#sum]) picture?.setSize(width, height);
    return true;
  }

  /** Discards the accumulated samples, as something moved. */
  restart() {
    this.#passes = 0;
  }

  /** True while samples are missing. */
  get unfinished() {
    return this.#passes < 1 + (this.#sum ? this.#grid ** 2 : 0);
  }

  /** Draws `view`: first with the samples for movement, then, call by call, with one more sample each. */
  draw(view) {
    const pass = this.#passes++;
    if (pass === 0) {
      const drawn = this.#moving ?? this.#resting;
      this.#sample(view, drawn, [0, 0]);
      this.#blit(drawn, null, 1, 'put');
      return;
    }
    const shift = (i) => (i + 0.5) / this.#grid - 0.5;
    this.#sample(view, this.#resting, [shift((pass - 1) % this.#grid), shift(Math.floor((pass - 1) / this.#grid))]);
    if (pass === 1) this.#clear(this.#sum, 0);
    this.#blit(this.#resting, this.#sum, 1 / this.#grid ** 2, 'add');
    if (!this.unfinished) this.#blit(this.#sum, null, 1, 'put');
  }

  /**
   * Depths of what a view shows with this near plane, row by row from below, as `size` times `size` numbers; infinite where there is nothing.
   */
  depths(view, near, size) {
    const camera = this.#camera;
    const own = camera.near;
    camera.near = near;
    this.#probe ??= target(0);
    this.#packed ??= new WebGLRenderTarget(1, 1, { type: UnsignedByteType, depthBuffer: false });
    for (const picture of [this.#probe, this.#packed]) picture.setSize(size, size);
    this.#sample(view, this.#probe, [0, 0]);
    camera.near = own;
    this.#blit({ texture: this.#probe.depthTexture }, this.#packed, 1, 'pack');
    const bytes = new Uint8Array(4 * size * size);
    this.#renderer.readRenderTargetPixels(this.#packed, 0, 0, size, size, bytes);
    const far = camera.far;
    const isReversed = this.#renderer.capabilities.reversedDepthBuffer;
    return Float64Array.from({ length: size * size }, (_, i) => {
      const code = (bytes[4 * i] / 255) + (bytes[4 * i + 1] / 255) / 255 + (bytes[4 * i + 2] / 255) / 65025;
      const depth = isReversed ? code : 1 - code;
      return depth <= 1e-7 ? Infinity : (near * far) / (depth * (far - near) + near);
    });
  }

  /** The bytes of another scene's picture for a view, RGBA8, row by row from below, 0 where there is nothing. */
  numbers(scene, view, width, height) {
    const into = new WebGLRenderTarget(width, height, { type: UnsignedByteType, minFilter: NearestFilter, magFilter: NearestFilter });
    applyView(this.#camera, view, width, height);
    this.#clear(into, 0, 0);
    this.#renderer.render(scene, this.#camera);
    const bytes = new Uint8Array(4 * width * height);
    this.#renderer.readRenderTargetPixels(into, 0, 0, width, height, bytes);
    into.dispose();
    return bytes;
  }

  #sample(view, into, shift) {
    applyView(this.#camera, view, this.width, this.height, shift);
    this.#clear(into, this.#background);
    this.#renderer.render(this.#scene, this.#camera);
  }

  #clear(into, color, alpha = 1) {
    this.#renderer.setRenderTarget(into);
    this.#renderer.setClearColor(color, alpha);
    this.#renderer.clear();
  }

  #blit(from, into, weight, how) {
    const { quad, camera } = this.#copy;
    const material = this.#copy[how];
    material.uniforms.picture.value = from.texture;
    material.uniforms.weight.value = weight;
    quad.material = material;
    this.#renderer.setRenderTarget(into);
    this.#renderer.render(quad, camera);
  }
}

function target(samples) {
  return new WebGLRenderTarget(1, 1, {
    type: UnsignedByteType, colorSpace: SRGBColorSpace, samples, resolveDepthBuffer: false,
    minFilter: NearestFilter, magFilter: NearestFilter, depthTexture: new DepthTexture(1, 1, FloatType),
  });
}

function adder() {
  const filters = { minFilter: NearestFilter, magFilter: NearestFilter };
  return new WebGLRenderTarget(1, 1, { type: HalfFloatType, depthBuffer: false, ...filters });
}

const COPIED = `gl_FragColor = vec4(texel.rgb * weight, 1.0);
          #include <colorspace_fragment>`;
/** A depth as three digits of base 255. */
const PACKED = `vec3 digits = fract(min(texel.r, 0.9999999) * vec3(1.0, 255.0, 65025.0));
          gl_FragColor = vec4(digits - vec3(digits.yz / 255.0, 0.0), 1.0);`;

/** A rectangle that fills the target with a picture; on the canvas three.js encodes it as sRGB. */
function copier() {
  const material = (blending, color = COPIED) =>
    new ShaderMaterial({
      uniforms: { picture: { value: null }, weight: { value: 1 } },
      vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader: `uniform sampler2D picture; uniform float weight;
        void main() {
          vec4 texel = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
          ${color}
        }`,
      depthTest: false, depthWrite: false, toneMapped: false, ...blending,
    });
  const added = { blending: CustomBlending, blendEquation: AddEquation, blendSrc: OneFactor, blendDst: OneFactor };
  const quad = new Mesh(new PlaneGeometry(2, 2));
  quad.frustumCulled = false;
  return { quad, camera: new OrthographicCamera(), add: material(added), put: material({}), pack: material({}, PACKED) };
}
