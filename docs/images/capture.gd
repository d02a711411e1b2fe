# Draws scene.glb as the camera of one photo sees it, as it is and as wires: colors.png and wires.png. view.json says where the camera is.
extends SceneTree

var frames := 0

func _initialize():
	RenderingServer.set_debug_generate_wireframes(true)
	var view = JSON.parse_string(FileAccess.get_file_as_string("res://view.json"))
	root.add_child(load("res://scene.glb").instantiate())
	var world := WorldEnvironment.new()
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_COLOR
	world.environment.background_color = Color.BLACK
	root.add_child(world)
	var camera := Camera3D.new()
	root.add_child(camera)
	var m: Array = view.camera_to_world
	camera.transform = Transform3D(vector(m[0]), vector(m[1]), vector(m[2]), vector(m[3]))
	var near := 0.01
	camera.set_frustum(near * view.height, near * Vector2(view.offset[0], view.offset[1]), near, 1000.0)
	root.msaa_3d = Viewport.MSAA_8X

func vector(v: Array) -> Vector3:
	return Vector3(v[0], v[1], v[2])

func _process(_delta):
	frames += 1
	if frames == 5:
		save("colors")
		root.debug_draw = Viewport.DEBUG_DRAW_WIREFRAME
	if frames == 10:
		save("wires")
	return frames == 10

func save(name: String):
	root.get_texture().get_image().save_png("res://%s.png" % name)
