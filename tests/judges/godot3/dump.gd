# Writes what Godot 3 made of scene.glb to dump.bin, one record a vertex in the order of the file: position as
# three floats, colour as three bytes. Prints one line a mesh node: name, vertices, colours and material flags; and one a body: name and
# triangles of its shape.
extends SceneTree

func _init():
	var out = File.new()
	out.open("res://dump.bin", File.WRITE)
	var root = load("res://scene.glb").instance()
	for node in root.get_children():
		if node is StaticBody:
			print("body ", node.name, " ", node.get_child(0).shape.get_faces().size() / 3)
		if not node is MeshInstance:
			continue
		var arrays = node.mesh.surface_get_arrays(0)
		var positions = arrays[Mesh.ARRAY_VERTEX]
		var colors = arrays[Mesh.ARRAY_COLOR]
		var material = node.mesh.surface_get_material(0)
		var shows = material.vertex_color_use_as_albedo and material.vertex_color_is_srgb
		var both_sides = material.params_cull_mode == SpatialMaterial.CULL_DISABLED
		print("node ", node.name, " ", positions.size(), " ", colors.size(), " ", shows and both_sides)
		for i in positions.size():
			var at = node.transform.xform(positions[i])
			for value in [at.x, at.y, at.z]:
				out.store_float(value)
			for value in [colors[i].r, colors[i].g, colors[i].b]:
				out.store_8(int(round(value * 255)))
	out.close()
	quit()
