# Opens the main scene of samples/engines/godot4 and walks. Prints what became of scene.glb: a line for each node that is drawn, one for
# each body with the triangles of its shape; how far the eyes are from the viewpoint after a second without a step, and how far they turned
# from it; whether and how high the walker stands after the first step; how far below the ground its feet ever were, on a walk in all
# directions and in a fall at full speed; and how far it sank where there is no ground.
extends SceneTree

var frames := 0
var main: Node
var player: CharacterBody3D
var stage := "waits"
var deepest := 0.0
var high: float
var turn := 0

func _initialize():
	main = load("res://main.tscn").instantiate()
	root.add_child(main)
	player = main.get_node("Player")
	for node in main.get_node("Scene").get_children():
		if node is MeshInstance3D:
			print("drawn ", node.name)
		elif node is StaticBody3D:
			print("body ", node.name, " ", node.get_child(0).shape.get_faces().size() / 3)
		else:
			print("other ", node.name)

func press(code: Key, pressed: bool):
	var event := InputEventKey.new()
	event.physical_keycode = code
	event.pressed = pressed
	Input.parse_input_event(event)

func next(name: String):
	stage = name
	frames = 0

# How far the feet are below the ground under the middle, in heights.
func depth() -> float:
	var ground: float = player.ground_below(player.position.y)
	if ground <= player.lowest:
		return 0.0
	return (ground - (player.position.y - 0.5 * player.height)) / player.height

func _physics_process(_delta):
	frames += 1
	match stage:
		"waits":
			if frames == 60:
				var first = main.get_node("Scene").find_child("viewpoint*", true, false)
				var eyes = player.get_node("Camera").global_transform
				var off = eyes.origin.distance_to(first.global_position) / player.height
				print("first ", off, " ", eyes.basis.z.angle_to(first.global_transform.basis.z), " ", player.get_node("Camera").current)
				press(KEY_W, true)
				next("steps")
		"steps":
			# There may be no ground below the first photo.
			if frames > 3 and (player.is_on_floor() or frames > 1200):
				var feet = player.position.y - 0.5 * player.height
				print("walker ", player.is_on_floor(), " ", player.position.x, " ", feet, " ", player.position.z, " ", player.height)
				press(KEY_W, true)
				press(KEY_SHIFT, true)
				next("walks")
		"walks":
			deepest = maxf(deepest, depth())
			if frames % 40 == 0:
				turn += 1
				player.rotate_y(2.4)
			if frames % 90 == 0:
				press(KEY_SPACE, true)
			if frames % 90 == 5:
				press(KEY_SPACE, false)
			if frames == 720:
				press(KEY_W, false)
				press(KEY_SHIFT, false)
				press(KEY_SPACE, false)
				next("falls")
		"falls":
			if frames == 1:
				var box: AABB = player.bounds(main.get_node("Scene"))
				player.position = box.get_center() + Vector3.UP * (2.0 * box.size.y)
				player.velocity = Vector3.DOWN * 3000.0 * player.height
			deepest = maxf(deepest, depth())
			if frames > 5 and (player.is_on_floor() or frames > 600):
				print("deepest ", deepest, " ", player.is_on_floor(), " ", player.position.y > player.lowest)
				# Far from everything.
				player.position += Vector3(1000, 0, 1000) * player.height
				high = player.position.y
				next("floats")
		"floats":
			if frames == 60:
				print("sank ", (high - player.position.y) / player.height)
				return true
	return false
