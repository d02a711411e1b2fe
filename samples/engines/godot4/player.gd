# Walks through the scene: W A S D and the mouse, Shift runs, Space jumps, Escape frees the mouse.
# It begins where scene.glb says that one looks from first, and floats there until the first step. Then it stands on the node that
# `trisplat bake --target godot --collision` puts into scene.glb; where there is no ground below, it floats on.
extends CharacterBody3D

## Height of the walker in units of the scene: 1.7 for one in metres. 0 is two fifths of the way from the first viewpoint to its subject.
@export var height := 0.0
## Speeds in heights a second, gravity in heights a second squared.
@export var walk := 1.0
@export var run := 3.0
@export var jump := 2.0
@export var gravity := 6.0

## True until the first step above ground.
var floating := true
## Below this there is no ground.
var lowest: float

func _ready():
	var scene := get_node("../Scene")
	var box := bounds(scene)
	var first := scene.find_child("viewpoint*", true, false) as Camera3D
	if height <= 0.0:
		# A bake puts the near plane at a hundredth of the way to the subject. The box would be that of all surroundings.
		height = 0.4 * 100.0 * first.near if first else 0.1 * box.size.length()
	$Shape.shape.height = height
	$Shape.shape.radius = 0.2 * height
	$Shape.disabled = true
	$Camera.position.y = 0.4 * height
	$Camera.near = 0.02 * height
	$Camera.far = 1000.0 * height
	# The viewpoint of scene.glb is a camera, too.
	$Camera.current = true
	safe_margin = 0.005 * height
	floor_snap_length = 0.1 * height
	lowest = box.position.y - box.size.y - height
	# Ground is ground from either side.
	for shape in scene.find_children("*", "CollisionShape3D", true, false):
		if shape.shape is ConcavePolygonShape3D:
			shape.shape.backface_collision = true
	look_from_first(first, box)
	show_sky(get_node("../World").environment)
	Input.mouse_mode = Input.MOUSE_MODE_CAPTURED

## Puts the eyes where scene.glb says, or above the scene when it does not.
func look_from_first(first: Camera3D, box: AABB):
	if first == null:
		position = box.get_center() + Vector3.UP * (0.5 * box.size.y + height)
		return
	var ahead := -first.global_transform.basis.z
	rotation.y = atan2(-ahead.x, -ahead.z)
	$Camera.rotation.x = asin(clampf(ahead.y, -1.0, 1.0))
	$Camera.fov = first.fov
	position = first.global_position - Vector3.UP * $Camera.position.y

## Shows the panorama that `trisplat bake --backdrop sky` writes beside scene.glb.
func show_sky(environment: Environment):
	var name := "res://scene.sky.jpg"
	if not ResourceLoader.exists(name):
		# With `--set texture_format=png`.
		name = "res://scene.sky.png"
	if not ResourceLoader.exists(name):
		return
	var panorama := PanoramaSkyMaterial.new()
	panorama.panorama = load(name)
	environment.sky = Sky.new()
	environment.sky.sky_material = panorama
	# A panorama of Godot begins at -Z, that of the file a quarter of a turn before.
	environment.sky_rotation.y = 0.5 * PI
	environment.background_mode = Environment.BG_SKY

## The box around what the bake calls the scene: a backdrop is no part of it.
func bounds(scene: Node) -> AABB:
	var all := AABB()
	for node in scene.get_children():
		if node is MeshInstance3D and not node.name.begins_with("backdrop"):
			var part: AABB = node.transform * node.get_aabb()
			all = all.merge(part) if all.has_volume() else part
	return all

func _input(event):
	if event is InputEventMouseMotion and Input.mouse_mode == Input.MOUSE_MODE_CAPTURED:
		rotate_y(-0.003 * event.relative.x)
		$Camera.rotation.x = clampf($Camera.rotation.x - 0.003 * event.relative.y, -1.5, 1.5)
	elif event.is_action_pressed("ui_cancel"):
		Input.mouse_mode = Input.MOUSE_MODE_VISIBLE
	elif event is InputEventMouseButton:
		Input.mouse_mode = Input.MOUSE_MODE_CAPTURED

func _physics_process(delta):
	var side := key(KEY_D) - key(KEY_A)
	var ahead := key(KEY_W) - key(KEY_S)
	var speed := height * (run if Input.is_physical_key_pressed(KEY_SHIFT) else walk)
	var way := (transform.basis * Vector3(side, 0, -ahead)).normalized() * speed
	var head := position.y + 0.5 * height
	var ground: float = ground_below(head)
	if floating and way != Vector3.ZERO and ground > lowest:
		floating = false
		$Shape.disabled = false
		# Photos are taken from anywhere: the feet may be in the ground.
		position.y = maxf(position.y, ground + 0.51 * height)
	velocity = Vector3(way.x, velocity.y - gravity * height * delta, way.z)
	if floating or ground <= lowest:
		velocity.y = 0.0
	elif is_on_floor() and Input.is_physical_key_pressed(KEY_SPACE):
		velocity.y = jump * height
	move_and_slide()
	# Between its middle before the step and its feet there was no ground; if there is now, it fell through.
	ground = ground_below(maxf(head - 0.5 * height, position.y))
	if not floating and position.y - 0.5 * height < ground - 0.02 * height:
		position.y = ground + 0.5 * height
		velocity.y = 0.0

## Height of the ground below `from`; `lowest` when there is none.
func ground_below(from: float) -> float:
	var query := PhysicsRayQueryParameters3D.create(Vector3(position.x, from, position.z), Vector3(position.x, lowest, position.z))
	query.exclude = [get_rid()]
	query.hit_back_faces = true
	var hit := get_world_3d().direct_space_state.intersect_ray(query)
	return hit.position.y if hit else lowest

func key(code: Key) -> float:
	return 1.0 if Input.is_physical_key_pressed(code) else 0.0
