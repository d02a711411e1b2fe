@tool
# Imports trained scenes by the program trisplat, which is on the PATH or where Editor Settings > Trisplat > Program says.
extends EditorPlugin

const Importer := preload("scene_importer.gd")
var importer: Importer

func _enter_tree():
	importer = Importer.new()
	importer.preferences = get_editor_interface().get_editor_settings()
	importer.declare_program()
	add_import_plugin(importer)

func _exit_tree():
	remove_import_plugin(importer)
	importer = null
