# Opens the main scene of samples/engines/godot4 and prints what is behind it: whether that is the sky, and the size of its panorama.
# Leaves a picture of each view of views.json, if there is one: a list of { fov: degrees from top to bottom, eye, target, out: PNG file }.
extends SceneTree

var world: Environment
var views := []
var camera := Camera3D.new()
var frames := 0

func _initialize():
	var main = load("res://main.tscn").instantiate()
	root.add_child(main)
	root.add_child(camera)
	world = main.get_node("World").environment
	if FileAccess.file_exists("res://views.json"):
		views = JSON.parse_string(FileAccess.get_file_as_string("res://views.json"))

func place(list: Array) -> Vector3:
	return Vector3(list[0], list[1], list[2])

func look():
	camera.far = 1000.0
	camera.fov = views[0].fov
	camera.make_current()
	camera.look_at_from_position(place(views[0].eye), place(views[0].target))

func _process(_delta):
	frames += 1
	if frames == 2:
		var sky := world.background_mode == Environment.BG_SKY
		var size: Vector2 = world.sky.sky_material.panorama.get_size() if sky else Vector2.ZERO
		print("sky ", sky, " ", size.x, " ", size.y)
	if frames < 3:
		return false
	if views.is_empty():
		return true
	# Each picture is of some frames after the camera moved, and the first frames load.
	if frames % 10 == 3:
		look()
	if frames % 10 == 2:
		root.get_texture().get_image().save_png("res://" + views.pop_front().out)
	return false
