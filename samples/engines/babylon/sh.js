// View-dependent colours of trisplat's glTF files in Babylon.js 6 and later, on WebGL 2: docs/formats.md says how they are stored.
//
//   <script src=".../babylon.js"></script><script src=".../babylonjs.loaders.min.js"></script><script src="sh.js"></script>
//
// Files load as before, with any of Babylon's loaders; those without harmonics are not changed.
(() => {
  const DEFINITIONS = `
uniform highp sampler2D shPicture;
vec3 shEncode(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
vec3 shDecode(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 shCoefficient(int j, float scale) {
  ivec2 first = ivec2(uv * vec2(textureSize(shPicture, 0)));
  return (texelFetch(shPicture, first + ivec2(j, 0), 0).rgb * 255.0 - 128.0) / 127.0 * scale;
}
vec3 shColor(vec3 linear, vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  float basis[16] = float[16](0.28209479, -0.48860251 * y, 0.48860251 * z, -0.48860251 * x,
    1.09254843 * x * y, -1.09254843 * y * z, 0.31539157 * (2.0 * zz - xx - yy), -1.09254843 * x * z, 0.54627422 * (xx - yy),
    -0.59004359 * y * (3.0 * xx - yy), 2.89061144 * x * y * z, -0.45704580 * y * (4.0 * zz - xx - yy),
    0.37317633 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy), -0.45704580 * x * (4.0 * zz - xx - yy), 1.44530572 * z * (xx - yy),
    -0.59004359 * x * (xx - 3.0 * yy));
  vec3 color = shEncode(linear);
  for (int j = 0; j < SH_COUNT; j++) color += basis[j] * shCoefficient(j, shScale[int(sqrt(float(j) + 0.5))]);
  return shDecode(clamp(color, 0.0, 1.0));
}`;
  // The mirror by which Babylon.js makes a file left-handed is in finalWorld, and undone with it.
  const END = `
mat3 shTurn = mat3(normalize(finalWorld[0].xyz), normalize(finalWorld[1].xyz), normalize(finalWorld[2].xyz));
vColor.rgb = shColor(vColor.rgb, normalize((worldPos.xyz - vEyePosition.xyz) * shTurn));`;

  class Harmonics extends BABYLON.MaterialPluginBase {
    constructor(material, { degree, scale }, picture) {
      super(material, 'TrisplatSh', 200, { SH_COUNT: 0 });
      Object.assign(this, { count: (degree + 1) ** 2, scale: [...scale, 0, 0, 0].slice(0, 4), picture });
      this._enable(true);
    }
    prepareDefinesBeforeAttributes(defines) {
      defines._needUVs = true;
      defines.SH_COUNT = this.count;
    }
    isReadyForSubMesh() {
      return this.picture.isReadyOrNotBlocking();
    }
    getSamplers(samplers) {
      samplers.push('shPicture');
    }
    getUniforms() {
      return { ubo: [{ name: 'shScale', size: 4, type: 'vec4' }], vertex: 'uniform vec4 shScale;' };
    }
    bindForSubMesh(buffer) {
      buffer.updateFloat4('shScale', ...this.scale);
      buffer.setTexture('shPicture', this.picture);
    }
    getCustomCode(type) {
      return type === 'vertex' ? { CUSTOM_VERTEX_DEFINITIONS: DEFINITIONS, CUSTOM_VERTEX_MAIN_END: END } : null;
    }
  }

  class Extension {
    name = 'trisplat_sh';
    enabled = true;
    // Before those that return a material.
    order = 1;
    constructor(loader) {
      this.loader = loader;
    }
    dispose() {}
    /** Adds the harmonics, and leaves all else of the material to others. */
    loadMaterialPropertiesAsync(context, { extras, occlusionTexture }, material) {
      const sh = extras?.trisplat_sh;
      if (!sh || !occlusionTexture) return null;
      this.loader.loadTextureInfoAsync(`${context}/occlusionTexture`, { index: occlusionTexture.index, nonColorData: true }, (picture) => new Harmonics(material, sh, picture));
      return null;
    }
  }
  BABYLON.GLTF2.GLTFLoader.RegisterExtension('trisplat_sh', (loader) => new Extension(loader));
})();
