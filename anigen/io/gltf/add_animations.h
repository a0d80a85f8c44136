#pragma once
#include <filesystem>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

struct AddAnimationOptions {
  bool keep_clips = true;  ///< the file's own animations stay, before the new ones
};

/// Writes a copy of a rigged glTF file with animations added. Nothing else changes, as graft_rig() describes it: JSON
/// keeps its text, the bytes of the first buffer are the beginning of the copy's. But for nodes that have a matrix and
/// are animated now, which glTF forbids: they get the same transform as translation, rotation and scale. Clips that
/// have the name of an earlier one get a number behind it.
///
/// Motion of a root that the importer made to join several goes to the joints below it; a mesh without any joint above
/// it, which the importer bound to that root, rests.
/// @param original .glb or .gltf @param animations of the skeleton that read_gltf() with
/// ImportOptions::require_rig = false makes of the file, Z up @param out .glb, or .gltf with everything inside; written
/// atomically
/// @throws InputError when the file cannot be read or has no joints, or an animation is not of that skeleton
/// (validate()); NotSupportedError naming the node where its matrix has a shear, or as graft_rig() for the file's first
/// buffer
std::vector<ImportNote> add_animations(const std::filesystem::path& original, const std::vector<Animation>& animations,
                                       const std::filesystem::path& out, const AddAnimationOptions& options = {});

}  // namespace anigen::io
