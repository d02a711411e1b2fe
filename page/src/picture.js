// Draws as a game engine does: depth buffer, opaque, no tone mapping, colours kept in linear light until the end.
//
// Samples are averaged in linear light (the target is SRGB8_ALPHA8, so the GPU encodes after blending), not in
// encoded values as a canvas with antialiasing would. While nothing moves, pictures with shifted samples are
// added up, so that edges and triangles smaller than a pixel come to rest.
import {
  AddEquation, Color, CustomBlending, DepthTexture, FloatType, HalfFloatType, Mesh, NearestFilter, OneFactor,
  OrthographicCamera, PerspectiveCamera, PlaneGeometry, Scene, ShaderMaterial, SRGBColorSpace, UnsignedByteType,
  WebGLRenderer, WebGLRenderTarget,
} from 'three';
import { aim } from './view.js';

/** Samples a pixel that the GPU takes at once. */
const AT_ONCE = 4;

export class Picture {
  #renderer;
  #scene = new Scene();
  #camera = new PerspectiveCamera();
  #samples;
  #drawn;
  #sum;
  #copy;
  #passes = 0;

  /** Fails where there is no WebGL 2. `samples` a pixel once all is at rest; 1 is pixel centres only. */
  constructor(canvas, samples, background) {
    this.#samples = samples;
    this.#renderer = new WebGLRenderer({ canvas, antialias: false, reversedDepthBuffer: true, powerPreference: 'high-performance' });
    this.#renderer.autoClear = false;
    this.#scene.matrixWorldAutoUpdate = false;
    this.background = new Color(background);
    this.#copy = copier();
  }

  get camera() {
    return this.#camera;
  }

  show(scene) {
    this.#scene.add(scene);
  }

  /** Fits the picture to the window; true when its size changed. */
  resize() {
    const canvas = this.#renderer.domElement;
    const ratio = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((px) => Math.max(1, Math.round(px * ratio)));
    if (this.#drawn?.width === width && this.#drawn?.height === height) return false;
    this.#renderer.setPixelRatio(1);
    this.#renderer.setSize(width, height, false);
    this.#drawn?.dispose();
    this.#sum?.dispose();
    this.#drawn = target(width, height, this.#samples >= AT_ONCE ? AT_ONCE : 0);
    this.#sum = this.#canAdd() ? adder(width, height) : null;
    return true;
  }

  get width() {
    return this.#drawn.width;
  }

  get height() {
    return this.#drawn.height;
  }

  /** Something moved: the next picture is a new one. */
  restart() {
    this.#passes = 0;
  }

  /** True when more samples would still come. */
  get unfinished() {
    return this.#passes < (this.#sum ? Math.max(1, this.#samples / AT_ONCE) : 1);
  }

  /** Draws once more from `view`, with the samples between those of the pictures before. */
  draw(view) {
    const renderer = this.#renderer;
    aim(this.#camera, view, this.width, this.height, shift(this.#passes, this.#samples / AT_ONCE));
    renderer.setRenderTarget(this.#drawn);
    renderer.setClearColor(this.background, 1);
    renderer.clear();
    renderer.render(this.#scene, this.#camera);
    let [shown, count] = [this.#drawn, 1];
    if (this.#sum && this.#samples > AT_ONCE) {
      renderer.setRenderTarget(this.#sum);
      renderer.setClearColor(0, 0);
      if (this.#passes === 0) renderer.clear();
      this.#blit(this.#drawn, 1, true);
      [shown, count] = [this.#sum, this.#passes + 1];
    }
    renderer.setRenderTarget(null);
    this.#blit(shown, 1 / count, false);
    this.#passes += 1;
  }

  #blit(from, share, add) {
    const { quad, camera } = this.#copy;
    const material = add ? this.#copy.add : this.#copy.put;
    material.uniforms.picture.value = from.texture;
    material.uniforms.share.value = share;
    quad.material = material;
    this.#renderer.render(quad, camera);
  }

  #canAdd() {
    const { extensions } = this.#renderer;
    return this.#samples > AT_ONCE && (extensions.has('EXT_color_buffer_float') || extensions.has('EXT_color_buffer_half_float'));
  }
}

function target(width, height, samples) {
  return new WebGLRenderTarget(width, height, {
    type: UnsignedByteType, colorSpace: SRGBColorSpace, samples, resolveDepthBuffer: false,
    minFilter: NearestFilter, magFilter: NearestFilter, depthTexture: new DepthTexture(width, height, FloatType),
  });
}

function adder(width, height) {
  const filters = { minFilter: NearestFilter, magFilter: NearestFilter };
  return new WebGLRenderTarget(width, height, { type: HalfFloatType, depthBuffer: false, ...filters });
}

/** Where pass `i` of `n` moves the samples, px: the Halton points, first none at all. */
function shift(i, n) {
  return i === 0 || n <= 1 ? [0, 0] : [halton(i, 2) - 0.5, halton(i, 3) - 0.5];
}

function halton(index, base) {
  let [value, share] = [0, 1];
  for (let i = index; i > 0; i = Math.floor(i / base)) value += (i % base) * (share /= base);
  return value;
}

/** A rectangle that fills the target with a picture; on the canvas three.js encodes it as sRGB. */
function copier() {
  const material = (blending) =>
    new ShaderMaterial({
      uniforms: { picture: { value: null }, share: { value: 1 } },
      vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader: `uniform sampler2D picture; uniform float share;
        void main() {
          gl_FragColor = vec4(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb * share, 1.0);
          #include <colorspace_fragment>
        }`,
      depthTest: false, depthWrite: false, toneMapped: false, ...blending,
    });
  const added = { blending: CustomBlending, blendEquation: AddEquation, blendSrc: OneFactor, blendDst: OneFactor };
  const quad = new Mesh(new PlaneGeometry(2, 2));
  quad.frustumCulled = false;
  return { quad, camera: new OrthographicCamera(), add: material(added), put: material({}) };
}
