#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/eval/motion/motion.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

struct MotionScoreOptions {
  std::size_t samples = 5000;  ///< per surface and frame
  std::uint64_t seed = 0;      ///< of the samples
};

/// Distances between two meshes that move at the same time, in the unit of the input.
struct MotionScore {
  double moving = 0.0;     ///< mean over the frames
  double rest = 0.0;       ///< the same distance in the bind pose: what the shapes differ by before anything moves
  double largest = 0.0;    ///< of the frames
  bool by_vertex = false;  ///< what the distance is
};

/// The true mesh posed by the true rig beside the predicted mesh posed by the predicted rig. Distance of two meshes:
/// where they have the same faces and as many vertices, the mean distance of vertices with equal numbers; else
/// surface_scores()' symmetric Chamfer distance.
/// @param truth_motion, predicted_motion of the same frames @pre both shapes have a skin and faces
/// @throws InputError as surface_scores()
MotionScore motion_score(const io::RiggedShape& truth, const Motion& truth_motion, const io::RiggedShape& predicted,
                         const Motion& predicted_motion, const MotionScoreOptions& options = {});

/// The motion that a truth is scored in, on its own joints in the frame that `placement` leads to:
///  - `given`, where there is one: onto the truth by retarget_freely();
///  - else the truth's own first clip that moves;
///  - else pose_sequence() of (seed, id).
/// @param truth already placed @param placement from its file's frame
/// @throws InputError unless frames is in 1 … 10000; when the truth has no joints
Motion truth_motion(const io::RiggedShape& truth, const Similarity& placement, const Motion* given, std::uint64_t seed,
                    int frames);

}  // namespace anigen::eval
