#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/json.h"
#include "anigen/io/rigs/shape_source.h"

namespace anigen::eval {

/// Surfaces of known category (a family of creatures), to say what another surface resembles most. Every surface is
/// 512 area-uniform samples, moved and scaled so that their bounding box is centred at 0 with a longest side of 1; what
/// is compared is Chamfer's distance between samples (chamfer_l1), so size and place do not count, but orientation
/// does.
class CategoryReferences {
 public:
  struct Match {
    std::string id, category;
    double chamfer = 0.0;  ///< longest sides of the bounding boxes are 1
  };

  /// Reads the shapes of `ids` (several at once, set_thread_count); those without a category or faces do not take part,
  /// nor do those that cannot be read, with a warning. None may be left.
  /// @param seed of the samples @throws Interrupted after Ctrl-C
  CategoryReferences(const io::ShapeSource& source, const std::vector<std::string>& ids, std::uint64_t seed);

  std::size_t size() const { return references_.size(); }

  /// The reference nearest to a surface; of equally near ones the first. Callable from several threads.
  /// @param excluded id of a reference that may not answer: the surface's own truth
  /// @throws InputError when the mesh has no faces or bad ones, or no other reference is left
  Match nearest(const Mesh& mesh, const std::string& excluded = "") const;

  /// What decides an answer, for settings and saved results: number of references, samples, seed, and a hash of ids,
  /// categories and samples.
  Json describe() const;

 private:
  struct Reference {
    std::string id, category;
    Eigen::Matrix3Xf points;
  };

  std::uint64_t seed_;
  std::vector<Reference> references_;
};

}  // namespace anigen::eval
