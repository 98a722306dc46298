"""Run by Blender's Python: SCRIPT and OUT.exr; a picture of the sphere that an exported script makes."""

import math
import runpy
import sys

import bpy
from mathutils import Vector

script, out = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
sys.argv = [script]
runpy.run_path(script)
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples = 64
scene.cycles.max_bounces = 1
scene.render.resolution_x = scene.render.resolution_y = 64
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.angle = math.radians(26.0)
camera.location = (0.0, 0.0, 5.4)
scene.collection.objects.link(camera)
scene.camera = camera
lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
lamp.data.energy, lamp.data.angle = 2.0, 0.0
lamp.rotation_euler = Vector((-0.5, 0.6, 0.7)).to_track_quat("Z", "Y").to_euler()
scene.collection.objects.link(lamp)
scene.render.film_transparent = True
scene.view_settings.view_transform = "Raw"
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = out
bpy.ops.render.render(write_still=True)
