# Prints what the texture of scene.glb is after its import, and the texels of its fifth mip level, as JSON.
extends SceneTree

func _init():
	var scene = load("res://scene.glb").instantiate()
	var pending = [scene]
	while not pending.is_empty():
		var node = pending.pop_back()
		pending.append_array(node.get_children())
		if not (node is MeshInstance3D):
			continue
		var texture = node.mesh.surface_get_material(0).albedo_texture
		if texture == null:
			continue
		var picture = texture.get_image()
		var said = {
			"size": [picture.get_width(), picture.get_height()],
			"mipmaps": picture.has_mipmaps(),
			"compressed": picture.is_compressed(),
			"format": picture.get_format(),
		}
		picture.decompress()
		picture.convert(Image.FORMAT_RGB8)
		var from = picture.get_mipmap_offset(4)
		said["level4"] = Array(picture.get_data().slice(from, picture.get_mipmap_offset(5)))
		print(JSON.stringify(said))
		break
	scene.free()
	quit()
