#include "anigen/io/gltf/import_weights.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "anigen/core/error.h"
#include "anigen/io/gltf/import_nearest.h"

namespace anigen::io::gltf_import {
namespace {

// Exporters print and round float weights; what is further from 1 was not normalised at all.
constexpr double kFloatRounding = 1e-3;

// Below this a row is what is left of rounding, and says nothing about where the vertex belongs.
constexpr double kNoWeight = 1e-6;

enum class Row { kGood, kZero, kNotFinite };

class RowReader {
 public:
  RowReader(const VertexBlock& block, const SkinBinding& binding, const std::string& file, const std::string& pointer)
      : block_(block), binding_(binding), file_(file), pointer_(pointer) {}

  Row read(std::size_t vertex, std::vector<Influence>& row);
  void note(Notes& notes) const;

 private:
  const VertexBlock& block_;
  const SkinBinding& binding_;
  const std::string& file_;
  const std::string& pointer_;
  std::size_t negative_ = 0, unnormalised_ = 0, unused_index_ = 0;
  double lowest_sum_ = 1.0;
};

Row RowReader::read(std::size_t vertex, std::vector<Influence>& row) {
  row.clear();
  double sum = 0.0;
  bool is_finite = true, is_negative = false;
  for (std::size_t set = 0; set < block_.influences.size(); ++set) {
    const InfluenceSet& influences = block_.influences[set];
    for (std::size_t k = 4 * vertex; k < 4 * vertex + 4; ++k) {
      const float weight = influences.weights[k];
      const std::uint32_t joint = influences.joints[k];
      is_finite = is_finite && std::isfinite(weight);
      is_negative = is_negative || weight < 0.0f;
      const bool in_range = joint < binding_.joints.size();
      if (!in_range && weight > 0.0f) {
        throw InputError(file_, pointer_ + "/attributes/JOINTS_" + std::to_string(set),
                         "vertex " + std::to_string(vertex) + " is bound to joint " + std::to_string(joint) +
                             " of a skin with " + std::to_string(binding_.joints.size()));
      }
      unused_index_ += in_range ? 0 : 1;
      if (!(weight > 0.0f) || !std::isfinite(weight)) continue;
      row.push_back({binding_.joints[joint], weight});
      sum += static_cast<double>(weight);
    }
  }
  if (!is_finite) return Row::kNotFinite;
  negative_ += is_negative ? 1 : 0;
  if (!(sum > kNoWeight)) return Row::kZero;
  lowest_sum_ = std::min(lowest_sum_, sum);
  if (std::abs(sum - 1.0) > kFloatRounding + static_cast<double>(block_.weight_rounding)) ++unnormalised_;
  // Done in double here, because adding up repeated joints in float could overflow.
  for (Influence& influence : row) influence.weight = static_cast<float>(static_cast<double>(influence.weight) / sum);
  return Row::kGood;
}

void RowReader::note(Notes& notes) const {
  notes.weight_sum(lowest_sum_);
  notes.tally("negative_weights", "vertices had negative weights, taken as 0", negative_);
  notes.tally("unnormalised_weights", "vertices had weights that did not sum to 1 and were divided by their sum",
              unnormalised_);
  notes.tally("unused_joint_index", "joint indices outside the skin had no weight and were ignored", unused_index_);
}

Eigen::Vector3f position(const VertexBlock& block, std::size_t vertex) {
  return Eigen::Map<const Eigen::Vector3f>(block.positions.data() + 3 * vertex);
}

// Finds rows for vertices without usable weights; built on the first such vertex.
class Substitute {
 public:
  Substitute(const VertexBlock& block, const SkinBinding& binding, const std::vector<Eigen::Vector3d>& joint_positions,
             const std::vector<Row>& rows) {
    for (std::size_t v = 0; v < rows.size(); ++v) {
      if (rows[v] == Row::kGood) vertices_.push_back(v);
    }
    std::vector<Eigen::Vector3f> points;
    if (!vertices_.empty()) {
      for (const std::size_t v : vertices_) points.push_back(position(block, v));
    } else {
      for (const int joint : binding.joints)
        points.push_back(joint_positions[static_cast<std::size_t>(joint)].cast<float>());
    }
    nearest_ = std::make_unique<NearestPoint>(std::move(points));
  }

  // @return a row in `row`
  void find(std::size_t vertex, const VertexBlock& block, const SkinBinding& binding, RowReader& reader,
            std::vector<Influence>& row) const {
    const Eigen::Vector3f p = position(block, vertex);
    if (!vertices_.empty()) {
      reader.read(vertices_[(*nearest_)(p)], row);
      return;
    }
    const Eigen::Vector4d bound = binding.to_bind * p.cast<double>().homogeneous();
    row = {{binding.joints[(*nearest_)(bound.head<3>().cast<float>())], 1.0f}};
  }

 private:
  std::vector<std::size_t> vertices_;
  std::unique_ptr<NearestPoint> nearest_;
};

}  // namespace

void append_weights(const VertexBlock& block, const SkinBinding& binding,
                    const std::vector<Eigen::Vector3d>& joint_positions, const std::string& file,
                    const std::string& pointer, SkinWeights& weights, Notes& notes) {
  RowReader reader(block, binding, file, pointer);
  std::vector<Row> rows(block.count);
  std::vector<Influence> row;
  std::size_t zero = 0, not_finite = 0;
  for (std::size_t v = 0; v < block.count; ++v) {
    rows[v] = reader.read(v, row);
    zero += rows[v] == Row::kZero ? 1 : 0;
    not_finite += rows[v] == Row::kNotFinite ? 1 : 0;
  }
  reader.note(notes);
  notes.tally("nan_weights", "vertices had weights that are not numbers and were bound like their nearest neighbour",
              not_finite);
  notes.tally("zero_weights", "vertices had no weight and were bound like their nearest neighbour", zero);
  std::unique_ptr<Substitute> substitute;
  if (zero + not_finite > 0) substitute = std::make_unique<Substitute>(block, binding, joint_positions, rows);
  for (std::size_t v = 0; v < block.count; ++v) {
    if (rows[v] == Row::kGood)
      reader.read(v, row);
    else
      substitute->find(v, block, binding, reader, row);
    weights.append_row(row);
  }
}

}  // namespace anigen::io::gltf_import
