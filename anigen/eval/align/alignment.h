#pragma once
#include <string>

#include "anigen/eval/align/icp.h"
#include "anigen/eval/align/normalization.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

struct AlignmentOptions {
  NormalizationMode normalization = NormalizationMode::kCentroidRms;
  bool icp = true;  ///< false: normalisation is all
  IcpOptions registration;
};

/// What the alignment looked at: the best that both shapes have.
enum class AlignedBy {
  kSurface,   ///< both have faces
  kVertices,  ///< one is a point set: vertices, or samples of the other's surface
  kJoints     ///< one has no vertices
};

std::string to_string(AlignedBy by);

/// How a prediction and its ground truth come into one frame, the frame of scores: the truth's bounding box centred at
/// the origin with its longest side 1 (reference training-and-data.md, 7.1), whatever normalisation ICP ran on. With
/// NormalizationMode::kNone it is the truth's own frame and unit.
struct Alignment {
  Similarity prediction;  ///< prediction's file → frame of scores
  Similarity truth;       ///< truth's file → frame of scores
  AlignedBy by = AlignedBy::kSurface;
  bool icp_used = false;
  IcpResult icp;  ///< between the normalised shapes; its residuals are given in the frame of scores
};

/// Normalises both shapes and registers the prediction to the truth. Runs on the calling thread unless
/// options.registration.parallel. A shape without size keeps its scale.
/// @throws InputError when the shapes share neither vertices nor joints, naming the file; on bad meshes; on bad options
Alignment align(const io::RiggedShape& prediction, const io::RiggedShape& truth, const AlignmentOptions& options = {});

}  // namespace anigen::eval
