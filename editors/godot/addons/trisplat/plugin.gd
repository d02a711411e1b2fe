@tool
# Imports trained scenes by the program trisplat, which is on the PATH or where Project Settings > Trisplat > Program says.
extends EditorPlugin

const Importer := preload("scene_importer.gd")
var importer: Importer

func _enter_tree():
	Importer.declare_program()
	importer = Importer.new()
	add_import_plugin(importer)

func _exit_tree():
	remove_import_plugin(importer)
	importer = null
