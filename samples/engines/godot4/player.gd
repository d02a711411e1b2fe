# Walks through the scene: W A S D and the mouse, Shift runs, Space jumps, Escape frees the mouse.
# It stands on the node that `trisplat bake --target godot --collision` puts into scene.glb.
extends CharacterBody3D

## Height of the walker in units of the scene: 1.7 for one in metres. 0 is a tenth of the scene's size.
@export var height := 0.0
## Speeds in heights a second, gravity in heights a second squared.
@export var walk := 1.0
@export var run := 3.0
@export var jump := 2.0
@export var gravity := 6.0

var box: AABB
var start: Vector3

func _ready():
	box = bounds(get_node("../Scene"))
	if height <= 0.0:
		height = 0.1 * box.size.length()
	$Shape.shape.height = height
	$Shape.shape.radius = 0.2 * height
	$Camera.position.y = 0.4 * height
	$Camera.near = 0.02 * height
	$Camera.far = 1000.0 * height
	# The viewpoint of scene.glb is a camera, too.
	$Camera.current = true
	safe_margin = 0.005 * height
	floor_snap_length = 0.1 * height
	start = box.get_center() + Vector3.UP * (0.5 * box.size.y + height)
	position = start
	Input.mouse_mode = Input.MOUSE_MODE_CAPTURED

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
	velocity = Vector3(way.x, velocity.y - gravity * height * delta, way.z)
	if is_on_floor() and Input.is_physical_key_pressed(KEY_SPACE):
		velocity.y = jump * height
	move_and_slide()
	# Beyond the edge of what was photographed there is nothing to stand on.
	if position.y < box.position.y - box.size.y - height:
		position = start
		velocity = Vector3.ZERO

func key(code: Key) -> float:
	return 1.0 if Input.is_physical_key_pressed(code) else 0.0
