#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// A rig as plain named arrays: UniRig's raw_data.npz (docs/reference/riggers.md, 5) and skeleton_voxelized.npz of the
/// published data set (docs/reference/training.md, 1.1) share them.
///   joints [J, 3]; parents [J], None or -1 for a root; skin [V, J] dense; vertices [V, 3]; faces [F, 3];
///   vertex_normals [V, 3]
/// Any part but the joints' parents may be missing; a note says so. Numbers stay in the file's frame.
/// @throws InputError naming file and array: other shapes, so also weights for another number of vertices or joints;
/// numbers that are not finite; indices out of range; a skeleton without a joint or with a cycle
RiggedShape shape_from_rig_arrays(const NamedArrays& arrays, const std::string& id, const std::string& file);

/// Reads an NPZ file with those arrays, and the joints' names when it has them (`names`).
RiggedShape read_rig_npz(const std::filesystem::path& file, const std::string& id);

/// True when an NPZ file has at least joints or vertices as plain arrays. @throws InputError when it is no NPZ file
bool is_rig_npz(const std::filesystem::path& file);

}  // namespace anigen::io
