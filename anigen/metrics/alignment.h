#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/icp.h"
#include "anigen/metrics/similarity.h"

namespace anigen::metrics {

/// Meaning of "normalise scale and centre"; the published protocol leaves it open (docs/reference/training.md, 7.1).
enum class NormalizationMode {
  kCentroidRms,  ///< centroid of the surface at the origin, RMS distance of the surface from it 1: the only one that
                 ///< does not change when the shape is rotated, so the only one after which a rigid ICP can be exact
  kBoundingBox,  ///< centre of the box at the origin, longest side 1: the reference's, and the frame of all scores
  kTruth,        ///< both shapes by the truth's box: a prediction for a given mesh stays where it is in it
  kTruthWithJoints,  ///< likewise, the box being that of the truth's vertices and joints (UniRig); it is the frame of
                     ///< scores, too
  kNone
};

/// "centroid-rms", "bounding-box", "truth", "truth-with-joints", "none". @throws InputError for another word
NormalizationMode normalization_mode(const std::string& word);
std::string to_string(NormalizationMode mode);

/// Centre and extent of a surface's mass. Integrals over the triangles in closed form, so that neither seed nor
/// tessellation matters: what seeded area-uniform samples estimate. A mesh whose faces have no area counts its vertices
/// instead.
struct SurfaceMoments {
  double area = 0.0;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  double rms_radius = 0.0;  ///< √(∫ |x − centroid|² dA / area)
};

/// @throws InputError without vertices, on a bad index or a position that is not finite
SurfaceMoments surface_moments(const Mesh& mesh);

/// Scale and translation that normalise a shape. A shape without size keeps its scale: 1. The box is that of all
/// vertices, as everywhere; without faces the vertices are a point set.
/// @param mode kTruth and kTruthWithJoints count as kBoundingBox
/// @throws InputError without vertices, on a bad index or a position that is not finite or beyond 1e15
Similarity normalization(const Mesh& mesh, NormalizationMode mode);

/// As above, for points that count equally: joints of a shape without a surface.
Similarity normalization(const std::vector<Eigen::Vector3d>& points, NormalizationMode mode);

struct AlignmentOptions {
  NormalizationMode normalization = NormalizationMode::kCentroidRms;
  bool icp = true;  ///< false: normalisation is all
  IcpOptions registration;
};

/// Features that the alignment used: the best that both shapes have.
enum class AlignedBy {
  kSurface,   ///< both have faces
  kVertices,  ///< one is a point set: vertices, or samples of the other's surface
  kJoints     ///< one has no vertices
};

std::string to_string(AlignedBy by);

/// Transform of a prediction and its ground truth into one frame, the frame of scores: the truth's bounding box centred
/// at the origin with its longest side 1 (docs/reference/training.md, 7.1), whatever normalisation ICP ran on; of the
/// truth's joints where it has no mesh. With
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

}  // namespace anigen::metrics
