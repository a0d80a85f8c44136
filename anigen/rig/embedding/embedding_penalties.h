#pragma once
#include <vector>

#include "anigen/rig/embedding/embedding_options.h"
#include "anigen/rig/embedding/reduced_skeleton.h"
#include "anigen/rig/embedding/sphere_graph.h"

namespace anigen::rig {

/// What a step that breaks a rule costs on top: a search that obeys rules takes no step that costs this much.
inline constexpr double kBrokenRule = 1.0;

/// A partial embedding: the vertices of the first joints, and what follows from them.
struct PlacedJoints {
  std::vector<int> vertices;                   ///< [k], of the first k reduced joints
  std::vector<char> used;                      ///< [V], on the way of a bone
  std::vector<std::vector<double>> tree_path;  ///< [k][k], lengths of ways along the bones
};

PlacedJoints placed_so_far(const SphereGraph& graph, const ReducedSkeleton& skeleton, std::vector<int> vertices);

/// The nine penalties of the discrete embedding (reference anymate-baselines.md, 9.2, stage 7), weighted and summed.
class EmbeddingPenalties {
 public:
  /// Keeps references to both.
  EmbeddingPenalties(const SphereGraph& graph, const ReducedSkeleton& skeleton, const EmbeddingOptions& options);

  /// Vertices where a joint may lie (stage 6); where no vertex qualifies, all.
  std::vector<int> candidates(std::size_t joint) const;
  /// Joint `joint` at vertex v without regard to other joints than its parent, which is at u: length, directions of
  /// the bone and of the joints along it, duplicate, extremity and foot height. The first joint has only the last.
  double lone(std::size_t joint, int u, int v) const;
  /// What the joints placed before add: direction from siblings, symmetry, doubled ways, disjointness.
  double together(std::size_t joint, int v, const PlacedJoints& placed) const;

 private:
  double length(const ReducedJoint& joint, int u, int v) const;
  double parent_direction(const ReducedJoint& joint, int u, int v) const;
  double local_direction(const ReducedJoint& joint, int u, int v) const;
  double local_bone(const ReducedJoint& joint, std::size_t link, const Eigen::Vector3d& embedded) const;
  bool goes_farther(int u, int v) const;
  bool is_extremity(int v) const;
  double play(int u, int v) const;
  double foot_height(const ReducedJoint& joint, int v) const;
  double sibling_directions(std::size_t joint, int v, const PlacedJoints& placed) const;
  double symmetry(const ReducedJoint& joint, int u, int v, const PlacedJoints& placed) const;
  double doubled_way(int u, int v, const PlacedJoints& placed) const;
  double disjointness(std::size_t joint, int v, const PlacedJoints& placed) const;

  const SphereGraph& graph_;
  const ReducedSkeleton& skeleton_;
  const EmbeddingOptions& options_;
  double lowest_ = 0.0;  ///< z of the lowest sphere's centre
  std::vector<char> extremity_;
};

}  // namespace anigen::rig
