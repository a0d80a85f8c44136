#pragma once
#include <string>
#include <vector>

#include "anigen/metrics/motion.h"
#include "anigen/motions/built_in.h"

namespace anigen::motions {

/// A motion with the body that makes it.
struct SourceClip {
  metrics::Motion motion;
  Body body;  ///< in the frame of motion.joints
};

struct Retargeted {
  BodyMotion motion;
  bool by_limbs = false;     ///< limb to limb; else bones were matched by transport (metrics::retarget_freely())
  std::size_t standing = 0;  ///< frames in which some foot was held where it stood
  double raised = 0.0;       ///< what all frames were moved up by, so that none sinks below the ground, in heights
};

/// Transfers a motion to a body of other proportions, joints and bind pose.
///
/// If both have equally many pairs of legs, the same stance and arms on both sides or none, limbs take the motion of
/// their counterparts: bones at equal places along a limb get the directions that the source's have, so that arms bound
/// aside follow arms bound downwards; trunk, neck, head, tail and feet get its turns since the bind pose. The way of
/// the pelvis is scaled by the lengths of the legs, and the lowest foot of the clip stands on the ground. Feet that
/// stand in the source stand in the result (keep_feet()). The source is turned about the vertical to face as the body
/// does.
///
/// Other bodies take it as metrics::retarget_freely() has it, raised where a frame would sink below the ground that the
/// bind pose stands on.
/// @throws InputError as these
Retargeted retarget_to(const Body& body, const SourceClip& source);

/// A motion of a skeleton without a surface: its bones stand for one. @throws InputError as figure_of()
SourceClip source_clip(metrics::Motion motion, const std::vector<std::string>& names = {});

/// Reads FILE or FILE#CLIP at `fps` key frames per second, `frames` if it is not 0; the body is that of the file's
/// skinned mesh, if it has one. @throws InputError as metrics::read_motion()
SourceClip read_clip(const std::string& file_and_clip, const MotionOptions& options);

}  // namespace anigen::motions
