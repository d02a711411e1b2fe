@tool
# A trained scene or Gaussian splats become a scene of Godot: `trisplat bake` makes a GLB, and this makes nodes of it.
extends EditorImportPlugin

const PROGRAM := "trisplat/program"
## The user's, not the project's: opening a project must not choose what runs.
var preferences: EditorSettings
const QUALITIES: Array[String] = ["default", "fast", "small"]

## Adds the program to the editor's settings.
func declare_program():
	if not preferences.has_setting(PROGRAM):
		preferences.set_setting(PROGRAM, "trisplat")
	preferences.set_initial_value(PROGRAM, "trisplat", false)
	preferences.add_property_info({"name": PROGRAM, "type": TYPE_STRING, "hint": PROPERTY_HINT_GLOBAL_FILE})

## An absolute path, or that of a name in an absolute folder of the PATH, never in the current folder; empty if it is not there.
func find(name: String) -> String:
	if name.is_absolute_path():
		return name if FileAccess.file_exists(name) and not name.contains("://") else ""
	if name.is_empty() or name.get_file() != name:
		return ""
	var windows := OS.get_name() == "Windows"
	for folder in OS.get_environment("PATH").split(";" if windows else ":", false):
		for ending in ["", ".exe"] if windows else [""]:
			var path: String = folder.path_join(name + ending)
			if folder.is_absolute_path() and not folder.contains("://") and FileAccess.file_exists(path):
				return path
	return ""

func _get_importer_name():
	return "trisplat.scene"

func _get_visible_name():
	return "Trisplat Scene"

func _get_recognized_extensions():
	return PackedStringArray(["ply", "pt", "splat", "spz", "sog"])

func _get_save_extension():
	return "scn"

func _get_resource_type():
	return "PackedScene"

func _get_priority():
	return 1.0

func _get_import_order():
	return ResourceImporter.IMPORT_ORDER_SCENE

func _can_import_threaded():
	return false

func _get_preset_count():
	return 1

func _get_preset_name(_preset):
	return "Default"

func _get_import_options(_path, _preset):
	return [
		{"name": "quality", "default_value": 0, "property_hint": PROPERTY_HINT_ENUM, "hint_string": ",".join(QUALITIES)},
		{"name": "harden", "default_value": false},
		{"name": "max_triangles", "default_value": 0, "property_hint": PROPERTY_HINT_RANGE, "hint_string": "0,10000000,1,or_greater"},
		{"name": "collision", "default_value": true},
		{"name": "backdrop", "default_value": true},
		{"name": "scale", "default_value": 1.0},
		# Other options of `trisplat bake`, as `trisplat schema bake` lists them: chunk_triangles=3000.
		{"name": "settings", "default_value": PackedStringArray()},
	]

func _get_option_visibility(_path, _option, _options):
	return true

## The flags of `trisplat bake` for these options.
func flags(options: Dictionary) -> PackedStringArray:
	var made := PackedStringArray(["--target", "godot", "--preset", QUALITIES[options.quality]])
	if options.harden:
		made.append("--harden")
	if options.max_triangles > 0:
		made.append_array(["--max-triangles", str(options.max_triangles)])
	if options.collision:
		made.append("--collision")
	if not options.backdrop:
		made.append_array(["--backdrop", "off"])
	if options.scale != 1.0:
		made.append_array(["--set", "place.scale=%s" % options.scale])
	# One word each: none can be another flag.
	for setting in options.settings:
		made.append("--set=" + setting)
	return made

func _import(source_file, save_path, options, _variants, _gen_files):
	var program := find(preferences.get_setting(PROGRAM))
	var glb := ProjectSettings.globalize_path(save_path + ".glb")
	var bake := PackedStringArray(["bake", ProjectSettings.globalize_path(source_file), "--output", glb, "--force", "--quiet"])
	bake.append_array(flags(options))
	var said := []
	var code := -1 if program.is_empty() else OS.execute(program, bake, said, true)
	if code != 0:
		var why := "the program was not found: Editor Settings > Trisplat > Program" if code == -1 else "".join(said).strip_edges()
		push_error("trisplat cannot bake %s: %s" % [source_file, why])
		return FAILED
	var root := read(glb)
	for file in [glb, glb + ".import"]:
		DirAccess.remove_absolute(file)
	if root == null:
		push_error("trisplat: Godot cannot read what was baked from %s" % source_file)
		return FAILED
	root.name = source_file.get_file().get_basename()
	var scene := PackedScene.new()
	var error := scene.pack(root)
	root.free()
	return error if error != OK else ResourceSaver.save(scene, "%s.%s" % [save_path, _get_save_extension()])

## The nodes of a baked file.
func read(glb: String) -> Node:
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	if document.append_from_file(glb, state) != OK:
		return null
	var root := document.generate_scene(state)
	for node in root.find_children("*", "ImporterMeshInstance3D", true, false):
		node.replace_by(body(node) if node.name.ends_with("-colonly") else drawn(node))
		node.free()
	for node in root.find_children("*", "", true, false):
		node.owner = root
	return root

## A mesh that is drawn, in its own colours: they are sRGB codes, which glTF cannot say.
func drawn(node: ImporterMeshInstance3D) -> MeshInstance3D:
	var made := MeshInstance3D.new()
	made.name = node.name
	made.transform = node.transform
	made.mesh = node.mesh.get_mesh()
	for surface in made.mesh.get_surface_count():
		var material := made.mesh.surface_get_material(surface) as BaseMaterial3D
		if material and material.resource_name.ends_with("-vcol"):
			material.resource_name = material.resource_name.trim_suffix("-vcol")
			material.vertex_color_use_as_albedo = true
			material.vertex_color_is_srgb = true
	return made

## The collision surface: a body, which is not drawn.
func body(node: ImporterMeshInstance3D) -> StaticBody3D:
	var made := StaticBody3D.new()
	made.name = String(node.name).trim_suffix("-colonly")
	made.transform = node.transform
	var shape := CollisionShape3D.new()
	shape.name = "shape"
	shape.shape = node.mesh.get_mesh().create_trimesh_shape()
	made.add_child(shape)
	return made
