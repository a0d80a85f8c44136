#pragma once
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/io/gltf/import_notes.h"
#include "anigen/io/gltf/import_rig.h"
#include "anigen/io/gltf/import_tracks.h"

namespace anigen::io::gltf_import {

/// Tracks of nodes as channels of joints, with the nodes folded into a joint applied to its keys and tangents (exact,
/// since they are similarities). Tracks of other nodes are dropped and noted.
std::vector<Animation> convert_animations(const std::vector<TrackSet>& animations, const Rig& rig, Notes& notes);

}  // namespace anigen::io::gltf_import
