#pragma once
#include <cstddef>
#include <filesystem>
#include <string>

#include "anigen/asset/animation.h"
#include "anigen/asset/skeleton.h"

namespace anigen::io {

/// A motion capture file of Biovision: a skeleton without a mesh, and one clip.
struct BvhMotion {
  Skeleton skeleton;    ///< identity rotations at the offsets, rest = bind; Z up, the file's unit (mostly centimetres)
  Animation animation;  ///< linear keys at every frame; named after the file
  double frame_time = 0.0;  ///< seconds, > 0
  std::size_t frames = 0;   ///< ≥ 1
};

/// The file is Y up: (X, Y, Z) → (X, −Z, Y), as glTF import does.
///
/// Channels stand in any order and turn in the order they are listed, the first outermost, angles in degrees. A
/// position channel stands for the offset's coordinate and is not added to it: what exporters mean that give all six
/// channels to every joint. (Where a root has no offset both readings agree.) An End Site becomes a joint called
/// `<parent>_end` that nothing turns.
/// @param file for messages
/// @throws InputError naming file and line: a word that does not belong there, a file that ends early, a joint called
/// as an earlier one (so that none is its own ancestor), a channel unknown or given twice, a frame with another number
/// of values than there are channels, fewer or more frames than announced, no frame, a number that is none, not finite
/// or beyond 1e9, a frame time that is not positive, more than 10,000 joints or 100,000,000 values
/// @throws NotSupportedError for several skeletons in one file
BvhMotion parse_bvh(const std::string& text, const std::string& file);

/// @throws InputError also when the file is missing, unreadable or larger than 1 GiB
BvhMotion read_bvh(const std::filesystem::path& file);

}  // namespace anigen::io
