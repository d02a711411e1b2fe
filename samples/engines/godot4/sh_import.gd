@tool
# View-dependent colours of trisplat's GLB files in Godot 4.3 and later: docs/formats.md says how they are stored.
#
# Bake with --target godot --sh auto, choose this file in the Import dock at Import Script > Path, and reimport. Each material with harmonics
# becomes one that draws them. Materials of other files are not changed.
extends EditorScenePostImport

# COLOR_0 holds sRGB codes for this target.
const SHADER := """shader_type spatial;
render_mode unshaded, CULL;
uniform sampler2D picture : filter_nearest, repeat_disable;
uniform vec4 scale;
uniform int degree;
vec3 coefficient(ivec2 first, int j, int of_degree) {
	return (texelFetch(picture, first + ivec2(j, 0), 0).rgb * 255.0 - 128.0) / 127.0 * scale[of_degree];
}
void vertex() {
	vec3 away = (MODEL_MATRIX * vec4(VERTEX, 1.0)).xyz - CAMERA_POSITION_WORLD;
	vec3 d = normalize(away * mat3(normalize(MODEL_MATRIX[0].xyz), normalize(MODEL_MATRIX[1].xyz), normalize(MODEL_MATRIX[2].xyz)));
	float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
	float basis[16] = { 0.28209479, -0.48860251 * y, 0.48860251 * z, -0.48860251 * x,
		1.09254843 * x * y, -1.09254843 * y * z, 0.31539157 * (2.0 * zz - xx - yy), -1.09254843 * x * z, 0.54627422 * (xx - yy),
		-0.59004359 * y * (3.0 * xx - yy), 2.89061144 * x * y * z, -0.45704580 * y * (4.0 * zz - xx - yy),
		0.37317633 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy), -0.45704580 * x * (4.0 * zz - xx - yy), 1.44530572 * z * (xx - yy),
		-0.59004359 * x * (xx - 3.0 * yy) };
	ivec2 first = ivec2(UV * vec2(textureSize(picture, 0)));
	vec3 c = COLOR.rgb;
	for (int n = 0; n <= degree; n++)
		for (int j = n * n; j < (n + 1) * (n + 1); j++) c += basis[j] * coefficient(first, j, n);
	c = clamp(c, 0.0, 1.0);
	COLOR.rgb = OUTPUT_IS_SRGB ? c : mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}
void fragment() {
	ALBEDO = COLOR.rgb;
}
"""

func _post_import(scene):
	var file := FileAccess.get_file_as_bytes(get_source_file())
	var length := file.decode_u32(12)
	var gltf: Dictionary = JSON.parse_string(file.slice(20, 20 + length).get_string_from_utf8())
	var made := {}
	for stored in gltf.get("materials", []):
		if stored.get("extras", {}).has("trisplat_sh") and stored.has("occlusionTexture"):
			# Godot's importer takes the hint off the name.
			made[stored.name.trim_suffix("-vcol")] = material(stored, gltf, file.slice(28 + length))
	for node in scene.find_children("*", "MeshInstance3D", true, false):
		for surface in node.mesh.get_surface_count():
			var name: String = node.mesh.surface_get_material(surface).resource_name
			if made.has(name):
				node.mesh.surface_set_material(surface, made[name])
	return scene

func material(stored: Dictionary, gltf: Dictionary, binary: PackedByteArray) -> ShaderMaterial:
	var sh: Dictionary = stored.extras.trisplat_sh
	var source: int = gltf.textures[stored.occlusionTexture.index].source
	var view: Dictionary = gltf.bufferViews[gltf.images[source].bufferView]
	var start: int = view.get("byteOffset", 0)
	# From its bytes: an imported picture has mip maps and may be compressed.
	var image := Image.new()
	image.load_png_from_buffer(binary.slice(start, start + int(view.byteLength)))
	var scale := Vector4()
	for n in sh.scale.size():
		scale[n] = sh.scale[n]
	var made := ShaderMaterial.new()
	made.resource_name = stored.name.trim_suffix("-vcol")
	made.shader = Shader.new()
	made.shader.code = SHADER.replace("CULL", "cull_disabled" if stored.get("doubleSided", false) else "cull_back")
	made.set_shader_parameter("picture", ImageTexture.create_from_image(image))
	made.set_shader_parameter("scale", scale)
	made.set_shader_parameter("degree", int(sh.degree))
	return made
