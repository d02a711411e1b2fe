# Opens the main scene of samples/engines/godot4, lets its walker fall, and prints what became of scene.glb: a line for each node that
# is drawn, one for each body with the triangles of its shape, and whether and how high the walker stands.
extends SceneTree

var frames := 0
var main: Node

func _initialize():
	main = load("res://main.tscn").instantiate()
	root.add_child(main)
	for node in main.get_node("Scene").get_children():
		if node is MeshInstance3D:
			print("drawn ", node.name)
		elif node is StaticBody3D:
			print("body ", node.name, " ", node.get_child(0).shape.get_faces().size() / 3)
		else:
			print("other ", node.name)

func _physics_process(_delta):
	frames += 1
	var player = main.get_node("Player")
	var done = player.is_on_floor() or frames > 1200
	if done:
		var feet = player.position.y - 0.5 * player.height
		print("walker ", player.is_on_floor(), " ", player.position.x, " ", feet, " ", player.position.z, " ", player.height)
	return done
