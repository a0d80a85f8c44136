# Says what Godot 3 made of the GLB files of a project that it has imported: one line of JSON per file, behind "GODOT ".
# check_in_godot.py calls this, and compares with what the files say. By hand:
#   godot3-server --path PROJECT --editor (to be stopped when the folder .import fills no more)
#   godot3-server --path PROJECT --script check_in_godot.gd
extends SceneTree

func visit(node, found):
	if node is Skeleton:
		var names = []
		for i in range(node.get_bone_count()):
			names.append(node.get_bone_name(i))
		found.skeletons.append(names)
	if node is MeshInstance and node.mesh:
		var counts = []
		var bound = 0
		for s in range(node.mesh.get_surface_count()):
			var arrays = node.mesh.surface_get_arrays(s)
			counts.append(arrays[Mesh.ARRAY_VERTEX].size())
			if arrays[Mesh.ARRAY_WEIGHTS] != null and arrays[Mesh.ARRAY_BONES] != null:
				bound += arrays[Mesh.ARRAY_VERTEX].size()
		var names = []
		if node.skin:
			for i in range(node.skin.get_bind_count()):
				names.append(node.skin.get_bind_name(i) if node.skin.has_method("get_bind_name") else "")
		found.meshes.append({"surfaces": counts, "bound": bound, "binds": names.size()})
	if node is AnimationPlayer:
		for name in node.get_animation_list():
			var clip = node.get_animation(name)
			var tracks = 0
			for i in range(clip.get_track_count()):
				if clip.track_get_key_count(i) > 0:
					tracks += 1
			found.clips.append({"name": name, "length": clip.length, "tracks": tracks})
	for child in node.get_children():
		visit(child, found)

func _init():
	var folder = Directory.new()
	folder.open("res://")
	folder.list_dir_begin(true)
	var name = folder.get_next()
	while name != "":
		if name.to_lower().ends_with(".glb"):
			var found = {"file": name, "skeletons": [], "meshes": [], "clips": [], "loaded": false}
			var scene = load("res://" + name)
			if scene != null:
				var root = scene.instance()
				found.loaded = root != null
				visit(root, found)
				root.free()
			print("GODOT " + to_json(found))
		name = folder.get_next()
	quit()
