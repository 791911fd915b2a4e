"""Blender shows a volume as the field's picture: SCRIPT VOLUME CAMERAS PICTURE.

The script of the book sets the scene up. The first camera of the file renders it in Cycles, at the
size of the picture. Prints the PSNR in dB.
"""

import json
import runpy
import sys

import bpy
import mathutils
import numpy

script, volume, cameras, picture = sys.argv[1:]
for own in list(bpy.data.objects):
    bpy.data.objects.remove(own)
sys.argv = [script, "--", volume]
made = runpy.run_path(script)

grids = made["volume"].data.grids
grids.load()
assert {grid.name for grid in grids} == {"density", "Cd"}, list(grids)
[material] = made["volume"].data.materials
nodes = material.node_tree.nodes
attributes = {node.attribute_name for node in nodes if node.type == "ATTRIBUTE"}
assert attributes == {"density", "Cd"}, attributes
[output] = [node for node in nodes if node.type == "OUTPUT_MATERIAL"]
assert output.inputs["Volume"].is_linked and not output.inputs["Surface"].is_linked


def pixels(path):
    image = bpy.data.images.load(path)
    values = numpy.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
    return values[:, :, :3]


want = pixels(picture)
scene = bpy.context.scene
with open(cameras, encoding="utf-8") as file:
    cameras = json.load(file)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
camera.matrix_world = mathutils.Matrix(cameras["frames"][0]["transform_matrix"])
camera.data.angle_x = cameras["camera_angle_x"]
scene.camera = camera
scene.render.resolution_y, scene.render.resolution_x = want.shape[:2]
scene.render.resolution_percentage = 100
scene.render.filepath = picture + ".blender.png"
scene.cycles.device = "CPU"
scene.cycles.samples = 32
scene.cycles.use_denoising = False
bpy.ops.render.render(write_still=True)
error = numpy.mean((pixels(scene.render.filepath) - want) ** 2)
print(f"{-10 * numpy.log10(error):.2f}")
