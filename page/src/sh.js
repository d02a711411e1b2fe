// View-dependent colours of trisplat's glTF files in three.js: docs/formats.md says how they are stored.
//
//   import { TrisplatSh } from './sh.js';
//   const loader = new GLTFLoader().register((parser) => new TrisplatSh(parser));
//
// The vertex shader adds spherical harmonics, in the direction from the camera to the vertex, to the sRGB-encoded COLOR_0.
// Files without harmonics load as without this plugin.

const PARS = `
attribute vec2 shTexel;
uniform sampler2D shPicture; uniform float shScale[4];
vec3 shEncode(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
vec3 shDecode(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 shCoefficient(int j, int degree) {
  ivec2 first = ivec2(shTexel * vec2(textureSize(shPicture, 0)));
  return (texelFetch(shPicture, first + ivec2(j, 0), 0).rgb * 255.0 - 128.0) / 127.0 * shScale[degree];
}
vec3 shColor(vec3 linear, vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  // Unrolled: an array of harmonics takes a tenth of the frame in software.
  vec3 color = shEncode(linear) + 0.28209479 * shCoefficient(0, 0)
    + 0.48860251 * (z * shCoefficient(2, 1) - y * shCoefficient(1, 1) - x * shCoefficient(3, 1));
#if SH_DEGREE > 1
  color += 1.09254843 * (x * y * shCoefficient(4, 2) - y * z * shCoefficient(5, 2) - x * z * shCoefficient(7, 2))
    + 0.31539157 * (2.0 * zz - xx - yy) * shCoefficient(6, 2) + 0.54627422 * (xx - yy) * shCoefficient(8, 2);
#endif
#if SH_DEGREE > 2
  color += 2.89061144 * x * y * z * shCoefficient(10, 3) + 1.44530572 * z * (xx - yy) * shCoefficient(14, 3)
    + 0.37317633 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * shCoefficient(12, 3)
    - 0.59004359 * (y * (3.0 * xx - yy) * shCoefficient(9, 3) + x * (xx - 3.0 * yy) * shCoefficient(15, 3))
    - 0.45704580 * (4.0 * zz - xx - yy) * (y * shCoefficient(11, 3) + x * shCoefficient(13, 3));
#endif
  return shDecode(clamp(color, 0.0, 1.0));
}`;

const COLOR = `#include <color_vertex>
vec3 shAway = (modelMatrix * vec4(position, 1.0)).xyz - cameraPosition;
mat3 shTurn = mat3(normalize(modelMatrix[0].xyz), normalize(modelMatrix[1].xyz), normalize(modelMatrix[2].xyz));
vColor.rgb = shColor(vColor.rgb, normalize(shAway * shTurn));`;

export class TrisplatSh {
  name = 'trisplat_sh';
  #scales = [];

  constructor(parser) {
    this.parser = parser;
  }

  /** True when the file has such colours. */
  get isThere() {
    return this.#scales.length > 0;
  }

  /** Shows them, or the plain ones. */
  show(on) {
    for (const { uniform, scale } of this.#scales) uniform.value = on ? scale : [0, 0, 0, 0];
  }

  async afterRoot({ scene }) {
    const meshes = [];
    scene.traverse((node) => node.material?.userData.trisplat_sh && meshes.push(node));
    for (const { geometry, material } of meshes) {
      const { degree, scale } = material.userData.trisplat_sh;
      const index = this.parser.associations.get(material)?.materials;
      const stored = this.parser.json.materials[index]?.occlusionTexture;
      if (!stored || !geometry.attributes.uv) continue;
      const picture = await this.parser.getDependency('texture', stored.index);
      const uniform = { value: [...scale, 0, 0].slice(0, 4) };
      this.#scales.push({ uniform, scale: uniform.value });
      geometry.setAttribute('shTexel', geometry.attributes.uv);
      material.defines = { ...material.defines, SH_DEGREE: degree };
      material.onBeforeCompile = (shader) => {
        shader.uniforms.shPicture = { value: picture };
        shader.uniforms.shScale = uniform;
        shader.vertexShader = shader.vertexShader.replace('#include <common>', `#include <common>${PARS}`)
          .replace('#include <color_vertex>', COLOR);
      };
      material.customProgramCacheKey = () => `trisplat_sh ${degree}`;
    }
  }
}
