#pragma once
#include <cstdint>
#include <string>

#include "anigen/eval/motion/motion.h"

namespace anigen::eval {

inline constexpr int kSequencePoses = 5;

/// A motion for a skeleton that came without one: from the bind pose through the first kSequencePoses random poses of
/// the deformation error (random_rotations(), the same probability and angles) and back, a second between poses,
/// joints' local rotations on the shortest arc in between. Frames are evenly spread over the loop; the first one is the
/// bind pose. Decided by seed, asset and the skeleton alone.
/// @param asset its id @throws InputError as check(), and unless frames is in 1 … 10000
Motion pose_sequence(const io::JointTree& tree, std::uint64_t seed, const std::string& asset, int frames);

}  // namespace anigen::eval
