#include <algorithm>
#include <string>

#include "anigen/eval/motion/motion_score.h"
#include "anigen/eval/motion/retarget.h"
#include "anigen/eval/pair/pair_groups.h"

namespace anigen::eval {
namespace {

constexpr std::size_t kMostSamples = 5000;  ///< per frame: many frames make up for few samples
constexpr double kNotedScaling = 0.01;

}  // namespace

MovedPair same_motion(const ComparedShapes& shapes, const PairSettings& settings, const Motion* given) {
  MovedPair moved;
  moved.truth = truth_motion(shapes.truth, shapes.alignment.truth, given, settings.seed, settings.motion_frames);
  moved.predicted = retarget(moved.truth, shapes.predicted.joints);
  return moved;
}

void add_motion_metrics(const ComparedShapes& shapes, const PairSettings& settings, const Motion* given,
                        PairResult& result) {
  const MovedPair moved = same_motion(shapes, settings, given);
  MotionScoreOptions options;
  options.samples = std::min(settings.surface_samples, kMostSamples);
  options.seed = settings.seed;
  const MotionScore score = motion_score(shapes.truth, moved.truth, shapes.predicted, moved.predicted, options);
  result.set("motion_distance", score.moving);
  result.set("motion_distance_rest", score.rest);
  result.details["motion"] = {{"clip", moved.truth.name},
                              {"frames", moved.truth.frames.size()},
                              {"distance", score.by_vertex ? "vertices" : "surfaces"},
                              {"largest", score.largest}};
  if (moved.truth.scaling > kNotedScaling) {
    result.notes.push_back("the clip scales joints by up to " + std::to_string(moved.truth.scaling) +
                           " from 1, which motion_distance leaves out on both sides");
  }
}

}  // namespace anigen::eval
