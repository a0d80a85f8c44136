#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

enum class Better { kLower, kHigher, kNeither };

/// Meaning of a key of metrics.json. The definitions in full: docs/metrics.md.
struct MetricInfo {
  std::string key;
  std::string label;  ///< column head for people
  Better better = Better::kLower;
  std::string unit;       ///< "box": longest side of the ground truth's bounding box is 1; "1": a plain number
  std::string group;      ///< skeleton, transport, skin, motion, surface, image, anymate, soundness, run
  bool headline = false;  ///< shown in the short table
};

/// Every metric, in the order of tables and files.
const std::vector<MetricInfo>& metric_table();

/// nullptr for an unknown key.
const MetricInfo* find_metric(const std::string& key);

/// "↓", "↑", or nothing.
std::string arrow(Better better);
/// Label and arrow.
std::string column_head(const MetricInfo& metric);
/// Decimals in tables.
int table_digits(const MetricInfo& metric);

/// A hash of everything metrics look at: geometry, skeleton, weights, colours, clips. Two files with the same content
/// agree; a prediction that was made again differs, so that no saved result outlives its input.
std::uint64_t fingerprint(const io::RiggedShape& shape);

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

  /// Inputs that decide an answer, for settings and saved results: number of references, samples, seed, and a hash of
  /// ids, categories and samples.
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
