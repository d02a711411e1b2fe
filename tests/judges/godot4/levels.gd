# Draws scene.lod.tscn from nearer and nearer and prints what is drawn: a line for each distance with the distance from the middle of the
# scene and the triangles of the frame. Distances are one far off, just beyond and just within the range of each level, and one within the scene.
# With OUT in the environment it leaves pictures.
extends SceneTree

var camera := Camera3D.new()
var middle: Vector3
var distances: Array[float] = []
var frames := 0

func _initialize():
	var scene = load("res://scene.lod.tscn").instantiate()
	root.add_child(scene)
	root.add_child(camera)
	var last := 0.0
	for level in scene.get_children():
		for node in level.get_children():
			if node is MeshInstance3D and node.visibility_range_begin > last:
				last = node.visibility_range_begin
				middle = node.custom_aabb.get_center()
				distances.append_array([0.99 * last, 1.01 * last])
	distances.push_front(0.1 * distances[0])
	distances.append(10.0 * last)
	camera.far = 100.0 * last
	distances.reverse()
	look()

func look():
	var towards := Vector3(0.36, 0.48, 0.8)
	# From within the scene outwards: half of it is out of view.
	var target := middle if distances.size() > 1 else middle + towards * distances[0] * 2.0
	camera.make_current()
	camera.look_at_from_position(middle + distances[0] * towards, target)

func _process(_delta):
	frames += 1
	# The first frames load; the figures are those of the frame before.
	if frames < 6:
		return false
	frames = 0
	var kind := RenderingServer.VIEWPORT_RENDER_INFO_TYPE_VISIBLE
	var what := RenderingServer.VIEWPORT_RENDER_INFO_PRIMITIVES_IN_FRAME
	print("drawn ", distances[0], " ", RenderingServer.viewport_get_render_info(root.get_viewport_rid(), kind, what))
	if OS.has_environment("OUT"):
		root.get_texture().get_image().save_png("res://%d.png" % distances.size())
	distances.pop_front()
	if distances.is_empty():
		return true
	look()
	return false
