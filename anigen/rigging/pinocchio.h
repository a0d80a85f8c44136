#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/rigging/pinocchio_discrete.h"
#include "anigen/rigging/pinocchio_solid.h"
#include "anigen/rigging/pinocchio_template.h"

namespace anigen::rigging {

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

/// Places the carried joints of a template with those they hang on: turned and scaled like the bone that leads there
/// from its parent, where there is one, else moved only. Joints above the first that is not carried move with it.
/// @param skeleton positions in the frame of the joints @param joints [J], those that are not carried in place
void place_carried_joints(const TemplateSkeleton& skeleton, std::vector<Eigen::Vector3d>& joints);

struct EmbeddedSkeleton {
  Skeleton skeleton;       ///< the mesh's frame and unit; names and order of the template, without its guides
  double penalty = 0.0;    ///< of the discrete embedding and of stretching; 1 or more: a rule was broken, it fits badly
  bool best = false;       ///< false: a good answer, not the one of least penalty (see discrete_embedding.h)
  bool stretched = false;  ///< the template was stretched to the mesh's box (EmbeddingOptions::most_stretch)
  std::size_t spheres = 0;                   ///< that joints could be placed at
  int bridges = 0;                           ///< edges between pieces of the mesh that do not touch
  std::size_t states = 0;                    ///< partial embeddings that were looked into
  double energy_before = 0.0, energy = 0.0;  ///< of the refinement
};

/// A mesh made ready for templates: its distance field, its medial spheres and the ways between them.
class EmbeddingSpace {
 public:
  /// @param mesh Z up, facing −Y, its left side towards +X; any unit. It need be neither closed nor of one piece
  /// (solid_field.h says what counts as its inside; pieces that do not touch are bridged where they are nearest).
  /// @throws InputError without faces or extent, for bad indices, vertices that are not finite, or bad options
  explicit EmbeddingSpace(const Mesh& mesh, const EmbeddingOptions& options = {});
  ~EmbeddingSpace();
  EmbeddingSpace(EmbeddingSpace&&) noexcept;

  /// @throws InputError for a bad template
  EmbeddedSkeleton embed(const TemplateSkeleton& skeleton) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// A skeleton in a mesh after Baran and Popović, "Automatic rigging and animation of 3D characters" (2007; reference
/// anymate-baselines.md, 9.2): signed distances, spheres packed on the medial surface, the template's branches and tips
/// placed at spheres by best-first search, the other joints along the ways between, all of them refined at last.
///
/// Differences from the published program: the field is a regular grid, of the solid that a mesh of any quality
/// suggests; medial points lie between its cells rather than on the faces of an octree; the search knows better bounds
/// and so takes up fewer states for the same result; it always gives an answer, in bounded time and memory; and
/// a template may be stretched to the mesh's box.
/// Deterministic, whatever the number of threads.
/// @throws InputError as EmbeddingSpace and embed()
EmbeddedSkeleton embed_skeleton(const Mesh& mesh, const TemplateSkeleton& skeleton,
                                const EmbeddingOptions& options = {});

struct TemplateChoice {
  std::size_t index = 0;          ///< of the template with the least penalty, the first of equals
  EmbeddedSkeleton embedded;      ///< that one
  std::vector<double> penalties;  ///< [templates]
};

/// Embeds every template and takes the one of least penalty; the mesh is made ready once.
/// @throws InputError without templates, and as embed_skeleton()
TemplateChoice choose_template(const Mesh& mesh, const std::vector<TemplateSkeleton>& templates,
                               const EmbeddingOptions& options = {});

}  // namespace anigen::rigging
