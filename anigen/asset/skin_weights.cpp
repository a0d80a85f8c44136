#include "anigen/asset/skin_weights.h"

#include <algorithm>
#include <cmath>

namespace anigen {
namespace {

bool heavier(const Influence& a, const Influence& b) {
  return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
}

}  // namespace

std::size_t SkinWeights::largest_row() const {
  std::size_t largest = 0;
  for (std::size_t v = 0; v < rows(); ++v) largest = std::max(largest, row_size(v));
  return largest;
}

bool SkinWeights::append_row(std::vector<Influence> row) {
  row.erase(std::remove_if(row.begin(), row.end(),
                           [](const Influence& i) { return !(i.weight > 0.0f) || !std::isfinite(i.weight); }),
            row.end());
  std::sort(row.begin(), row.end(), [](const Influence& a, const Influence& b) { return a.joint < b.joint; });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (kept > 0 && row[kept - 1].joint == row[i].joint)
      row[kept - 1].weight += row[i].weight;
    else
      row[kept++] = row[i];
  }
  row.resize(kept);
  double sum = 0.0;
  for (const Influence& i : row) sum += i.weight;
  std::sort(row.begin(), row.end(), heavier);
  for (const Influence& i : row) {
    // Weights below the smallest float after the division carry no information.
    const auto weight = static_cast<float>(i.weight / sum);
    if (weight > 0.0f) influences.push_back({i.joint, weight});
  }
  offsets.push_back(influences.size());
  return !row.empty();
}

SkinWeights limit_influences(const SkinWeights& weights, std::size_t count) {
  SkinWeights limited;
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    const Influence* row = weights.row(v);
    const std::size_t kept = std::min(count, weights.row_size(v));
    // A complete row is copied as it is: dividing by a sum of 1 ± an ulp would change it.
    if (kept == weights.row_size(v)) {
      limited.influences.insert(limited.influences.end(), row, row + kept);
      limited.offsets.push_back(limited.influences.size());
    } else {
      limited.append_row({row, row + kept});
    }
  }
  return limited;
}

std::vector<float> to_dense(const SkinWeights& weights, std::size_t joints) {
  std::vector<float> dense(weights.rows() * joints, 0.0f);
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    for (std::size_t i = 0; i < weights.row_size(v); ++i) {
      const Influence& influence = weights.row(v)[i];
      dense[v * joints + static_cast<std::size_t>(influence.joint)] = influence.weight;
    }
  }
  return dense;
}

SkinWeights from_dense(const std::vector<float>& dense, std::size_t rows, std::size_t joints, float threshold,
                       std::size_t* unweighted) {
  SkinWeights weights;
  std::size_t empty = 0;
  std::vector<Influence> row;
  for (std::size_t v = 0; v < rows; ++v) {
    row.clear();
    for (std::size_t j = 0; j < joints; ++j) {
      const float weight = dense[v * joints + j];
      if (weight > threshold) row.push_back({static_cast<std::int32_t>(j), weight});
    }
    if (row.empty()) {
      row.push_back({0, 1.0f});
      ++empty;
    }
    weights.append_row(row);
  }
  if (unweighted != nullptr) *unweighted = empty;
  return weights;
}

}  // namespace anigen
