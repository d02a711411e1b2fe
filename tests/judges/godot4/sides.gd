# Prints a line for each mesh node of scene.glb: its name, and whether its faces are drawn from behind too.
extends SceneTree

func _initialize():
	for node in load("res://scene.glb").instantiate().find_children("*", "MeshInstance3D"):
		print("node ", node.name, " ", node.mesh.surface_get_material(0).cull_mode == BaseMaterial3D.CULL_DISABLED)
	quit()
