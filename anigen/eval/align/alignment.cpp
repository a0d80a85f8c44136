#include "anigen/eval/align/alignment.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

AlignedBy common_ground(const io::RiggedShape& a, const io::RiggedShape& b) {
  if (a.has_surface() && b.has_surface()) return AlignedBy::kSurface;
  if (!a.mesh.vertices.empty() && !b.mesh.vertices.empty()) return AlignedBy::kVertices;
  if (a.has_joints() && b.has_joints()) return AlignedBy::kJoints;
  const io::RiggedShape& poorer = a.has_joints() ? b : a;
  throw InputError(poorer.file, "", "there is nothing to align by: the two shapes share neither a mesh nor joints");
}

Similarity normalize(const io::RiggedShape& shape, NormalizationMode mode, AlignedBy by) {
  try {
    return by == AlignedBy::kJoints ? normalization(shape.joints.positions, mode) : normalization(shape.mesh, mode);
  } catch (const InputError& error) {
    throw InputError(shape.file, error.place(), error.problem());
  }
}

AlignmentShape prepare(const io::RiggedShape& shape, const Similarity& normalized, AlignedBy by,
                       const IcpOptions& options) {
  const std::size_t samples = std::max(options.samples, options.score_samples);
  if (by == AlignedBy::kJoints) {
    return {transformed(normalized, shape.joints.positions), samples, options.seed};
  }
  if (shape.has_surface()) {
    Mesh mesh;
    mesh.vertices = shape.mesh.vertices;
    mesh.faces = shape.mesh.faces;
    return {transformed(normalized, std::move(mesh)), samples, options.seed};
  }
  return {transformed(normalized, shape.mesh.vertices), samples, options.seed};
}

}  // namespace

std::string to_string(AlignedBy by) {
  switch (by) {
    case AlignedBy::kSurface:
      return "surface";
    case AlignedBy::kVertices:
      return "vertices";
    case AlignedBy::kJoints:
      break;
  }
  return "joints";
}

Alignment align(const io::RiggedShape& prediction, const io::RiggedShape& truth, const AlignmentOptions& options) {
  check(options.registration);
  Alignment result;
  result.by = common_ground(prediction, truth);
  const Similarity from = normalize(prediction, options.normalization, result.by);
  const Similarity to = normalize(truth, options.normalization, result.by);
  const bool raw = options.normalization == NormalizationMode::kNone;
  result.truth = raw ? Similarity{} : normalize(truth, NormalizationMode::kBoundingBox, result.by);
  const Similarity to_scores = compose(result.truth, to.inverse());
  if (options.icp) {
    result.icp = register_shapes(prepare(prediction, from, result.by, options.registration),
                                 prepare(truth, to, result.by, options.registration), options.registration);
    result.icp.rmse *= to_scores.scale;
    result.icp.runner_up *= to_scores.scale;
    result.icp_used = true;
  }
  result.prediction = compose(to_scores, compose(result.icp.transform, from));
  return result;
}

}  // namespace anigen::eval
