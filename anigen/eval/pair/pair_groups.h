#pragma once
#include <Eigen/Core>

#include "anigen/eval/pair/pair_evaluation.h"

namespace anigen::eval {

// The groups of metrics, each on shapes that were brought together; they only add to the result.

/// Chamfer distances of all protocols, joint matching, connectivity, tree edit distance.
void add_skeleton_metrics(const ComparedShapes& shapes, PairResult& result);
/// Wasserstein, Gromov–Wasserstein, fused; the first two by the method that the settings ask for.
void add_transport_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result);
/// Anymate's joint metrics in its frame, the box of side 2.
void add_anymate_metrics(const ComparedShapes& shapes, PairResult& result);
/// Weights moved to the true vertices, joints matched by matching_plan(); deformation error.
void add_skin_metrics(const ComparedShapes& shapes, const Eigen::MatrixXd& plan, const PairSettings& settings,
                      PairResult& result);
/// Both meshes in the truth's motion. @param given a motion for the truth in place of its own; null: its own
void add_motion_metrics(const ComparedShapes& shapes, const PairSettings& settings, const Motion* given,
                        PairResult& result);
void add_surface_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result);
/// Whether the prediction most resembles a reference of its truth's category.
void add_category(const ComparedShapes& shapes, const CategoryQuestion& question, PairResult& result);
void add_image_metrics(const ComparedShapes& shapes, const PairSettings& settings, const PerceptualDistance& perceptual,
                       PairResult& result);

/// Gives every metric of a group the same reason.
void skip_group(const std::string& group, const std::string& reason, PairResult& result);

}  // namespace anigen::eval
