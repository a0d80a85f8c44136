#pragma once
#include "anigen/motions/built_in.h"

namespace anigen::motions {

/// Largest way that a foot which stands slides along the ground, in heights of the body: horizontal distance of the
/// middle of its sole from where it came down, on ground that moves with motion.ground_velocity. Measured in the clip,
/// between its keys, too. 0 without contacts.
double foot_slide(const Body& body, const BodyMotion& motion, const Animation& clip, const Skeleton& skeleton);

/// Holds feet where they stand: while motion.contacts say so, the middle of a sole stays at the mean of its places, on
/// the height of the ground; the correction fades in and out over a few frames. Legs bend for it, with their knees as
/// they pointed. @return frames in which some foot was held
std::size_t keep_feet(const Body& body, BodyMotion& motion);

}  // namespace anigen::motions
