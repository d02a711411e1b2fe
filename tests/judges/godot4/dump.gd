# Writes what Godot 4 made of scene.ply, or of scene.glb where there is none, to dump.bin, one record a vertex in the order of the file: position as
# three floats, colour as three bytes. Prints one line a mesh node: name, vertices, colours and material flags; and one a body: name and
# triangles of its shape.
extends SceneTree

func _init():
	var out = FileAccess.open("res://dump.bin", FileAccess.WRITE)
	var path = "res://scene.ply" if ResourceLoader.exists("res://scene.ply") else "res://scene.glb"
	var root = load(path).instantiate()
	for node in root.get_children():
		if node is StaticBody3D:
			print("body ", node.name, " ", node.get_child(0).shape.get_faces().size() / 3)
		if not node is MeshInstance3D:
			continue
		var arrays = node.mesh.surface_get_arrays(0)
		var positions = arrays[Mesh.ARRAY_VERTEX]
		var colors = arrays[Mesh.ARRAY_COLOR]
		var indices = arrays[Mesh.ARRAY_INDEX]
		var material = node.mesh.surface_get_material(0)
		var shows = material.vertex_color_use_as_albedo and material.vertex_color_is_srgb
		var unlit = material.shading_mode == BaseMaterial3D.SHADING_MODE_UNSHADED
		var both_sides = material.cull_mode == BaseMaterial3D.CULL_DISABLED
		var normals = arrays[Mesh.ARRAY_NORMAL]
		if not unlit:
			print("lit ", node.name, " ", shows and both_sides and normals.size() == positions.size())
		print("node ", node.name, " ", positions.size(), " ", colors.size(), " ", shows and unlit and both_sides)
		for first in range(0, positions.size(), 3):
			for corner in [first, first + 2, first + 1]: # the import turns triangles round
				var i = corner if indices == null else indices[corner]
				var at = node.transform * positions[i]
				for value in [at.x, at.y, at.z]:
					out.store_float(value)
				for value in [colors[i].r, colors[i].g, colors[i].b]:
					out.store_8(int(round(value * 255)))
	out.close()
	quit()
