#pragma once
#include <string>

#include "anigen/core/json.h"
#include "anigen/eval/motion/motion.h"

namespace anigen::eval {

/// A motion that a user named.
struct MotionFile {
  Motion motion;   ///< Z up, the file's unit
  Json described;  ///< file, sha256, clip, number of joints: saved results are told apart by it
};

/// Reads "FILE" or "FILE#CLIP": .bvh, which has one clip, or a .glb, .gltf, .fbx or .dae that is rigged or has no mesh.
/// CLIP is a clip's name, else its number from 0; without it the first clip that moves.
/// @throws InputError naming the file: unreadable, another extension, no clip, no clip of that name (with those there
/// are), or nothing in it moves
MotionFile read_motion(const std::string& file_and_clip, int frames);

/// The first clip that moves(), else nothing: .frames is empty. @param frames as in motion_of()
Motion first_moving_clip(const std::vector<Animation>& animations, const Skeleton& skeleton, int frames);

}  // namespace anigen::eval
