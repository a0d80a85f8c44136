#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/rig/embedding/embedding_options.h"
#include "anigen/rig/embedding/embedding_template.h"
#include "anigen/rig/embedding/solid_field.h"

namespace anigen::rig {

/// Moves the joints of an embedding where bones run in the middle of the solid, without becoming shorter than or
/// turning away from those of the template, or longer than those of the other side (reference anymate-baselines.md,
/// 9.2, stage 9): gradient descent with line searches.
class BoneRefinement {
 public:
  /// @param medial_distance as distance_to_medial() @param skeleton with positions in the frame of the field
  BoneRefinement(const SolidField& field, const std::vector<float>& medial_distance, const TemplateSkeleton& skeleton,
                 const EmbeddingOptions& options);

  /// @param joints [J]; those that are carried neither move nor count
  void refine(std::vector<Eigen::Vector3d>& joints) const;
  double energy(const std::vector<Eigen::Vector3d>& joints) const;

 private:
  double bone_energy(std::size_t bone, const std::vector<Eigen::Vector3d>& joints) const;
  double depth_energy(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;
  /// Gradient for some joints, 0 for others.
  std::vector<Eigen::Vector3d> gradient(const std::vector<Eigen::Vector3d>& joints,
                                        const std::vector<std::size_t>& moving) const;
  void search_along_gradient(std::vector<Eigen::Vector3d>& joints, const std::vector<std::size_t>& moving) const;
  double energy_around(const std::vector<Eigen::Vector3d>& joints, const std::vector<std::size_t>& bones) const;
  std::vector<std::size_t> bones_at(const std::vector<std::size_t>& moving) const;

  const SolidField& field_;
  const std::vector<float>& medial_distance_;
  const TemplateSkeleton& skeleton_;
  const EmbeddingOptions& options_;
  std::vector<std::size_t> bones_;                  ///< joints whose bone to the parent counts
  std::vector<std::vector<std::size_t>> bones_of_;  ///< [J], bones whose energy a joint has a part in
};

}  // namespace anigen::rig
