#include "anigen/eval/motion/motion_score.h"

#include <algorithm>
#include <utility>

#include "anigen/eval/motion/motion_file.h"
#include "anigen/eval/motion/pose_sequence.h"
#include "anigen/eval/motion/retarget.h"
#include "anigen/eval/surface/surface_metrics.h"

namespace anigen::eval {
namespace {

using Vertices = std::vector<Eigen::Vector3f>;

double vertex_distance(const Vertices& a, const Vertices& b) {
  double sum = 0.0;
  for (std::size_t v = 0; v < a.size(); ++v) sum += (a[v].cast<double>() - b[v].cast<double>()).norm();
  return sum / static_cast<double>(a.size());
}

Mesh with_vertices(const std::vector<Triangle>& faces, Vertices vertices) {
  Mesh mesh;
  mesh.faces = faces;
  mesh.vertices = std::move(vertices);
  return mesh;
}

}  // namespace

MotionScore motion_score(const io::RiggedShape& truth, const Motion& truth_motion, const io::RiggedShape& predicted,
                         const Motion& predicted_motion, const MotionScoreOptions& options) {
  MotionScore score;
  score.by_vertex =
      truth.mesh.vertices.size() == predicted.mesh.vertices.size() && truth.mesh.faces == predicted.mesh.faces;
  SurfaceOptions surface;
  surface.samples = options.samples;
  surface.seed = options.seed;
  const auto distance = [&](Vertices of_truth, Vertices of_prediction) {
    if (score.by_vertex) return vertex_distance(of_truth, of_prediction);
    return surface_scores(with_vertices(predicted.mesh.faces, std::move(of_prediction)),
                          with_vertices(truth.mesh.faces, std::move(of_truth)), surface)
        .chamfer;
  };
  score.rest = distance(truth.mesh.vertices, predicted.mesh.vertices);
  for (std::size_t f = 0; f < truth_motion.frames.size(); ++f) {
    const double here =
        distance(posed_vertices(truth, rigid_motions(truth.joints, truth_motion.frames[f])),
                 posed_vertices(predicted, rigid_motions(predicted.joints, predicted_motion.frames[f])));
    score.moving += here / static_cast<double>(truth_motion.frames.size());
    score.largest = std::max(score.largest, here);
  }
  return score;
}

Motion truth_motion(const io::RiggedShape& truth, const Similarity& placement, const Motion* given, std::uint64_t seed,
                    int frames) {
  if (given != nullptr) return retarget_freely(*given, truth.joints);
  if (truth.clips != nullptr && truth.clips->skeleton.size() == truth.joints.size()) {
    Similarity turn;
    turn.rotation = truth.clips_turn;
    Motion own = first_moving_clip(truth.clips->animations, truth.clips->skeleton, frames);
    if (!own.frames.empty()) {
      own = transformed(compose(placement, turn), std::move(own));
      own.joints = truth.joints;
      return own;
    }
  }
  return pose_sequence(truth.joints, seed, truth.id, frames);
}

}  // namespace anigen::eval
