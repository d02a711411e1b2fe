"""Draws a GLB with f3d from given cameras: tests/judges/renderers.rs says what for.

Standard input: {"file", "size": [w, h], "background": [r, g, b], "views": [{"eye", "target", "up", "fov", "out"}]},
fov vertical, in degrees. f3d has square pixels, one centred sample a pixel here, and no word for the near plane.
It shows the numbers of COLOR_0 as they are, so the file has to hold sRGB codes.
"""
import json
import sys

import f3d

job = json.load(sys.stdin)
engine = f3d.Engine.create(True)
engine.window.size = tuple(job["size"])
engine.options["render.grid.enable"] = False
engine.options["render.background.color"] = job["background"]
engine.options["ui.axis"] = False
engine.scene.add(job["file"])
for view in job["views"]:
    camera = engine.window.camera
    camera.position, camera.focal_point, camera.view_up = view["eye"], view["target"], view["up"]
    camera.view_angle = view["fov"]
    engine.window.render_to_image().save(view["out"])
